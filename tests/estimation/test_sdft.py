"""The sliding DFT: the paper's recursion for whole N, exact sines for any N, and no drift."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from schwung.errors import InputError
from schwung.estimation.sdft import samples_per_window, sliding_dft


def paper_recursion(values, window):
    """Equation 8 literally, X(n) = [X(n−1) − x(n−N) + x(n)]·e^{j2π/N}, k = 1, from rest; amplitude 2|X|/N."""
    padded, state, amplitude = np.concatenate([np.zeros(window), values]), 0j, []
    for n in range(window, padded.size):
        state = (state - padded[n - window] + padded[n]) * np.exp(2j * np.pi / window)
        amplitude.append(2 * abs(state) / window)
    return np.array(amplitude)


@pytest.mark.parametrize(
    ("rate", "frequency"), [(4000.0, 50.0), (1000.0, 50.0), (8000.0, 100.0), (400.0, 50.0)]
)
def test_whole_windows_are_equation_8(rate, frequency):
    values = np.random.default_rng(0).normal(size=700).cumsum()
    spectrum = sliding_dft(values, np.arange(700) / rate, rate, frequency)
    window = round(rate / frequency)
    assert spectrum.window == window
    np.testing.assert_allclose(
        np.abs(spectrum.phasor[window - 1 :]),
        paper_recursion(values, window)[window - 1 :],
        rtol=1e-8,
        atol=1e-9,
    )
    assert np.isnan(spectrum.phasor[: window - 1]).all()


@given(
    samples_per_period=st.floats(8.6, 120.0),
    amplitude=st.floats(1e-3, 1e3),
    phase=st.floats(-np.pi, np.pi),
    offset=st.floats(-1e4, 1e4),
    start=st.floats(0.0, 100.0),
)
def test_a_sine_on_a_constant_is_exact_for_any_number_of_samples(
    samples_per_period, amplitude, phase, offset, start
):
    rate = 1000.0
    frequency = rate / samples_per_period
    time = start + np.arange(400) / rate
    values = offset + amplitude * np.cos(2 * np.pi * frequency * time + phase)
    spectrum = sliding_dft(values, time, rate, frequency)
    good = slice(spectrum.window - 1, None)
    scale = amplitude + 1e-9 * abs(offset)
    np.testing.assert_allclose(
        spectrum.phasor[good], amplitude * np.exp(1j * phase), atol=1e-8 * scale * (1 + start)
    )
    np.testing.assert_allclose(spectrum.mean[good], offset, atol=1e-7 * (scale + abs(offset)))
    assert np.all(spectrum.residual[good] < 1e-6 * (amplitude + abs(offset)))


def test_ratio_of_two_signals_keeps_phase():
    time = np.arange(300) / 1000
    first = sliding_dft(np.sin(2 * np.pi * 47 * time), time, 1000.0, 47.0)
    second = sliding_dft(3 * np.sin(2 * np.pi * 47 * time - 0.7), time, 1000.0, 47.0)
    np.testing.assert_allclose(second.phasor[30:] / first.phasor[30:], 3 * np.exp(-0.7j), rtol=1e-10)


def test_harmonics_and_constant_are_rejected_for_whole_windows():
    """The comb's zeros (Fig. 4): DC and every multiple of f but f itself."""
    time = np.arange(400) / 4000
    values = 5 + sum(np.cos(2 * np.pi * 50 * order * time + order) for order in (2, 3, 5, 10))
    assert np.nanmax(np.abs(sliding_dft(values, time, 4000.0, 50.0).phasor)) < 1e-12


def test_nothing_drifts_over_a_long_recording():
    """A disturbance long gone leaves no trace; equation 8's recursion would carry its rounding on."""
    time = np.arange(200_000) / 1000
    values = np.sin(2 * np.pi * 50 * time)
    values[:1000] += 1e12
    spectrum = sliding_dft(values, time, 1000.0, 50.0)
    level_error = 1e12 * 1e-15  # rounding of the mean that is taken off
    np.testing.assert_allclose(np.abs(spectrum.phasor[-1000:]), 1.0, atol=level_error)


def test_residual_is_the_noise():
    rng = np.random.default_rng(3)
    time = np.arange(20_000) / 4000
    spectrum = sliding_dft(
        np.sin(2 * np.pi * 50 * time) + 0.1 * rng.normal(size=time.size), time, 4000.0, 50.0
    )
    assert np.sqrt(np.nanmean(spectrum.residual**2)) == pytest.approx(0.1, rel=0.02)
    error = np.abs(spectrum.phasor[79:] - np.exp(-0.5j * np.pi))
    assert np.sqrt(np.mean(error**2) / 2) == pytest.approx(0.1 * np.sqrt(2 / 80), rel=0.1)


def test_too_few_samples_are_named():
    with pytest.raises(InputError, match=r"5 samples per period of 200 Hz.*1600 Hz or faster"):
        samples_per_window(1000.0, 200.0)
    with pytest.raises(InputError, match="shorter than a period"):
        sliding_dft(np.zeros(10), np.arange(10) / 1000, 1000.0, 50.0)
    for nonsense in (0.0, -1.0, np.nan, np.inf):
        with pytest.raises(InputError, match="frequency"):
            samples_per_window(1000.0, nonsense)
