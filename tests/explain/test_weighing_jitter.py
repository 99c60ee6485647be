"""Samples that are taken early or late: noise that grows with the speed, and no physics."""

from dataclasses import replace

import numpy as np
import pytest
from scipy.interpolate import CubicSpline
from strangers import STRANGERS, belief_of, session_of

from schwung.explain.publishing.publish import publish


def taken_unevenly(session, deviation_s, seed=3):
    """The same with every sample taken a little early or late, and reported as if it was not."""
    chance, runs = np.random.default_rng(seed), []
    for run in session.runs:
        at = np.clip(
            run.time_s + deviation_s * chance.standard_normal(len(run)), run.time_s[0], run.time_s[-1]
        )
        position, speed, torque = (
            CubicSpline(run.time_s, values)(at)
            for values in (run.position_rad, run.speed_rad_s, run.torque_nm)
        )
        runs.append(replace(run, position_rad=position, speed_rad_s=speed, torque_nm=torque))
    return replace(session, runs=tuple(runs))


@pytest.mark.long
@pytest.mark.parametrize("deviation_s", [0.0, 12e-6])
def test_uneven_sampling_is_noise_of_its_own(deviation_s):
    """As one noise of the angle for rest and motion alike, fast runs kept aside missed 1.2 times as much."""
    session = taken_unevenly(session_of(STRANGERS[0], 5, every=4, times=(0.25, 0.4)), deviation_s)
    found = publish(session, belief_of(STRANGERS[0]))
    assert not [one for one in found.names if one.probability > 0.5]
    assert found.noise.jitter_s == pytest.approx(deviation_s, rel=0.1)
    assert found.noise.position_rad < 1e-5
    assert found.proof is not None
    assert found.proof.after < 1.02
