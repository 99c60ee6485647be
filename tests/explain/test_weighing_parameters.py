"""A name's numbers over all sets that hold it: an interval where either of two sets may be right holds both."""

from types import SimpleNamespace

import numpy as np
import pytest

from schwung.explain.weighing.parameters import over_sets, tells
from schwung.explain.weighing.values import Parameter
from schwung.explain.weighing.weigh import Posterior


def found(value: float, half: float, key: str = "stiffness_nm_rad") -> dict[str, Parameter]:
    return {key: Parameter(value, value - half, value + half)}


def test_one_set_says_its_own_interval() -> None:
    assert over_sets([(1.0, found(6500.0, 70.0))]) == found(6500.0, 70.0)


def test_of_two_sets_an_interval_holds_95_percent_of_both() -> None:
    """Against as many draws: of a coupling beside a motor inertia, or a load inertia, that is off."""
    (one,) = over_sets([(0.66, found(6845.0, 70.0)), (0.34, found(6490.0, 66.0))]).values()
    chance = np.random.default_rng(0)
    first = chance.uniform(size=400_000) < 0.66
    drawn = np.where(
        first, chance.normal(6845.0, 70.0 / 1.96, first.size), chance.normal(6490.0, 66.0 / 1.96, first.size)
    )
    assert one.value == 6845.0
    assert [one.low, one.high] == pytest.approx(np.percentile(drawn, (2.5, 97.5)).tolist(), abs=1.0)


def test_what_is_hardly_likely_moves_no_end() -> None:
    assert not tells(0.02, 1.0)
    assert tells(0.02, 0.5)


def test_a_phase_is_as_far_as_the_turn_allows() -> None:
    (one,) = over_sets([(0.5, found(3.1, 0.02, "phase_rad")), (0.5, found(-3.1, 0.02, "phase_rad"))]).values()
    assert 3.05 < one.low < 3.1
    assert 3.18 < one.high < 3.25


def test_another_way_of_saying_a_name_says_nothing_of_its_numbers() -> None:
    """A load inertia that is so much more, or so many times as much."""
    both = over_sets([(0.6, found(1.0, 0.1, "delta_kgm2")), (0.4, found(1.2, 0.1, "scale"))])
    assert both == found(1.0, 0.1, "delta_kgm2")


def test_a_law_that_does_not_hold_elsewhere_is_no_name() -> None:
    """It was left out of the set by which names stand, and then stood for itself: a lag of 0.96 whose interval held
    nothing."""
    search = SimpleNamespace(name=str, shares=lambda: [(1.0, SimpleNamespace(picks=("damping", "lag")))])
    search.candidate = lambda pick: SimpleNamespace(name=pick)
    candidates = [SimpleNamespace(name=name, named=True) for name in ("damping", "lag")]
    weighed = SimpleNamespace(
        sure=search,
        grown=SimpleNamespace(data=SimpleNamespace(candidates=candidates), search=SimpleNamespace(data=None)),
        stands=SimpleNamespace(of=lambda _search, _name: 1.0),
        disproved=frozenset(),
        unlawful=frozenset({"lag"}),
        damped=SimpleNamespace(named=0.0),
        _possible=lambda _name: 1.0,
    )
    weighed.grown.search.data = SimpleNamespace(candidates=[])
    names = vars(Posterior)["names"].func(weighed)
    assert set(names) == {"damping"}
