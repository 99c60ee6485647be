"""A gap, or a stiffness far off, costs more than all lines of a round: it is asked again only where it may be more."""

from typing import Any

import pytest
from sealed_sessions import fewer
from strangers import Stranger, belief_of, session_of

from schwung.explain.weighing.resting import Rests
from schwung.explain.weighing.weigh import weigh


@pytest.mark.long
def test_it_is_asked_first_and_last_and_never_for_less_than_there_is(monkeypatch: pytest.MonkeyPatch) -> None:
    asked: list[tuple[Rests, str, float, float]] = []  # who, what, what it had to exceed, what it gained
    rest = Rests.rest

    def noted(
        rests: Rests, search: Any, one: Any, start: Any, at: Any, least: float = 0.0, **how: Any
    ) -> Any:
        found = rest(rests, search, one, start, at, least, **how)
        last = search.candidate(one.picks[-1]) if one.picks else None
        grown = last is not None and len(one.picks) > len(start.picks) and (last.opens or last.elsewhere)
        if grown and how.get("everywhere", True):
            asked.append((rests, last.name, least, found[1]))
        return found

    monkeypatch.setattr(Rests, "rest", noted)
    stranger = Stranger("dry friction, inertia", (), (0.8, 0.0, 0.0, 0.0), believed_scale=0.95)
    found = weigh(fewer(session_of(stranger, 5, every=8, times=(0.25, 0.4)), 1), belief_of(stranger))
    assert {name.name for name in found.names if name.probability > 0.9} >= {"coulomb_friction"}

    before: dict[tuple[int, str], float] = {}
    for who, what, least, gain in asked:
        assert before.get((id(who), what), float("inf")) > least or least == 0.0
        before[id(who), what] = gain
    assert {what for _, what, _, _ in asked} == {"backlash", "coupling_stiffness", "nonlinear_stiffness"}
    assert asked[-1][2] == 0.0  # beside all that was found it was asked as well
