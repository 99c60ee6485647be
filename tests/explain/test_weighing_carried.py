"""What the coupling carries is all of it: friction of gears, by that torque, feels a transmission that is off."""

from dataclasses import replace
from typing import Any, NamedTuple

import numpy as np
import pytest
from integrated import TICK_S, shaken

from schwung.drivetrain.machine import Coupling, Load, Machine, Motor
from schwung.drivetrain.physics_term import PhysicsTerm
from schwung.explain.causes.present import Member
from schwung.explain.causes.vocabulary import vocabulary
from schwung.explain.weighing.round import View, at_rest
from schwung.explain.weighing.weigh import _view
from schwung.explain.weighing.work import Work
from schwung.innovations.likelihood import Noise
from schwung.session.model import Run, Session

ROTOR, LOAD, STIFFNESS, DAMPING, LOST = 0.02, 0.06, 8000.0, 1.0, 0.06
EVERY, NOISE = 8, (2e-6, 0.015, 0.08)
ORDER, OFF, CUBIC = 8.0, 1e-3, 2e9


class Played(NamedTuple):
    session: Session
    states: np.ndarray  # (n, 4) as they were: angle, speed, wind-up, the load's speed
    carried: np.ndarray  # (n,) N·m


def played(off: float, cubic: float) -> Played:
    """A gear behind a transmission that is `off`, or a coupling that stiffens."""

    def between(angle: Any, speed: Any, load_angle: Any, load_speed: Any) -> Any:
        wound = angle + off * np.sin(ORDER * angle) - load_angle
        ratio = 1 + off * ORDER * np.cos(ORDER * angle)
        return STIFFNESS * wound + cubic * wound**3 + DAMPING * (ratio * speed - load_speed), ratio

    def slope(state: np.ndarray, torque: float) -> np.ndarray:
        carried, ratio = between(*state)
        lost = LOST * abs(carried) * np.tanh(state[1] / 0.01)
        return np.array([state[1], (torque - lost - ratio * carried) / ROTOR, state[3], carried / LOAD])

    chance, (time, states, torques) = np.random.default_rng(1), shaken(slope)
    carried = np.array([between(*state)[0] for state in states])
    every = np.column_stack([states, torques, carried])[::EVERY]
    angle, speed, torque = (every[:, [0, 1, 4]] + chance.standard_normal((len(every), 3)) * np.array(NOISE)).T
    run = Run(
        role="reference", repeat=0, time_s=time[::EVERY], position_rad=angle, speed_rad_s=speed,
        torque_nm=torque, sample_rate_hz=1 / (EVERY * TICK_S),
    )  # fmt: skip
    session = Session((run,), created="2026-01-01T00:00:00+00:00", source="gear")
    states = np.column_stack([every[:, 0], every[:, 1], every[:, 0] - every[:, 2], every[:, 3]])
    return Played(session, states, every[:, 5])


def belief(*physics: PhysicsTerm) -> Machine:
    return Machine(
        name="gear",
        motor=Motor(inertia_kgm2=ROTOR, viscous_friction_nms=0.0, peak_torque_nm=60.0),
        coupling=Coupling(stiffness_nm_rad=STIFFNESS, damping_nms=DAMPING),
        load=Load(viscous_friction_nms=0.0, inertia_kgm2=LOAD),
        physics=physics,
    )


@pytest.fixture(scope="module")
def gear() -> Played:
    return played(OFF, 0.0)


GEAR_LOSS = PhysicsTerm(name="load_dependent_friction", share=LOST)
TRANSMISSION = PhysicsTerm(name="kinematic_error", order=ORDER, amplitude_rad=OFF, phase_rad=0.0)


def test_a_belief_that_has_both_misses_nothing(gear: Played) -> None:
    about = at_rest(
        _view(gear.session, belief(GEAR_LOSS, TRANSMISSION), (), Work()),
        (),
        Noise(NOISE[2], NOISE[1], NOISE[0]),
    )
    assert np.sqrt(about.square([0]) / about.samples([0])) == pytest.approx(1.0, abs=0.1)


@pytest.mark.parametrize(
    ("name", "shape", "coefficients"),
    [("kinematic_error", (ORDER,), [ORDER * OFF, 0.0]), ("nonlinear_stiffness", (), [CUBIC])],
)
def test_all_that_is_present_is_carried(
    name: str, shape: tuple[float, ...], coefficients: list[float], gear: Played
) -> None:
    """By the states as they were, beside the torque that the machine had; by the belief or by a cause."""
    there = gear if name == "kinematic_error" else played(0.0, CUBIC)
    plain, term = belief(), TRANSMISSION
    if name == "nonlinear_stiffness":
        term = PhysicsTerm(name=name, cubic_nm_rad3=CUBIC)
    view = _as_it_was(there, plain)
    (cause,) = (
        c for c in vocabulary(view.ranges, view.known)
        if c.name == name and c.named and c.size == len(coefficients) and c.sought is None
    )  # fmt: skip
    member = Member(cause, shape, np.array(coefficients), np.array(cause.deviations))
    for along in (view.alongs([member])[0], _as_it_was(there, belief(term)).alongs([])[0]):
        off = along.carried - there.carried
        assert np.sqrt(np.mean(off**2)) < 0.02 * np.sqrt(np.mean(there.carried**2))
    missing = view.alongs([])[0].carried - there.carried
    assert np.sqrt(np.mean(missing**2)) > 0.1 * np.sqrt(np.mean(there.carried**2))


def _as_it_was(there: Played, machine: Machine) -> View:
    view = _view(there.session, machine, (), Work())
    (run,) = view.runs
    places = np.round(run.time_s / (EVERY * TICK_S)).astype(int)
    return replace(view, runs=(run.about(there.states[places]),))
