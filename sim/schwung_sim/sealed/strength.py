"""How strong an effect is: what it changes in the torque that the machine needs, over the noise floor.

Residual: reported torque minus the torque that the plain machine needs for the reported motor motion, in a band up
to BAND_HZ, root mean square over the strokes. Strength is what hidden physics adds to it, over the residual that the
noise alone leaves: the floor. The floor counts on the best combination of reported position and speed.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.signal import butter, sosfiltfilt

from schwung_sim.plants import TICK_S
from schwung_sim.plants.two_mass import TwoMassPlant
from schwung_sim.sealed.loop import PlayedAxis, needed_torque
from schwung_sim.sealed.machines import DrawnMachine

Array = NDArray[np.float64]

#: Upper end of the band in which residuals count (Hz).
BAND_HZ = 200.0
_LOW_PASS = butter(4, BAND_HZ, fs=1 / TICK_S, output="sos")
_FLOOR_POINTS = 400
_BISECTIONS = 24


@dataclass(frozen=True, eq=False)
class PlayedRun:
    """A run as played, with no noise but the encoder's: angle, speed and torque (SI) at every tick, (m, 3)."""

    index: int
    rows: Array


def play_runs(
    drawn: DrawnMachine, plant: TwoMassPlant, seed: int, indices: Sequence[int] | None = None
) -> list[PlayedRun]:
    """Play the session's runs (those of `indices`, in their order) one after the other on one axis.

    Raises BenchError where the plant diverges.
    """
    axis = PlayedAxis(plant, drawn.settings, seed)
    axis.energise(True)
    played = []
    for index in range(len(drawn.runs)) if indices is None else indices:
        run = drawn.runs[index]
        rest = round(run.pause_s / TICK_S)
        jitter = np.random.default_rng([seed, index, 41]).standard_normal(rest + run.stroke.time_s.size)
        jitter *= drawn.noise.position_rad
        axis.play(np.zeros(rest), np.zeros(rest), jitter[:rest])
        plant.state["motions"] = float(index)  # the run's start counts it: drift is told run by run
        rows = axis.play(run.stroke.demand_rad(), run.torque_added_nm(), jitter[rest:])
        played.append(PlayedRun(index, rows))
    return played


def residual(drawn: DrawnMachine, plain: TwoMassPlant, run: PlayedRun) -> Array:
    """Reported torque minus what the plain machine needs (N·m), in the band, at every tick, (m,)."""
    needed = np.empty(run.rows.shape[0])
    needed_torque(
        plain.parameters, plain.tables.inertia, float(run.rows[0, 0]), run.rows[:, 1].copy(), needed
    )
    return in_band(run.rows[:, 2] - needed)


def in_band(values: Array) -> Array:
    """Signals (m, …) at the control ticks without what is beyond BAND_HZ, and without lag."""
    return np.asarray(sosfiltfilt(_LOW_PASS, values, axis=0))


def residuals(drawn: DrawnMachine, played: Sequence[PlayedRun]) -> Array:
    """The residuals within the strokes of these runs (N·m), one after the other, (m,)."""
    plain = TwoMassPlant(drawn.drive, drawn.profile)
    return np.concatenate(
        [residual(drawn, plain, run)[drawn.runs[run.index].stroke.moving()] for run in played]
    )


def residual_rms(drawn: DrawnMachine, played: Sequence[PlayedRun]) -> float:
    """Root mean square of the residual over the strokes of these runs (N·m)."""
    return rms(residuals(drawn, played))


def rms(values: Array) -> float:
    """Root mean square."""
    return float(np.sqrt(np.mean(values**2)))


def representative_runs(drawn: DrawnMachine) -> list[int]:
    """For each motion time one run without and one with injection, spread over the session."""
    chosen: list[int] = []
    for stroke in dict.fromkeys(run.stroke for run in drawn.runs):
        for injected in (False, True):
            same = [
                i
                for i, run in enumerate(drawn.runs)
                if run.stroke == stroke and (run.injection is not None) == injected
            ]
            chosen.append(same[len(same) // 2])
    return chosen


def floor_nm(drawn: DrawnMachine) -> float:
    """The residual (N·m rms) that noise and the encoder's counts leave in the band.

    Torque noise, and speed noise through the machine's dynamic stiffness, averaged over the inertias of the stroke.
    Speed is known from two sources, the reported speed and the slope of the reported position; in each frequency they
    are weighed as their noise demands.
    """
    frequency = np.linspace(0.5, BAND_HZ, _FLOOR_POINTS)
    s = 2j * np.pi * frequency
    half_rate = 0.5 * drawn.rate_hz
    count = 2 * np.pi / drawn.settings.encoder_counts
    share = -np.expm1(-TICK_S / drawn.settings.speed_filter_s)
    angle = drawn.noise.position_rad**2 + count**2 / 12
    difference = angle * 2 / TICK_S**2 * share**2 / (2 - share)  # over a tick, filtered
    position = angle / half_rate
    speed = (drawn.noise.speed_rad_s**2 + difference) / half_rate
    combined = 1 / (1 / speed + 1 / (np.abs(s) ** 2 * position))
    drive = drawn.drive
    coupling = drive.damping_nms + drive.stiffness_nm_rad / s
    inertia = drawn.profile.at(drawn.angles_rad())[:, np.newaxis]
    load = inertia * s + drive.load_viscous_nms
    stiffness = drive.rotor_inertia_kgm2 * s + drive.rotor_viscous_nms + coupling * load / (coupling + load)
    density = drawn.noise.torque_nm**2 / half_rate + np.mean(np.abs(stiffness) ** 2, axis=0) * combined
    return float(np.sqrt(np.trapezoid(density, frequency)))


def strength(drawn: DrawnMachine, played: Sequence[PlayedRun], silent_nm: float) -> float:
    """What is hidden in these runs (N·m rms): their residual without what they have with nothing hidden."""
    return float(np.sqrt(max(residual_rms(drawn, played) ** 2 - silent_nm**2, 0.0)))


def size_for(
    measure: Callable[[float], float], target: float, highest: float, tolerance: float = 0.03
) -> float | None:
    """The size at which `measure` (growing with the size) gives `target`; None where `highest` is not enough.

    False position between logarithms: most effects grow as a power of their size. A measure of infinity is one too
    many.
    """
    low, high = highest * 1e-7, highest
    at_low, at_high = 1e-9 * target, measure(high)
    if at_high < target:
        return None
    guess = high * target / at_high if np.isfinite(at_high) else 0.1 * high
    for _ in range(_BISECTIONS):
        guess = min(max(guess, low * 1.0001), high * 0.9999)
        value = measure(guess)
        if abs(value / target - 1) < tolerance:
            return guess
        if value < target:
            low, at_low = guess, max(value, 1e-9 * target)
        else:
            high, at_high = guess, value
        middle = 0.5
        if np.isfinite(at_high) and at_low > 1e-3 * target:
            middle = float(np.clip(np.log(target / at_low) / np.log(at_high / at_low), 0.05, 0.95))
        elif np.isfinite(value) and value > 0:
            guess *= target / value
            if low < guess < high:
                continue
        guess = low * (high / low) ** middle
    return None
