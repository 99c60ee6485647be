"""Strangers' machines, which lie with the benchmarks, and the hand-made answer of the report's tests; and what a search
finds does not depend on how fast the computer is."""

import sys
from pathlib import Path

import pytest

sys.path.append(str(Path(__file__).parents[2] / "benchmarks"))
sys.path.append(str(Path(__file__).parents[1] / "report"))

from schwung.compiled import computing_s
from schwung.explain.weighing.work import Work


@pytest.fixture(autouse=True, scope="session")
def unhurried():
    """No search ends for the processor's time, but where a test tells the time: work is counted."""
    own = Work.__post_init__

    def begun(work: Work) -> None:
        work.seconds = float("inf") if work.now is computing_s else work.seconds
        own(work)

    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(Work, "__post_init__", begun)
        yield
