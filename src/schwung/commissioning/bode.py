"""Frequency responses through the drive: hold at each angle, inject, record, move on slowly, come back.

The same set-up, way out, journal and recording as for commissioning (`procedure.record`); only the runs differ.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Iterator
from dataclasses import dataclass, field
from pathlib import Path
from typing import Literal

import numpy as np

from schwung.commissioning.commission import read_gains, settings_of
from schwung.commissioning.journal import Change, ParameterJournal
from schwung.commissioning.plan import (
    AMPLITUDE_SHARE,
    Limits,
    LimitWishes,
    Plan,
    PlannedRun,
    believed_inertia_range,
    limits_of,
)
from schwung.commissioning.preflight import (
    HEAVIER,
    Check,
    Preflight,
    Survey,
    bus_checks,
    drive_checks,
    share_check,
    simulated_run,
    survey,
    with_control,
)
from schwung.commissioning.procedure import MAX_JITTER_SHARE, Observer, Recorded, record
from schwung.drivetrain import FeedForward, Machine, Simulated, anti_resonance_hz, resonance_hz
from schwung.drivetrain.response import injection_to_speed, injection_to_torque
from schwung.errors import InputError
from schwung.estimation.bode import fit_bode
from schwung.estimation.bode_values import BodeFit
from schwung.estimation.response import BAND_SHARE, SETTLE_S, ComplexArray, measured_responses
from schwung.fieldbus.drive import Acquisition, Drive
from schwung.fieldbus.profile import DeviceProfile
from schwung.motion import Array, Excitation, Motion
from schwung.session import Session, read_session

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
#: Between angles: shares of the speed limit and of the torque limit, and the rest before and after (s).
_SLOW_SPEED, _SLOW_TORQUE, _REST_S = 0.1, 0.1, 0.1
_SHORTEST_MOVE_S = 0.3
#: Peak speed and acceleration of the fifth-order polynomial over distance/duration and distance/duration².
_POLY5_SPEED, _POLY5_ACCELERATION = 1.875, 5.774
#: However little the loop is damped, no run waits longer than this (s).
_LONGEST_SETTLING_S = 2.0
#: An angle nearer than this to where the axis stands needs no move (rad).
_THERE_RAD = 1e-4


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
class PreparedBode:
    """Everything known before the power stage is switched on."""

    plan: Plan
    runs: tuple[PlannedRun, ...]
    machine: Machine
    survey: Survey
    preflight: Preflight

    @property
    def duration_s(self) -> float:
        """Bus time of all runs."""
        return sum(run.motion.total_s for run in self.runs)


@dataclass(frozen=True, eq=False)
class MeasuredBode:
    """What was recorded and fitted, and where it lies."""

    prepared: PreparedBode
    session_path: Path
    session: Session
    recorded: Recorded
    fit: BodeFit
    changes: tuple[Change, ...]


def prepare_bode(drive: Drive, profile: DeviceProfile, machine: Machine, wishes: BodeWishes) -> PreparedBode:
    """Plan and check; reads the drive, changes nothing, moves nothing.

    Raises InputError where limits or beliefs are missing or a wish cannot be met; what preflight finds is in the
    result.
    """
    gains = read_gains(drive, profile)
    machine = with_control(machine, gains)
    limits = limits_of(wishes.limits, drive.limits(), machine)
    injected = profile.quantities.torque_added
    held = injected is None or injected.between_syncs == "held"
    grid = _grid(machine, wishes)
    lines = grid.lines_hz
    excitations = _excitations(machine, limits, wishes, grid, held)
    start = drive.state().position_rad
    runs = tuple(_runs(machine, limits, wishes.angles_rad, excitations, start))
    first = next(run for run in runs if run.excitation is not None)
    plan = Plan(
        motion=first.motion,
        excitation=excitations[0],
        repeats=wishes.repeats,
        acquisition=Acquisition(mode="csp", sample_rate_hz=wishes.sample_rate_hz),
        limits=limits,
        start_position_rad=start,
        reasons=tuple(_reasons(machine, wishes, excitations, lines)),
    )
    forward = FeedForward(speed_share=gains.get("speed_feed_forward", 0.0))
    seen = survey(drive, plan)
    simulated = [simulated_run(run, plan, machine, forward) for run in runs]
    checks = (
        *drive_checks(seen),
        *bus_checks(seen.bus_load),
        *_motion_checks(plan, simulated),
        *_band(machine, wishes.sample_rate_hz, lines),
    )
    by_position = held or wishes.sample_rate_hz * seen.resolution.position_rad < seen.resolution.speed_rad_s
    source: Literal["position", "drive"] = "position" if by_position else "drive"
    ready = Preflight(checks, source, simulated[0], simulated[runs.index(first)], None)
    return PreparedBode(plan, runs, machine, seen, ready)


def measure_bode(
    drive: Drive,
    prepared: PreparedBode,
    out: Path,
    observer: Observer,
    max_jitter_share: float = MAX_JITTER_SHARE,
) -> MeasuredBode:
    """Move, inject, record, fit. The session lies in `out` run by run; parameters are back when this returns.

    Raises RefusedError, DriveError, InterruptedByUser as `record` does, InputError where the recording allows no fit
    (it is kept).
    """
    path = out / "session.h5"
    journal = ParameterJournal(drive, out / "setup.backup.json", drive.describe())
    recorded = record(
        drive,
        prepared.plan,
        prepared.preflight,
        session_path=path,
        journal=journal,
        observer=observer,
        settings=settings_of(prepared.plan),
        max_jitter_share=max_jitter_share,
        runs=prepared.runs,
        source="schwung bode",
    )
    observer.phase("Fitting the responses")
    session = read_session(path)
    fit = fit_bode(measured_responses(session), prepared.machine)
    return MeasuredBode(prepared, path, session, recorded, fit, journal.changes)


# ── what is injected ─────────────────────────────────────────────────────────────────────────────────────────────


@dataclass(frozen=True, eq=False)
class _Grid:
    """Frequencies (Hz), (m,), all multiples of one, whose period is a whole number of samples."""

    base_hz: float
    lines_hz: Array


def _grid(machine: Machine, wishes: BodeWishes) -> _Grid:
    """Frequencies (Hz), spaced evenly on a logarithmic scale, on the grid of the period."""
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
    return _Grid(rate / period, np.unique(np.clip(np.rint(orders), 1, highest_order)) * rate / period)


def _excitations(
    machine: Machine, limits: Limits, wishes: BodeWishes, grid: _Grid, held: bool
) -> list[Excitation]:
    """One multisine per repeat, or one sine per frequency and repeat; within torque and deviation everywhere."""
    if wishes.periods < 2 or wishes.repeats < 1:
        raise InputError("--periods", "and --repeats are too few for a spread", "Two periods, one repeat.")
    peak = wishes.amplitude_nm or AMPLITUDE_SHARE * limits.torque_max_nm
    rate, base, lines = wishes.sample_rate_hz, grid.base_hz, grid.lines_hz
    hold, settle = 1 / rate if held else None, _settling_s(machine)
    found = []
    if wishes.waveform == "sine":
        steady = math.ceil(wishes.periods * _SINE_GRID_S * rate) / rate
        for _ in range(wishes.repeats):
            for line in lines:
                amplitude = peak * _share(machine, limits, np.array([line]), np.array([-1j * peak]))
                found.append(
                    Excitation(
                        frequency_hz=float(line), amplitude_nm=amplitude, ramp_s=_RAMP_S, settle_s=settle,
                        end_s=2 * _RAMP_S + settle + steady, hold_s=hold,
                    )
                )  # fmt: skip
        return found
    fade = lines[0] / _LOWEST_SHARE * _FADE_SHARE
    shape = np.minimum(1.0, lines / fade)
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


# ── where, and in which order ────────────────────────────────────────────────────────────────────────────────────


def _runs(
    machine: Machine, limits: Limits, angles: tuple[float, ...], excitations: list[Excitation], start: float
) -> Iterator[PlannedRun]:
    """To each angle and back to where it stood; moves are recorded as references, standstills as excited runs."""
    if not angles:
        raise InputError("--angles", "names none", "Give for instance --angles 0,90deg,180deg.")
    here, moves = start, 0
    _, largest = believed_inertia_range(machine)
    for angle in (*angles, None):
        target = start if angle is None else angle
        if abs(target - here) > _THERE_RAD:
            motion = _slow_move(machine, limits, target - here, largest)
            yield PlannedRun("reference", moves, motion, None, here)
            here, moves = target, moves + 1
        if angle is not None:
            for repeat, excitation in enumerate(excitations):
                length = (excitation.end_s or 0.0) + _REST_S
                still = Motion(  # there and back, by nothing
                    distance_rad=0.0, duration_s=length / 2, start_time_s=0.0, returns=True, dwell_s=0.0
                )
                yield PlannedRun("excited", repeat, still, excitation, here)


def _slow_move(machine: Machine, limits: Limits, distance: float, largest_kgm2: float) -> Motion:
    way = abs(distance)
    acceleration = _SLOW_TORQUE * limits.torque_max_nm / (machine.motor.inertia_kgm2 + largest_kgm2)
    duration = max(
        _SHORTEST_MOVE_S,
        _POLY5_SPEED * way / (_SLOW_SPEED * limits.speed_max_rad_s),
        math.sqrt(_POLY5_ACCELERATION * way / acceleration),
    )
    return Motion(
        kind="poly5",
        distance_rad=distance,
        duration_s=duration,
        start_time_s=_REST_S,
        returns=False,
        dwell_s=_REST_S + SETTLE_S,
    )


def _reasons(
    machine: Machine, wishes: BodeWishes, excitations: list[Excitation], lines: Array
) -> Iterable[str]:
    peak = max(e.amplitude_nm for e in excitations)
    what = "multisine" if wishes.waveform == "multisine" else "stepped sine"
    yield f"{what}, {lines.size} frequencies from {lines[0]:.3g} to {lines[-1]:.4g} Hz, up to {peak:.3g} N·m"
    if wishes.amplitude_nm is None:
        yield (
            f"amplitude: {AMPLITUDE_SHARE:.0%} of the torque limit, or less where the axis would leave its angle by "
            f"more than {MAX_DEVIATION_RAD:g} rad"
        )


# ── checks ───────────────────────────────────────────────────────────────────────────────────────────────────────


def _motion_checks(plan: Plan, simulated: list[Simulated]) -> Iterable[Check]:
    limits = plan.limits
    low = min(s.lowest_position_rad for s in simulated)
    high = max(s.highest_position_rad for s in simulated)
    inside = limits.position_min_rad <= low and high <= limits.position_max_rad
    yield Check(
        "room to move",
        "ok" if inside else "stop",
        f"{low:.4g} … {high:.4g} rad of {limits.position_min_rad:.4g} … {limits.position_max_rad:.4g} rad",
        "" if inside else "Choose other --angles, or widen the window if the machine allows it.",
    )
    torque = max(s.peak_torque_nm for s in simulated)
    clipped = any(bool(np.any(s.clipped)) for s in simulated)
    yield share_check(
        "torque",
        torque * (2 if clipped else 1),
        limits.torque_max_nm,
        f"up to {torque:.3g} of {limits.torque_max_nm:.3g} N·m{' and clipped' if clipped else ''}",
        "Inject less (--amplitude).",
    )
    speed = max(s.peak_speed_rad_s for s in simulated)
    yield share_check(
        "speed", speed, limits.speed_max_rad_s, f"up to {speed:.3g} of {limits.speed_max_rad_s:.3g} rad/s",
        "Inject less (--amplitude) or allow more (--max-speed).",
    )  # fmt: skip
    error = max(s.peak_following_error_rad for s in simulated)
    yield share_check(
        "following error", error, limits.following_error_rad,
        f"up to {error:.3g} of {limits.following_error_rad:.3g} rad",
        "Inject less (--amplitude), or widen 0x6065 in the drive.",
    )  # fmt: skip


def _band(machine: Machine, rate: float, lines: Array) -> Iterable[Check]:
    """What the rate lets us see of the believed machine."""
    if machine.coupling is None:
        return
    smallest, _ = believed_inertia_range(machine)
    low, high = float(anti_resonance_hz(machine, smallest)), float(resonance_hz(machine, smallest))
    top = float(lines[-1])
    if top > high:
        yield Check("band", "ok", f"up to {top:.0f} Hz: the believed resonance at {high:.0f} Hz is within it")
        return
    lost = "motor inertia and resonance" if top > low else "stiffness, damping and motor inertia"
    yield Check(
        "band",
        "warning",
        f"at {rate:g} Hz only {top:.0f} Hz can be reached; the believed anti-resonance reaches {low:.0f} Hz, the "
        f"resonance {high:.0f} Hz: {lost} will be uncertain",
        "Raise --rate if the bus allows it.",
    )
