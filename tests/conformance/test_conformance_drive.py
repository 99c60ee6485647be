"""What every drive has to do with its own objects: tell who it is, be set up and put back, move, and stop."""

from __future__ import annotations

import threading
import time

import numpy as np
import pytest
from conformance_drives import HEARTBEAT_S, RATE_HZ, Room

from schwung.errors import DriveFaultError, InputError, StateError
from schwung.fieldbus.drive import ENERGISED, Acquisition, Setpoints
from schwung_sim.drives.power import Power


def _moving(room: Room) -> str:
    """The mode to move in. Skips where there is none; that the driver says so is another test."""
    mode = room.mode
    if mode is None:
        pytest.skip("cannot be moved, and says why")
    return mode


def test_it_tells_who_it_is(room: Room) -> None:
    identity, values = room.drive.identity, room.bench.servo.dictionary.values
    assert identity.vendor_id == values[0x101801]
    assert identity.product_code == values[0x101802]
    expected = room.profile.identity
    if expected is not None:
        assert identity.vendor_id == expected.vendor_id


def test_every_capability_is_there_or_says_why_not(room: Room) -> None:
    for capability in room.drive.capabilities():
        assert capability.reason, capability
        given = room.profile.cannot.get(capability.name)  # type: ignore[call-overload]  # any name will do
        if given is not None:
            assert not capability.available, capability
            assert given in capability.reason


def test_a_unit_is_what_the_bench_makes_of_it(room: Room) -> None:
    ours, theirs = room.drive.resolution(), room.bench.servo.operation.units
    assert ours.position_rad == pytest.approx(abs(theirs.position_rad), rel=1e-12)
    q = room.profile.quantities
    if q.speed is not None:
        assert ours.speed_rad_s == pytest.approx(abs(theirs.speed_rad_s), rel=1e-12)
    if q.torque is not None:
        assert ours.torque_nm == pytest.approx(theirs.torque_nm, rel=1e-12)
    if q.torque_added is not None:
        assert ours.torque_added_nm == pytest.approx(theirs.torque_added_nm, rel=1e-12)


def test_its_limits_are_finite_or_unknown(room: Room) -> None:
    for name, value in vars(room.drive.limits()).items():
        assert value is None or np.isfinite(value), name
        if value is not None and name not in (
            "position_min_rad",
            "position_max_rad",
            "following_error_time_s",
        ):
            assert value > 0, name


@pytest.mark.parametrize("mode", ["csp", "pp"])
def test_set_up_is_complete_and_can_be_put_back(room: Room, mode: str) -> None:
    if mode not in room.profile.modes:
        with pytest.raises(InputError):
            room.drive.setup(Acquisition(mode, RATE_HZ))  # type: ignore[arg-type]  # one of the modes
        return
    before = dict(room.bench.servo.dictionary.values)
    acquisition = room.acquisition(mode)  # type: ignore[arg-type]  # one of the modes
    wanted = room.drive.setup(acquisition)
    old = [room.drive.read(value.parameter) for value in wanted]
    room.drive.write(wanted)
    assert room.drive.setup(acquisition) == []
    room.drive.write(old)
    assert dict(room.bench.servo.dictionary.values) == before


def test_it_climbs_to_operation_enabled_and_back(room: Room) -> None:
    with room.enabled(_moving(room)):
        assert room.bench.servo.power.state is Power.OPERATION_ENABLED
        assert room.drive.state().cia402.lower() in ENERGISED
    assert room.bench.servo.power.state is Power.SWITCH_ON_DISABLED
    assert not room.bench.axis.energised


@pytest.mark.parametrize("mode", ["csp", "pp"])
def test_it_goes_where_it_is_sent_and_reports_what_it_did(room: Room, mode: str) -> None:
    if mode not in room.profile.modes:
        pytest.skip("has no such mode")
    with room.enabled(mode):
        setpoints = room.stroke(mode)
        began = room.bench.axis.position_rad
        recording = room.drive.play(setpoints)
        resolution = room.drive.resolution()
        assert recording.lost.size == 0
        assert room.bench.axis.position_rad - began == pytest.approx(0.3, abs=0.003)
        assert recording.position_rad[-1] == pytest.approx(
            room.bench.axis.position_rad, abs=2 * resolution.position_rad + 1e-3
        )
        if room.profile.quantities.speed is not None:
            slope = np.gradient(recording.position_rad, 1 / RATE_HZ)
            off = np.abs(recording.speed_rad_s - slope)
            coarse = 2 * resolution.position_rad * RATE_HZ + 2 * resolution.speed_rad_s
            assert np.percentile(off, 90) < 0.1 + coarse
            assert np.max(recording.speed_rad_s) > 2.0
        if room.profile.quantities.torque is not None:
            assert np.max(np.abs(recording.torque_nm)) > 2.0


def test_injected_torque_arrives(room: Room) -> None:
    added = room.profile.quantities.torque_added
    if added is None or not room.offers("torque injection"):
        pytest.skip("takes no torque at every SYNC, and says why")
    mode = _moving(room)
    with room.enabled(mode):
        still = room.stroke(mode)
        begin = still.position_rad[0]
        torque = np.zeros(200)
        torque[50:150] = 20.0
        moves = tuple(
            type(m)(m.at_index, begin + 1e-4, m.peak_speed_rad_s, m.acceleration_rad_s2) for m in still.moves
        )
        recording = room.drive.play(Setpoints(RATE_HZ, np.full(200, begin), torque, moves))
        assert np.max(np.abs(recording.position_rad - begin)) > 1e-3
        assert np.nanmax(recording.torque_added_nm) == pytest.approx(
            20.0, abs=room.drive.resolution().torque_added_nm
        )


def test_halt_ends_a_motion(room: Room) -> None:
    mode = _moving(room)
    with room.enabled(mode):
        setpoints = room.stroke(mode, 3.0, cycles=20_000)
        threading.Timer(0.05, room.drive.halt).start()
        with pytest.raises(StateError, match="request"):
            room.drive.play(setpoints)
        assert room.bench.servo.settle(2.0)
        assert abs(room.bench.axis.speed_rad_s) < 0.5


def test_a_fault_is_named_and_only_reset_on_request(room: Room) -> None:
    mode = _moving(room)
    with room.enabled(mode):
        setpoints = room.stroke(mode, 0.3, cycles=20_000)
        threading.Timer(0.05, lambda: room.bench.servo.fault(0x4310)).start()
        with pytest.raises(DriveFaultError, match="4310"):
            room.drive.play(setpoints)
        assert room.bench.servo.settle(2.0)
        assert room.drive.state().cia402.lower() == "fault"
        room.drive.reset_fault()
        assert room.bench.servo.power.state is Power.SWITCH_ON_DISABLED
        assert not room.bench.axis.energised


def test_it_stops_by_itself_when_we_fall_silent(room: Room) -> None:
    mode = _moving(room)
    if not room.offers("stop by heartbeat"):
        pytest.skip("does not watch us, and says why")
    with room.enabled(mode):
        assert room.drive._heartbeat is not None
        room.drive._heartbeat.close()  # what kill -9 does: our heartbeat ends, nothing else is said
        deadline = time.monotonic() + 2.0
        while room.bench.servo.power.state is Power.OPERATION_ENABLED and time.monotonic() < deadline:
            time.sleep(0.005)
        assert room.bench.servo.settle(2.0)
        assert room.bench.servo.power.state is not Power.OPERATION_ENABLED
        room.drive._heartbeat = None
        room.drive._beat(HEARTBEAT_S)  # and here we are again: a fault by silence cannot be reset before
        time.sleep(2 * HEARTBEAT_S)
