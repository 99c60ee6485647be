"""Names that stand out from what is left to none, and names that do not."""

from collections.abc import Callable
from dataclasses import dataclass
from math import inf
from types import SimpleNamespace

import numpy as np
import pytest

from schwung.drivetrain.machine import Coupling
from schwung.explain.causes.along import Ranges
from schwung.explain.causes.candidate import Candidate
from schwung.explain.causes.vocabulary.shaft import shaft
from schwung.explain.publishing.values import Proof
from schwung.explain.weighing.data import Atom
from schwung.explain.weighing.search import Pick
from schwung.explain.weighing.standing import larger_than_usual, standing
from schwung.innovations.effect import Effect


@dataclass
class Cause:
    name: str
    worth: float  # log evidence that it adds to any set
    named: bool = True
    scales: tuple[float, ...] = (1.0,)
    taken: float = 0.0  # of the recording, where that is more
    told: float = inf  # of that, by the numbers that it is told with
    larger: float = 1.0  # probability of being more than is usual
    inertia: Callable[[], None] | None = None  # of an inertia, anything
    part_of: str = ""
    causes: int = 1
    alike: float = -inf  # log odds that all motions have it alike


@dataclass
class Picked:
    picks: tuple[Pick, ...]
    log: float


class Additive:
    """A search where every cause is worth the same in all sets."""

    odds = handicap = -3.7

    def __init__(self, *causes: Cause):
        self.causes = causes

    def candidate(self, pick: Pick) -> Cause:
        return self.causes[pick.atom]

    def index(self, pick: Pick) -> int:
        return pick.atom

    def name(self, pick: Pick) -> str:
        return self.candidate(pick).name

    def score(self, picks: tuple[Pick, ...]) -> Picked:
        return Picked(picks, sum(self.candidate(pick).worth + self.odds for pick in picks))

    def sized(self, scored: Picked) -> Picked:
        return scored


def stands(*causes: Cause, besides: float = 0.0):
    search = Additive(*causes)
    every = tuple(Pick(number, 1.0) for number in range(len(causes)))
    return standing(
        search,  # type: ignore[arg-type]
        search.score(every),  # type: ignore[arg-type]
        (),
        lambda *_: inf,
        lambda _search, scored, pick: causes[pick.atom].larger if scored.picks == every else 1.0,
        lambda _search, _picks, pick: causes[pick.atom].taken or causes[pick.atom].worth,
        lambda _search, _best, _picks, pick: causes[pick.atom].told,
        besides,
        lambda _search, _best, pick: causes[pick.atom].alike,
    )


def test_a_name_that_leaves_nothing_is_nearly_sure():
    assert stands(Cause("friction", 300.0)).names["friction"] > 0.99


def test_weak_evidence_is_no_more_than_evidence():
    assert stands(Cause("friction", 5.0)).names["friction"] == pytest.approx(0.786, abs=0.01)


def test_names_that_share_what_none_explains_all_fall():
    found = stands(Cause("gain", 6000.0), Cause("inertia", 2000.0), Cause("curve", 800.0, named=False))
    assert all(p < 0.5 for p in found.names.values())
    assert found.left > 8000


@pytest.mark.parametrize(("alike", "stands_out"), [(-inf, False), (0.0, False), (20.0, True)])
def test_a_curve_that_all_motions_have_alike_is_a_law_beside_which_names_stand(
    alike: float, stands_out: bool
):
    """Friction over the root of the speed has no name, and cogging, a lag and a load beside it had none either."""
    found = stands(Cause("cogging", 3000.0), Cause("curve", 800.0, named=False, alike=alike))
    assert (found.names["cogging"] > 0.95) is stands_out
    assert (found.names["cogging"] < 0.5) is not stands_out


def test_a_small_name_beside_a_large_one_is_what_the_large_law_is_off_by():
    found = stands(Cause("spot", 2e6), Cause("cogging", 40.0))
    assert found.names["spot"] > 0.9
    assert found.names["cogging"] < 0.5


def test_numbers_are_less_sure_by_what_has_no_name_and_not_by_what_their_law_may_be_off_by():
    """That is a part of the law, sized by the recording: counted twice, intervals of gross effects were four times too
    wide."""
    assert stands(Cause("spot", 2e6)).blurring == 1.0
    assert stands(Cause("spot", 2e6)).tempering > 10
    assert stands(Cause("spot", 2e6), Cause("curve", 100.0, named=False)).blurring == pytest.approx(201.0)


def test_laws_that_other_motions_refute_are_left_to_no_name():
    """They took something that is there, and may be along the names' columns as well."""
    assert stands(Cause("ripple", 16.0)).names["ripple"] > 0.99
    assert stands(Cause("ripple", 16.0), besides=170.0).names["ripple"] < 0.1
    assert stands(Cause("friction", 50_000.0), besides=170.0).names["friction"] > 0.8


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


@pytest.mark.parametrize(("told", "stands_out"), [(-300.0, False), (200.0, False), (50_000.0, True)])
def test_beside_a_curve_a_name_takes_what_its_own_numbers_do(told: float, stands_out: bool):
    """A load by direction was there for the jump that a plane could not do, three times as large as all friction and
    taken back by the plane: without the plane it took all of the friction, and stood out by that."""
    load = Cause("load by direction", 300.0, taken=120_000.0, told=told)
    assert (stands(load, Cause("plane", 1000.0, named=False)).names["load by direction"] > 0.5) is stands_out


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


def test_an_inertia_over_the_angle_leaves_nothing_to_a_curve_of_torque():
    """What swings is felt by how it accelerates, a torque is not: no law is needed to tell them apart."""
    inertia = Cause("inertia over angle", 48_000.0, scales=(1.0, 0.1), inertia=lambda: None)
    found = stands(Cause("friction over angle", 14_000.0, scales=(1.0, 0.1)), inertia)
    assert min(found.names.values()) > 0.9


@pytest.mark.parametrize(("part_of", "stands_out"), [("inertia over angle", True), ("", False)])
def test_a_part_of_a_curve_that_stands_is_nothing_left(part_of: str, stands_out: bool):
    curve = Cause("inertia over angle", 1e6, scales=(1.0, 0.1), inertia=lambda: None)
    found = stands(curve, Cause("inertia everywhere", 40.0, part_of=part_of), Cause("lag", 1000.0))
    assert found.names["inertia everywhere"] < 0.2
    assert (found.names["lag"] > 0.5) is stands_out


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


def late(lag_us: float, usual_us: float) -> float:
    """That a lag is a finding beside so much that the usual timing takes of it, all known to 5 µs, together to 1 µs."""
    usual = Candidate("usual_torque_timing", lambda *_: Effect(), (5e-5, 1e-8), named=False)
    lag = Candidate(
        "torque_lag",
        lambda *_: Effect(),
        (1e-3,),
        known_to=7e-5,
        with_usual={"usual_torque_timing": (-1.0, 0.0)},
    )
    covariance = 1e-12 * np.array([[25.0, 0, 24.5], [0, 1e-6, 0], [24.5, 0, 25.0]])
    found = SimpleNamespace(
        coefficients=np.array([1e-6 * usual_us, 2e-9, 1e-6 * lag_us]), covariance=covariance
    )
    atoms = [Atom(0, (), slice(0, 2)), Atom(1, (), slice(2, 3))]
    search = SimpleNamespace(
        candidate=lambda _pick: lag, always=(0,), data=SimpleNamespace(candidates=[usual, lag], atoms=atoms)
    )
    scored = SimpleNamespace(which=np.arange(3), found=found)
    return larger_than_usual(search, scored, Pick(1, 1.0))  # type: ignore[arg-type]


def test_a_lag_that_the_usual_timing_takes_back_is_none():
    """A lag of 100 µs beside a torque that is reported 65 µs late says how it bends, not that it comes late."""
    assert late(100.0, 65.0) < 0.5 < late(100.0, 0.0) < late(400.0, 0.0)
    assert late(400.0, 0.0) > 0.99
    assert late(100.0, 160.0) == 0.0  # the other way round


def test_a_further_mass_is_felt_at_its_resonance():
    """A third of a per mille of the load is a part in a hundred of it where it is damped with a ratio of 0.015."""
    coupling, of = (
        Coupling(stiffness_nm_rad=4e4, damping_nms=5.0),
        Ranges(0.0, 4.0, 50.0, 2000.0, 40.0, 1.0, 0.1, 8, 160.0),
    )
    mass, _ = [c for c in shaft(of, coupling, 1.0, 0.01, 0.1) if c.name == "extra_compliance"]
    covariance = np.array([[1e-14]])
    assert mass.beyond(np.array([3.3e-5]), covariance, (300.0, 0.015)) > 0.99
    assert mass.beyond(np.array([3.3e-5]), covariance, (300.0, 0.1)) < 0.01
    assert mass.beyond(np.array([3e-7]), covariance, (300.0, 0.023)) < 0.01
