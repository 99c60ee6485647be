"""The proposal of frequency and amplitude: each cause where it should bite."""

from dataclasses import replace
from functools import cache

import numpy as np
import pytest

from schwung.drivetrain import Control, paper_machine
from schwung.drivetrain.response import injection_to_speed, torque_to_speed
from schwung.errors import InputError
from schwung.estimation.bode import fit_bode
from schwung.estimation.proposal import MAX_DEVIATION_RAD, Stroke, motion_torque_nm, propose
from schwung.estimation.response import Response

GAINS = Control(
    position_gain_per_s=60.0, speed_gain_nms=7.0, speed_integral_time_s=20e-3, sample_rate_hz=8000.0
)
MACHINE = paper_machine().model_copy(update={"control": GAINS})


@cache
def _fit(noise=1e-3):
    """Paper's machine at two angles, one per cent of noise in the response, `noise` rad/s in one second's phasor."""
    rng, f = np.random.default_rng(0), np.geomspace(8, 400, 40)
    responses = []
    for angle, load in ((0.0, 0.055), (np.pi / 2, 0.16)):
        exact = torque_to_speed(MACHINE, load, f)
        std = 0.01 * np.abs(exact)
        error = std * (rng.normal(size=40) + 1j * rng.normal(size=40)) / np.sqrt(2)
        ones = np.ones(40)
        responses.append(
            Response(angle, f, exact + error, std, ones, 0j * ones, noise * ones, 1000.0, None, 8)
        )
    return fit_bode(responses)


def _proposed(stroke=None, noise=1e-3, **options):
    return propose(_fit(noise), MACHINE, 1000.0, stroke=stroke, **options)


def test_every_candidate_has_a_whole_number_of_samples_and_the_best_is_the_least():
    found = _proposed(Stroke(np.pi, 0.25))
    for candidate in found.candidates:
        assert candidate.samples >= 10
        assert candidate.samples * candidate.frequency_hz == pytest.approx(1000.0)
    assert found.best.relative == min(c.relative for c in found.candidates)
    assert any("samples a period" in reason for reason in found.reasons)


def test_a_faster_motion_wants_a_higher_frequency_and_noise_a_lower_one():
    slow, fast = _proposed(Stroke(np.pi, 2.0), 0.05), _proposed(Stroke(np.pi, 0.2), 0.05)
    assert fast.best.frequency_hz > 1.5 * slow.best.frequency_hz
    noisy = _proposed(Stroke(np.pi, 0.5), 0.5)
    quiet = _proposed(Stroke(np.pi, 0.5), 0.005)
    assert noisy.best.frequency_hz < quiet.best.frequency_hz


def test_noise_is_what_the_inversion_makes_of_it():
    """By hand: a phasor's error over one period, over the gain's slope and the torque, worst angle."""
    candidate = next(c for c in _proposed().candidates if c.samples == 20)
    f, j = candidate.frequency_hz, candidate.inertia_kgm2
    slope = (torque_to_speed(MACHINE, j * 1.001, f) - torque_to_speed(MACHINE, j * 0.999, f)) / (0.002 * j)
    speed = abs(injection_to_speed(MACHINE, j, f)) * candidate.amplitude_nm
    torque = speed / abs(torque_to_speed(MACHINE, j, f))
    assert candidate.noise_kgm2 == pytest.approx(1e-3 * np.sqrt(f) / abs(slope) / torque, rel=1e-3)


def test_the_amplitude_keeps_the_axis_where_it_is_and_leaves_the_motion_its_torque():
    low = _proposed().candidates[-1]
    assert low.deviation_rad == pytest.approx(MAX_DEVIATION_RAD, rel=1e-6)
    assert low.amplitude_nm < 0.2 * 233
    roomy, hasty = _proposed(Stroke(np.pi, 0.5)), _proposed(Stroke(np.pi, 0.11))
    assert roomy.best.amplitude_nm == pytest.approx(0.2 * 233)
    assert hasty.best.amplitude_nm < roomy.best.amplitude_nm
    assert motion_torque_nm(_fit(), MACHINE, Stroke(np.pi, 0.11)) > 0.8 * 233
    narrow = _proposed(Stroke(np.pi, 0.5, room_rad=1e-4))
    assert narrow.best.deviation_rad <= 1e-4 * (1 + 1e-9)
    assert _proposed(torque_max_nm=50.0).best.amplitude_nm <= 10.0


def test_an_uncertain_stiffness_counts_where_the_gain_depends_on_it():
    fit = _fit()
    vague = replace(fit, stiffness=replace(fit.stiffness, std=0.1 * fit.stiffness.value))
    sure, unsure = (propose(f, MACHINE, 1000.0).candidates for f in (fit, vague))
    assert unsure[0].model_kgm2 > 5 * sure[0].model_kgm2  # 100 Hz, about the anti-resonances
    slowest = unsure[-1]
    assert slowest.model_kgm2 / slowest.inertia_kgm2 < unsure[0].model_kgm2 / unsure[0].inertia_kgm2


def test_without_gains_or_frequencies_there_is_no_proposal():
    with pytest.raises(InputError, match="control"):
        propose(_fit(), paper_machine().model_copy(update={"control": None}), 1000.0)
    with pytest.raises(InputError, match="samples a period"):
        propose(_fit(), MACHINE, 50.0)


def test_four_phases_need_not_fear_the_window_but_want_samples():
    found = _proposed(Stroke(np.pi, 0.15))
    phased = found.in_phases
    assert phased.samples >= 16
    assert phased.frequency_hz < found.best.frequency_hz
    for other in found.candidates:
        if other.samples >= 16:
            assert np.hypot(phased.noise_kgm2, phased.model_kgm2) / phased.inertia_kgm2 <= (
                np.hypot(other.noise_kgm2, other.model_kgm2) / other.inertia_kgm2
            )
    assert found.to_json()["in_phases"]["frequency_hz"] == phased.frequency_hz
    crowded = replace(found, candidates=tuple(c for c in found.candidates if c.samples < 16))
    assert crowded.in_phases == found.best
