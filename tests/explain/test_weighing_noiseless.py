"""Runs without any noise, as a simulation makes them: the filter's own rounding is no noise."""

import numpy as np
import pytest

from schwung.drivetrain.machine import Load, Machine, Motor
from schwung.explain.weighing.weigh import weigh
from schwung.motion import Motion
from schwung.session.model import Run, Session

ROTOR_KGM2, LOAD_KGM2 = 0.002, 0.01


def _run(repeat: int, duration_s: float, dry_nm: float) -> Run:
    motion = Motion(kind="poly5", distance_rad=np.pi, duration_s=duration_s, start_time_s=0.1, dwell_s=0.2)
    time = motion.time(4000.0)
    demand = motion.demand(time)
    speed = demand.speed_rad_s
    torque = (ROTOR_KGM2 + LOAD_KGM2) * demand.acceleration_rad_s2 + dry_nm * np.tanh(speed / 0.05)
    return Run(
        role="reference", repeat=repeat, sample_rate_hz=4000.0, time_s=time, position_rad=demand.position_rad,
        speed_rad_s=speed, torque_nm=torque, position_demand_rad=demand.position_rad, torque_added_nm=None,
        motion=motion, excitation=None, name=f"run {repeat}",
    )  # fmt: skip


@pytest.mark.parametrize(("dry_nm", "second_s"), [(0.3, 0.4), (0.0, 0.6)])
def test_a_rigid_machine_without_noise_is_weighed(dry_nm: float, second_s: float) -> None:
    runs = (_run(0, 0.4, dry_nm), _run(1, second_s, dry_nm))
    session = Session(runs, created="2026-01-01T00:00:00", source="a formula")
    machine = Machine(
        name="rigid",
        motor=Motor(inertia_kgm2=ROTOR_KGM2, viscous_friction_nms=0.0, peak_torque_nm=5.0),
        load=Load(inertia_kgm2=LOAD_KGM2),
    )
    found = weigh(session, machine)
    if dry_nm == 0:
        assert not found.names
        assert not found.unnamed
    else:
        assert [one.name for one in found.names if one.probability > 0.9] == ["coulomb_friction"]
    assert np.isfinite(found.noise.speed_rad_s)
    assert found.noise.speed_rad_s >= 1e-9
