"""The injected torque: a sine, or a periodic sum of sines, that fades in and out."""

from __future__ import annotations

from typing import Literal

import numpy as np
from numpy.typing import NDArray
from pydantic import BaseModel, ConfigDict, Field, FiniteFloat, model_validator

from schwung.motion.profiles import Array


class Excitation(BaseModel):
    """amplitude·sin(2πft + phase), t the run's time; as stored in a run's `excitation` attribute.

    `ramp_s`, `end_s`, `hold_s` and `settle_s` are Schwung's own additions: the amplitude rises as a raised cosine over
    `ramp_s` from t = 0 and falls likewise to zero at `end_s` (both absent: full amplitude throughout); each value is
    held for `hold_s`, as by a bus that sends one per SYNC (absent: a continuous sine). For `settle_s` after the ramp
    the axis is not expected to vibrate steadily.

    So is the waveform "multisine", for frequency responses: Σ amplitudes·sin(2π·frequencies·t + phases), where every
    frequency is a multiple of `frequency_hz`, one over the period, and `amplitude_nm` bounds the sum.

    `torque(time)` gives N·m at instants (s), shape (n,). Raises pydantic's ValidationError, a ValueError, for what is
    no excitation.

    >>> schwung.Excitation(frequency_hz=50.0, amplitude_nm=10.0).lines_hz
    array([50.])
    """

    model_config = ConfigDict(frozen=True, extra="allow")

    waveform: Literal["sine", "multisine"] = "sine"
    frequency_hz: float = Field(gt=0, allow_inf_nan=False)
    amplitude_nm: float = Field(gt=0, allow_inf_nan=False)
    phase_rad: float = Field(default=0.0, allow_inf_nan=False)
    ramp_s: float | None = Field(default=None, ge=0, allow_inf_nan=False)
    end_s: float | None = Field(default=None, ge=0, allow_inf_nan=False)
    hold_s: float | None = Field(default=None, gt=0, allow_inf_nan=False)
    settle_s: float | None = Field(default=None, ge=0, allow_inf_nan=False)
    frequencies_hz: tuple[FiniteFloat, ...] | None = None
    amplitudes_nm: tuple[FiniteFloat, ...] | None = None
    phases_rad: tuple[FiniteFloat, ...] | None = None

    @model_validator(mode="after")
    def _lines_are_whole(self) -> Excitation:
        if self.waveform == "sine":
            return self
        lines, amplitudes, phases = self.frequencies_hz, self.amplitudes_nm, self.phases_rad
        if not lines or not amplitudes or not phases or not len(lines) == len(amplitudes) == len(phases):
            raise ValueError("a multisine needs frequencies_hz, amplitudes_nm and phases_rad of one length")
        orders = np.array(lines) / self.frequency_hz
        if min(lines) <= 0 or np.any(np.abs(orders - np.rint(orders)) > 1e-6):
            raise ValueError("frequencies_hz of a multisine are positive multiples of frequency_hz")
        return self

    @property
    def lines_hz(self) -> Array:
        """Frequencies that are injected (Hz), (m,)."""
        return np.array(self.frequencies_hz if self.frequencies_hz else (self.frequency_hz,))

    @property
    def phasors_nm(self) -> NDArray[np.complex128]:
        """Amplitude and phase of each line, (m,) complex; `torque` is the real part of Σ phasor·exp(j2πft)."""
        if self.frequencies_hz and self.amplitudes_nm and self.phases_rad:
            amplitude, phase = np.array(self.amplitudes_nm), np.array(self.phases_rad)
        else:
            amplitude, phase = np.array([self.amplitude_nm]), np.array([self.phase_rad])
        return np.asarray(-1j * amplitude * np.exp(1j * phase))

    def envelope(self, time: Array) -> Array:
        """Share of the full amplitude at the given instants (s), (n,), 0…1."""
        if not self.ramp_s:
            return np.ones_like(time) if self.end_s is None else np.where(time < self.end_s, 1.0, 0.0)
        rise = np.clip(time / self.ramp_s, 0.0, 1.0)
        fall = 1.0 if self.end_s is None else np.clip((self.end_s - time) / self.ramp_s, 0.0, 1.0)
        return (1 - np.cos(np.pi * np.minimum(rise, fall))) / 2

    def torque(self, time: Array) -> Array:
        """Injected torque (N·m) at the given instants (s), (n,)."""
        if self.waveform == "multisine":
            turning = np.exp(2j * np.pi * np.multiply.outer(time, self.lines_hz))
            return self.envelope(time) * np.real(turning @ self.phasors_nm)
        sine = np.sin(2 * np.pi * self.frequency_hz * time + self.phase_rad)
        return self.amplitude_nm * self.envelope(time) * sine
