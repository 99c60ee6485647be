"""The response from torque to speed at standstill, as measured: complex points with their spread and coherence.

The axis is held by its controller, so the torque is the *total* motor torque and the ratio of phasors is the open
loop (method.md, step 2). Every line of a sine or multisine is fitted over blocks of whole periods. The spread is what
differs from block to block or from run to run, or what is found at frequencies that nobody injected: the counts of
encoder and torque repeat with the vibration, and so do their errors, in every block alike.

A torque that a bus refreshes once per SYNC is a staircase a_k, and samples of the same rate hold its images at
f + i·f_s, too (`sampling.py`). Here the torque is the fundamental of what acts: S·a, S = (e^{sT} − 1)/(sT), for the
staircase of steps of T that end with their sample, plus the controller's share as sampled; the speed is that of the
sampled positions. What the images leave in both is small, and `bode.py` has it in its model.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from schwung.errors import InputError
from schwung.motion import Array, Excitation
from schwung.session.model import SAME_PERIOD, Run, Session

ComplexArray = NDArray[np.complex128]

#: After the ramp the closed loop swings for a while; this much is left out where the excitation does not say (s).
SETTLE_S = 0.2
#: Runs whose mean angles differ by less belong to one angle (rad).
SAME_ANGLE_RAD = 0.02
#: An axis that travels farther than this within a run was not at standstill (rad).
MAX_TRAVEL_RAD = 0.2
#: Lines above this share of the sampling rate are left out: there the images are as large as what is looked for.
BAND_SHARE = 0.4
#: Points below this coherence are shown but not fitted.
MIN_COHERENCE = 0.8
#: The spread is averaged over so many lines on either side: of a handful of periods it is a coarse number itself.
_SMOOTHED_LINES = 2
#: Free frequencies that are looked at beside each line.
_STRAYS = 4
#: Blocks are a whole number of samples to this accuracy (samples); so many periods are tried for it.
_WHOLE, _MOST_PERIODS = 0.02, 40
#: The shortest block (s): a few periods of a fast sine are one block.
_MIN_BLOCK_S = 0.05


@dataclass(frozen=True, eq=False)
class Response:
    """Speed per torque at one angle; arrays (m,), one row per frequency.

    `response` complex, rad/s per N·m; `std` of the same, the root of E|error|² (both parts together);
    `coherence` 0…1; `staircase`: held injection over torque, complex, 0 where it was not held;
    `speed_noise`: standard deviation of a speed phasor taken over one second, rad/s.
    """

    position_rad: float
    frequency_hz: Array
    response: ComplexArray
    std: Array
    coherence: Array
    staircase: ComplexArray
    speed_noise: Array
    sample_rate_hz: float
    hold_s: float | None
    blocks: int

    @property
    def used(self) -> NDArray[np.bool_]:
        """Points good enough to be fitted, (m,)."""
        return np.asarray(
            (self.coherence >= MIN_COHERENCE) & (self.frequency_hz <= BAND_SHARE * self.sample_rate_hz)
        )


@dataclass(frozen=True, eq=False)
class _Blocks:
    """Phasors per block and line (n, m), each over the phasor that was commanded."""

    frequency_hz: Array
    speed: ComplexArray
    torque: ComplexArray
    added: ComplexArray
    commanded_nm: Array
    stray_speed: ComplexArray  # (n, m, _STRAYS), beside each line, over the amplitude that was commanded
    stray_torque: ComplexArray
    block_s: float
    hold_s: float | None


def measured_responses(session: Session) -> tuple[Response, ...]:
    """The response at every angle at which the session has runs at standstill, in increasing angle.

    Raises InputError where there is none, a run is too short, or its torque has the wrong sign.
    """
    groups: list[list[Run]] = []
    for run in sorted(_at_standstill(session), key=lambda run: float(np.mean(run.position_rad))):
        near = groups and abs(_angle(groups[-1][0]) - _angle(run)) < SAME_ANGLE_RAD
        if near:
            groups[-1].append(run)
        else:
            groups.append([run])
    return tuple(_response(group) for group in groups)


def _at_standstill(session: Session) -> list[Run]:
    runs = [run for run in session.excited if np.ptp(run.position_rad) < MAX_TRAVEL_RAD]
    if not runs:
        raise InputError(
            "session",
            "has no run with an injected torque at standstill",
            "Record one with `schwung bode -m MACHINE --angles …`.",
        )
    return runs


def _angle(run: Run) -> float:
    return float(np.mean(run.position_rad))


def _response(runs: Sequence[Run]) -> Response:
    """All runs at one angle, line by line."""
    blocks = [_phasors(run) for run in runs]
    lines = np.unique(np.concatenate([b.frequency_hz for b in blocks]).round(9))
    points = [_point(line, blocks) for line in lines]
    within, between, stray = (
        _smoothed(np.array([p[key] for p in points])) for key in ("within", "between", "stray")
    )
    torque = np.array([p["torque"] for p in points])
    response = np.array([p["response"] for p in points])
    lowest = response[: max(3, lines.size // 4)]
    if np.median(lowest.imag) > 0:  # below the anti-resonance an inertia lags: the sign is wrong
        raise InputError(
            runs[0].name or "excited run",
            "speed falls where torque rises",
            "Correct the sign of torque (or of speed and position) in the recording or the profile.",
        )
    return Response(
        position_rad=float(np.mean([_angle(run) for run in runs])),
        frequency_hz=lines,
        response=response,
        std=np.sqrt(np.maximum(np.maximum(within, between), stray)) / np.abs(torque),
        coherence=np.array([p["coherence"] for p in points]).real,
        staircase=np.array([p["added"] for p in points]) / torque,
        speed_noise=np.array([p["noise"] for p in points]).real,
        sample_rate_hz=runs[0].sample_rate_hz,
        hold_s=blocks[0].hold_s,
        blocks=min(b.speed.shape[0] for b in blocks),
    )


def _point(line: float, blocks: Sequence[_Blocks]) -> dict[str, complex]:
    """One line: ratio of means, spread of the mean within and between runs (per commanded N·m), coherence."""
    holding = [(b, int(np.argmin(np.abs(b.frequency_hz - line)))) for b in blocks]
    holding = [(b, column) for b, column in holding if abs(b.frequency_hz[column] - line) < 1e-6]
    speed, torque, added = (
        np.concatenate([getattr(b, name)[:, column] for b, column in holding])
        for name in ("speed", "torque", "added")
    )
    response = speed.mean() / torque.mean()
    error = speed - response * torque
    n, runs = speed.size, len(holding)
    scatter = float(np.sum(np.abs(error) ** 2)) / (n - 1)
    means = [np.mean(b.speed[:, column] - response * b.torque[:, column]) for b, column in holding]
    between = float(np.sum(np.abs(means) ** 2)) / (runs * (runs - 1)) if runs > 1 else 0.0
    cross = abs(np.vdot(torque, speed)) ** 2
    power = float(np.sum(np.abs(speed) ** 2) * np.sum(np.abs(torque) ** 2))
    beside = [b.stray_speed[:, column] - response * b.stray_torque[:, column] for b, column in holding]
    stray = float(np.mean([np.mean(np.abs(error.mean(axis=0)) ** 2) for error in beside])) / runs
    amplitude = float(np.mean([b.commanded_nm[column] for b, column in holding]))
    duration = float(np.mean([b.block_s for b, _ in holding]))
    return {
        "response": response,
        "torque": complex(torque.mean()),
        "added": complex(added.mean()),
        "within": scatter / n,
        "between": between,
        "stray": stray,
        "coherence": cross / power if power > 0 else 0.0,
        "noise": np.sqrt(scatter * duration) * amplitude,
    }


def _smoothed(values: ComplexArray) -> Array:
    """Mean over neighbouring lines, (m,)."""
    real = np.asarray(values.real)
    width = _SMOOTHED_LINES
    return np.array([real[max(i - width, 0) : i + width + 1].mean() for i in range(real.size)])


def _phasors(run: Run) -> _Blocks:
    """Phasors of every line in every whole block of a run, after ramp and settling."""
    excitation = run.excitation
    assert excitation is not None  # guaranteed by Run
    rate, lines = run.sample_rate_hz, excitation.lines_hz
    size = _block_samples(rate, excitation)
    ramp = excitation.ramp_s or 0.0
    settled = SETTLE_S if excitation.settle_s is None else excitation.settle_s
    first = int(np.searchsorted(run.time_s, ramp + settled))
    end = run.time_s[-1] if excitation.end_s is None else min(excitation.end_s - ramp, run.time_s[-1])
    last = int(np.searchsorted(run.time_s, end, side="right"))
    count = (last - first) // size
    if count < 2:
        raise InputError(
            run.name or "excited run",
            f"vibrates steadily for {max(last - first, 0) / rate:.3g} s, less than two blocks of {size / rate:.3g} s",
            "Record more periods.",
        )
    fitter = _Fitter.of(size, rate, excitation)
    starts = run.time_s[first : first + count * size : size]

    def of(samples: Array) -> _Phasors:
        return fitter.fit(samples[first : first + count * size].reshape(count, size), starts)

    s = np.asarray(2j * np.pi * lines, dtype=np.complex128)
    hold = excitation.hold_s if _is_held(run, excitation) else None
    by_position = hold is not None or run.extra.get("speed_source") == "position"
    torque, added_nm = run.torque_nm, np.zeros(len(run))
    if hold is not None:
        added_nm = excitation.torque(run.time_s) if run.torque_added_nm is None else run.torque_added_nm
        torque = torque - added_nm
    added, vibration = of(added_nm).lines, of(run.position_rad if by_position else run.speed_rad_s)
    turned = of(torque)
    stray_s = 2j * np.pi * fitter.strays_hz
    return _Blocks(
        frequency_hz=lines,
        speed=vibration.lines * (s if by_position else 1.0),
        torque=turned.lines if hold is None else turned.lines + added * staircase_gain(s, hold),
        added=added,
        commanded_nm=np.abs(excitation.phasors_nm),
        stray_speed=vibration.strays * (stray_s if by_position else 1.0),
        stray_torque=turned.strays,
        block_s=size / rate,
        hold_s=hold,
    )


@dataclass(frozen=True, eq=False)
class _Phasors:
    """Per block: at the lines (n, m), over the commanded phasor; beside them (n, m, _STRAYS), over its size."""

    lines: ComplexArray
    strays: ComplexArray


@dataclass(frozen=True, eq=False)
class _Fitter:
    """Least squares for lines, mean and drift of a block; what is left, at the nearest free frequencies."""

    lines_hz: Array
    strays_hz: Array  # (m, _STRAYS)
    commanded: ComplexArray
    design: Array
    inverse: Array
    stray_bins: NDArray[np.int64]

    @classmethod
    def of(cls, size: int, rate: float, excitation: Excitation) -> _Fitter:
        lines, local = excitation.lines_hz, np.arange(size) / rate
        turning = np.multiply.outer(local, 2 * np.pi * lines)
        drift = np.stack([np.ones(size), local - local.mean()], axis=1)  # it may creep
        design = np.hstack([np.cos(turning), np.sin(turning), drift])
        taken = np.rint(lines * size / rate)
        free = np.setdiff1d(np.arange(1, (size - 1) // 2), taken)
        nearest = np.argsort(np.abs(free - taken[:, None]), axis=1, kind="stable")[:, :_STRAYS]
        bins = free[nearest]
        return cls(lines, bins * rate / size, excitation.phasors_nm, design, np.linalg.pinv(design), bins)

    def fit(self, samples: Array, starts_s: Array) -> _Phasors:
        """Phasors of samples (n, size) that start at the given instants (n,)."""
        fitted = samples @ self.inverse.T
        m = self.lines_hz.size
        back = np.exp(-2j * np.pi * np.multiply.outer(starts_s, self.lines_hz)) / self.commanded
        left = np.fft.rfft(samples - fitted @ self.design.T, axis=1) * 2 / samples.shape[1]
        shift = np.exp(-2j * np.pi * np.multiply.outer(starts_s, self.strays_hz))
        strays = left[:, self.stray_bins] * shift / np.abs(self.commanded)[:, None]
        return _Phasors(np.asarray((fitted[:, :m] - 1j * fitted[:, m : 2 * m]) * back), np.asarray(strays))


def _is_held(run: Run, excitation: Excitation) -> bool:
    return excitation.hold_s is not None and abs(excitation.hold_s * run.sample_rate_hz - 1) < SAME_PERIOD


def staircase_gain(s: ComplexArray, hold_s: float) -> ComplexArray:
    """S = (e^{sT} − 1)/(sT): what acts at s where a value is held over the T that ends with its sample."""
    return np.asarray(np.expm1(s * hold_s) / (s * hold_s))


def _block_samples(rate: float, excitation: Excitation) -> int:
    """Samples of the shortest block of whole periods that is a whole number of samples, or the nearest to one."""
    period = rate / excitation.frequency_hz
    least = max(1, int(np.ceil(_MIN_BLOCK_S * excitation.frequency_hz)))
    periods = np.arange(least, least + _MOST_PERIODS)
    off = np.abs(periods * period - np.rint(periods * period))
    best = int(np.argmax(off < _WHOLE)) if np.any(off < _WHOLE) else int(np.argmin(off))
    return round(float(periods[best] * period))
