"""What a recorded stage of the creep shows: phasors of the injected frequency beside what the motion itself makes."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from schwung.motion import Array
from schwung.session import Run

#: A reported torque may lag by so much without the drive telling (s), beside half a sample.
UNTOLD_LAG_S = 1e-3
#: What may be left beside a clean sine, over its amplitude.
MOST_REST = 0.5
#: Stick and slip makes overtones, which are fitted as far as the samples show them (share of their rate).
HARMONICS, BELOW_RATE = 5, 0.4
#: The part of a stroke that is looked at: away from standstill.
INNER = (0.15, 0.85)

Phasor = complex


@dataclass(frozen=True)
class Measured:
    """A phasor, its standard deviation, and what is left beside it (root mean square)."""

    value: Phasor
    std: float
    rest: float

    @property
    def clean(self) -> bool:
        """A sine is what is there, beside the motion; no stick and slip, and more than a few counts."""
        return self.value != 0 and self.rest <= MOST_REST * abs(self.value)

    @property
    def share(self) -> float:
        """Standard deviation over magnitude."""
        return math.inf if self.value == 0 else self.std / abs(self.value)


@dataclass(frozen=True)
class Evidence:
    """One recorded stage; SI. None: not reported, or its phase is not known."""

    frequency_hz: float
    lag_s: float  # by which the torque may be late or early, unsaid
    position: Measured
    speed: Measured | None
    torque: Measured
    added: Phasor | None
    added_acting: Phasor | None  # with the delay of a value that is held from SYNC to SYNC
    travel_rad_s: float = (
        0.0  # mean speed by the position's ends, and by the reported speed; 0: at standstill
    )
    travel_told_rad_s: float = 0.0
    travel_std_rad_s: float = math.inf


def evidence_of(run: Run, counts: tuple[float, float, float]) -> Evidence:
    """The phasors of a recorded stage; `counts`: what one of position, speed and torque is worth (rad, rad/s, N·m)."""
    assert run.motion is not None
    assert run.excitation is not None
    frequency, rate = run.excitation.frequency_hz, run.sample_rate_hz
    fit = _Fit(run, frequency)
    reported = "speed_origin" not in run.extra
    added = None
    if run.torque_added_nm is not None and np.all(np.isfinite(run.torque_added_nm[fit.rows])):
        added = fit.phasor(run.torque_added_nm, 0.0).value
    elif run.excitation.model_dump().get("phase_known", True):
        sine = run.excitation
        added = complex(-1j * sine.amplitude_nm * np.exp(1j * sine.phase_rad))
    held = run.excitation.hold_s if run.extra.get("sampling") != "trace" else None
    acting = added
    if added is not None and held:
        acting = added * np.sinc(frequency * held) * np.exp(1j * math.pi * frequency * held)
    travel, told, std = fit.travel(run, counts[1])
    return Evidence(
        frequency_hz=frequency,
        lag_s=0.5 / rate + UNTOLD_LAG_S,
        position=fit.phasor(run.position_rad, counts[0]),
        speed=fit.phasor(run.speed_rad_s, counts[1]) if reported else None,
        torque=fit.phasor(run.torque_nm, counts[2]),
        added=added,
        added_acting=acting,
        travel_rad_s=travel,
        travel_told_rad_s=told,
        travel_std_rad_s=std,
    )


class _Fit:
    """Least squares of one sine and, stroke by stroke, of what the motion itself makes: its demand, speed and
    acceleration, and a constant."""

    def __init__(self, run: Run, frequency_hz: float) -> None:
        motion, time = run.motion, run.time_s
        assert motion is not None
        begin, end = INNER
        demand = motion.demand(time)
        columns: list[Array] = []
        inside = np.zeros(time.size, dtype=bool)
        self._strokes: list[NDArray[np.intp]] = []
        if motion.distance_rad == 0:
            first, last = motion.start_time_s, motion.start_time_s + 2 * motion.duration_s
            inside = (time >= first) & (time <= last)
            columns += [np.ones_like(time), (time - first) / (last - first)]
        else:
            for start in motion.stroke_starts_s:
                part = (time >= start + begin * motion.duration_s) & (time <= start + end * motion.duration_s)
                inside |= part
                self._strokes.append(np.flatnonzero(part))
                for shape in (
                    np.ones_like(time),
                    demand.position_rad,
                    demand.speed_rad_s,
                    demand.acceleration_rad_s2,
                ):
                    largest = float(np.max(np.abs(shape[part]), initial=0.0))
                    if largest > 0:
                        columns.append(np.where(part, shape / largest, 0.0))
        self.rows: NDArray[np.intp] = np.flatnonzero(inside)
        orders = min(HARMONICS, int(BELOW_RATE * run.sample_rate_hz / frequency_hz))
        turns = [2 * math.pi * order * frequency_hz * time for order in range(1, max(orders, 1) + 1)]
        waves = [wave for turn in turns for wave in (np.cos(turn), -np.sin(turn))]
        self._waves = len(waves)
        self._basis = np.column_stack([*waves, *columns])[self.rows]

    def phasor(self, values: Array, count: float) -> Measured:
        """Re(phasor exp(jωt)) is the sine in the values; `count`: their resolution."""
        rows, size = self.rows.size, self._basis.shape[1]
        if rows <= size:
            return Measured(0j, math.inf, math.inf)
        solution, *_ = np.linalg.lstsq(self._basis, values[self.rows], rcond=None)
        rest = values[self.rows] - self._basis @ solution
        noise = math.sqrt(float(rest @ rest) / (rows - size)) + count / math.sqrt(12)
        others = float(np.hypot.reduce(solution[2 : self._waves])) / math.sqrt(2)
        return Measured(
            complex(solution[0], solution[1]), noise * math.sqrt(2 / rows), math.hypot(noise, others)
        )

    def travel(self, run: Run, speed_count: float) -> tuple[float, float, float]:
        """Mean speed of the strokes by position and as reported, both counted along the motion, and its deviation."""
        travels, told, size = [], [], 0
        for part in (part for part in self._strokes if part.size > 1):
            ends = run.position_rad[part[[0, -1]]]
            speed = float(ends[1] - ends[0]) / float(run.time_s[part[-1]] - run.time_s[part[0]])
            travels.append(abs(speed))
            told.append(math.copysign(1.0, speed) * float(np.mean(run.speed_rad_s[part])))
            size += part.size
        if not travels:
            return 0.0, 0.0, math.inf
        spread = float(np.std(run.speed_rad_s[self.rows])) / math.sqrt(size)
        return float(np.mean(travels)), float(np.mean(told)), speed_count + 2 * spread
