"""The injected torque: a sine that fades in before the motion and out after it."""

from __future__ import annotations

from typing import Literal

import numpy as np
from pydantic import BaseModel, ConfigDict, Field

from schwung.motion.profiles import Array


class Excitation(BaseModel):
    """amplitude·sin(2πft + phase), t the run's time; as stored in a run's `excitation` attribute.

    `ramp_s`, `end_s` and `hold_s` are Schwung's own additions: the amplitude rises as a raised cosine over `ramp_s`
    from t = 0 and falls likewise to zero at `end_s` (both absent: full amplitude throughout); each value is held for
    `hold_s`, as by a bus that sends one per SYNC (absent: a continuous sine).
    """

    model_config = ConfigDict(frozen=True, extra="allow")

    waveform: Literal["sine"] = "sine"
    frequency_hz: float = Field(gt=0, allow_inf_nan=False)
    amplitude_nm: float = Field(gt=0, allow_inf_nan=False)
    phase_rad: float = Field(default=0.0, allow_inf_nan=False)
    ramp_s: float | None = Field(default=None, ge=0, allow_inf_nan=False)
    end_s: float | None = Field(default=None, ge=0, allow_inf_nan=False)
    hold_s: float | None = Field(default=None, gt=0, allow_inf_nan=False)

    def envelope(self, time: Array) -> Array:
        """Share of the full amplitude at the given instants (s), (n,), 0…1."""
        if not self.ramp_s:
            return np.ones_like(time) if self.end_s is None else np.where(time < self.end_s, 1.0, 0.0)
        rise = np.clip(time / self.ramp_s, 0.0, 1.0)
        fall = 1.0 if self.end_s is None else np.clip((self.end_s - time) / self.ramp_s, 0.0, 1.0)
        return (1 - np.cos(np.pi * np.minimum(rise, fall))) / 2

    def torque(self, time: Array) -> Array:
        """Injected torque (N·m) at the given instants (s), (n,)."""
        sine = np.sin(2 * np.pi * self.frequency_hz * time + self.phase_rad)
        return self.amplitude_nm * self.envelope(time) * sine
