"""What a sealed session commands: rest-to-rest runs, out and back, with an injected sine or without."""

from __future__ import annotations

import json
from collections.abc import Callable, Mapping
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from schwung_sim.plants import TICK_S

Array = NDArray[np.float64]


def _third(u: Array) -> Array:
    """A third each of constant acceleration, constant speed and braking."""
    braking = 1 - 2.25 * (1 - u) ** 2
    return np.where(u < 1 / 3, 2.25 * u**2, np.where(u < 2 / 3, 0.25 + 1.5 * (u - 1 / 3), braking))


def _poly5(u: Array) -> Array:
    """Fifth order, at rest with no acceleration at both ends."""
    return np.asarray(u**3 * (10 - 15 * u + 6 * u**2))


def _cosine(u: Array) -> Array:
    """Half a cosine."""
    return np.asarray((1 - np.cos(np.pi * u)) / 2)


def _scurve(u: Array) -> Array:
    """As `_third`, each acceleration a sine-squared bump: ∬ 9 sin²(3πu)."""
    w = 6 * np.pi

    def bump(v: Array) -> Array:
        return np.asarray(4.5 * (v**2 / 2 + (np.cos(w * v) - 1) / w**2))

    return bump(np.minimum(u, 1 / 3)) + 1.5 * np.maximum(u - 1 / 3, 0) - bump(np.maximum(u - 2 / 3, 0))


STROKES: Mapping[str, Callable[[Array], Array]] = {
    "third": _third, "poly5": _poly5, "scurve": _scurve, "cosine": _cosine,
}  # fmt: skip


@dataclass(frozen=True)
class Stroke:
    """Rest, move by `distance_rad` (signed) in `duration_s`, rest, move back, rest."""

    kind: str
    distance_rad: float
    duration_s: float
    start_time_s: float
    dwell_s: float

    @property
    def total_s(self) -> float:
        """Length of a run."""
        return self.start_time_s + 2 * (self.duration_s + self.dwell_s)

    @property
    def time_s(self) -> Array:
        """The control ticks of a run (s), (m,)."""
        return np.arange(round(self.total_s / TICK_S), dtype=float) * TICK_S

    def demand_rad(self) -> Array:
        """Demanded angle at the control ticks, (m,)."""
        shape = STROKES[self.kind]
        there, back = (np.clip((self.time_s - begin) / self.duration_s, 0.0, 1.0) for begin in self._begins)
        return np.asarray(self.distance_rad * (shape(there) - shape(back)))

    def moving(self) -> NDArray[np.bool_]:
        """The control ticks within a stroke, (m,)."""
        t = self.time_s
        return np.asarray(
            np.any([(t >= begin) & (t <= begin + self.duration_s) for begin in self._begins], axis=0)
        )

    @property
    def _begins(self) -> tuple[float, float]:
        return self.start_time_s, self.start_time_s + self.duration_s + self.dwell_s

    def json(self) -> str:
        """The run's `motion` attribute."""
        return json.dumps(
            {
                "kind": self.kind,
                "distance_rad": self.distance_rad,
                "duration_s": self.duration_s,
                "start_time_s": self.start_time_s,
                "returns": True,
                "dwell_s": self.dwell_s,
            }
        )


@dataclass(frozen=True)
class Injection:
    """A sine of the run's time that fades in over `ramp_s` and out before `end_s`."""

    frequency_hz: float
    amplitude_nm: float
    phase_rad: float
    ramp_s: float
    end_s: float

    def torque_nm(self, time_s: Array) -> Array:
        """Injected torque, (m,)."""
        share = np.clip(np.minimum(time_s, self.end_s - time_s) / self.ramp_s, 0.0, 1.0)
        sine = np.sin(2 * np.pi * self.frequency_hz * time_s + self.phase_rad)
        return np.asarray(self.amplitude_nm * (1 - np.cos(np.pi * share)) / 2 * sine)

    def json(self) -> str:
        """The run's `excitation` attribute."""
        return json.dumps(
            {
                "waveform": "sine",
                "frequency_hz": self.frequency_hz,
                "amplitude_nm": self.amplitude_nm,
                "phase_rad": self.phase_rad,
                "ramp_s": self.ramp_s,
                "end_s": self.end_s,
            }
        )


@dataclass(frozen=True)
class PlannedRun:
    """One run of a session; `injection` None: a reference."""

    stroke: Stroke
    injection: Injection | None
    repeat: int
    pause_s: float  # how long the axis holds before it, unrecorded

    def torque_added_nm(self) -> Array:
        """Injected torque at the control ticks, (m,)."""
        time = self.stroke.time_s
        return self.injection.torque_nm(time) if self.injection else np.zeros_like(time)
