"""One drive after another: a bench and a connection for each, shared by the tests that leave them as they were."""

from __future__ import annotations

from collections.abc import Iterator

import pytest
from conformance_drives import Case, canopen_cases, modbus_cases
from conformance_rooms import MISSES_ALLOWED, CanopenRoom, Room, in_lockstep, room_of

from schwung.fieldbus.canopen import nmt, setup
from schwung.fieldbus.canopen.operation import Operation


@pytest.fixture(scope="module", autouse=True)
def lockstep() -> Iterator[None]:
    """In lockstep, and patient with a busy computer.

    By module: with the scope of a folder it would hold for whatever the same process runs after these tests.
    """
    patch = pytest.MonkeyPatch()
    patch.setattr(Operation, "_choose", in_lockstep)
    for module in (nmt, setup):
        patch.setattr(module, "MISSES_ALLOWED", MISSES_ALLOWED)
    yield
    patch.undo()


@pytest.fixture(scope="module", params=[*canopen_cases(), *modbus_cases()], ids=lambda case: case.id)
def room(request: pytest.FixtureRequest, tmp_path_factory: pytest.TempPathFactory) -> Iterator[Room]:
    case: Case = request.param
    with room_of(case, tmp_path_factory.mktemp("profile")) as room:
        yield room


@pytest.fixture(scope="module", params=canopen_cases(), ids=lambda case: case.id)
def canopen_room(
    request: pytest.FixtureRequest, tmp_path_factory: pytest.TempPathFactory
) -> Iterator[CanopenRoom]:
    case: Case = request.param
    with room_of(case, tmp_path_factory.mktemp("profile")) as room:
        assert isinstance(room, CanopenRoom)
        yield room
