"""A coupling with play that bounces, integrated here, and how surely the filter foresees it."""

from types import SimpleNamespace
from typing import Any

import numpy as np

from schwung.innovations import kalman
from schwung.innovations.likelihood import Equations, Noise, problem_of
from schwung.innovations.play import through_play
from schwung.innovations.steps import Steps
from schwung.innovations.values import Shaft
from schwung.motion import Array

STEP_S, COUNT, GAP_RAD = 1e-3, 1500, 1.2e-3
SHAFT = Shaft(0.002, 0.01, 0.01, 10_000.0, 1.0, rigid=False)
LOAD_KGM2, NOISE = 0.004, Noise(0.15, 0.05, 6e-6)


def _slope(x: Array, torque: float) -> Array:
    wound, winding = x[2], x[1] - x[3]
    side, deep = np.sign(wound), abs(wound) - GAP_RAD / 2
    carried = side * max(SHAFT.stiffness * deep + SHAFT.damping * side * winding, 0.0) if deep > 0 else 0.0
    motor = (torque - carried - SHAFT.motor_friction * x[1]) / SHAFT.rotor_inertia
    return np.array([x[1], motor, winding, (carried - SHAFT.load_friction * x[3]) / LOAD_KGM2])


def _played(torque: Array) -> Array:
    """States at the samples (n, 4), by Runge and Kutta's fourth order at 40 µs."""
    states, parts = np.zeros((COUNT, 4)), 25
    h = STEP_S / parts
    for k in range(COUNT - 1):
        x = states[k]
        for part in range(parts):
            here, middle, there = (
                torque[k] + (part + share) / parts * (torque[k + 1] - torque[k]) for share in (0, 0.5, 1)
            )
            first = _slope(x, here)
            second = _slope(x + h / 2 * first, middle)
            third = _slope(x + h / 2 * second, middle)
            x = x + h / 6 * (first + 2 * second + 2 * third + _slope(x + h * third, there))
        states[k + 1] = x
    return states


def test_bounces_are_foreseen_as_surely_as_they_come() -> None:
    """A filter that takes a contact for a line is sure of a load that it has lost: at 30 deviations for 25 ms."""
    chance = np.random.default_rng(2)
    time = STEP_S * np.arange(COUNT)
    reported = 1.5 * np.sin(60 * time) + 2.0 * np.sin(270 * time)
    true = reported + NOISE.torque_nm * chance.normal(size=COUNT)
    states = _played(true)
    assert np.mean(np.abs(np.diff(np.abs(states[:, 2]) > GAP_RAD / 2))) > 0.1  # it bounces
    measured = states[:, :2] + chance.normal(size=(COUNT, 2)) * [NOISE.position_rad, NOISE.speed_rad_s]
    inertia = np.full(COUNT - 1, LOAD_KGM2)
    steps = Steps.of(SHAFT, inertia, STEP_S, slopes=False)
    none = np.zeros(COUNT - 1)
    torques = np.column_stack([reported[:-1], none, reported[1:], none, none, none])
    equations = Equations(
        np.zeros((COUNT - 1, 5, 5)), np.zeros((COUNT - 1, 5)),
        np.column_stack([np.zeros((COUNT - 1, 4)), np.ones(COUNT - 1)]),
        np.zeros(COUNT), none, measured, np.zeros(5), torques,
    )  # fmt: skip
    run: Any = SimpleNamespace(
        step_s=STEP_S, time_s=time, states=states, position_rad=measured[:, 0], rigid=False,
        speed_measured=True, load_nm=reported,
    )  # fmt: skip
    coupling = np.array([SHAFT.stiffness, SHAFT.damping])
    passed, _ = through_play(equations, steps, SHAFT, coupling, inertia, GAP_RAD, NOISE, run)
    found = kalman.filtered(problem_of(passed, NOISE, run))
    squares = (found.error**2 / found.variance)[20:]
    assert np.mean(squares) < 1.5
    assert np.mean(squares > 25) < 1e-3
