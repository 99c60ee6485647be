"""One drive after another: a bench and a connection for each, shared by the tests that leave them as they were."""

from __future__ import annotations

from collections.abc import Iterator

import pytest
from conformance_drives import Case, Room, canopen_cases, in_lockstep, room_of

from schwung.fieldbus.canopen.operation import Operation


@pytest.fixture(scope="package", autouse=True)
def lockstep() -> Iterator[None]:
    patch = pytest.MonkeyPatch()
    patch.setattr(Operation, "_choose", in_lockstep)
    yield
    patch.undo()


@pytest.fixture(scope="module", params=canopen_cases(), ids=lambda case: case.id)
def case(request: pytest.FixtureRequest) -> Case:
    return request.param


@pytest.fixture(scope="module")
def room(case: Case, tmp_path_factory: pytest.TempPathFactory) -> Iterator[Room]:
    with room_of(case, tmp_path_factory.mktemp("profile"), seed=11) as room:
        yield room
