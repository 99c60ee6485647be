"""Recordings made ready for a simulator to follow: the motor's motion without lag or needless noise, and its torque.

Angle and speed are weighed in the frequency domain by their own noise: below σ_ω/σ_θ (rad/s) the angle's derivative
is the better speed, above it the reported speed. All filters have zero phase. Everything beyond `band_hz`, where the
noise of the acceleration drowns any torque, is left out of motion and torque alike.

An injection that a bus refreshes once per SYNC is a staircase: its images at f_s ± f fall upon f where it is sampled.
At the instants of sampling they leave the angle alone to third order in f/f_s, but not the speed. So the angle gives
the motion, and the torque is what was reported with the staircase's fundamental in the staircase's place.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from schwung.errors import InputError
from schwung.motion import Array
from schwung.session.derived import speed_is_derived
from schwung.session.model import Run, Session
from schwung.simulators.noise import Noise, reported_noise
from schwung.simulators.spectrum import ORDER, Spectrum
from schwung.simulators.speed_filter import SpeedFilter, speed_filter

#: The band: at least this (Hz), at most that, and at most this share of the sampling rate.
LOWEST_BAND_HZ, HIGHEST_BAND_HZ, BAND_SHARE = 30.0, 300.0, 0.2
#: Where the acceleration's noise is this many times the torque's, the band ends.
DROWNED = 30.0
#: The band also ends where the acceleration's own noise reaches this share of the acceleration: a regressor as noisy
#: as that hides inertia. It then goes as low as LOWEST_NOISY_HZ.
NOISY, LOWEST_NOISY_HZ = 0.15, 4.0
#: The motion keeps so much more than the band, that products, signs and impacts of it are right within the band.
MOTION_BAND = 3.0
#: Rate of the grid over the band.
GRID_PER_BAND = 12.0


@dataclass(frozen=True, eq=False)
class Followed:
    """One run on the grid; arrays (n,)."""

    time_s: Array
    position_rad: Array
    speed_rad_s: Array
    acceleration_rad_s2: Array
    torque_nm: Array  # as reported, not band-limited; a held injection by its fundamental


@dataclass(frozen=True, eq=False)
class Recording:
    """A session made ready."""

    runs: tuple[Followed, ...]
    band_hz: float
    rate_hz: float  # of the grid
    source_rate_hz: float  # of the session
    noise: Noise
    samples: tuple[int, ...]  # of each run of the session


def recording_of(session: Session, inertia_kgm2: float) -> Recording:
    """Every run on one grid; `inertia_kgm2`: all that the motor moves, roughly.

    Raises InputError where runs are of different rates.
    """
    rates = {run.sample_rate_hz for run in session.runs}
    if len(rates) != 1:
        raise InputError(
            "session", f"has runs at {', '.join(f'{r:g}' for r in sorted(rates))} Hz", "Resample to one rate."
        )
    rate = rates.pop()
    noise = reported_noise(session.runs)
    band = _clear(session.runs, noise, _band(noise, inertia_kgm2, rate))
    factor = max(1, int(rate / (GRID_PER_BAND * band)))
    filtered = _speed_filter(session.runs, noise, band)
    runs = (_followed(run, _torque(run), noise, band, filtered, factor) for run in session.runs)
    return Recording(
        runs=tuple(runs),
        band_hz=band,
        rate_hz=rate / factor,
        source_rate_hz=rate,
        noise=noise,
        samples=tuple(len(run) for run in session.runs),
    )


def along(twin: Session, recording: Recording) -> Recording:
    """What a simulator did along the recorded runs, on their grid and in their band: it reports at once, unfiltered.

    Raises InputError where it is not run for run, sample for sample.
    """
    if tuple(len(run) for run in twin.runs) != recording.samples:
        raise InputError("twin", "has other runs than the recording", "Play it along every run.")
    factor = round(recording.source_rate_hz / recording.rate_hz)
    about = (recording.noise, recording.band_hz, SpeedFilter(), factor)
    return replace(recording, runs=tuple(_followed(run, run.torque_nm, *about) for run in twin.runs))


def _followed(
    run: Run, torque_nm: Array, noise: Noise, band_hz: float, filtered: SpeedFilter, factor: int
) -> Followed:
    at = slice(None, None, factor)
    position, speed, acceleration = _moved(run, noise, band_hz, filtered)
    torque = _anti_aliased(torque_nm, factor, run.sample_rate_hz)
    return Followed(run.time_s[at], position[at], speed[at], acceleration[at], torque[at])


def _band(noise: Noise, inertia_kgm2: float, rate_hz: float) -> float:
    """Up to where the acceleration's noise times the moved inertia stays within reach of the torque's (Hz)."""
    frequency = np.linspace(LOWEST_BAND_HZ, HIGHEST_BAND_HZ, 200)
    omega = 2 * np.pi * frequency
    best = 1 / np.sqrt(1 / noise.speed_rad_s**2 + 1 / (omega * noise.position_rad) ** 2)
    drowned = inertia_kgm2 * omega * best > DROWNED * noise.torque_nm
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
    share, low = _speed_share(noise, np.abs(spectrum.omega)), spectrum.low_pass(band_hz)
    change = spectrum.apply(run.position_rad, low * spectrum.omega * (1 - share), "slope")
    change = change + spectrum.apply(run.speed_rad_s, low * share, "drop")
    return float(np.mean(spectrum.apply(change, low * spectrum.omega, "slope") ** 2))


def _speed_share(noise: Noise, omega_rad_s: Array) -> Array:
    """Share of the reported speed, against the angle's derivative, at each angular frequency, (n,)."""
    crossing = noise.speed_rad_s / noise.position_rad
    if not np.isfinite(crossing):
        return np.zeros_like(omega_rad_s)
    return np.asarray(omega_rad_s**2 / (omega_rad_s**2 + crossing**2))


def _speed_filter(runs: Sequence[Run], noise: Noise, band_hz: float) -> SpeedFilter:
    """How late and how filtered the speed is reported; of one that says nothing of its own, no delay is known."""
    if any("speed_origin" in run.extra for run in runs):
        return SpeedFilter()
    found = speed_filter(runs, [_jumps(run) for run in runs], band_hz, noise.position_rad, noise.speed_rad_s)
    if speed_is_derived(runs):
        found = replace(found, delay_s=0.0)
    return replace(found, bend_s2=0.0) if any(run.is_held for run in runs) else found


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
    share = _speed_share(noise, np.abs(spectrum.omega))
    of_speed = low * share * filtered.undone(spectrum.omega)
    position, speed = _fused(spectrum, run.position_rad, run.speed_rad_s, low * (1 - share), of_speed)
    acceleration = spectrum.apply(
        speed, spectrum.low_pass(2 * MOTION_BAND * band_hz) * spectrum.omega, "slope"
    )
    return position, speed, acceleration


def _jumps(run: Run) -> Array:
    """Of a held injection, per sample, (n,); zero where none was held."""
    if not run.is_held or run.torque_added_nm is None:
        return np.zeros(len(run))
    return np.gradient(run.torque_added_nm)


def _torque(run: Run) -> Array:
    """Torque of a run at the instants of sampling, (n,), with a held injection by its fundamental.

    `torque_added` of a sample was in force over the step that ends with it: the fundamental is sinc(f/f_s) as large as
    the samples, and at the instant of sampling half a step further on.
    """
    if not run.is_held or run.torque_added_nm is None:
        return run.torque_nm
    spectrum = Spectrum(len(run), run.sample_rate_hz, 20 / run.sample_rate_hz)
    gain = np.sinc(spectrum.frequency_hz / run.sample_rate_hz) * np.exp(
        spectrum.omega * 0.5 / run.sample_rate_hz
    )
    return run.torque_nm - run.torque_added_nm + spectrum.apply(run.torque_added_nm, gain)


def _anti_aliased(values: Array, factor: int, rate_hz: float) -> Array:
    """Low-passed for a grid of every `factor`-th sample."""
    if factor == 1:
        return values
    spectrum = Spectrum(values.size, rate_hz, 20 * factor / rate_hz)
    return spectrum.apply(values, spectrum.low_pass(0.35 * rate_hz / factor))
