"""Intervals that cover: bias of noisy regressors taken off, scatter counted, ringing of unknown beginnings left out."""

from __future__ import annotations

import numpy as np
import pytest

from schwung.drivetrain.effects import Effects
from schwung.drivetrain.machine import Coupling, Load, Machine, Motor
from schwung.explain import forward
from schwung.explain.fit import Fitted, Model, Problem
from schwung.explain.intervals import interval
from schwung.explain.noise import whitener
from schwung.explain.residual import Residuals, Unknowns
from schwung.explain.search import Found
from schwung.explain.sharpened import sharpened
from schwung.explain.signals import prepare
from schwung.motion import Array, Motion
from schwung.session.model import Run, Session

RATE_HZ, TORQUE_NOISE_NM = 2000.0, 0.05
COULOMB_NM, VISCOUS_NMS, DELTA_KGM2 = 0.5, 0.02, 0.004
MOTOR = Motor(inertia_kgm2=0.01, viscous_friction_nms=0.0, peak_torque_nm=500.0)
RIGID = Machine(name="rigid", motor=MOTOR, load=Load(viscous_friction_nms=0.1, inertia_kgm2=0.05))
SOFT = Machine(
    name="soft",
    motor=MOTOR,
    coupling=Coupling(stiffness_nm_rad=8000.0, damping_nms=0.4),
    load=Load(viscous_friction_nms=0.0, inertia_kgm2=0.05),
)


def recorded(seed: int, speed_noise_rad_s: float, angle_noise_rad: float) -> Session:
    """Two motion times with two repeats each of the rigid machine with more friction and inertia than is believed."""
    chance, runs = np.random.default_rng(seed), []
    for repeat in range(2):
        for duration in (0.25, 0.4):
            motion = Motion(
                distance_rad=2.0, duration_s=duration, start_time_s=0.1, dwell_s=0.1, returns=True
            )
            time = motion.time(RATE_HZ)
            demand = motion.demand(time)
            # a shake that never ends, fast enough for the noise of its acceleration to be felt
            phase = 2 * np.pi * 35.0 * time
            angle = demand.position_rad + 2e-3 * np.sin(phase)
            speed = demand.speed_rad_s + 2e-3 * 2 * np.pi * 35.0 * np.cos(phase)
            acceleration = demand.acceleration_rad_s2 - 2e-3 * (2 * np.pi * 35.0) ** 2 * np.sin(phase)
            torque = (0.06 + DELTA_KGM2) * acceleration + (0.1 + VISCOUS_NMS) * speed
            torque += COULOMB_NM * np.sign(speed)
            runs.append(
                Run(
                    role="reference",
                    repeat=repeat,
                    sample_rate_hz=RATE_HZ,
                    time_s=time,
                    position_rad=angle + angle_noise_rad * chance.standard_normal(time.size),
                    speed_rad_s=speed + speed_noise_rad_s * chance.standard_normal(time.size),
                    torque_nm=torque + TORQUE_NOISE_NM * chance.standard_normal(time.size),
                    motion=motion,
                )
            )
    return Session(tuple(runs), created="2026-01-01T00:00:00", source="test")


def fitted(session: Session) -> tuple[Found, Fitted]:
    """The three terms as an explanation fits them in the end."""
    prepared = prepare(session, RIGID)
    residuals, runs = Residuals(prepared, RIGID), tuple(range(len(session.runs)))
    noise = whitener(prepared, RIGID, residuals.all(runs, Unknowns()))
    problem = Problem(residuals, noise, runs)
    bare = problem.fit(Model())
    best = problem.fit(
        Model(
            terms=("coulomb_friction", "viscous_friction", "load_inertia"),
            unknowns=bare.model.unknowns,
            fixed=("inertia_scale",),
        )
    )
    key = frozenset(best.model.terms)
    return sharpened(Found(problem, (), {frozenset(): bare, key: best}), best, RIGID, runs)


TRUE = {"coulomb_positive_nm": COULOMB_NM, "viscous_nms": VISCOUS_NMS, "inertia_delta_kgm2": DELTA_KGM2}


def test_nineteen_of_twenty_intervals_hold_the_truth_and_are_no_wider_than_need_be() -> None:
    held, errors, widths = [], [], []
    for seed in range(8):
        found, best = fitted(recorded(seed, 2e-3, 2e-6))
        for name, true in TRUE.items():
            low, high = interval(found, best, name)
            held.append(low <= true <= high)
            errors.append((best.told.value(name) / true - 1) ** 2)
            widths.append((high - low) / 2 / true)
    assert np.mean(held) > 0.8  # 24 intervals: fewer than 20 of them once in 200 times
    assert np.mean(widths) < 5 * np.sqrt(np.mean(errors))


def test_noise_of_the_motion_makes_a_fit_see_too_little_inertia_and_that_is_taken_off() -> None:
    raw, told = [], []
    for seed in range(4):
        _, best = fitted(recorded(seed, 0.02, 2e-4))
        raw.append(best.model.value("inertia_delta_kgm2") / DELTA_KGM2 - 1)
        told.append(best.told.value("inertia_delta_kgm2") / DELTA_KGM2 - 1)
    assert np.mean(raw) < -0.005
    assert abs(np.mean(told)) < 0.6 * abs(np.mean(raw))


def _rung(begun: tuple[float, float]) -> Session:
    """The soft machine, whose load swings already as each run begins; torque as it needs, with noise."""
    chance, runs = np.random.default_rng(1), []
    belief = forward.believed(SOFT)
    for repeat in range(4):
        motion = Motion(distance_rad=2.0, duration_s=0.4, start_time_s=0.1, dwell_s=0.1)
        time = motion.time(RATE_HZ)
        demand = motion.demand(time)
        moved = forward.Motion(
            *map(np.ascontiguousarray, (demand.position_rad, demand.speed_rad_s, demand.acceleration_rad_s2)),
            np.ascontiguousarray(time - 0.1),
            1 / RATE_HZ,
        )
        torque: Array = 0.01 * demand.acceleration_rad_s2
        torque = torque + forward.coupling_needed(belief, Effects(), moved, begun)
        runs.append(
            Run(
                role="reference",
                repeat=repeat,
                sample_rate_hz=RATE_HZ,
                time_s=time,
                position_rad=demand.position_rad,
                speed_rad_s=demand.speed_rad_s,
                torque_nm=torque + TORQUE_NOISE_NM * chance.standard_normal(time.size),
                motion=motion,
            )
        )
    return Session(tuple(runs), created="2026-01-01T00:00:00", source="test")


@pytest.mark.parametrize("begun", [(0.0, 0.0), (2e-4, 0.0), (0.0, 0.08)])
def test_a_load_that_swings_as_a_run_begins_is_no_physics_that_was_left_out(
    begun: tuple[float, float],
) -> None:
    session = _rung(begun)
    residuals = Residuals(prepare(session, SOFT), SOFT)
    left = residuals.residual(0, Unknowns())[residuals.valid(0)]
    in_band = TORQUE_NOISE_NM * np.sqrt(2 * residuals.prepared.band_hz / RATE_HZ)
    assert np.sqrt(np.mean(left**2)) < 1.3 * in_band
