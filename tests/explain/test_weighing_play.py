"""Play: what a contact does within a step, and the gap that a machine with a rounded dead zone shows."""

import numpy as np
import pytest
from strangers import NOISE, Stranger, belief_of, session_of

from schwung.explain.causes.along import ranges_of
from schwung.explain.causes.known import known
from schwung.explain.causes.third_mass import third_mass
from schwung.explain.causes.true_torque import TrueTorque
from schwung.explain.causes.vocabulary import vocabulary
from schwung.explain.weighing.round import View
from schwung.explain.weighing.sets import absent
from schwung.explain.weighing.settling import Weighing, settled, settled_beyond
from schwung.innovations.likelihood import Noise
from schwung.innovations.signals import signals_of


def test_a_further_mass_answers_a_sine_as_its_frequency_response_says():
    """H = (2ζω₃ s + ω₃²)/(s² + 2ζω₃ s + ω₃²), however coarse the samples."""
    rate, ratio, step = 2 * np.pi * 50.0, 0.05, 1e-3
    time, s = np.arange(4000) * step, 2j * np.pi * 43.0
    answer = (2 * ratio * rate * s + rate**2) / (s**2 + 2 * ratio * rate * s + rate**2)
    swung = third_mass(np.sin(abs(s) * time), rate, ratio, step)[-500:]
    expected = np.imag(answer * np.exp(s * time[-500:]))
    np.testing.assert_allclose(swung, expected, atol=0.01 * abs(answer))


def test_a_gap_comes_to_rest_where_it_is():
    """The dead zone that is hidden has round corners, (gap/2) tanh(2 φ/gap)."""
    gap, stranger = 2e-4, Stranger("play with round corners", ("backlash",), gap=2e-4)
    session, machine = session_of(stranger, 5, every=8, times=(0.25,)), belief_of(stranger)
    runs = [signals_of(run, machine, 160.0, 0.0) for run in session.runs]
    of = ranges_of(runs, 0.002, 160.0)
    torques = tuple(TrueTorque(run, run.drive.whole_nm) for run in runs)
    view = View(session.runs, tuple(runs), known(machine, of.low_rad, of.high_rad), of, torques, dry_nm=0.0)
    causes = vocabulary(of, view.known)
    play = next(one for one in causes if one.name == "backlash")
    usual = [absent(one) for one in causes if one.name.startswith("usual")]
    noise = Noise(torque_nm=NOISE[2], speed_rad_s=NOISE[1], position_rad=NOISE[0])
    without_play = settled(view, usual, Weighing(noise, range(len(runs)), 1.0))
    promised = [*(m.coefficients for m in usual), np.zeros(play.size)]
    at = settled_beyond(
        without_play.about,
        [*without_play.members, absent(play)],
        promised,
        Weighing(noise, range(len(runs)), 1.0),
    )
    assert at.members[-1].coefficients[0] == pytest.approx(gap, rel=0.25)
    assert at.log > without_play.log + 1000
