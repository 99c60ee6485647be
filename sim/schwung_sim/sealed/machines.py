"""Random machines and the sessions recorded on them, in the spirit of the paper's Table 1 but over two decades.

Drawn: inertias, coupling, friction, gains, inertia profile, motion kind and times, repeats, phases of the injection,
sampling rate, noise. What is drawn moves well: a machine that does not come to rest is drawn again.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from schwung_sim.drives.axis import AxisSettings
from schwung_sim.errors import BenchError
from schwung_sim.plants.profile import Profile, four_bar, slider_crank
from schwung_sim.plants.two_mass import TwoMassMachine, TwoMassPlant
from schwung_sim.sealed.loop import PlayedAxis
from schwung_sim.sealed.motions import STROKES, Injection, PlannedRun, Stroke

Array = NDArray[np.float64]
Chance = np.random.Generator

PROFILE_KINDS = ("constant", "slider-crank", "four-bar", "table")
RATES_HZ = (1000.0, 2000.0, 4000.0, 8000.0)
_UNLIMITED_NM = 1e9
_HIGHEST_TORQUE_NM = 1500.0
#: The encoder's noise in counts, at least: with less, the errors of counting are the same in every repeat.
_LEAST_JITTER = 0.4
_ATTEMPTS = 60
#: What is left of the peak speed, and of the stroke, 10 ms before a run ends.
_AT_REST = 0.01


@dataclass(frozen=True)
class SignalNoise:
    """Standard deviations of white noise: the encoder's, within the loop, and what is added to speed and torque."""

    position_rad: float
    speed_rad_s: float
    torque_nm: float


@dataclass(frozen=True, eq=False)
class DrawnMachine:
    """A machine without concealed physics, its drive, and the session that is recorded on it."""

    drive: TwoMassMachine
    profile_kind: str
    profile: Profile
    settings: AxisSettings
    noise: SignalNoise
    rate_hz: float
    runs: tuple[PlannedRun, ...]

    @property
    def distance_rad(self) -> float:
        """The stroke, signed."""
        return self.runs[0].stroke.distance_rad

    @property
    def injection_hz(self) -> float:
        """Frequency of the injected sine."""
        return next(run.injection.frequency_hz for run in self.runs if run.injection)

    @property
    def peak_speed_rad_s(self) -> float:
        """About the highest speed: that of a 1/3 profile in the shortest time."""
        return 1.5 * abs(self.distance_rad) / min(run.stroke.duration_s for run in self.runs)

    def angles_rad(self, points: int = 65) -> Array:
        """Load angles over the stroke, (points,), increasing."""
        return np.sort(np.linspace(0.0, self.distance_rad, points))


def _log_uniform(chance: Chance, low: float, high: float) -> float:
    return float(np.exp(chance.uniform(np.log(low), np.log(high))))


def _profile(chance: Chance, kind: str, mean_kgm2: float, distance_rad: float) -> Profile:
    """Load inertia over the angle with about this mean, wherever in its turn the machine starts."""
    if kind == "constant":
        return Profile.constant(mean_kgm2)
    start = chance.uniform(0, 2 * np.pi)
    if kind == "slider-crank":
        swing, ratio = chance.uniform(0.8, 2.5), chance.uniform(0.15, 0.4)
        scale = mean_kgm2 / (1.0 + 0.5 * swing)
        return Profile.of_turn(lambda a: slider_crank(a + start, scale, swing * scale, ratio))
    if kind == "four-bar":
        rocker = chance.uniform(1.0, 4.0)
        scale = mean_kgm2 / (1.0 + 0.1 * rocker)
        return Profile.of_turn(lambda a: four_bar(a + start, scale, rocker * scale))
    margin = 0.3
    low, high = min(0.0, distance_rad) - margin, max(0.0, distance_rad) + margin
    count = int(chance.integers(5, 9))
    points = np.linspace(low, high, count)
    return Profile.of_pairs(points, mean_kgm2 * np.exp(chance.uniform(-0.45, 0.45, count)))


def _drive(chance: Chance, profile: Profile, angles: Array, ratio: float) -> TwoMassMachine:
    inertia = profile.at(angles)
    mean = float(np.mean(inertia))
    rotor = ratio * mean
    anti_resonance = 2 * np.pi * _log_uniform(chance, 45.0, 140.0)
    stiffness = mean * anti_resonance**2
    damping = 2 * chance.uniform(0.03, 0.25) * np.sqrt(stiffness * rotor * mean / (rotor + mean))
    return TwoMassMachine(rotor, 0.0, stiffness, damping, 0.0, _UNLIMITED_NM)


def _settings(chance: Chance, drive: TwoMassMachine, highest_kgm2: float) -> AxisSettings:
    bandwidth = chance.uniform(60.0, 140.0)
    return AxisSettings(
        position_gain_1_s=bandwidth * chance.uniform(0.35, 0.6),
        speed_gain_nms_rad=bandwidth * (drive.rotor_inertia_kgm2 + highest_kgm2),
        speed_integral_time_s=chance.uniform(2.0, 4.0) / bandwidth,
        speed_feed_forward=float(chance.uniform() < 0.6),
        rotor_inertia_kgm2=drive.rotor_inertia_kgm2,
        torque_limit_nm=_UNLIMITED_NM,
        speed_filter_s=float(chance.choice([100e-6, 200e-6])),
        encoder_counts=2 ** int(chance.integers(19, 23)),
    )


def _runs(chance: Chance, amplitude_nm: float, distance_rad: float) -> tuple[PlannedRun, ...]:
    """Two or three motion times; of each two or three references, and two to four phases of the injection."""
    kind = str(chance.choice(list(STROKES)))
    times = 0.12 * (500 / 120) ** (np.arange(3) / 2 + chance.uniform(-0.12, 0.12, 3))
    times = np.clip(times, 0.12, 0.5)
    if chance.uniform() < 0.4:
        times = times[[0, 2]] if chance.uniform() < 0.5 else times[1:]
    frequency = float(np.round(chance.uniform(28.0, 65.0)))
    start, dwell = 0.16, chance.uniform(0.09, 0.13)
    references, phases = int(chance.integers(2, 4)), int(chance.integers(2, 5))
    turns = np.array([0.0, 0.5, 0.25, 0.75])[:phases] if phases != 3 else np.arange(3) / 3
    runs = []
    for duration in np.round(times, 4):
        stroke = Stroke(kind, distance_rad, float(duration), start, float(dwell))
        plan: list[tuple[Injection | None, int]] = [(None, repeat) for repeat in range(references)]
        plan += [
            (Injection(frequency, amplitude_nm, 2 * np.pi * float(turn), 0.04, stroke.total_s), 0)
            for turn in turns
        ]
        runs += [
            PlannedRun(stroke, injection, repeat, float(chance.uniform(0.2, 0.5)))
            for injection, repeat in plan
        ]
    return tuple(runs)


def draw_machine(chance: Chance) -> DrawnMachine:
    """A random machine that moves well, with a session planned for it. Raises BenchError where none is found."""
    for _ in range(_ATTEMPTS):
        drawn = _attempt(chance)
        if drawn is not None:
            return drawn
    raise BenchError("sealed machine", f"did not come to rest in {_ATTEMPTS} draws")


def _attempt(chance: Chance) -> DrawnMachine | None:
    distance = _log_uniform(chance, 1.2, 9.0) * (1.0 if chance.uniform() < 0.8 else -1.0)
    kind = str(chance.choice(list(PROFILE_KINDS)))
    mean = _log_uniform(chance, 0.003, 0.3)
    profile = _profile(chance, kind, mean, distance)
    angles = np.sort(np.linspace(0.0, distance, 65))
    highest = float(np.max(profile.at(angles)))
    drive = _drive(chance, profile, angles, _log_uniform(chance, 0.08, 0.5))
    settings = _settings(chance, drive, highest)
    shares = chance.uniform(0.003, 0.03), chance.uniform(0.001, 0.015), chance.uniform(0.08, 0.25)
    spare, rate = chance.uniform(1.8, 3.5), float(chance.choice(list(RATES_HZ)))
    noise_shares = (
        _log_uniform(chance, 5e-7, 5e-6),
        _log_uniform(chance, 3e-4, 3e-3),
        _log_uniform(chance, 5e-4, 3e-3),
    )
    encoder_rad = max(noise_shares[0], _LEAST_JITTER * 2 * np.pi / settings.encoder_counts)
    runs = _runs(chance, 1.0, distance)
    fastest = min((run for run in runs if run.injection is None), key=lambda run: run.stroke.duration_s)
    peak_speed = 1.5 * abs(distance) / fastest.stroke.duration_s
    drawn = DrawnMachine(
        drive,
        kind,
        profile,
        settings,
        SignalNoise(encoder_rad, noise_shares[1] * peak_speed, 0.0),
        rate,
        runs,
    )
    torque = _peak_torque(drawn, fastest)
    if torque is None or torque > _HIGHEST_TORQUE_NM:
        return None
    amplitude = shares[2] * torque
    drive = replace(
        drive,
        rotor_viscous_nms=shares[0] * torque / peak_speed,
        load_viscous_nms=shares[1] * torque / peak_speed,
        peak_torque_nm=spare * torque,
    )
    injected = tuple(
        replace(run, injection=replace(run.injection, amplitude_nm=amplitude)) if run.injection else run
        for run in runs
    )
    return replace(
        drawn,
        drive=drive,
        settings=replace(settings, torque_limit_nm=drive.peak_torque_nm),
        noise=replace(drawn.noise, torque_nm=noise_shares[2] * torque),
        runs=injected,
    )


def _peak_torque(drawn: DrawnMachine, run: PlannedRun) -> float | None:
    """Highest torque (N·m) of a run; None where the axis has not come to rest at its end."""
    axis = PlayedAxis(TwoMassPlant(drawn.drive, drawn.profile), drawn.settings)
    axis.energise(True)
    demand = run.stroke.demand_rad()
    try:
        rows = axis.play(demand, np.zeros_like(demand), np.zeros_like(demand))
    except BenchError:
        return None
    end = rows[-80:]
    speed, distance = drawn.peak_speed_rad_s, abs(drawn.distance_rad)
    if np.max(np.abs(end[:, 1])) > _AT_REST * speed or np.max(np.abs(end[:, 0])) > _AT_REST * distance:
        return None
    return float(np.max(np.abs(rows[:, 2])))
