"""Injections that a bus sends once a sample, and drives that take them some ticks later."""

import sys
from dataclasses import replace
from pathlib import Path

import pytest

sys.path.append(str(Path(__file__).parents[2] / "benchmarks"))
from stranger_plant import draw_stranger, stranger_belief, stranger_session

from schwung.explain.weighing.weigh import posterior_of


@pytest.mark.parametrize(("seed", "late"), [(607, 3), (606, 4)])
def test_what_is_taken_late_is_no_damping(seed: int, late: int) -> None:
    """Its corners lie within the steps, where samples do not show them: a coupling's damping or stiffness a few per
    cent off says the same of them. The belief's load is a third off."""
    stranger = replace(draw_stranger(seed, every=8), held_late=late)
    found = posterior_of(stranger_session(stranger, seed), stranger_belief(stranger))
    sure = [one.name for one in found.told.names if one.probability > 0.5]
    assert sure in (["inertia_profile"], ["load_inertia"])
    assert not [one for one in found.told.unnamed if one.probability > 0.5]
    taken = found.grown.climbed.at.about.alongs[1].held_late
    assert taken * stranger.every == pytest.approx(late, abs=0.7)
