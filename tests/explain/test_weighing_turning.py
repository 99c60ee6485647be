"""Dry friction changes its sign where the motion turns, which is between samples."""

import numpy as np
import pytest

from schwung.drivetrain.machine import Coupling, Load, Machine, Motor
from schwung.drivetrain.physics_term import PhysicsTerm
from schwung.explain.causes.along import ranges_of
from schwung.explain.causes.known import known
from schwung.explain.causes.true_torque import TrueTorque
from schwung.explain.weighing.round import View, at_rest
from schwung.innovations.likelihood import Noise
from schwung.innovations.signals import signals_of
from schwung.motion import Motion
from schwung.session.model import Run, Session
from schwung_sim.plants.concealed import parse_conceal
from schwung_sim.plants.profile import Profile
from schwung_sim.plants.two_mass import TICK_S, TwoMassMachine, TwoMassPlant

RUBS_NM, INERTIA = 4.0, 0.1
NOISE = Noise(torque_nm=0.05, speed_rad_s=0.01, position_rad=1.5e-6)
EVERY = 8  # ticks, a millisecond


@pytest.fixture(scope="module")
def session() -> Session:
    """0.4 s under a torque of 40 N·m at 40 Hz beside a slow one: the speed turns by 0.5 rad/s in a millisecond."""
    flat = Profile.of_turn(lambda angle: np.full_like(angle, INERTIA))
    plant = TwoMassPlant(TwoMassMachine(), flat, parse_conceal(f"coulomb_friction={RUBS_NM}"))
    chance, ticks = np.random.default_rng(2), int(0.4 / TICK_S)
    time = TICK_S * np.arange(ticks + 1)
    torque, held = (
        40 * np.cos(80 * np.pi * at) + 10 * np.cos(5 * np.pi * at) for at in (time, time + TICK_S / 2)
    )
    moved = np.empty((ticks + 1, 2))
    for tick in range(ticks + 1):
        moved[tick] = plant.state["motor_rad"][0], plant.state["motor_rad_s"][0]
        plant.step(held[tick])
    noise = chance.standard_normal((3, time[::EVERY].size))
    run = Run(
        role="reference", repeat=0, sample_rate_hz=1000.0, time_s=time[::EVERY],
        position_rad=moved[::EVERY, 0] + NOISE.position_rad * noise[0],
        speed_rad_s=moved[::EVERY, 1] + NOISE.speed_rad_s * noise[1],
        torque_nm=torque[::EVERY] + NOISE.torque_nm * noise[2],
        motion=Motion(kind="poly5", distance_rad=1.0, duration_s=0.4),
    )  # fmt: skip
    return Session((run,), created="2026-01-01T00:00:00", source="test")


def test_a_machine_with_dry_friction_misses_noise_where_it_turns(session: Session):
    """Friction that goes straight from sample to sample is late, or early, by up to half a step."""
    rubs = PhysicsTerm.model_validate({"name": "coulomb_friction", "torque_nm": RUBS_NM})
    machine = Machine(
        name="rubs",
        motor=Motor(inertia_kgm2=0.012, viscous_friction_nms=0.2, peak_torque_nm=233.0),
        coupling=Coupling(stiffness_nm_rad=24963.0, damping_nms=8.62),
        load=Load(viscous_friction_nms=0.1, inertia_kgm2=INERTIA),
        physics=(rubs,),
    )
    runs = [signals_of(run, machine, 160.0, 0.0) for run in session.runs]
    of = ranges_of(runs, 0.002, 160.0)
    torques = tuple(TrueTorque(run, run.drive.whole_nm) for run in runs)
    view = View(
        session.runs, tuple(runs), known(machine, of.low_rad, of.high_rad), of, torques, dry_nm=RUBS_NM
    )
    about = at_rest(view, (), NOISE)
    (where,) = about.alongs
    turns = where.speed[:-1] * where.speed[1:] < 0
    assert np.count_nonzero(turns) >= 15
    missed = about.passed[0].innovations.reshape(-1, 2)
    near = np.flatnonzero(turns)[:, None] + np.arange(1, 4)  # the samples that follow
    assert np.max(np.abs(missed[near[near[:, -1] < len(missed)]])) < 5
    assert about.square([0]) < 1.1 * about.samples([0])
