"""What was commanded, recognised from its counts: the sine that was added to the torque, and the motion.

A model is believed where it gives the commanded counts but for rounding: whoever commanded it rounded once.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import get_args

import numpy as np
from scipy.optimize import least_squares

from schwung.motion import Array, Excitation, Motion, MotionKind

#: Largest difference between a commanded count and the model's value: half a count by rounding, and what floats lose.
_ROUNDING_COUNTS = 0.55
#: The same as rms: a value rounded to whole counts is off by 1/√12; fade-ins of another shape stay below twice that.
_ROUNDING_RMS = 0.6
_FULL_SHARE = 0.97  # of the amplitude: the sine has faded in
_KINDS: tuple[MotionKind, ...] = tuple(kind for kind in get_args(MotionKind) if kind != "points")


@dataclass(frozen=True)
class Injection:
    """A sine as recognised: `excitation` over the time from sample `start` on, until sample `stop`."""

    excitation: Excitation
    start: int
    stop: int


def recognise_injection(counts: Array, rate_hz: float, count_nm: float) -> Injection | None:
    """The sine in commanded torque, (n,) counts, of which the first and last that are not 0 bound it. None where it is
    no sine. With raised-cosine ends where they give the counts; else its full part alone."""
    on = np.flatnonzero(counts)
    if on.size < 8:
        return None
    first, last = int(on[0]), int(on[-1])
    own = counts[first : last + 1]
    frequency = strongest_hz(own, rate_hz)
    if frequency is None:
        return None
    period = rate_hz / frequency
    envelope = _envelope(own, frequency, rate_hz)
    peak = float(np.median(envelope[envelope > 0.5 * envelope.max()]))
    full = np.flatnonzero(envelope > _FULL_SHARE * peak)
    if full.size < 2 * period:
        return None
    time = np.arange(own.size) / rate_hz
    middle = slice(int(full[0]), int(full[-1]) + 1)
    sine = _fitted_sine(time[middle], own[middle], frequency)
    faded = _with_ends(own, time, sine, envelope / peak, rate_hz)
    if faded is not None:
        excitation, start = faded
        stop = first + start + round((excitation.end_s or 0.0) * rate_hz) + 1
        scaled = excitation.model_copy(update={"amplitude_nm": excitation.amplitude_nm * count_nm})
        return Injection(scaled, first + start, stop)
    model = sine.at(time[middle])
    if float(np.sqrt(np.mean((own[middle] - model) ** 2))) > max(_ROUNDING_RMS, 0.01 * sine.amplitude):
        return None
    begin = middle.start
    phase = sine.phase + 2 * np.pi * sine.frequency * begin / rate_hz
    excitation = Excitation(
        frequency_hz=sine.frequency, amplitude_nm=sine.amplitude * count_nm, phase_rad=float(phase % (2 * np.pi)),
        hold_s=1 / rate_hz,
    )  # fmt: skip
    return Injection(excitation, first + begin, first + int(middle.stop))


@dataclass(frozen=True)
class _Sine:
    frequency: float
    amplitude: float
    phase: float

    def at(self, time: Array) -> Array:
        return np.asarray(self.amplitude * np.sin(2 * np.pi * self.frequency * time + self.phase))


def strongest_hz(counts: Array, rate_hz: float) -> float | None:
    """The frequency (Hz) of the strongest line, by a padded spectrum and a parabola through its peak."""
    windowed = (counts - counts.mean()) * np.hanning(counts.size)
    spectrum = np.abs(np.fft.rfft(windowed, 8 * counts.size))
    k = int(np.argmax(spectrum))
    if not 0 < k < spectrum.size - 1:
        return None
    left, top, right = np.log(spectrum[k - 1 : k + 2] + 1e-300)
    shift = 0.5 * (left - right) / (left - 2 * top + right)
    return float((k + shift) * rate_hz / (8 * counts.size))


def _envelope(counts: Array, frequency: float, rate_hz: float) -> Array:
    """Amplitude (n,) of that line around each sample, over a period."""
    turning = np.exp(-2j * np.pi * frequency * np.arange(counts.size) / rate_hz)
    width = max(3, round(rate_hz / frequency))
    mean = np.convolve(counts * turning, np.ones(width) / width, "same")
    return np.asarray(2 * np.abs(mean))


def _fitted_sine(time: Array, counts: Array, frequency: float) -> _Sine:
    def parts(f: float) -> tuple[Array, Array]:
        columns = np.column_stack([np.sin(2 * np.pi * f * time), np.cos(2 * np.pi * f * time)])
        found = np.linalg.lstsq(columns, counts, rcond=None)[0]
        return found, counts - columns @ found

    fitted = least_squares(
        lambda x: parts(float(x[0]))[1], [frequency], x_scale=0.1 / max(float(np.ptp(time)), 1e-9)
    )
    best = float(fitted.x[0])
    (sine, cosine), _ = parts(best)
    return _Sine(best, float(np.hypot(sine, cosine)), float(np.arctan2(cosine, sine)))


def _with_ends(
    counts: Array, time: Array, sine: _Sine, envelope: Array, rate_hz: float
) -> tuple[Excitation, int] | None:
    """Excitation with raised-cosine ends over the time from sample `start` on, its amplitude in counts; None where the
    ends are of another shape. The start is on the grid of SYNC, as commanded."""
    half = np.flatnonzero(envelope >= 0.5)
    ramp = 2 * (time[half[0]] - time[0])
    if ramp * sine.frequency < 0.5:
        return None
    pad = round(0.2 * ramp * rate_hz) + 2  # the first counts of a ramp round to 0
    padded = np.concatenate((np.zeros(pad), counts, np.zeros(pad)))
    clock = (np.arange(padded.size) - pad) / rate_hz

    def model(x: Array, start: float) -> Array:
        frequency, in_phase, quadrature, width, stop = x
        rise, fall = np.clip((clock - start) / width, 0, 1), np.clip((stop - clock) / width, 0, 1)
        shape = (1 - np.cos(np.pi * np.minimum(rise, fall))) / 2
        angle = 2 * np.pi * frequency * clock
        return np.asarray(shape * (in_phase * np.sin(angle) + quadrature * np.cos(angle)))

    begin = [sine.frequency, sine.amplitude * np.cos(sine.phase), sine.amplitude * np.sin(sine.phase), ramp]
    step = 1 / rate_hz
    scale = [0.1 / float(np.ptp(clock)), 1.0, 1.0, step, step]
    free = least_squares(lambda x: model(x[:5], x[5]) - padded, [*begin, time[-1] + 2 * step, -2 * step],
                         x_scale=[*scale, step])  # fmt: skip
    start = int(np.rint(free.x[5] * rate_hz))
    fixed = least_squares(lambda x: model(x, start * step) - padded, free.x[:5], x_scale=scale)
    if float(np.max(np.abs(fixed.fun))) > _ROUNDING_COUNTS + 0.02 * sine.amplitude:
        return None
    if float(np.sqrt(np.mean(fixed.fun**2))) > max(_ROUNDING_RMS, 0.002 * sine.amplitude):
        return None
    frequency, in_phase, quadrature, width, stop = (float(x) for x in fixed.x)
    phase = np.arctan2(quadrature, in_phase) + 2 * np.pi * frequency * start * step
    excitation = Excitation(
        frequency_hz=frequency,
        amplitude_nm=float(np.hypot(in_phase, quadrature)),
        phase_rad=float(phase % (2 * np.pi)),
        ramp_s=width,
        end_s=stop - start * step,
        hold_s=step,
    )
    return excitation, start


def recognise_motion(counts: Array, rate_hz: float, count_rad: float) -> Motion | None:
    """The motion in demanded positions, (n,) counts from rest to rest, 0 at the first sample; there, or there and
    back. None where no kind gives the counts but for rounding."""
    way = counts - counts[0]
    moving = np.flatnonzero(np.diff(way))
    if moving.size < 8:
        return None
    far = way[int(np.argmax(np.abs(way)))]
    returns = bool(abs(way[-1]) < 0.5 * abs(far))
    time = np.arange(way.size) / rate_hz
    begin, end = time[moving[0]], time[moving[-1] + 1]
    if returns:
        at_far = np.flatnonzero(way == far)
        duration, dwell = time[at_far[0]] - begin, time[at_far[-1]] - time[at_far[0]]
    else:
        duration, dwell = end - begin, 0.0
    found: tuple[float, Motion] | None = None
    for kind in _KINDS:
        made = _fitted_motion(kind, way, time, (begin, duration, dwell, float(far)), returns)
        if made is not None and (found is None or made[0] < found[0]):
            found = made
    if found is None:
        return None
    motion = found[1]
    return motion.model_copy(update={"distance_rad": motion.distance_rad * count_rad})


def _fitted_motion(
    kind: MotionKind, way: Array, time: Array, guess: tuple[float, float, float, float], returns: bool
) -> tuple[float, Motion] | None:
    begin, duration, dwell, distance = guess

    def motion(x: Array) -> Motion:
        rest = max(float(x[3]), 0.0) if returns else max(float(time[-1] - x[0] - x[1]), 0.0)
        return Motion(kind=kind, distance_rad=float(x[2]), duration_s=max(float(x[1]), 1e-6),
                      start_time_s=max(float(x[0]), 0.0), returns=returns, dwell_s=rest)  # fmt: skip

    def miss(x: Array) -> Array:
        return np.asarray(motion(x).demand(time).position_rad - way)

    step = float(time[1] - time[0])
    best: tuple[float, Motion] | None = None
    for wider in (1.0, 1.02, 1.05, 1.1):  # smooth kinds round to rest at both ends, so that they look shorter
        longer = duration * wider
        first = [max(begin - (longer - duration) / 2, 0.0), longer, distance]
        start = [*first, max(dwell - (longer - duration), 0.0)] if returns else first
        scale = [step, step, 1.0, step][: len(start)]
        fitted = least_squares(miss, start, x_scale=scale)
        worst = float(np.max(np.abs(fitted.fun)))
        if best is None or worst < best[0]:
            best = (worst, motion(fitted.x))
        if worst <= _ROUNDING_COUNTS:
            break
    return best if best is not None and best[0] <= 2 * _ROUNDING_COUNTS else None
