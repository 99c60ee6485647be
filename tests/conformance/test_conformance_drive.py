"""What every drive has to do, by its own objects on its own bus: tell who it is, be set up, moved and stopped."""

from __future__ import annotations

import numpy as np
import pytest
from conformance_rooms import RATE_HZ, SEED, SHORT_HEARTBEAT_S, ModbusRoom, Room

from schwung.errors import DriveFaultError, InputError, StateError
from schwung.fieldbus.drive import ENERGISED, Acquisition, Move, OperatingMode, Setpoints

MODES: tuple[OperatingMode, ...] = ("csp", "pp")


def moving(room: Room) -> OperatingMode:
    """The mode to move in. Skips where there is none; that the drive says so is another test."""
    mode = room.mode
    if mode is None:
        pytest.skip("cannot be moved, and says why")
    return mode


def test_it_tells_who_it_is(room: Room) -> None:
    identity = room.drive.identity
    assert (identity.vendor_id, identity.product_code) == room.identity
    if isinstance(room, ModbusRoom) and room.profile.serial is not None:
        assert identity.serial == SEED


def test_every_capability_is_there_or_says_why_not(room: Room) -> None:
    for capability in room.drive.capabilities():
        assert capability.reason, capability
        given = room.profile.cannot.get(capability.name)  # type: ignore[call-overload]  # any name will do
        if given is not None:
            assert not capability.available, capability
            assert given in capability.reason


def test_its_position_is_the_axis_own(room: Room) -> None:
    resolution = room.drive.resolution().position_rad
    assert room.drive.state().position_rad == pytest.approx(room.axis.position_rad, abs=2 * resolution)


def test_its_limits_are_finite_or_unknown(room: Room) -> None:
    told = {name: value for name, value in vars(room.drive.limits()).items() if isinstance(value, float)}
    for name, value in told.items():
        assert np.isfinite(value), name
        if name not in (
            "position_min_rad",
            "position_max_rad",
            "following_error_time_s",
            "home_offset_rad",
        ):
            assert value > 0, name


@pytest.mark.parametrize("mode", MODES)
def test_set_up_is_complete_and_can_be_put_back(room: Room, mode: OperatingMode) -> None:
    offered = room.offers("cyclic position" if mode == "csp" else "profile position")
    if not offered:
        with pytest.raises(InputError, match=r"this profile can't do that|has no"):
            room.drive.start(Acquisition(mode, RATE_HZ))
        return
    before = room.held()
    acquisition = room.acquisition(mode)
    wanted = room.drive.setup(acquisition)
    old = [room.drive.read(value.parameter) for value in wanted]
    room.drive.write(wanted)
    assert room.drive.setup(acquisition) == []
    room.drive.write(old)
    assert room.held() == before


def test_it_climbs_to_operation_enabled_and_back(room: Room) -> None:
    with room.enabled(moving(room)):
        assert room.state() == "operation enabled"
        assert room.drive.state().cia402.lower() in ENERGISED
        assert room.axis.energised
    assert room.state() == "switch on disabled"
    assert not room.axis.energised


@pytest.mark.parametrize("mode", MODES)
def test_it_goes_where_it_is_sent_and_reports_what_it_did(room: Room, mode: OperatingMode) -> None:
    if not room.offers("cyclic position" if mode == "csp" else "profile position"):
        pytest.skip("has no such mode, and says why")
    with room.enabled(mode):
        began = room.axis.position_rad
        recording = room.drive.play(room.stroke(mode))
        resolution, q = room.drive.resolution(), room.profile.quantities
        assert recording.lost.size == 0
        assert room.axis.position_rad - began == pytest.approx(0.3, abs=0.005)
        within = 2 * resolution.position_rad + 5e-3
        assert recording.position_rad[-1] == pytest.approx(room.axis.position_rad, abs=within)
        if q.speed is not None:
            slope = np.gradient(recording.position_rad, 1 / recording.sample_rate_hz)
            coarse = 2 * resolution.position_rad * recording.sample_rate_hz + 2 * resolution.speed_rad_s
            assert np.percentile(np.abs(recording.speed_rad_s - slope), 80) < 0.3 + coarse
            assert np.max(recording.speed_rad_s) > 2.0
        if q.torque is not None:
            assert np.max(np.abs(recording.torque_nm)) > 2.0


def test_injected_torque_arrives(room: Room) -> None:
    if not room.offers("torque injection"):
        pytest.skip("takes no torque at every SYNC, and says why")
    mode = moving(room)
    with room.enabled(mode):
        begin = room.drive.state().position_rad
        torque = np.zeros(200)
        torque[50:150] = 20.0
        moves = (Move(20, begin + 1e-4, 6.0, 100.0),) if mode == "pp" else ()
        recording = room.drive.play(Setpoints(RATE_HZ, np.full(200, begin), torque, moves))
        assert np.max(np.abs(recording.position_rad - begin)) > 1e-3
        step = room.drive.resolution().torque_added_nm
        assert np.nanmax(recording.torque_added_nm) == pytest.approx(20.0, abs=step)


def test_halt_ends_a_motion(room: Room) -> None:
    mode = moving(room)
    with room.enabled(mode):
        setpoints = room.stroke(mode, 3.0, cycles=6000)
        with room.once_it_moves(room.drive.halt), pytest.raises(StateError, match=r"request|halted"):
            room.drive.play(setpoints)
        assert room.comes_to_rest()


def test_a_fault_is_named_and_only_reset_on_request(room: Room) -> None:
    mode = moving(room)
    with room.enabled(mode):
        setpoints = room.stroke(mode, 3.0, cycles=6000)
        with room.once_it_moves(lambda: room.fail(0x4310)), pytest.raises(DriveFaultError, match="4310"):
            room.drive.play(setpoints)
        assert room.comes_to_rest()
        assert room.drive.state().cia402.lower() == "fault"
        room.drive.reset_fault()
        assert room.state() == "switch on disabled"
        assert not room.axis.energised


def test_it_stops_by_itself_when_we_fall_silent(room: Room) -> None:
    mode = moving(room)
    if not room.offers("stop by heartbeat"):
        pytest.skip("does not watch us, and says why")
    with room.enabled(mode, SHORT_HEARTBEAT_S):
        speak = room.fall_silent()
        assert room.comes_to_rest()
        speak()
