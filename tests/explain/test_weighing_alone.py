"""Runs that nothing repeats: noise is what a set leaves, and no set may take it for what moves the machine."""

import numpy as np
import pytest

from schwung.drivetrain.machine import Load, Machine, Motor
from schwung.explain.causes.candidate import Missed
from schwung.explain.causes.vocabulary.line import finest_order
from schwung.explain.weighing.weigh import weigh
from schwung.session.model import Run, Session

RATE_HZ, INERTIA, WEIGHT, DRY = 500.0, 0.15, 3.0, 0.25
SWINGING = Machine(
    name="pendulum",
    motor=Motor(inertia_kgm2=0.002, viscous_friction_nms=0.0, peak_torque_nm=20.0),
    load=Load(inertia_kgm2=INERTIA - 0.002),
)


@pytest.fixture(scope="module")
def swung() -> Session:
    """One swing of a pendulum that is driven through its noisy torque: much noise in all that is told of it."""
    chance, step, fine = np.random.default_rng(4), 1 / RATE_HZ, 20
    time = np.arange(int(6 * RATE_HZ)) * step
    asked = 2.2 * np.sin(2 * np.pi * 0.35 * time) + 1.2 * np.sin(2 * np.pi * 0.9 * time + 1.0)
    angle, speed, told = 0.1, 0.0, []
    for torque in asked:
        told.append((angle, speed))
        for _ in range(fine):
            rate = (torque - WEIGHT * np.sin(angle) - DRY * np.tanh(speed / 0.02) - 0.02 * speed) / INERTIA
            speed += rate * step / fine
            angle += speed * step / fine
    angles, speeds = np.array(told).T
    run = Run(
        role="reference", repeat=0, sample_rate_hz=RATE_HZ, time_s=time,
        position_rad=angles + chance.normal(0.0, 8e-4, time.size),
        speed_rad_s=speeds + chance.normal(0.0, 0.12, time.size),
        torque_nm=asked + chance.normal(0.0, 0.6, time.size),
    )  # fmt: skip
    return Session((run,), created="2026-01-01T00:00:00", source="test")


@pytest.mark.long
def test_gravity_and_dry_friction_of_one_swing_have_their_names(swung: Session) -> None:
    found = weigh(swung, SWINGING)
    likely = {one.name: one for one in found.names if one.probability > 0.5}
    assert "load_torque" in likely
    assert likely.keys() & {"coulomb_friction", "asymmetric_friction", "viscous_friction"}
    assert not likely.keys() & {"load_inertia", "inertia_profile", "torque_constant"}
    # there is a little viscous friction, too, which so much noise may leave without a name
    assert not [one for one in found.unnamed if one.probability > 0.5 and one.like != "viscous_friction"]
    assert found.noise.torque_nm == pytest.approx(0.6, rel=0.3)


def test_a_ripple_finer_than_any_order_of_the_grid_is_found_where_it_is() -> None:
    chance = np.random.default_rng(2)
    time = np.arange(4000) / 1000.0
    angle = 0.11 * (1 - np.cos(2 * np.pi * time / 4.0))
    order = 2 * np.pi / 2.5e-3
    noise = [chance.standard_normal(time.size) for _ in range(3)]
    ends = (60.0, 6000.0)
    assert finest_order([Missed(one, angle, 1e-3, ()) for one in noise], 0.0, 0.22, ends) == ()
    rippled = [Missed(one + np.sin(order * angle + 1.0), angle, 1e-3, ()) for one in noise]
    ((found,),) = finest_order(rippled, 0.0, 0.22, ends)
    assert found == pytest.approx(order, rel=2e-3)
