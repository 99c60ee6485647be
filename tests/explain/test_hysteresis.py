"""A coupling with hysteresis, against laws of another formula: Iwan's slipping elements, Dahl's bristles."""

from __future__ import annotations

import numpy as np
import pytest
from sealed_sessions import fewer
from strangers import Stranger, belief_of, session_of

from schwung.drivetrain.hysteresis import yielded
from schwung.drivetrain.machine import Machine
from schwung.drivetrain.physics_term import PhysicsTerm
from schwung.drivetrain.presliding import bent
from schwung.explain.causes.along import ranges_of
from schwung.explain.causes.known import known
from schwung.explain.causes.true_torque import TrueTorque
from schwung.explain.publishing.learned import Found, learned
from schwung.explain.weighing.round import View, at_rest
from schwung.explain.weighing.weigh import weigh
from schwung.innovations.likelihood import first_noise
from schwung.innovations.signals import picked_signals_of
from schwung.motion import Array

OVER = 1e-3
SLIPS = Stranger("slips", ("coupling_hysteresis",), slips=(2.0, 1e-3))


def wound(samples: int = 4001) -> Array:
    """A wind-up that grows, then dies out (rad)."""
    share = np.linspace(0.0, 1.0, samples)
    return np.asarray(4 * OVER * np.sin(30 * share) * np.sin(np.pi * share) ** 2)


def slipping(twist: Array, limits: Array) -> Array:
    """What springs in parallel hold that slip at their limits, over the most that they do."""
    held, share = np.zeros(limits.size), np.zeros(twist.size)
    for i, way in enumerate(np.diff(twist), 1):
        held = np.clip(held + way, -limits, limits)
        share[i] = held.sum() / limits.sum()
    return share


def left(truth: Array, *tried: Array) -> float:
    """The share of a variance that the best of these leaves, each at its best size."""
    return min(float(np.var(truth - one * (one @ truth) / (one @ one)) / np.var(truth)) for one in tried)


def test_loaded_from_nothing_it_nears_what_it_yields_at() -> None:
    twist = np.linspace(0.0, 3 * OVER, 300)
    assert yielded(twist, OVER, 1.0) == pytest.approx(1 - np.exp(-twist / OVER), abs=1e-3)
    assert yielded(twist, OVER, 2.0) == pytest.approx(np.tanh(twist / OVER), abs=1e-3)
    assert yielded(twist, OVER, 20.0) == pytest.approx(np.minimum(twist / OVER, 1), abs=0.06)


def test_unloaded_it_is_the_spring_that_it_was() -> None:
    twist = np.concatenate([np.linspace(0.0, 3 * OVER, 300), np.linspace(3 * OVER, 2.5 * OVER, 50)])
    held = yielded(twist, OVER, 2.0)
    assert held[299] - held[-1] == pytest.approx(0.5, abs=1e-3)


def test_what_it_holds_goes_by_the_way_and_not_by_the_time() -> None:
    fine, coarse = yielded(wound(4001), OVER, 2.0)[::10], yielded(wound(401), OVER, 2.0)
    assert coarse == pytest.approx(fine, abs=0.02)


@pytest.mark.parametrize("law", ["even", "one", "bristles"])
def test_other_laws_are_nearly_one_of_its_exponents(law: str) -> None:
    """Friction of as much alone leaves far more."""
    twist = wound()
    truth = {
        "even": slipping(twist, 2 * OVER * np.arange(1, 7) / 6),
        "one": slipping(twist, np.array([OVER])),
        "bristles": bent(twist, OVER, 0.0),
    }[law]
    tried = [yielded(twist, OVER * x, n) for x in np.geomspace(0.2, 5, 25) for n in (0.5, 1, 2, 5, 20)]
    assert left(truth, *tried) < 0.01
    assert left(truth, np.sign(np.gradient(twist))) > 0.05


@pytest.mark.long
def test_a_stranger_that_slips_is_named() -> None:
    found = weigh(fewer(session_of(SLIPS, 5, every=8, times=(0.25,)), 1), belief_of(SLIPS))
    assert [one.name for one in found.names if one.probability > 0.5] == ["coupling_hysteresis"]
    named = next(one for one in found.names if one.name == "coupling_hysteresis").parameters
    assert named["torque_nm"].value == pytest.approx(2.0, rel=0.15)


def test_what_is_found_beside_what_is_believed_is_one_term() -> None:
    had = {"torque_nm": 1.0, "stiffness_nm_rad": 4e3, "exponent": 2.0}
    term = PhysicsTerm.model_validate({"name": "coupling_hysteresis", **had})
    believed = belief_of(Stranger("", ())).model_copy(update={"physics": (term,)})
    more = {"torque_nm": 0.2, "stiffness_nm_rad": 500.0, "exponent": 2.0}
    (one,) = learned(believed, [Found("coupling_hysteresis", True, more, {})]).physics
    assert one.parameters["torque_nm"] == pytest.approx(1.2)


def test_a_file_with_hysteresis_is_judged_about_a_coupling_that_has_it() -> None:
    """About states of one that bends nowhere it missed more than the belief, or its states ran away."""
    hidden = Stranger("slips", ("coupling_hysteresis",), slips=(6.0, 6e-4))
    session = fewer(session_of(hidden, 5, every=8, times=(0.25,)), 1)
    law = {"torque_nm": 6.3, "stiffness_nm_rad": 1.4e4, "exponent": 5.0}
    term = PhysicsTerm.model_validate({"name": "coupling_hysteresis", **law})
    believed = belief_of(hidden)

    def missed(machine: Machine) -> float:
        runs = tuple(picked_signals_of(run, machine, 160.0) for run in session.runs)
        of = ranges_of(list(runs), 0.002, 160.0)
        torques = tuple(TrueTorque(run, run.drive.whole_nm) for run in runs)
        view = View(session.runs, runs, known(machine, of.low_rad, of.high_rad), of, torques)
        about = at_rest(view, (), first_noise(runs))
        return about.square(range(len(runs))) / about.samples(range(len(runs)))

    assert missed(believed.model_copy(update={"physics": (term,)})) < 0.15 * missed(believed)
