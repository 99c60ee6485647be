"""The balance's Fourier coefficients are what they are by definition: sums over the samples, and parts integrated."""

from __future__ import annotations

from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from schwung.estimation.balance import _Spectrum


@pytest.mark.parametrize(("size", "step", "start_s"), [(860, 1, 0.0), (607, 3, 0.0), (500, 4, -0.2)])
def test_coefficients_are_sums(size: int, step: int, start_s: float) -> None:
    rate, random = 1000.0, np.random.default_rng(size)
    time = start_s + np.arange(size) / rate
    frequencies = np.fft.fftfreq(size, 1 / rate)[12:90]
    load: Any = SimpleNamespace(
        frequencies=frequencies, fade=np.sin(np.pi * np.linspace(0, 1, size)) ** 2, step=step
    )
    ripple: Any = SimpleNamespace(time_s=time, sample_rate_hz=rate)
    spectrum = _Spectrum.of(load, ripple)
    torque, momentum = (random.normal(size=(time[::step].size, 5)) + 0j for _ in range(2))
    s = 2j * np.pi * frequencies[:, None]
    kernel, fade = np.exp(-s * time[::step]), load.fade[::step]
    parts = kernel * (fade - np.gradient(fade, step / rate) / s)
    np.testing.assert_allclose(spectrum.over_s(torque), (kernel * fade / s) @ torque, rtol=1e-9, atol=1e-12)
    both = (kernel * fade / s) @ torque + parts @ momentum
    np.testing.assert_allclose(spectrum.over_s(torque, momentum), both, rtol=1e-9, atol=1e-9)
