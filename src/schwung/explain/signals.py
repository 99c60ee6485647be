"""Recordings made ready: the motor's motion without lag or needless noise, and which samples are compared.

Angle and speed are weighed in the frequency domain by their own noise: below σ_ω/σ_θ (rad/s) the angle's derivative
is the better speed, above it the reported speed. All filters have zero phase. Everything beyond `band_hz`, where the
noise of the acceleration drowns any torque, is left out of motion and torque alike.

An injection that a bus refreshes once per SYNC is a staircase: its images at f_s ± f fall upon f where it is sampled.
At the instants of sampling they leave the angle alone to third order in f/f_s, but not the speed, and the controller
answers them: by how much no drive says, only in which shape, that of the jumps. So the angle gives the motion, the
torque is what was reported with the staircase's fundamental in the staircase's place, and the shape of the jumps tells
nothing.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from schwung.drivetrain.machine import Machine
from schwung.errors import InputError
from schwung.explain.channels import Noise, alike_noise, channel_noise, nothing_new, repeating
from schwung.explain.filtered import SpeedFilter, speed_filter
from schwung.explain.spectrum import ORDER, Spectrum
from schwung.motion import Array
from schwung.session.imports import motion_identity
from schwung.session.model import Run, Session

#: The band that is compared: at least this (Hz), at most that, and at most this share of the sampling rate.
LOWEST_BAND_HZ, HIGHEST_BAND_HZ, BAND_SHARE = 30.0, 300.0, 0.2
#: Where the acceleration's noise is this many times the torque's, the band ends.
DROWNED = 30.0
#: The band also ends where the acceleration's own noise reaches this share of the acceleration: a regressor as noisy
#: as that hides inertia. It then goes as low as LOWEST_NOISY_HZ.
NOISY, LOWEST_NOISY_HZ = 0.15, 4.0
#: The motion keeps so much more than the band, that products, signs and impacts of it are right within the band.
MOTION_BAND = 3.0
#: Rate of the simulation over the band, and of the compared samples over the band.
GRID_PER_BAND, COMPARED_PER_BAND = 12.0, 2.5
#: Below this share of the session's highest speed the axis stands: stiction may hold any torque there.
STANDSTILL = 0.01
#: The axis moves where it does so for at least this long in one direction (s).
SHORTEST_S = 0.03
#: Filters spread what happens over so many periods of the band's upper end.
REACH = 1.0
#: What a guess of the inertia beyond its table has set ringing dies away over so many.
BEYOND = 6.0
#: The torque's filter bends like the speed's but for this share of that, and never surer than so (s²).
UNLIKE_SPEED, SURE_S2 = 0.3, 1e-9


@dataclass(frozen=True, eq=False)
class Signals:
    """One run on the grid of the simulation; arrays (n,)."""

    run: int
    group: int  # runs of one group repeat the same motion
    share: float  # how far through the session, 0…1
    time_s: Array
    motion_time_s: Array  # since the demand left rest
    position_rad: Array
    speed_rad_s: Array
    acceleration_rad_s2: Array
    torque_nm: Array  # as reported, not band-limited; a held injection by its fundamental
    added_nm: Array  # that fundamental: unlike the rest of the torque, it is reported without any lag
    jumps_nm: Array  # of a held injection, per sample; both zero where none was held
    considered: NDArray[np.bool_]  # samples that are compared

    @property
    def step_s(self) -> float:
        """Time between samples (s)."""
        return float(self.time_s[1] - self.time_s[0])


@dataclass(frozen=True, eq=False)
class Prepared:
    """A session made ready."""

    runs: tuple[Signals, ...]
    band_hz: float
    rate_hz: float  # of the grid
    source_rate_hz: float  # of the recording
    every: int  # each so many-th sample of the grid is compared
    noise: Noise
    alike: Noise  # what of it repeats have in common, so that their differences do not show it
    speed_delay_s: float  # of the reported speed behind the reported angle
    speed_delay_std_s: float
    smoothing_rad_s: float  # within which a speed's sign is not known
    peak_speed_rad_s: float
    injected_hz: tuple[float, ...] = ()
    bend_s2: float = 0.0  # of the reported torque's own filter, as far as the speed's tells (see filtered.py)
    bend_std_s2: float = SURE_S2
    seen_bend_s2: float = 0.0  # of the speed's filter, by the recordings alone
    seen_bend_std_s2: float = np.inf
    samples: tuple[int, ...] = ()  # of each recorded run


def prepare(session: Session, machine: Machine, seen: Sequence[int] | None = None) -> Prepared:
    """Every run on one grid; band, noise and the speed's filter as the runs `seen` tell them (None: all).

    Raises InputError where runs are too short, or of different rates.
    """
    rates = {run.sample_rate_hz for run in session.runs}
    if len(rates) != 1:
        raise InputError(
            "session", f"has runs at {', '.join(f'{r:g}' for r in sorted(rates))} Hz", "Resample to one rate."
        )
    rate = rates.pop()
    looked_at = session.runs if seen is None else tuple(session.runs[number] for number in seen)
    noise = channel_noise(looked_at)
    band = _clear(looked_at, noise, _band(noise, machine, rate))
    factor = max(1, int(rate / (GRID_PER_BAND * band)))
    filtered = _speed_filter(looked_at, noise, band)
    peak = max(float(np.max(np.abs(_moved(run, noise, band, SpeedFilter())[1]))) for run in looked_at)
    widest = 2 * np.pi * MOTION_BAND * band
    sign_noise = min(noise.speed_rad_s, widest * noise.position_rad) * np.sqrt(2 * MOTION_BAND * band / rate)
    smoothing = max(3 * sign_noise, 0.002 * peak, 1e-9)
    groups: dict[object, int] = {}
    runs = []
    for number, run in enumerate(session.runs):
        group = groups.setdefault(motion_identity(run), len(groups))
        share = number / max(len(session.runs) - 1, 1)
        position, speed, acceleration = _moved(run, noise, band, filtered)
        moving = lasting(np.abs(speed) > max(STANDSTILL * peak, 2 * smoothing), round(SHORTEST_S * rate))
        moving = _away_from(~moving, moving, round(REACH * rate / band))
        moving = _within_table(moving, position, machine, round(BEYOND * rate / band))
        edge = round(1.5 * rate / band)
        moving[:edge] = moving[-edge:] = False
        at = slice(None, None, factor)
        torque = _unstepped(run)
        start = run.motion.start_time_s if run.motion else _leaves_rest(speed, peak) / rate
        runs.append(
            Signals(
                run=number,
                group=group,
                share=share,
                time_s=run.time_s[at],
                motion_time_s=run.time_s[at] - start,
                position_rad=position[at],
                speed_rad_s=speed[at],
                acceleration_rad_s2=acceleration[at],
                torque_nm=_anti_aliased(torque.total_nm, factor, rate)[at],
                added_nm=_anti_aliased(torque.added_nm, factor, rate)[at],
                jumps_nm=_anti_aliased(torque.jumps_nm, factor, rate)[at],
                considered=moving[at],
            )
        )
    grid = rate / factor
    return Prepared(
        runs=tuple(runs),
        band_hz=band,
        rate_hz=grid,
        source_rate_hz=rate,
        every=max(1, int(grid / (COMPARED_PER_BAND * band))),
        noise=noise,
        alike=alike_noise(looked_at if repeating(looked_at) else session.runs, noise),
        speed_delay_s=filtered.delay_s,
        speed_delay_std_s=filtered.delay_std_s,
        smoothing_rad_s=smoothing,
        peak_speed_rad_s=peak,
        injected_hz=tuple(sorted({run.excitation.frequency_hz for run in session.runs if run.excitation})),
        bend_s2=filtered.bend_s2,
        bend_std_s2=UNLIKE_SPEED * filtered.bend_s2 + max(filtered.bend_std_s2, SURE_S2),
        seen_bend_s2=filtered.seen_s2,
        seen_bend_std_s2=filtered.seen_std_s2,
        samples=tuple(len(run) for run in session.runs),
    )


def prepare_twin(twin: Session, prepared: Prepared) -> Prepared:
    """What a simulator did along the recorded runs, on their grid and in their band: it reports at once, unfiltered.

    Raises InputError where it is not run for run, sample for sample.
    """
    if [len(run) for run in twin.runs] != [int(size) for size in prepared.samples]:
        raise InputError("twin", "has other runs than the recording", "Play it along every run.")
    factor = round(prepared.source_rate_hz / prepared.rate_hz)
    runs = []
    for run, recorded in zip(twin.runs, prepared.runs, strict=True):
        position, speed, acceleration = _moved(run, prepared.noise, prepared.band_hz, SpeedFilter())
        at, nothing = slice(None, None, factor), np.zeros_like(recorded.torque_nm)
        runs.append(
            replace(
                recorded,
                position_rad=position[at],
                speed_rad_s=speed[at],
                acceleration_rad_s2=acceleration[at],
                torque_nm=_anti_aliased(run.torque_nm, factor, prepared.source_rate_hz)[at],
                added_nm=nothing,
                jumps_nm=nothing,
            )
        )
    return replace(prepared, runs=tuple(runs), bend_s2=0.0)


def lasting(moving: NDArray[np.bool_], samples: int) -> NDArray[np.bool_]:
    """Only stretches of at least so many samples: an axis that swings about a standstill sticks and slips."""
    edges = np.flatnonzero(np.diff(np.r_[False, moving, False].astype(int)))
    result = np.zeros_like(moving)
    for first, last in edges.reshape(-1, 2):
        result[first:last] = last - first >= samples
    return result


def _away_from(there: NDArray[np.bool_], moving: NDArray[np.bool_], samples: int) -> NDArray[np.bool_]:
    """Moving samples with none of those within so many: what stiction does, or a guess, filters spread."""
    near = np.convolve(there, np.ones(2 * samples + 1), "same") > 0.5
    return np.asarray(moving & ~near)


def _within_table(
    moving: NDArray[np.bool_], position: Array, machine: Machine, samples: int
) -> NDArray[np.bool_]:
    """Samples with none near them beyond the ends of the inertia's table, which says nothing there.

    Where that would leave less than half of a run, its ends are believed as they are.
    """
    table = machine.load.inertia_table
    if table is None:
        return moving
    beyond = (position < table.position_rad[0]) | (position > table.position_rad[-1])
    within = _away_from(beyond, moving, samples)
    return within if within.sum() >= 0.5 * moving.sum() else moving


def _band(noise: Noise, machine: Machine, rate_hz: float) -> float:
    """Up to where the acceleration's noise times the moved inertia stays within reach of the torque's (Hz)."""
    load = machine.load_inertia
    inertia = machine.motor.inertia_kgm2
    if load is not None:
        inertia += load if isinstance(load, float) else float(np.mean(load.inertia_kgm2))
    frequency = np.linspace(LOWEST_BAND_HZ, HIGHEST_BAND_HZ, 200)
    omega = 2 * np.pi * frequency
    best = 1 / np.sqrt(1 / noise.speed_rad_s**2 + 1 / (omega * noise.position_rad) ** 2)
    drowned = inertia * omega * best > DROWNED * noise.torque_nm
    highest = frequency[np.argmax(drowned)] if drowned.any() else HIGHEST_BAND_HZ
    return float(min(max(highest, LOWEST_BAND_HZ), BAND_SHARE * rate_hz))


def _clear(runs: Sequence[Run], noise: Noise, band_hz: float) -> float:
    """A band, narrower where that is needed, in which the acceleration stands out of its own noise (Hz)."""
    rate = runs[0].sample_rate_hz
    while band_hz > LOWEST_NOISY_HZ:
        omega = 2 * np.pi * np.linspace(0.0, 1.2 * band_hz, 200)[1:]
        speed = 1 / (1 / noise.speed_rad_s**2 + 1 / (omega * noise.position_rad) ** 2)
        low = 1 / (1 + (omega / (2 * np.pi * band_hz)) ** ORDER)
        own = float(np.mean(omega**2 * speed * low**2)) * 2.4 * band_hz / rate
        whole = max(_acceleration_power(run, noise, band_hz) for run in runs)
        if own < NOISY**2 * max(whole - own, 0.0):
            break
        band_hz = max(0.85 * band_hz, LOWEST_NOISY_HZ)
    return band_hz


def _acceleration_power(run: Run, noise: Noise, band_hz: float) -> float:
    """Mean square of the acceleration within the band, signal and noise."""
    spectrum = Spectrum(len(run), run.sample_rate_hz, 4 / band_hz)
    share, low = speed_share(noise, np.abs(spectrum.omega)), spectrum.low_pass(band_hz)
    change = spectrum.apply(run.position_rad, low * spectrum.omega * (1 - share), "slope")
    change = change + spectrum.apply(run.speed_rad_s, low * share, "drop")
    return float(np.mean(spectrum.apply(change, low * spectrum.omega, "slope") ** 2))


def speed_share(noise: Noise, omega_rad_s: Array) -> Array:
    """Share of the reported speed, against the angle's derivative, at each angular frequency, (n,)."""
    crossing = noise.speed_rad_s / noise.position_rad
    if not np.isfinite(crossing):
        return np.zeros_like(omega_rad_s)
    return np.asarray(omega_rad_s**2 / (omega_rad_s**2 + crossing**2))


def _speed_filter(runs: Sequence[Run], noise: Noise, band_hz: float) -> SpeedFilter:
    """How late and how filtered the speed is reported; of one that says nothing of its own, no delay is known."""
    if any("speed_origin" in run.extra for run in runs):
        return SpeedFilter()
    jumps = [_unstepped(run).jumps_nm for run in runs]
    found = speed_filter(runs, jumps, band_hz, noise.position_rad, noise.speed_rad_s)
    if any(nothing_new(run) for run in runs):
        found = replace(found, delay_s=0.0, delay_std_s=np.inf)
    if any(run.is_held for run in runs):
        return replace(found, bend_s2=0.0, bend_std_s2=0.0, seen_s2=0.0, seen_std_s2=np.inf)
    return found


def drawn_noise(prepared: Prepared, spectrum: Spectrum, chance: np.random.Generator) -> Array:
    """What the channels' own noise may be in a run on the grid: angle, speed, acceleration and torque, (4, n)."""
    noise, band = prepared.noise, prepared.band_hz
    angle, speed, torque = chance.standard_normal((3, spectrum.samples)) * np.sqrt(
        prepared.rate_hz / prepared.source_rate_hz
    )
    share, low = speed_share(noise, np.abs(spectrum.omega)), spectrum.low_pass(MOTION_BAND * band)
    speed *= noise.speed_rad_s if np.isfinite(noise.speed_rad_s) else 0.0
    angle, change = _fused(spectrum, noise.position_rad * angle, speed, low * (1 - share), low * share)
    acceleration = spectrum.apply(change, spectrum.low_pass(2 * MOTION_BAND * band) * spectrum.omega, "slope")
    return np.stack([angle, change, acceleration, noise.torque_nm * torque])


def _fused(
    spectrum: Spectrum, angle: Array, speed: Array, of_angle: NDArray[Any], of_speed: NDArray[Any]
) -> tuple[Array, Array]:
    """Angle and speed as one motion, (n,) each: the reported angle by one gain, the reported speed's sum by another.

    A stiff coupling multiplies what the two differ by, and the counts of the angle would be all that one sees.
    """
    summed = np.cumsum(speed) / spectrum.rate_hz  # half a sample early, and larger by 1/sinc
    exact = np.sinc(spectrum.frequency_hz / spectrum.rate_hz) * np.exp(
        -0.5 * spectrum.omega / spectrum.rate_hz
    )
    of_sum, omega = of_speed * exact, spectrum.omega
    position = spectrum.apply(angle, of_angle) + spectrum.apply(summed, of_sum, "drop")
    change = spectrum.apply(angle, of_angle * omega, "slope") + spectrum.apply(summed, of_sum * omega, "drop")
    return position, change


def _moved(run: Run, noise: Noise, band_hz: float, filtered: SpeedFilter) -> tuple[Array, Array, Array]:
    """Angle, speed and acceleration of the motor, (n,) each, without lag."""
    spectrum = Spectrum(len(run), run.sample_rate_hz, 4 / band_hz)
    low = spectrum.low_pass(MOTION_BAND * band_hz)
    share = speed_share(noise, np.abs(spectrum.omega))
    of_speed = low * share * filtered.undone(spectrum.omega)
    position, speed = _fused(spectrum, run.position_rad, run.speed_rad_s, low * (1 - share), of_speed)
    acceleration = spectrum.apply(
        speed, spectrum.low_pass(2 * MOTION_BAND * band_hz) * spectrum.omega, "slope"
    )
    return position, speed, acceleration


class _Torque(NamedTuple):
    """Torque of a run at the instants of sampling, (n,) each."""

    total_nm: Array
    added_nm: Array
    jumps_nm: Array


def _unstepped(run: Run) -> _Torque:
    """Torque with a held injection by its fundamental in place of its steps.

    `torque_added` of a sample was in force over the step that ends with it: the fundamental is sinc(f/f_s) as large as
    the samples, and at the instant of sampling half a step further on.
    """
    if not run.is_held or run.torque_added_nm is None:
        nothing = np.zeros(len(run))
        return _Torque(run.torque_nm, nothing, nothing)
    spectrum = Spectrum(len(run), run.sample_rate_hz, 20 / run.sample_rate_hz)
    gain = np.sinc(spectrum.frequency_hz / run.sample_rate_hz) * np.exp(
        spectrum.omega * 0.5 / run.sample_rate_hz
    )
    added = spectrum.apply(run.torque_added_nm, gain)
    return _Torque(run.torque_nm - run.torque_added_nm + added, added, np.gradient(run.torque_added_nm))


def _anti_aliased(values: Array, factor: int, rate_hz: float) -> Array:
    """Low-passed for a grid of every `factor`-th sample."""
    if factor == 1:
        return values
    spectrum = Spectrum(values.size, rate_hz, 20 * factor / rate_hz)
    return spectrum.apply(values, spectrum.low_pass(0.35 * rate_hz / factor))


def _leaves_rest(speed: Array, peak: float) -> int:
    """First sample that moves."""
    moving = np.abs(speed) > STANDSTILL * peak
    return int(np.argmax(moving)) if moving.any() else 0
