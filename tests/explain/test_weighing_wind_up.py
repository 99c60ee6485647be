"""A coupling whose torque follows its wind-up in a way that has no name: a curve, in the file, and known from there."""

from dataclasses import replace

import numpy as np
import pytest
from sealed_sessions import fewer
from strangers import STIFFNESS, STRANGERS, belief_of, session_of

from schwung.drivetrain.residual import residuals_of
from schwung.explain.causes.candidate import LADDER
from schwung.explain.publishing.publish import publish, published_of
from schwung.explain.weighing.exchange import resized
from schwung.explain.weighing.sets import members_of
from schwung.explain.weighing.weigh import posterior_of
from schwung.explain.weighing.work import Work

SOFT = next(one for one in STRANGERS if one.yields[0])


@pytest.fixture(scope="module")
def session():
    return fewer(session_of(SOFT, 5, every=8, times=(0.25, 0.4)), 1)


@pytest.fixture(scope="module")
def posterior(session):
    return posterior_of(session, belief_of(SOFT), work=Work(most=1e9))


@pytest.fixture(scope="module")
def found(session, posterior):
    return published_of(session, belief_of(SOFT), posterior)


@pytest.mark.long
def test_it_is_a_curve_over_the_wind_up_and_nothing_else(found):
    """Two straight lines, or a law that hardens otherwise, were nothing, a motor inertia, or four other things."""
    (curve,) = (one for one in found.curves if one.probability > 0.5)
    assert curve.coordinate == "wind_up"
    assert not [one.physics for one in found.names if one.probability > 0.5]
    assert found.proof is not None
    assert found.proof.before > 4
    assert found.proof.after < 1.15
    assert "over the coupling's wind-up" in found.headline


@pytest.mark.long
@pytest.mark.parametrize("scale", [LADDER[0], LADDER[-1]])
def test_it_is_as_large_as_the_evidence_has_it(posterior, scale):
    """Of another size, whatever was asked beside it had what that gains: 75 nats of a load event of 0 N·m."""
    grown = posterior.grown
    rests = grown.growth.rests
    search, picks = grown.search, grown.best.picks
    assert "wind_up" in map(search.name, picks)
    wrong = search.score(
        tuple(replace(one, scale=scale) if search.name(one) == "wind_up" else one for one in picks)
    )
    at = rests.settled(grown.climbed.at.about.view, members_of(search, wrong, rests.candidates))
    one, rested = resized(rests, search, wrong, at)
    assert one.picks == picks
    assert rested.log > at.log + 1.0


@pytest.mark.long
def test_its_file_says_how_the_coupling_gives_way(found):
    (curve,) = residuals_of(found.machine.physics).values()
    assert curve.over == "wind_up"
    wound = np.linspace(-1.2e-3, 1.2e-3, 9)
    share, width = SOFT.yields
    lost = -STIFFNESS * share * width * np.tanh(wound / width)
    told = curve.at(wound, np.ones_like(wound))
    # the plant's own wind-up is what acts, and a constant torque between the shafts is where the load stands
    assert np.diff(told) == pytest.approx(np.diff(lost), abs=0.05 * np.ptp(lost))


@pytest.mark.long
def test_the_learned_file_leaves_nothing_out(session, found):
    again = publish(session, found.machine)
    assert again.verdict == "consistent"
