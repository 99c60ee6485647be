"""What shall be done: motion, injection, repeats; with sensible proposals where the user left a gap."""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from typing import Protocol, get_args

import numpy as np

from schwung.commissioning.guarding import guard_of, travel_of
from schwung.commissioning.host_played import HostPlayed
from schwung.commissioning.limits import Limits
from schwung.drivetrain import InertiaTable, Machine, anti_resonance_hz
from schwung.errors import InputError
from schwung.estimation import MIN_PHASES
from schwung.fieldbus.drive import (
    MISSES_ALLOWED,
    Acquisition,
    Injecting,
    Move,
    OperatingMode,
    Sampling,
    Setpoints,
    Sine,
)
from schwung.fieldbus.profile import Generator, Trace
from schwung.fieldbus.tracing import trace_request
from schwung.motion import Array, Excitation, Motion, MotionKind
from schwung.session import Role

#: The injection stays at or below this share of the lowest believed anti-resonance: near it the gain is most
#: sensitive to J_l, above it the magnitude no longer tells the branch, and the belief may be off by a factor of two.
FREQUENCY_SHARE = 2 / 3
#: Share of the peak torque that is injected, as in the paper.
AMPLITUDE_SHARE = 0.2
#: Fewer samples per period than this leave the sliding DFT no room.
MIN_SAMPLES_PER_PERIOD = 10
#: Periods of the injection that the ramp takes, and that pass at full amplitude before the motion starts: the
#: controller answers the ramp for some tens of milliseconds.
RAMP_PERIODS, SETTLED_PERIODS = 2, 3
#: The grid on which the motion is simulated and a frequency is proposed where the drive samples by itself (Hz).
NOMINAL_RATE_HZ = 1000.0


class TorqueAlong(Protocol):
    """The torque beside the setpoints of a motion."""

    def __call__(self, motion: Motion, time_s: Array) -> Array:
        """For each setpoint, due at these instants (s): torque (N·m), (n,), held for the cycle before it."""
        ...


@dataclass(frozen=True)
class PlannedRun:
    """One motion to record; it starts where the plan says, unless it says otherwise."""

    role: Role
    repeat: int
    motion: Motion
    excitation: Excitation | None
    start_position_rad: float | None = None
    played: HostPlayed | None = None
    torque: TorqueAlong | None = None  # that belongs to the motion, beside its setpoints


@dataclass(frozen=True)
class Plan:
    """Everything that a commissioning run needs to know; made once, shown, then carried out."""

    motion: Motion
    excitation: Excitation
    repeats: int
    acquisition: Acquisition
    limits: Limits
    start_position_rad: float
    reasons: tuple[str, ...] = ()
    phases: int = 1  # of the injection, equally spaced over a period; one excited run for each
    slower: tuple[Motion, ...] = ()  # the same stroke in more time: tells what follows speed, place or time

    def runs(self) -> Iterator[PlannedRun]:
        """The motions in the order in which they are made: reference, then excited, so often as repeated.

        Several phases need no reference: one is made all the same, for the following error without injection.
        Slower ones are mixed in, so that what drifts is not mistaken for what follows speed.
        """
        for repeat in range(self.repeats):
            for motion in (self.motion, *self.slower):
                if self.phases == 1 or repeat == 0:
                    yield PlannedRun("reference", repeat, motion, None)
                for number in range(self.phases):
                    yield PlannedRun("excited", repeat, motion, self._turned(number, motion))

    @property
    def generator_starts_with_motion(self) -> bool:
        """The generator's phase counts from the motion's start; else it is on before, and only the drive knows."""
        return self.acquisition.injecting == "generator" and self.phases > 1

    @property
    def grid_rate_hz(self) -> float:
        """Samples per second of what is simulated: that of SYNC, or a nominal one where the drive samples."""
        return NOMINAL_RATE_HZ if self.acquisition.sampling == "trace" else self.acquisition.sample_rate_hz

    @property
    def recorded_rate_hz(self) -> float:
        """Samples per second of what is recorded."""
        return self.acquisition.trace_rate_hz or self.acquisition.sample_rate_hz

    @property
    def by_itself(self) -> bool:
        """The drive moves, injects and samples by itself: nothing depends on the instant at which a frame comes."""
        way = self.acquisition
        return (way.mode, way.sampling, way.injecting) == ("pp", "trace", "generator")

    @property
    def way_text(self) -> str:
        """Who moves, samples and injects, in words."""
        way = self.acquisition
        sampled = "sampled by SYNC" if way.sampling == "sync" else "sampled by the drive's trace"
        injected = (
            "injected by setpoints" if way.injecting == "setpoints" else "injected by the drive's generator"
        )
        return f"{way.mode.upper()}, {sampled}, {injected}"

    def excitation_of(self, motion: Motion) -> Excitation:
        """The injection, for so long as a motion lasts."""
        if self.acquisition.injecting == "generator":  # on all the time
            return self.excitation
        end = _injected_until(motion, self.excitation.frequency_hz)
        return self.excitation.model_copy(update={"end_s": end})

    def _turned(self, number: int, motion: Motion) -> Excitation:
        """The injection at its `number`-th phase, for so long as the motion lasts."""
        turned = self.excitation.phase_rad + 2 * math.pi * number / self.phases
        return self.excitation_of(motion).model_copy(update={"phase_rad": turned})

    def start_of(self, run: PlannedRun) -> float:
        """Where a run starts (rad)."""
        return self.start_position_rad if run.start_position_rad is None else run.start_position_rad

    def way_back(self, run: PlannedRun) -> PlannedRun | None:
        """The motion that undoes a run, without injection; None where the run returns by itself."""
        if run.motion.returns:
            return None
        end = self.start_of(run) + run.motion.distance_rad
        return PlannedRun("reference", run.repeat, run.motion.way_back(), None, end)

    @property
    def duration_s(self) -> float:
        """Bus time of all motions."""
        return sum(run.motion.total_s for run in self.runs()) * (1 if self.motion.returns else 2)


def _injected_until(motion: Motion, frequency_hz: float) -> float:
    """The injection ends half a period before the recording does (s)."""
    return motion.total_s - 0.5 / frequency_hz


def believed_inertia_range(machine: Machine) -> tuple[float, float]:
    """Smallest and largest believed J_l (kg·m²). Raises InputError where the machine file has none."""
    inertia = machine.load_inertia
    if inertia is None:
        raise InputError(
            f'machine "{machine.name}"',
            "load.inertia is not given, so the motion cannot be simulated before it is made",
            "Give a rough load.inertia; the measurement replaces it.",
        )
    if isinstance(inertia, InertiaTable):
        return float(inertia.inertia_kgm2.min()), float(inertia.inertia_kgm2.max())
    return inertia, inertia


def propose_frequency(machine: Machine, sample_rate_hz: float) -> tuple[float, str]:
    """Injection frequency (Hz) with a whole number of samples per period, and the reason for it."""
    _, largest = believed_inertia_range(machine)
    if machine.coupling is None:
        samples = 2 * MIN_SAMPLES_PER_PERIOD
        return sample_rate_hz / samples, f"rigid coupling: {samples} samples per period"
    anti_resonance = float(anti_resonance_hz(machine, largest))
    samples = max(MIN_SAMPLES_PER_PERIOD, math.ceil(sample_rate_hz / (FREQUENCY_SHARE * anti_resonance)))
    return (
        sample_rate_hz / samples,
        f"at most 2/3 of the lowest believed anti-resonance ({anti_resonance:.0f} Hz), {samples} samples a period",
    )


def make_plan(
    machine: Machine,
    limits: Limits,
    *,
    start_position_rad: float,
    distance_rad: float,
    duration_s: float,
    kind: str = "third",
    returns: bool = True,
    mode: OperatingMode = "csp",
    sample_rate_hz: float = 1000.0,
    frequency_hz: float | None = None,
    amplitude_nm: float | None = None,
    repeats: int = 2,
    phases: int = 1,
    also_s: Sequence[float] = (),
    torque_held: bool = True,
    heartbeat_s: float = 0.1,
    misses_allowed: int = MISSES_ALLOWED,
    sampling: Sampling = "sync",
    injecting: Injecting = "setpoints",
    trace: Trace | None = None,
    trace_rate_hz: float | None = None,
    generator: Generator | None = None,
) -> Plan:
    """Fill the gaps with proposals and say why. `torque_held`: the drive holds the injected torque between SYNCs.

    `also_s`: further times of the stroke, all longer than the first, by which everything is dimensioned. `trace` and
    `generator`: the drive's own, where it samples or injects by itself.

    Raises InputError where a wish cannot be met by any motion (too few samples per period, PP with a profile that
    drives do not have).
    """
    machine.require_torque("a commissioning")
    reasons = []
    _require_sense(distance_rad, duration_s, kind, sample_rate_hz, frequency_hz, amplitude_nm, repeats)
    for further in also_s:
        if not (math.isfinite(further) and further > duration_s):
            raise InputError(
                "--also", f"is {further:g} s", "Give longer times than --duration, the shortest."
            )
    if phases != 1 and (phases < MIN_PHASES or phases % 2):
        raise InputError(
            "--phases", f"is {phases}", "Use 1, or an even number from 4: pairs cancel the motion."
        )
    if mode == "pp" and kind != "third":
        raise InputError("--profile-kind", f'is "{kind}"', "In PP the drive makes a trapezoid: use third.")
    by_itself = sampling == "trace" and injecting == "generator"
    grid_hz = NOMINAL_RATE_HZ if by_itself else sample_rate_hz
    if frequency_hz is None:
        frequency_hz, why = propose_frequency(machine, grid_hz)
        reasons.append(f"injection at {frequency_hz:g} Hz: {why}")
    if injecting == "generator" and generator is not None:
        frequency_hz = round(frequency_hz / generator.frequency.scale) * generator.frequency.scale
    if grid_hz / frequency_hz < MIN_SAMPLES_PER_PERIOD:
        raise InputError(
            "--frequency",
            f"{frequency_hz:g} Hz leaves {grid_hz / frequency_hz:.1f} samples a period at {grid_hz:g} Hz",
            f"Stay at or below {grid_hz / MIN_SAMPLES_PER_PERIOD:g} Hz or sample faster.",
        )
    if amplitude_nm is None:
        amplitude_nm = AMPLITUDE_SHARE * limits.torque_max_nm
        reasons.append(
            f"amplitude {amplitude_nm:.3g} N·m: {AMPLITUDE_SHARE:.0%} of the torque limit, as in the paper"
        )
    period = 1 / frequency_hz
    rest = math.ceil((RAMP_PERIODS + SETTLED_PERIODS) * period * sample_rate_hz) / sample_rate_hz
    dwell = math.ceil(2 * period * sample_rate_hz + 0.05 * sample_rate_hz) / sample_rate_hz
    motion = Motion.model_validate(
        {
            "kind": kind,
            "distance_rad": distance_rad,
            "duration_s": duration_s,
            "start_time_s": rest,
            "returns": returns,
            "dwell_s": dwell + RAMP_PERIODS * period,
        }
    )
    excitation = Excitation(frequency_hz=frequency_hz, amplitude_nm=amplitude_nm)
    if injecting == "setpoints":
        excitation = Excitation(
            frequency_hz=frequency_hz,
            amplitude_nm=amplitude_nm,
            ramp_s=RAMP_PERIODS * period,
            end_s=_injected_until(motion, frequency_hz),
            hold_s=1 / sample_rate_hz if torque_held else None,
        )
    slower = tuple(motion.model_copy(update={"duration_s": further}) for further in also_s)
    trace_s = 0.0
    if sampling == "trace" and trace is not None:
        trace_s = max(m.total_s - m.start_time_s for m in (motion, *slower))
        trace_rate_hz = trace_request(trace, trace_s, trace_rate_hz).rate_hz
        _require_traceable(trace_rate_hz, frequency_hz, sample_rate_hz, injecting)
        reasons.append(f"the drive's trace samples at {trace_rate_hz:g} Hz, from the motion's start on")
    return Plan(
        motion=motion,
        excitation=excitation,
        repeats=repeats,
        acquisition=Acquisition(
            mode=mode,
            sample_rate_hz=sample_rate_hz,
            heartbeat_s=heartbeat_s,
            misses_allowed=misses_allowed,
            moves=moves_of(motion, start_position_rad, sample_rate_hz) if mode == "pp" else (),
            guard=guard_of(
                machine,
                limits,
                (motion, *slower),
                (excitation,),
                travel_of([(start_position_rad, motion)]),
                believed_inertia_range(machine)[1],
            ),
            sampling=sampling,
            injecting=injecting,
            trace_rate_hz=trace_rate_hz if sampling == "trace" else None,
            trace_s=trace_s,
        ),
        limits=limits,
        start_position_rad=start_position_rad,
        reasons=tuple(reasons),
        phases=phases,
        slower=slower,
    )


def _require_traceable(
    trace_rate_hz: float, frequency_hz: float, sample_rate_hz: float, injecting: Injecting
) -> None:
    """Raise InputError where the trace is too slow: for the injection, or for its staircase."""
    if trace_rate_hz / frequency_hz < MIN_SAMPLES_PER_PERIOD:
        raise InputError(
            "--trace-rate",
            f"{trace_rate_hz:g} Hz leaves {trace_rate_hz / frequency_hz:.1f} samples a period of {frequency_hz:g} Hz",
            "Trace faster, inject at a lower --frequency, or take a shorter motion.",
        )
    if injecting == "setpoints" and trace_rate_hz < (1 - 1e-6) * sample_rate_hz:
        raise InputError(
            "--trace-rate",
            f"{trace_rate_hz:g} Hz cannot resolve an injection that steps at {sample_rate_hz:g} Hz",
            "Trace as fast as SYNC comes at the least, or inject with the generator.",
        )


def _require_sense(
    distance_rad: float,
    duration_s: float,
    kind: str,
    sample_rate_hz: float,
    frequency_hz: float | None,
    amplitude_nm: float | None,
    repeats: int,
) -> None:
    """Raise InputError naming the first wish that no motion could fulfil."""
    if not (math.isfinite(distance_rad) and distance_rad != 0):
        raise InputError("--distance", f"is {distance_rad:g}", "Give the stroke in rad, signed.")
    for option, value in (
        ("--duration", duration_s),
        ("--rate", sample_rate_hz),
        ("--frequency", frequency_hz),
        ("--amplitude", amplitude_nm),
    ):
        if value is not None and not (math.isfinite(value) and value > 0):
            raise InputError(option, f"is {value:g}", "Give a positive number.")
    kinds = [name for name in get_args(MotionKind) if name != "points"]
    if kind not in kinds:
        raise InputError("--profile-kind", f'is "{kind}"', f"Use {', '.join(kinds)}.")
    if repeats < 1:
        raise InputError("--repeats", f"is {repeats}", "One at the least.")


def moves_of(motion: Motion, start_position_rad: float, sample_rate_hz: float) -> tuple[Move, ...]:
    """The strokes of a motion for a drive that makes its own trapezoid (PP)."""
    return tuple(
        Move(
            at_index=round(start * sample_rate_hz),
            target_rad=start_position_rad + (motion.distance_rad if number == 0 else 0.0),
            peak_speed_rad_s=motion.peak_speed_rad_s,
            acceleration_rad_s2=motion.peak_acceleration_rad_s2,
        )
        for number, start in enumerate(motion.stroke_starts_s)
    )


def setpoints_of(run: PlannedRun, plan: Plan) -> Setpoints:
    """The setpoints of one run, one per SYNC; absolute positions from where the axis rests."""
    rate, start = plan.acquisition.sample_rate_hz, plan.start_of(run)
    time = run.motion.time(rate)
    demand = run.motion.demand(time)
    added, sine = np.zeros_like(time), None
    if run.excitation is not None and plan.acquisition.injecting == "setpoints":
        added = run.excitation.torque(time)
    elif run.excitation is not None:
        sine = Sine(
            run.excitation.frequency_hz,
            run.excitation.amplitude_nm,
            run.excitation.phase_rad,
            from_motion=plan.generator_starts_with_motion,
        )
    if run.played is not None:
        added = added + run.played.torque(demand, start)
    if run.torque is not None:
        added = added + run.torque(run.motion, time)
    moves = moves_of(run.motion, start, rate) if plan.acquisition.mode == "pp" else ()
    return Setpoints(rate, start + demand.position_rad, added, moves, sine)
