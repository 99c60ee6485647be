"""What is injected to measure a frequency response: lines, amplitudes and phases that keep the axis at its angle."""

from __future__ import annotations

import math
from dataclasses import dataclass, field
from typing import Literal

import numpy as np

from schwung.commissioning.plan import AMPLITUDE_SHARE, Limits, LimitWishes, believed_inertia_range
from schwung.commissioning.preflight import HEAVIER
from schwung.commissioning.procedure import MAX_JITTER_SHARE
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
#: Length of the grid's period for a stepped sine (s), and of every ramp (s).
_SINE_GRID_S, _RAMP_S = 0.2, 0.05
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
    period = round(_SINE_GRID_S * rate) if wishes.waveform == "sine" else round(4 * rate / lowest)
    orders = np.geomspace(lowest, highest, LINES[wishes.waveform]) * period / rate
    highest_order = int(highest * period / rate + 1e-9)
    return Grid(rate / period, np.unique(np.clip(np.rint(orders), 1, highest_order)) * rate / period)


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
    hold, settle = 1 / rate if held else None, _settling_s(machine)
    found = []
    if wishes.waveform == "sine":
        steady = math.ceil(wishes.periods * _SINE_GRID_S * rate) / rate
        for repeat in range(wishes.repeats):
            for line in lines:
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
    shape = np.minimum(1.0, lines / _fade_hz(machine, lines))
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
    """How long the loop, taken as rigid, rings down to a thousandth with the largest inertia, and more of it (s).

    (J s³ + K_ps s² + K_ps (K_pp + 1/T_n) s + K_ps K_pp/T_n = 0.)
    """
    control, (_, largest) = machine.required_control(), believed_inertia_range(machine)
    gain, outer, inner = (
        control.speed_gain_nms,
        control.position_gain_per_s,
        1 / control.speed_integral_time_s,
    )
    inertia = machine.motor.inertia_kgm2 + HEAVIER * largest
    poles = np.roots([inertia, gain, gain * (outer + inner), gain * outer * inner])
    slowest = max(float(-poles.real.max()), 1e-3)
    return float(np.clip(math.log(1000) / slowest, SETTLE_S, _LONGEST_SETTLING_S))


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
