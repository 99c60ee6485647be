"""What is injected to measure a frequency response: lines, amplitudes and phases that keep the axis at its angle."""

from __future__ import annotations

import math
from dataclasses import dataclass, field
from typing import Literal

import numpy as np

from schwung.commissioning.limits import Limits, LimitWishes
from schwung.commissioning.plan import AMPLITUDE_SHARE, believed_inertia_range
from schwung.commissioning.preflight import HEAVIER
from schwung.commissioning.ways import MAX_JITTER_SHARE
from schwung.drivetrain import Machine, anti_resonance_hz
from schwung.drivetrain.response import injection_to_speed, injection_to_torque
from schwung.errors import InputError
from schwung.estimation.response import BAND_SHARE, SETTLE_S, ComplexArray
from schwung.motion import Array, Excitation

Waveform = Literal["multisine", "sine"]

#: The injection may move the axis by so much to either side (rad): J_l hardly changes within it.
MAX_DEVIATION_RAD = 0.015
#: Share of the torque limit that injection and controller together may take.
MAX_TORQUE_SHARE = 0.5
#: Lines of a multisine; frequencies of a stepped sine.
LINES = {"multisine": 40, "sine": 16}
#: Draws of random phases, of which the one with the lowest peak is taken.
_DRAWS = 64
#: The lowest frequency as a share of the lowest believed anti-resonance; the lines below half of it fade.
_LOWEST_SHARE, _FADE_SHARE = 1 / 8, 1 / 2
#: Blocks of a stepped sine (s), each with so many whole periods at the least: a fast sine is told sooner.
_SINE_BLOCKS_S, _PERIODS_IN_BLOCK = (0.05, 0.1, 0.2), 3
#: Length of every ramp (s).
_RAMP_S = 0.05
#: What is left of the ramp's transient when a sine counts as steady, over the sine.
_SETTLED = 1e-3
#: Every repeat of a sine is weaker by this share: the same sine would meet the same counts of the encoder again.
_LESS_EACH_REPEAT = 0.1
#: However little the loop is damped, no run waits longer than this (s).
_LONGEST_SETTLING_S = 2.0


@dataclass(frozen=True)
class BodeWishes:
    """What the user asked for; None: propose. `periods` and `repeats`: of each excitation, at every angle."""

    angles_rad: tuple[float, ...]
    limits: LimitWishes = field(default_factory=LimitWishes)
    waveform: Waveform = "multisine"
    amplitude_nm: float | None = None
    lowest_hz: float | None = None
    highest_hz: float | None = None
    periods: int = 4
    repeats: int = 2
    sample_rate_hz: float = 1000.0
    max_jitter_share: float = MAX_JITTER_SHARE


@dataclass(frozen=True, eq=False)
class Grid:
    """Frequencies (Hz), (m,), all multiples of one, whose period is a whole number of samples."""

    base_hz: float
    lines_hz: Array


def grid_of(machine: Machine, wishes: BodeWishes) -> Grid:
    """Frequencies (Hz), spaced evenly on a logarithmic scale, on the grid of the period.

    Raises InputError where the rate does not reach them.
    """
    _, largest = believed_inertia_range(machine)
    rate, top = wishes.sample_rate_hz, BAND_SHARE * wishes.sample_rate_hz
    if machine.coupling is None:
        lowest = wishes.lowest_hz or top / 50
    else:
        lowest = wishes.lowest_hz or _LOWEST_SHARE * float(anti_resonance_hz(machine, largest))
    highest = wishes.highest_hz or top
    if not 0 < lowest < highest <= top * (1 + 1e-9):
        raise InputError(
            "--highest" if highest > top else "--lowest",
            f"{lowest:.4g} … {highest:.4g} Hz cannot be measured at {rate:g} Hz",
            f"Stay at or below {BAND_SHARE:g} of the sampling rate, {top:g} Hz, or raise --rate.",
        )
    wanted = np.geomspace(lowest, highest, LINES[wishes.waveform])
    if wishes.waveform == "sine":
        period = round(_SINE_BLOCKS_S[-1] * rate)
        steps = np.array([1 / _sine_block_s(line) for line in wanted])
    else:
        period = round(4 * rate / lowest)
        steps = np.full(wanted.size, rate / period)
    orders = np.clip(np.rint(wanted / steps), 1, np.floor(highest / steps * (1 + 1e-9)))
    return Grid(rate / period, np.unique((orders * steps).round(9)))


def _sine_block_s(line_hz: float) -> float:
    """The shortest block with enough periods of a line."""
    long_enough = [block for block in _SINE_BLOCKS_S if block * line_hz >= _PERIODS_IN_BLOCK * (1 - 1e-9)]
    return long_enough[0] if long_enough else _SINE_BLOCKS_S[-1]


def excitations_of(
    machine: Machine, limits: Limits, wishes: BodeWishes, grid: Grid, held: bool
) -> list[Excitation]:
    """One multisine per repeat, or one sine per frequency and repeat; within torque and deviation everywhere.

    Raises InputError for too few periods or repeats.
    """
    if wishes.periods < 2 or wishes.repeats < 1:
        raise InputError("--periods", "and --repeats are too few for a spread", "Two periods, one repeat.")
    peak = wishes.amplitude_nm or AMPLITUDE_SHARE * limits.torque_max_nm
    rate, base, lines = wishes.sample_rate_hz, grid.base_hz, grid.lines_hz
    hold = 1 / rate if held else None
    found = []
    if wishes.waveform == "sine":
        for repeat in range(wishes.repeats):
            for line in lines:
                settle = _sine_settling_s(machine, float(line))
                steady = math.ceil(wishes.periods * _sine_block_s(line) * rate) / rate
                amplitude = (
                    (1 - _LESS_EACH_REPEAT) ** repeat
                    * peak
                    * _share(machine, limits, np.array([line]), np.array([-1j * peak]))
                )
                found.append(
                    Excitation(
                        frequency_hz=float(line), amplitude_nm=amplitude, ramp_s=_RAMP_S, settle_s=settle,
                        end_s=2 * _RAMP_S + settle + steady, hold_s=hold,
                    )
                )  # fmt: skip
        return found
    settle, shape = _settling_s(machine), np.minimum(1.0, lines / _fade_hz(machine, lines))
    time = np.arange(round(rate / base) * 4) / (4 * rate)
    for repeat in range(wishes.repeats):
        draw = _quiet_phases(lines, shape, time, seed=repeat)
        amplitudes = peak / draw.peak * shape
        share = _share(machine, limits, lines, -1j * amplitudes * np.exp(1j * draw.phases))
        found.append(
            Excitation(
                waveform="multisine",
                frequency_hz=base,
                amplitude_nm=peak * share,
                frequencies_hz=tuple(lines.tolist()),
                amplitudes_nm=tuple((share * amplitudes).tolist()),
                phases_rad=tuple(draw.phases.tolist()),
                ramp_s=_RAMP_S,
                settle_s=settle,
                end_s=2 * _RAMP_S + settle + wishes.periods / base,
                hold_s=hold,
            )
        )
    return found


def _fade_hz(machine: Machine, lines: Array) -> float:
    """Below it the lines are weaker: there an inertia moves far for little torque."""
    if machine.coupling is None:
        return 4 * float(lines[0])
    return _FADE_SHARE * float(anti_resonance_hz(machine, believed_inertia_range(machine)[1]))


@dataclass(frozen=True, eq=False)
class _Draw:
    """Phases (m,) and the peak of the sum, for amplitudes of the given shape."""

    phases: Array
    peak: float


def _quiet_phases(lines: Array, shape: Array, time: Array, seed: int) -> _Draw:
    """Random phases with a low peak."""
    rng = np.random.default_rng([seed, 0xB0DE])
    turning = np.exp(2j * np.pi * np.multiply.outer(time, lines)) * shape
    drawn = rng.uniform(-np.pi, np.pi, (lines.size, _DRAWS))
    peaks = np.max(np.abs(np.imag(turning @ np.exp(1j * drawn))), axis=0)
    best = int(np.argmin(peaks))
    return _Draw(drawn[:, best], float(peaks[best]))


def _settling_s(machine: Machine) -> float:
    """How long the loop rings down to a thousandth with the largest inertia, and more of it (s)."""
    poles = _position_per_torque(machine, HEAVIER * believed_inertia_range(machine)[1])[1].roots
    slowest = max(float(-poles.real.max()), 1e-3)
    return float(np.clip(-math.log(_SETTLED) / slowest, SETTLE_S, _LONGEST_SETTLING_S))


def _sine_settling_s(machine: Machine, line_hz: float) -> float:
    """How long after its ramp a sine is told to a thousandth in the position, whatever still rings beside it (s).

    A smooth ramp of several periods hardly moves a slow loop; a fast sine's block sees what rings slowly as drift.
    """
    low, high = believed_inertia_range(machine)
    longest = max(_ringing_s(machine, load, line_hz) for load in (low, high, HEAVIER * high))
    return float(np.clip(longest, _RAMP_S, _LONGEST_SETTLING_S))


def _ringing_s(machine: Machine, load_kgm2: float, line_hz: float) -> float:
    """For one inertia: what each pole keeps of a sine that comes in by the ramp, beyond its part in the steady one."""
    above, below = _position_per_torque(machine, load_kgm2)
    s, step = 2j * math.pi * line_hz, _RAMP_S / 2000
    time = np.arange(0.5 * step, _RAMP_S, step)
    ramped = Excitation(frequency_hz=line_hz, amplitude_nm=1.0, ramp_s=_RAMP_S).torque(time)
    swing, longest = abs(above(s) / below(s)), 0.0
    for pole in below.roots:
        met = np.sum(np.exp(pole * (_RAMP_S - time)) * ramped) * step
        steady = sum(sign * np.exp(sign * s * _RAMP_S) / (sign * s - pole) for sign in (1, -1)) / 2j
        left = (
            abs(above(pole) / below.deriv()(pole) * (met - steady)) / swing * _taken_for_line(pole, line_hz)
        )
        longest = max(longest, math.log(max(left / _SETTLED, 1.0)) / max(float(-pole.real), 1e-3))
    return longest


def _taken_for_line(pole: complex, line_hz: float) -> float:
    """Amplitude that a block's fit of line, mean and drift (`response.py`) finds in e^{pt}."""
    block = _sine_block_s(line_hz)
    time = np.linspace(0.0, block, 400, endpoint=False)
    turning = 2 * math.pi * line_hz * time
    design = np.stack([np.cos(turning), np.sin(turning), np.ones_like(time), time / block], axis=1)
    found = np.linalg.lstsq(design, np.exp(pole * time), rcond=None)[0]
    return float(np.linalg.norm(found[:2]))


def _position_per_torque(machine: Machine, load_kgm2: float) -> tuple[np.poly1d, np.poly1d]:
    """θ_r/T_add of the closed loop without frictions, as numerator and denominator: s q / (s² n + K (s + a)(s + c) q).

    n/q is torque over speed of the two masses, K (1 + a/s)(1 + c/s) the cascade's.
    """
    control, motor = machine.required_control(), machine.motor.inertia_kgm2
    if machine.coupling is None:
        q, n = np.poly1d([1.0]), np.poly1d([motor + load_kgm2, 0.0])
    else:
        shaft = np.poly1d([machine.coupling.damping_nms, machine.coupling.stiffness_nm_rad])
        q = np.poly1d([load_kgm2, 0.0, 0.0]) + shaft
        n = np.poly1d([motor, 0.0]) * q + np.poly1d([load_kgm2, 0.0]) * shaft
    cascade = control.speed_gain_nms * np.poly1d(
        [-control.position_gain_per_s, -1 / control.speed_integral_time_s], True
    )
    return np.poly1d([1.0, 0.0]) * q, np.poly1d([1.0, 0.0, 0.0]) * n + cascade * q


def _share(machine: Machine, limits: Limits, lines: Array, phasors: ComplexArray) -> float:
    """Factor, at most 1, that keeps deviation and total torque within their bounds at every believed inertia."""
    time = np.linspace(0.0, 1.0 / float(lines.min()), 2000)
    turning = np.exp(2j * np.pi * np.multiply.outer(time, lines))
    worst = 1.0
    for inertia in believed_inertia_range(machine):
        position = injection_to_speed(machine, inertia, lines) / (2j * np.pi * lines)
        torque = injection_to_torque(machine, inertia, lines)
        deviation = float(np.max(np.abs(np.real(turning @ (position * phasors)))))
        total = float(np.max(np.abs(np.real(turning @ (torque * phasors)))))
        worst = max(worst, deviation / MAX_DEVIATION_RAD, total / (MAX_TORQUE_SHARE * limits.torque_max_nm))
    return 1 / worst
