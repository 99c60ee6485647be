"""States that a set makes likely stay as they are once they are: else what a set is worth goes by the way to it."""

from dataclasses import replace
from importlib import import_module
from pathlib import Path

import numpy as np
import pytest
from sealed_sessions import drawn

from schwung.explain.weighing.growth import Growth
from schwung.explain.weighing.round import View, linearised, resmoothed_about
from schwung.explain.weighing.sets import absent
from schwung.explain.weighing.weigh import weigh


class _SeenError(Exception):
    """Ends a search that has not begun."""

    def __init__(self, growth: Growth, view: View) -> None:
        super().__init__()
        self.growth, self.view = growth, view


def _seen(growth: Growth, view: View) -> None:
    raise _SeenError(growth, view)


@pytest.mark.long
def test_a_late_speed_is_not_corrected_by_its_own_correction(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """At 2 kHz, filtered by 0.28 ms: beside three causes, each smoothing made the last sample worse, by 30 a run,
    and without that all samples went round in four, by 400 of 28 000."""
    session, belief, _ = drawn(tmp_path, 309000, 2, kind="three")
    monkeypatch.setattr(import_module("schwung.explain.weighing.weigh"), "grown", _seen)
    with pytest.raises(_SeenError) as seen:
        weigh(session, belief)
    rests, train = seen.value.growth.rests, seen.value.growth.rests.train
    found = {"usual_timing_beyond": np.array([0.0, 2.8e-4])}
    always = [absent(rests.candidates[i]) for i in seen.value.growth.always]
    members = [replace(m, coefficients=found.get(m.candidate.name, m.coefficients)) for m in always]
    about = linearised(rests.wide.seen(seen.value.view), members, rests.weighing.noise, None, train)
    squares = []
    for _ in range(10):
        about = linearised(resmoothed_about(about), members, rests.weighing.noise, None, train)
        squares.append(about.square(train))
    assert np.ptp(squares[-4:]) < 1e-6 * squares[-1]
