"""One drive after another: a bench and a connection for each, shared by the tests that leave them as they were."""

from __future__ import annotations

from collections.abc import Iterator

import pytest
from conformance_drives import Case, canopen_cases, modbus_cases
from conformance_rooms import CanopenRoom, Room, room_of


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
