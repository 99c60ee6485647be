"""Several runs as one are what each is by itself, one behind another."""

from collections.abc import Callable
from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from strangers import STRANGERS, belief_of, session_of

from schwung.drivetrain.inertia import InertiaTable, slider_crank_inertia
from schwung.drivetrain.machine import Load
from schwung.explain.causes.along import Along, ranges_of
from schwung.explain.causes.candidate import Candidate, Shape
from schwung.explain.causes.equations import load_taken
from schwung.explain.causes.inertia_at import DIFFERENCE_RAD, inertia_of
from schwung.explain.causes.joined import Joined, behind
from schwung.explain.causes.known import known
from schwung.explain.causes.present import Member
from schwung.explain.causes.true_torque import TrueTorque
from schwung.explain.causes.vocabulary import vocabulary
from schwung.explain.weighing import round as rounds
from schwung.explain.weighing.repeated import repeated
from schwung.innovations.likelihood import first_noise
from schwung.innovations.signals import signals_of

PLAY_RAD = 2e-4


def same(found: np.ndarray, wanted: np.ndarray) -> bool:
    """But next to the points of an inertia table, where its bend jumps within a difference: there, to 20 %."""
    size = np.max(np.abs(wanted), initial=1e-9)
    near = np.isclose(found, wanted, rtol=1e-6, atol=1e-6 * size)
    return bool(np.mean(near) > 0.97 and np.allclose(found, wanted, rtol=0, atol=0.2 * size))


@pytest.fixture(scope="module")
def view():
    """Runs of two lengths and two sampling rates, about a crank's inertia."""
    session = session_of(STRANGERS[6], 5, every=8, times=(0.25, 0.4))
    at = np.linspace(-1.0, 5.0, 33)
    load = Load(inertia_table=InertiaTable(at, slider_crank_inertia(at, 0.01, 0.02)))
    machine = belief_of(STRANGERS[6]).model_copy(update={"load": load})
    other = session_of(STRANGERS[6], 6, every=16, times=(0.3,))
    recorded = (*session.runs[:3], *other.runs[:1])
    runs = tuple(signals_of(run, machine, 160.0) for run in recorded)
    assert len({run.step_s for run in runs}) == 2
    of = ranges_of(list(runs), 0.002, 160.0)
    torques = tuple(TrueTorque(run, run.drive.whole_nm) for run in runs)
    found = rounds.View(recorded, runs, known(machine, of.low_rad, of.high_rad), of, torques)
    return rounds.at_rest(found, (), first_noise(runs)).view


def _shape(one: Candidate, at: int) -> Shape:
    """One of those that are tried; of what is only sought, one of as many numbers."""
    return one.shapes[at] if one.sought is None else (30.0, 0.1, 2.0)[: len(one.bounds)]


def asked_of(one: Candidate, shape: Shape, coefficients: np.ndarray) -> list[Callable[[Along], Any]]:
    """All that a cause is asked along a run."""
    laws = [law for law in (one.tangent, one.heavier) if law is not None]
    return [
        lambda along: one.effect(along, shape),
        lambda along: one.done(along, shape, coefficients),
        *(lambda along, law=law: law(along, shape) for law in one.own),
        *(lambda along, law=law: law(along, shape, coefficients) for law in laws),
    ]


@pytest.mark.parametrize("gap_rad", [0.0, PLAY_RAD])
def test_every_cause_does_to_joined_runs_what_it_does_to_each(view, gap_rad):
    """Whoever adds one that goes from sample to sample, or has numbers of each run's own, says so (`run_by_run`)."""
    parts = [replace(part, beyond=replace(part.beyond, gap_rad=gap_rad)) for part in view.alongs(())]
    joined, chance = Joined.of(parts), np.random.default_rng(3)
    candidates = [*vocabulary(view.ranges, view.known), *(one.curve for one in repeated(view.recorded, 1.0))]
    for one in candidates:
        shape = _shape(one, -1)
        coefficients = chance.uniform(0.1, 1.0, one.size) * one.deviations
        for ask in asked_of(one, shape, coefficients):
            whole, each = ask(joined), behind([ask(part) for part in parts])
            pairs = (
                [(whole, each)]
                if isinstance(whole, np.ndarray)
                else zip(whole.parts, each.parts, strict=True)
            )
            for found, wanted in pairs:
                assert (found is None) == (wanted is None), one.name
                if found is not None:
                    assert same(found, wanted), one.name


def test_what_acts_and_what_the_load_takes_are_those_of_each_run(view):
    candidates = {c.name: c for c in vocabulary(view.ranges, view.known)}
    members = [
        Member(candidates[name], candidates[name].shapes[0], np.full(candidates[name].size, size), np.ones(1))
        for name, size in (("coulomb_friction", 0.4), ("nonlinear_stiffness", 1e4), ("acceleration", 0.1))
    ]
    parts = view.alongs(members)
    joined = Joined.of(parts)
    whole, each = rounds.acting_on_each(view, joined, members)
    taken = load_taken(joined, whole)
    for part, where, acts in zip(parts, joined.wheres, each, strict=True):
        alone = rounds.acting(view, part, members)
        assert acts.dry_nm == pytest.approx(alone.dry_nm, rel=1e-12)
        np.testing.assert_allclose(acts.coupling, alone.coupling, rtol=1e-12, atol=1e-12)
        found, wanted = taken.within(where), load_taken(part, alone)
        np.testing.assert_allclose(found.inertia, wanted.inertia, rtol=1e-6)
        size = np.max(np.abs(wanted.start))
        for one, other in zip(found[1:], wanted[1:], strict=True):
            assert np.sqrt(np.mean((one - other) ** 2)) < 1e-5 * size


def test_an_inertia_by_differences_is_the_same_for_many_angles_and_for_few(view):
    """Of many angles the differences are worked out at as many places as there are differences, and a spline goes
    through them."""
    machine, of = view.known.machine, view.ranges
    few = np.linspace(of.low_rad + 0.1, of.high_rad - 0.1, 40)
    many = np.linspace(of.low_rad, of.high_rad, int(of.span_rad / DIFFERENCE_RAD))
    for found, wanted in zip(
        inertia_of(machine, np.concatenate([few, many])), inertia_of(machine, few), strict=True
    ):
        assert same(found[: few.size], wanted)


def test_what_each_run_has_of_its_own_is_nothing_in_a_run_that_is_yet_to_come(view):
    """`--next` ended in a traceback where a set held one of these."""
    (part, *_), chance = view.alongs(()), np.random.default_rng(4)
    coming = replace(part, number=view.ranges.runs + 1)
    own = [one for one in vocabulary(view.ranges, view.known) if one.each_run or one.coordinate == "run"]
    assert {one.name for one in own} >= {"run", "periodic_disturbance", "friction_drift"}
    for one in own:
        shape = _shape(one, 0)
        coefficients = chance.uniform(0.1, 1.0, one.size) * one.deviations
        effect, done = one.effect(coming, shape), one.done(coming, shape, coefficients)
        drifts = one.named and not one.each_run  # and goes on drifting
        assert np.any(effect.parts[0]) == np.any(done.parts[0]) == drifts, one.name
