"""Names that stand out from what is left to none, and names that do not."""

from dataclasses import dataclass
from math import inf

import pytest

from schwung.explain.weighing.search import Pick
from schwung.explain.weighing.standing import standing
from schwung.explain.weighing.values import Proof


@dataclass
class Cause:
    name: str
    worth: float  # log evidence that it adds to any set
    named: bool = True
    scales: tuple[float, ...] = (1.0,)


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
    return standing(search, search.score(every), (), lambda *_: inf)  # type: ignore[arg-type]


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
