"""Play: what a contact does within a step, and the gap that a machine with a rounded dead zone shows."""

from dataclasses import replace

import numpy as np
import pytest
from stranger_plant import draw_stranger, stranger_belief, stranger_session
from strangers import NOISE, Stranger, belief_of, session_of

from schwung.drivetrain.machine import Machine
from schwung.explain.causes.along import ranges_of
from schwung.explain.causes.candidate import Candidate
from schwung.explain.causes.known import known
from schwung.explain.causes.third_mass import third_mass
from schwung.explain.causes.true_torque import TrueTorque
from schwung.explain.causes.vocabulary import vocabulary
from schwung.explain.weighing.round import View
from schwung.explain.weighing.sets import absent
from schwung.explain.weighing.settling import Settled, Weighing, settled, settled_beyond, smoothed
from schwung.innovations.likelihood import Noise
from schwung.innovations.signals import signals_of
from schwung.session.model import Session


def test_a_further_mass_answers_a_sine_as_its_frequency_response_says():
    """H = (2ζω₃ s + ω₃²)/(s² + 2ζω₃ s + ω₃²), however coarse the samples."""
    rate, ratio, step = 2 * np.pi * 50.0, 0.05, 1e-3
    time, s = np.arange(4000) * step, 2j * np.pi * 43.0
    answer = (2 * ratio * rate * s + rate**2) / (s**2 + 2 * ratio * rate * s + rate**2)
    swung = third_mass(np.sin(abs(s) * time), rate, ratio, step)[-500:]
    expected = np.imag(answer * np.exp(s * time[-500:]))
    np.testing.assert_allclose(swung, expected, atol=0.01 * abs(answer))


def _seen(session: Session, machine: Machine) -> tuple[View, list[Candidate]]:
    """A session before anything is known of it, and what may act."""
    runs = [signals_of(run, machine, 160.0, 0.0) for run in session.runs]
    of = ranges_of(runs, 0.002, 160.0)
    torques = tuple(TrueTorque(run, run.drive.whole_nm) for run in runs)
    view = View(session.runs, tuple(runs), known(machine, of.low_rad, of.high_rad), of, torques, dry_nm=0.0)
    return view, vocabulary(of, view.known)


def _with_play(view: View, before: Settled, play: Candidate, weighing: Weighing) -> Settled:
    """At rest with play as well, which is shut where it begins."""
    members = [*before.members, absent(play)]
    about = smoothed(before.about.view, members, weighing)
    return settled_beyond(about, members, [m.coefficients for m in members], weighing)


def test_a_gap_comes_to_rest_where_it_is():
    """The dead zone that is hidden has round corners, (gap/2) tanh(2 φ/gap)."""
    gap, stranger = 2e-4, Stranger("play with round corners", ("backlash",), gap=2e-4)
    view, causes = _seen(session_of(stranger, 5, every=8, times=(0.25,)), belief_of(stranger))
    play = next(one for one in causes if one.name == "backlash")
    usual = [absent(one) for one in causes if one.name.startswith("usual")]
    noise = Noise(torque_nm=NOISE[2], speed_rad_s=NOISE[1], position_rad=NOISE[0])
    weighing = Weighing(noise, range(len(view.runs)), 1.0)
    without_play = settled(view, usual, weighing)
    at = _with_play(view, without_play, play, weighing)
    assert at.members[-1].coefficients[0] == pytest.approx(gap, rel=0.25)
    assert at.log > without_play.log + 1000


def test_a_gap_beside_a_weight_is_found_between_gaps_that_are_worse_than_none():
    """The load is pressed to one side and thrown to the other: half decades of gaps stepped over the one that is there,
    and a soft coupling with curves was published in its place. What is believed of this load is a third off."""
    stranger = draw_stranger(704, every=8)
    wound = stranger.amplitude_nm / stranger.shaft.stiffness
    shaft = replace(stranger.shaft, gap=1.2 * wound, weight=0.6 * stranger.amplitude_nm)
    session = stranger_session(replace(stranger, shaft=shaft), 704)
    view, causes = _seen(session, stranger_belief(stranger))
    play, load = (next(one for one in causes if one.name == name) for name in ("backlash", "load_torque"))
    noise = Noise(torque_nm=1e-3, speed_rad_s=1e-3, position_rad=stranger.loop.count_rad / np.sqrt(12))
    weighing = Weighing(noise, range(len(view.runs)), 1.0)
    usual = [absent(one) for one in causes if one.name.startswith("usual")]
    without_play = settled(view, [*usual, absent(load)], weighing)
    at = _with_play(view, without_play, play, weighing)
    assert at.members[-1].coefficients[0] == pytest.approx(shaft.gap, rel=0.5)
    assert at.log > without_play.log + 1000
