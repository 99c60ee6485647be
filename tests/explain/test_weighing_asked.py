"""What is brought to rest, among all that could be: it costs most of the time."""

from types import SimpleNamespace
from typing import Any, NamedTuple

import numpy as np
import pytest

from schwung.explain.weighing import asked
from schwung.explain.weighing.grown import Grown

LINE, ELSEWHERE = "line", "elsewhere"


class Picked(NamedTuple):
    """A set."""

    picks: tuple[str, ...]


@pytest.mark.parametrize(("leaves", "brought"), [(True, [LINE, ELSEWHERE]), (False, [LINE])])
def test_what_no_line_leads_to_is_asked_where_something_is_left(
    monkeypatch: pytest.MonkeyPatch, leaves: bool, brought: list[str]
) -> None:
    line, beyond = Picked((LINE,)), Picked((ELSEWHERE,))
    monkeypatch.setattr(asked, "_in_place", lambda *_: (None, 0.0))
    monkeypatch.setattr(asked, "_asked", lambda *_: ({line: None}, [beyond]))
    monkeypatch.setattr(asked, "is_unnamed", lambda *_: False)
    seen: list[str] = []

    def rest(_search: Any, one: Any, *_: Any, **__: Any) -> tuple[str, float]:
        seen.append(one.picks[0])
        return f"at rest with {one.picks[0]}", 400.0 if one is line else 20.0

    candidate = SimpleNamespace(is_number=False, bends_by_shape=False)
    search: Any = SimpleNamespace(
        kind=frozenset, candidate=lambda _: candidate, index=str, asked={},
        data=SimpleNamespace(work=SimpleNamespace(spent=False)),
    )  # fmt: skip
    rests: Any = SimpleNamespace(
        named={}, rest=rest, leaves=lambda _: leaves, misses=lambda _: False, note_named=lambda *_: None
    )
    start: Any = Picked(())
    found = asked.further(rests, search, start, at=rests, gained={})
    assert found == (line, f"at rest with {LINE}")
    assert seen == brought


@pytest.mark.parametrize(
    ("leaves", "rested", "brought"),
    [
        (True, set(), ["across", "promises"]),
        (True, {frozenset({"across"})}, ["promises"]),
        (False, set(), ["promises"]),
    ],
)
def test_friction_across_the_coupling_is_asked_whatever_a_line_promises(
    monkeypatch: pytest.MonkeyPatch, leaves: bool, rested: set[frozenset[str]], brought: list[str]
) -> None:
    """Once, and where more than noise is left."""

    class Promised(Picked):
        @property
        def log(self) -> float:
            return {"across": -300.0, "promises": 5.0, "less": -1.0}.get(self.picks[0], 0.0)

    across, promises, less = (Promised((name,)) for name in ("across", "promises", "less"))
    monkeypatch.setattr(asked, "across_instead", lambda *_: [across])
    monkeypatch.setattr(asked, "numbers_instead", lambda *_: [promises, less])
    monkeypatch.setattr(asked, "limits_instead", lambda *_: [])
    seen: list[str] = []

    def rest(_search: Any, one: Any, *_: Any) -> tuple[str, float]:
        seen.append(one.picks[0])
        return "at rest", 400.0 if one is across else 3.0

    search: Any = SimpleNamespace(
        kind=frozenset, asked={}, data=SimpleNamespace(work=SimpleNamespace(spent=False))
    )
    rests: Any = SimpleNamespace(rest=rest, rested=rested, leaves=lambda _: leaves)
    start: Any = Promised(("start",))
    best, gain = asked._in_place(rests, search, start, rests)
    assert seen == brought
    assert (best, gain) == (
        ((across, "at rest"), 400.0) if "across" in brought else ((promises, "at rest"), 3.0)
    )


@pytest.mark.parametrize("spent", [False, True])
def test_each_set_that_would_be_told_is_at_rest_first(spent: bool) -> None:
    """Five sets with a further mass promised more than the hum that was found, and ended at their bounds: three of
    them were asked, and the fourth was told."""
    promised = {frozenset({i}): 10.0 - i for i in range(5)} | {frozenset({9}): 0.0, frozenset({8}): -30.0}
    rival = frozenset({7})
    promised |= {rival: -2.0}
    kept: dict[frozenset[int], float] = {}

    def tempered(_ratio: float) -> Any:
        logs = {kind: log + kept.get(kind, 0.0) for kind, log in promised.items()}
        whole = float(np.log(np.sum(np.exp(list(logs.values())))))
        order = sorted(logs, key=lambda kind: -logs[kind])
        shares = [(float(np.exp(logs[kind] - whole)), SimpleNamespace(picks=tuple(kind))) for kind in order]
        return SimpleNamespace(kind=frozenset, shares=lambda: shares)

    def note(kind: frozenset[int], at_rest: float, before: float) -> None:
        kept[kind] = at_rest - before

    search: Any = SimpleNamespace(
        tempered=tempered, kind=frozenset, kept=kept, doubts={}, note=note,
        table={kind: SimpleNamespace(picks=tuple(kind), log=log) for kind, log in promised.items()},
        data=SimpleNamespace(work=SimpleNamespace(late=False, spent=spent)),
    )  # fmt: skip
    growth: Any = SimpleNamespace(rests=SimpleNamespace(rest=lambda *_: (None, -np.inf)))
    climbed: Any = SimpleNamespace(search=search, best=SimpleNamespace(picks=(9,), log=0.0), at=None)
    found: Any = Grown(growth, climbed, view=search)
    (share, best), *_ = found.tempered(10.0).shares()
    assert (best.picks, share) == ((9,), pytest.approx(1.0 if not spent else 1 / (1 + np.exp(-2.0))))
    # what would not be told is left; of what is not the likeliest, where the work is over
    assert set(kept) == {frozenset({i}) for i in range(5)} | (set() if spent else {rival})
