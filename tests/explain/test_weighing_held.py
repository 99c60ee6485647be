"""Injections that a bus sends once a sample, and drives that take them some ticks later."""

import sys
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

sys.path.append(str(Path(__file__).parents[2] / "benchmarks"))
from stranger_plant import draw_stranger, stranger_belief, stranger_session

from schwung.explain.weighing.further import within
from schwung.explain.weighing.round import Linearised, linearised
from schwung.explain.weighing.weigh import Posterior, posterior_of


def weighed(seed: int, late: int) -> Posterior:
    """Of a stranger that logs every eighth tick, and takes what is sent with a log's sample so many ticks later."""
    stranger = replace(draw_stranger(seed, every=8), held_late=late)
    return posterior_of(stranger_session(stranger, seed), stranger_belief(stranger))


@pytest.fixture(scope="module")
def late_by_half() -> Posterior:
    """By half a step; the belief's load is a third off."""
    return weighed(606, 4)


def sure(found: Posterior) -> list[str]:
    assert not [one for one in found.told.unnamed if one.probability > 0.5]
    return [one.name for one in found.told.names if one.probability > 0.5]


def taken(found: Posterior) -> float:
    """In ticks after the sample whose injection it is taken for."""
    return 8 * found.grown.climbed.at.about.alongs[1].beyond.held_late


@pytest.mark.long
def test_what_is_taken_late_is_no_damping(late_by_half: Posterior) -> None:
    """Its corners lie within the steps, where samples do not show them: a coupling's damping or stiffness a few per
    cent off says the same of them."""
    assert sure(late_by_half) == ["load_inertia"]
    assert taken(late_by_half) == pytest.approx(4, abs=0.7)


@pytest.mark.long
def test_from_a_belief_that_is_far_off_another_share_of_the_step_is_likelier() -> None:
    """Begun from what the belief alone makes likely, it came to rest at 0.8 of a step."""
    found = weighed(607, 3)
    assert sure(found) == ["inertia_profile"]
    assert taken(found) == pytest.approx(3, abs=0.7)


@pytest.mark.long
def test_what_is_taken_more_than_a_step_late_is_no_stiffness() -> None:
    """A drive may answer a PDO after more than one SYNC: what is the injection's of the reported torque was sent a
    sample before. It was a stiffness and a torque constant (0.98, 0.90)."""
    found = weighed(606, 12)
    assert sure(found) == ["load_inertia"]
    assert taken(found) == pytest.approx(12 - 8, abs=0.7)


@pytest.mark.long
def test_no_step_leads_past_a_sample(late_by_half: Posterior) -> None:
    """The slope on its other side is another: of a bench that takes what is sent with the very SYNC, one half of all
    steps led past it, and a set that no further step should change still promised 5 (log)."""
    (hold,) = (m for m in late_by_half.grown.climbed.at.members if m.candidate.holds)
    places = [0.3]
    for asked in (0.2, -0.2, -0.2, -0.2, 0.1, 0.1, 0.1):
        (place,) = within(replace(hold, coefficients=np.array(places[-1:])), np.array([asked]))
        places.append(float(place))
    assert places == pytest.approx([0.3, 0.2, 1e-6, -1e-6, -0.2, -1e-6, 1e-6, 0.1])


@pytest.mark.long
@pytest.mark.parametrize(
    ("share", "low", "high"),
    [(-1e-6, -2e-3, -1e-6), (0.0, 0.0, 2e-3), (0.3, 0.299, 0.301), (0.8, 0.799, 0.801)],
)
def test_where_in_the_step_it_is_taken_has_the_right_slope(
    late_by_half: Posterior, share: float, low: float, high: float
) -> None:
    """A speed that is late, as any is, shows the corners a little later: without that the line led the other way. At a
    sample there are two slopes: taken before it, it has moved what is measured there."""
    at, noise, run = late_by_half.grown.climbed.at, late_by_half.growth.rests.wide.noise, 1
    (hold,) = (m for m in at.members if m.candidate.holds)
    (both,) = (m for m in at.members if all(m.candidate.late))

    def about(where: float) -> Linearised:
        have = {hold.candidate.name: where, both.candidate.name: 4e-4}
        coefficients = (have.get(m.candidate.name, m.coefficients) for m in at.members)
        members = [
            replace(m, coefficients=np.atleast_1d(c)) for m, c in zip(at.members, coefficients, strict=True)
        ]
        return linearised(at.about.view, members, noise, None, [run])

    line = about(share).whitened([(hold.candidate, hold.shape)], [run])[0].copy()
    change = (about(high).innovations([run]) - about(low).innovations([run])) / (high - low)
    assert -line == pytest.approx(change, abs=0.02 * np.max(np.abs(change)))
