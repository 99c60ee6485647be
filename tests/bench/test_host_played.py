"""A drive that holds no inertia: the host plays the torque beside the setpoints, and the axis follows better."""

from pathlib import Path

import numpy as np
import pytest
from bench_machine import Silence, desk

from schwung.commissioning import HostPlayed, following_error_rms, host_played, repeat_reference
from schwung.drivetrain import InertiaTable
from schwung.errors import InputError
from schwung.fieldbus.profile import load_profile
from schwung.motion import Motion


def test_the_played_torque_makes_the_following_error_several_times_smaller(tmp_path: Path) -> None:
    with desk(seed=5) as room:
        done = room.commission(tmp_path / "out")
        motor = done.prepared.machine.motor.inertia_kgm2
        played = host_played(room.profile, done.estimate.table, motor, done.prepared.plan.acquisition.mode)
        after = repeat_reference(room.drive, done.prepared, tmp_path, "verification", Silence(), played)
        assert not room.bench.servo.power.energised
    before_rms, after_rms = following_error_rms(done.recorded.runs[0]), following_error_rms(after)
    assert before_rms is not None
    assert after_rms is not None
    assert before_rms > 3 * after_rms
    assert after.torque_added_nm is not None
    assert np.max(np.abs(after.torque_added_nm)) > 10.0


def test_the_torque_is_that_of_a_varying_inertia() -> None:
    """Energy: what is put in up to the highest speed is ½ (J_r + J_l) ω² there, wherever the inertia went."""
    angle = np.linspace(-0.1, 3.3, 200)
    table = InertiaTable(angle, 0.1 + 0.03 * np.cos(2 * angle))
    motion = Motion(kind="poly5", distance_rad=3.0, duration_s=0.3, start_time_s=0.0)
    time = np.arange(0.0, 0.15, 1e-5)
    demand = motion.demand(time)
    torque = HostPlayed(table, 0.012).torque(demand, 0.0)
    put_in = float(np.trapezoid(torque * demand.speed_rad_s, time))
    inertia = 0.012 + float(table.at(demand.position_rad[-1:])[0])
    assert put_in == pytest.approx(inertia * demand.speed_rad_s[-1] ** 2 / 2, rel=1e-3)


@pytest.mark.parametrize(("family", "mode"), [("maxon-epos2", "csp"), ("generic-cia402", "pp")])
def test_it_is_refused_where_the_drive_cannot(family: str, mode: str) -> None:
    table = InertiaTable(np.array([0.0, 1.0]), np.array([0.1, 0.1]))
    with pytest.raises(InputError, match=r"this profile can't do that, because|--mode csp"):
        host_played(load_profile(family), table, 0.012, mode)
