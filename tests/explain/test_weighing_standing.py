"""Names that stand out from what is left to none, and names that do not."""

from dataclasses import dataclass
from math import inf

import numpy as np
import pytest

from schwung.explain.weighing.candidate import Candidate
from schwung.explain.weighing.search import Pick
from schwung.explain.weighing.standing import standing
from schwung.explain.weighing.values import Proof
from schwung.innovations.effect import Effect


@dataclass
class Cause:
    name: str
    worth: float  # log evidence that it adds to any set
    named: bool = True
    scales: tuple[float, ...] = (1.0,)
    taken: float = 0.0  # of the recording, where that is more
    larger: float = 1.0  # probability of being more than is usual


@dataclass
class Picked:
    picks: tuple[Pick, ...]
    log: float


class Additive:
    """A search where every cause is worth the same in all sets."""

    odds = -3.7

    def __init__(self, *causes: Cause):
        self.causes = causes

    def candidate(self, pick: Pick) -> Cause:
        return self.causes[pick.atom]

    def score(self, picks: tuple[Pick, ...]) -> Picked:
        return Picked(picks, sum(self.candidate(pick).worth + self.odds for pick in picks))

    def sized(self, scored: Picked) -> Picked:
        return scored


def stands(*causes: Cause):
    search = Additive(*causes)
    every = tuple(Pick(number, 1.0) for number in range(len(causes)))
    return standing(
        search,  # type: ignore[arg-type]
        search.score(every),  # type: ignore[arg-type]
        (),
        lambda *_: inf,
        lambda _search, scored, pick: causes[pick.atom].larger if scored.picks == every else 1.0,
        lambda _search, _picks, pick: causes[pick.atom].taken or causes[pick.atom].worth,
    )


def test_a_name_that_leaves_nothing_is_nearly_sure():
    assert stands(Cause("friction", 300.0)).names["friction"] > 0.99


def test_weak_evidence_is_no_more_than_evidence():
    assert stands(Cause("friction", 5.0)).names["friction"] == pytest.approx(0.786, abs=0.01)


def test_names_that_share_what_none_explains_all_fall():
    found = stands(Cause("gain", 6000.0), Cause("inertia", 2000.0), Cause("curve", 800.0, named=False))
    assert all(p < 0.5 for p in found.names.values())
    assert found.left > 8000


def test_a_small_name_beside_a_large_one_is_what_the_large_law_is_off_by():
    found = stands(Cause("spot", 2e6), Cause("cogging", 40.0))
    assert found.names["spot"] > 0.9
    assert found.names["cogging"] < 0.5


def test_two_that_are_both_large_both_stand():
    found = stands(Cause("spot", 50_000.0), Cause("friction", 20_000.0))
    assert min(found.names.values()) > 0.95


def test_a_change_that_is_as_much_as_is_usual_is_no_finding_and_tells_nothing_of_laws():
    found = stands(Cause("stiffness", 5000.0, larger=0.01), Cause("friction", 300.0))
    assert found.names["stiffness"] < 0.02
    assert found.names["friction"] > 0.99
    assert found.usual == pytest.approx({"stiffness": 0.99, "friction": 0.0})


def test_what_is_usual_is_judged_beside_all_others_that_are():
    """Beside fewer, a lag takes over what a delay did, and would be larger than is usual."""
    found = stands(Cause("delay", 50.0, larger=0.0), Cause("lag", 40.0, larger=0.01))
    assert max(found.names.values()) < 0.02


@pytest.mark.parametrize(("taken", "stands_out"), [(0.0, False), (20_000.0, True)])
def test_what_is_left_is_held_against_what_a_name_takes_of_the_recording(taken: float, stands_out: bool):
    """A usual timing would take as much as a late speed does, so that the speed's evidence is the prior's."""
    found = stands(Cause("late speed", 6.0, taken=taken), Cause("curve", 150.0, named=False))
    assert (found.names["late speed"] > 0.5) is stands_out


@pytest.mark.parametrize(
    ("change", "spread", "expected"),
    [(0.001, 1e-4, 0.0), (0.003, 1e-4, 0.5), (-0.01, 1e-3, 1.0), (0.01, 0.007, 0.84)],
)
def test_a_change_is_a_finding_as_far_as_it_is_more_than_the_belief_is_off_by(change, spread, expected):
    cause = Candidate("inertia", lambda *_: Effect(), (0.1,), known_to=0.003)
    probability = cause.beyond(np.array([change]), np.array([[spread**2]]))
    assert probability == pytest.approx(expected, abs=0.01)


def test_the_size_of_a_curve_is_that_of_its_values():
    modes = np.array([[1.0, 0.0], [0.0, 3.0]])
    curve = Candidate("profile", lambda *_: Effect(), (1.0, 1.0), known_to=1.5, products=modes.T @ modes / 2)
    assert curve.beyond(np.array([1.0, 0.5]), 1e-6 * np.eye(2)) == 0.0  # values 1 and 1.5
    assert curve.beyond(np.array([1.0, 1.0]), 1e-6 * np.eye(2)) == 1.0  # values 1 and 3


@pytest.mark.parametrize("alone", [True, False])
def test_a_curve_has_its_name_only_where_it_is_the_only_one(alone):
    curve = Cause("friction over angle", 14_000.0, scales=(1.0, 0.1))
    other = [] if alone else [Cause("load over angle", 48_000.0, scales=(1.0, 0.1))]
    found = stands(curve, *other, Cause("lag", 5000.0))
    assert (found.names["friction over angle"] > 0.5) is alone


@pytest.mark.parametrize(
    ("before", "after", "taken"),
    [
        (5.0, 1.0, 1.0),
        (5.0, 5.0, 0.0),
        (5.0, 0.9, 1.0),
        (0.92, 5.21, 0.0),
        (0.92, 0.95, 1.0),
        (2.0, 3.0, 1 - 8 / 3),
    ],
)
def test_what_a_proof_takes_is_nothing_where_it_makes_worse(
    before: float, after: float, taken: float
) -> None:
    assert Proof((1,), 0.0, before, after).taken == pytest.approx(taken)
