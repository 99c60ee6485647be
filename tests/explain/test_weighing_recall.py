"""Of sets that explain the same, each is weighed by what it was worth at rest."""

from types import SimpleNamespace
from typing import Any

import pytest

from schwung.explain.weighing.growth import Growth
from schwung.explain.weighing.resting import Rests
from schwung.explain.weighing.search import Search

LATE, SOFT, BOTH = frozenset({1}), frozenset({2}), frozenset({1, 2})


def recalled(promised: float, rested: float) -> Any:
    """A search about `LATE`, at rest at −10, after `SOFT` was brought to rest; the table holds what is promised."""
    table = {kind: SimpleNamespace(log=log) for kind, log in ((LATE, 40.0), (SOFT, promised), (BOTH, 36.0))}
    search: Any = SimpleNamespace(table=table, kept={}, resting=LATE, kind=frozenset, prior=lambda _: 0.0)
    rests: Any = SimpleNamespace(rested={SOFT: ((), rested), LATE: ((), -10.0)})
    best: Any = SimpleNamespace(picks=(1,), log=40.0)
    Rests.recall(rests, search, best, -10.0)
    return search


@pytest.mark.parametrize("promised", [-300.0, 39.0])
def test_a_rival_is_as_far_behind_as_at_rest(promised: float) -> None:
    search = recalled(promised, rested=-13.0)
    assert search.table[SOFT].log + Search.unkept(search, SOFT) == pytest.approx(40.0 - 3.0)
    assert Search.unkept(search, LATE) == 0.0


def test_what_a_rival_is_worth_at_rest_is_not_worth_it_beside_another() -> None:
    assert Search.unkept(recalled(-300.0, rested=-13.0), BOTH) == 0.0


def test_what_it_did_not_keep_it_keeps_beside_none() -> None:
    assert Search.unkept(recalled(39.0, rested=-60.0), BOTH) == pytest.approx(-49.0)


def test_progress_never_goes_back() -> None:
    """However many searches a session takes: laws alone began again at a fifth."""
    nobody: Any = None
    growth = Growth(Rests((), (), nobody), (), nobody)
    assert [next(one.rounds) for one in (growth, growth.afresh(), growth, growth.afresh().afresh())] == [
        1,
        2,
        3,
        4,
    ]
