"""What is heard of a smoothed signal, and what its noise alone is."""

from dataclasses import replace

import numpy as np
from strangers import STRANGERS, belief_of, session_of

from schwung.explain.causes.along import ranges_of
from schwung.explain.causes.equations import Acting, equations_of
from schwung.explain.causes.known import known
from schwung.explain.causes.true_torque import TrueTorque
from schwung.explain.weighing import round as rounds
from schwung.innovations.effect import Passed
from schwung.innovations.likelihood import Noise
from schwung.innovations.low_pass import heard, loudness, low_passed, surely_heard
from schwung.innovations.signals import signals_of

NOISE = Noise(0.05, 1e-2, 2e-6, 0.01)


def test_states_of_a_run_are_those_without_noise_and_those_of_noise() -> None:
    session, machine = session_of(STRANGERS[0], 5, every=8, times=(0.25,)), belief_of(STRANGERS[0])
    run = signals_of(session.runs[0], machine, 160.0, 0.0)
    of = ranges_of([run], 0.002, 160.0)
    torques = (TrueTorque(run, run.drive.smooth_nm),)
    view = rounds.View(session.runs[:1], (run,), known(machine, of.low_rad, of.high_rad), of, torques)
    equations, steps = equations_of(view.alongs(())[0], Acting(), NOISE)
    run = view.runs[0]
    clean = Passed.of(equations, steps, NOISE, run)
    noise = clean.of_noise(NOISE, run, np.random.default_rng(3))

    chance, count = np.random.default_rng(3), run.time_s.size
    torque = chance.standard_normal(count) * np.hypot(NOISE.torque_nm, NOISE.torque_share * run.load_nm)
    measured = chance.standard_normal((count, 2)) * [NOISE.position_rad, NOISE.speed_rad_s]
    acts = (steps.inputs[:, :, 0].T * torque[:-1] + steps.inputs[:, :, 2].T * torque[1:]).T
    forcing = equations.forcing + np.pad(acts, ((0, 0), (0, 1)))
    noisy = replace(equations, forcing=forcing, measured=equations.measured + measured)
    change = Passed.of(noisy, steps, NOISE, run).states - clean.states
    # angles of radians are smoothed, of which this is the last of sixteen digits
    np.testing.assert_allclose(change[:, 1:], noise.states[:, 1:], atol=1e-8 * np.max(np.abs(clean.states)))


def test_a_regressor_that_is_heard_does_not_meet_its_own_noise() -> None:
    """Of a line at 50 Hz in four times as much noise below 160 Hz, which what is explained holds, too."""
    step, count = 1e-3, 4000
    chance, edge = np.random.default_rng(4), 2 * 160.0 * step
    line = np.sqrt(2) * np.sin(2 * np.pi * 50.0 * step * np.arange(count))
    noise, alike = (4 * low_passed(chance.standard_normal(count), edge, 4) / 0.57 for _ in range(2))
    regressor = heard(line + noise, loudness(alike))
    # power about a frequency is known to √(2/15), its noise's to √(2/31): what is above it is 0.17 on average
    assert abs(float(regressor @ noise)) < 0.25 * abs(float((line + noise) @ noise))
    assert float(regressor @ line) > 0.5 * float(line @ line)
    np.testing.assert_allclose(heard(line, 1e-9), line, atol=1e-6)


def test_of_what_is_only_noise_next_to_nothing_is_surely_heard() -> None:
    """A loud slow signal: beyond it, averages that are above the noise by chance keep 0.15 of it."""
    count, kept = 4000, []
    slow = 10 * np.sin(2 * np.pi * 3.0 * np.arange(count) / count) ** 3
    for number in range(8):
        noise = np.random.default_rng(number).standard_normal(count)
        kept.append(
            [float((each(slow + noise, 1.0) - slow) @ noise) / count for each in (heard, surely_heard)]
        )
    likely, surely = np.mean(kept, axis=0)
    assert likely > 0.1
    assert surely < 0.07
    np.testing.assert_allclose(surely_heard(slow, 1e-9), slow, atol=1e-6)
