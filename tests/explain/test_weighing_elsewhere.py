"""What predicts motions that it was not fitted to stays; what was only fitted to one does not."""

from dataclasses import dataclass
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from schwung.explain.weighing.elsewhere import foretold, holding
from schwung.explain.weighing.search import Pick

SAMPLES, RUNS, NAMES = 400, 6, ("law", "one motion's", "name")


@dataclass
class Scored:
    picks: tuple[Pick, ...]

    @property
    def which(self) -> Any:
        return np.array([pick.atom for pick in self.picks], dtype=np.intp)

    @property
    def deviations(self) -> Any:
        return np.ones(len(self.picks))


class Recorded:
    """Two runs each of three motions; a law acts in all, another thing in the first, along a column that all have."""

    def __init__(self) -> None:
        chance = np.random.default_rng(3)
        rows = chance.normal(size=(3, RUNS * SAMPLES))
        motion = np.repeat([0, 0, 1, 1, 2, 2], SAMPLES)
        target = 0.3 * rows[0] + np.where(motion == 0, 1.0, 0.0) * rows[1] + chance.normal(size=motion.size)
        motions = [SimpleNamespace(model_dump_json=lambda i=i: str(i // 2)) for i in range(RUNS)]
        about = SimpleNamespace(
            stretches=lambda runs: [slice(i * SAMPLES, (i + 1) * SAMPLES) for i in runs],
            view=SimpleNamespace(recorded=[SimpleNamespace(motion=one) for one in motions]),
        )
        self.data = SimpleNamespace(rows=rows, target=target, train=range(RUNS), excess=1.0, about=about)

    def score(self, picks: tuple[Pick, ...]) -> Scored:
        return Scored(picks)

    def name(self, pick: Pick) -> str:
        return NAMES[pick.atom]

    def candidate(self, pick: Pick) -> Any:
        return SimpleNamespace(is_law=pick.atom == 2)

    def held(self, *named: str) -> set[str]:
        every: Any = Scored(tuple(Pick(number, 1.0) for number in range(3)))
        return {self.name(pick) for pick in holding(self, every, named).picks}  # type: ignore[arg-type]


def test_what_one_motion_alone_shows_is_refuted_by_the_others() -> None:
    assert "one motion's" not in Recorded().held("name")


def test_a_law_holds_and_a_name_is_not_asked() -> None:
    assert Recorded().held("name") == {"law", "name"}
    assert Recorded().held("one motion's") >= {"law", "one motion's"}


def test_one_run_refutes_nothing() -> None:
    alone = Recorded()
    alone.data.train = range(1)
    assert alone.held("name") == set(NAMES)


def test_of_one_motion_each_run_is_predicted_by_the_others() -> None:
    one = Recorded()
    one.data.about.view.recorded = [SimpleNamespace(motion=None, extra={})] * RUNS
    with_law, without = (foretold(one, Scored(picks)) for picks in ((Pick(0, 1.0),), ()))  # type: ignore[arg-type]
    gained = with_law.plainly - without.plainly
    assert gained.size == RUNS
    assert np.sum(gained) == pytest.approx(0.3**2 * RUNS * SAMPLES / 2, rel=0.2)


@pytest.mark.parametrize(("also_there", "is_refuted"), [(0.0, False), (1.0, True)])
def test_a_motion_where_no_other_was_refutes_nothing(also_there: float, is_refuted: bool) -> None:
    """A curve of two modes, of which other motions show the sum and the first one only one, or the sum as well."""
    away = Recorded()
    data, first = away.data, np.arange(RUNS * SAMPLES) < 2 * SAMPLES
    data.rows[1] = np.where(first, also_there, 1.0) * data.rows[0]
    data.target = np.where(first, -0.7, 0.3) * data.rows[0] + data.rows[2]
    whole, fewer = (foretold(away, Scored(picks)) for picks in ((Pick(0, 1.0), Pick(1, 1.0)), ()))  # type: ignore[arg-type]
    assert whole.plainly[0] < fewer.plainly[0] - 20  # about their mean alone, it is worse
    assert (whole.gains_by_leaving(fewer, curve=True) > 0) == is_refuted
    assert whole.gains_by_leaving(fewer, curve=False) > whole.gains_by_leaving(fewer, curve=True) - 1e-9
