"""The creep: a few degrees at low speed with a small injected torque, before the first full stroke.

Demand and position are in one unit, so that a stroke alone proves nothing. What does is the injected sine: the torque
that comes back has to hold it (sign and scale of torque), what the torque accelerates has to weigh what is believed
(torque against position), and the speed has to be the position's (`proof.py`). A unit that is wrong by a large factor
makes the first stroke as much longer than it was meant to be; so the axis first only holds while the torque is
injected, and strokes grow fourfold from a 256th, until the units are proven or found wrong. What is injected is small
in counts of the drive's own torque, whatever those are worth.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator
from dataclasses import dataclass

import numpy as np

from schwung.commissioning.evidence import evidence_of
from schwung.commissioning.plan import (
    AMPLITUDE_SHARE,
    MIN_SAMPLES_PER_PERIOD,
    Plan,
    PlannedRun,
    believed_inertia_range,
)
from schwung.commissioning.proof import Belief, Proof, cascade, judge
from schwung.commissioning.runs import run_of
from schwung.drivetrain import Machine, anti_resonance_hz
from schwung.drivetrain.response import injection_to_speed, injection_to_torque
from schwung.errors import RefusedError
from schwung.fieldbus import cia402
from schwung.fieldbus.drive import Drive, Recording, Resolution
from schwung.motion import Excitation, Motion
from schwung.session import Run

#: Of the lowest believed anti-resonance: three times the believed load inertia still moves with the motor.
FREQUENCY_SHARE = 0.25
#: The lowest frequency is this much below the highest.
LOWEST_SHARE = 3
#: Counts that the sine shall be high in the reported torque and position, and injected at most while nothing is proven.
TORQUE_COUNTS, POSITION_COUNTS, UNPROVEN_COUNTS = 20.0, 8.0, 100.0
#: Periods of the sine within a stroke, and those that it takes to rise and to settle.
PERIODS, RAMP_PERIODS, SETTLED_PERIODS = 6, 2, 2
#: The creep's length (rad), at first and where friction hides the sine; and its peak speed over what the sine adds.
SHORTEST_RAD, LONG_RAD, LONGEST_RAD = math.radians(1.0), math.radians(2.0), math.radians(6.0)
SPEED_OVER_RIPPLE = 2.0
#: Share of the speed limit, and of the stroke, that the creep takes at the most.
SPEED_SHARE, STROKE_SHARE = 0.1, 0.5
#: Strokes before it, as shares of it; and how much further it may go where friction hides the sine.
GROWING, FURTHER = (1 / 256, 1 / 64, 1 / 16, 1 / 4), (2.0, 4.0, 8.0)
#: Counts of position in the shortest stroke, and of speed in the slowest that a drive is asked to make by itself.
LEAST_COUNTS, LEAST_SPEED_COUNTS = 8.0, 2.0
#: Share of a stroke by which the axis may miss its end while the sine is on.
FOLLOWED = 0.25
#: An enabled drive says within so long that it follows (s).
FOLLOWS_WITHIN_S = 0.1


@dataclass(frozen=True)
class Stage:
    """One small motion. `decisive`: far enough from friction and play for the last word."""

    planned: PlannedRun
    decisive: bool


@dataclass(frozen=True, eq=False)
class Creep:
    """The small motions in the order in which they are made, and what is believed of the machine."""

    stages: tuple[Stage, ...]
    belief: Belief
    resolution: Resolution

    @property
    def text(self) -> str:
        """What will be done first, in words."""
        last = next(stage.planned for stage in self.stages if stage.decisive)
        assert last.excitation is not None
        return (
            f"{math.degrees(abs(last.motion.distance_rad)):.2g}° at {last.motion.peak_speed_rad_s:.2g} rad/s with "
            f"{last.excitation.amplitude_nm:.2g} N·m at {last.excitation.frequency_hz:.3g} Hz prove signs and units "
            "before the first stroke"
        )

    def motions(self, plan: Plan) -> Iterator[PlannedRun]:
        """The largest that may be moved, the ways back included; the others are the same with less."""
        for stage in (stage for stage in self.stages if stage.decisive):
            yield stage.planned
            back = plan.way_back(stage.planned)
            if back is not None:
                yield back


def creep_of(plan: Plan, machine: Machine, resolution: Resolution) -> Creep | None:
    """The creep for a plan; None where the drive tells no unit of torque, so that nothing can be proven.

    Raises InputError where the machine's load inertia or gains are not believed.
    """
    count = resolution.torque_nm
    if not (math.isfinite(count) and count > 0 and resolution.position_rad > 0):
        return None
    smallest, largest = believed_inertia_range(machine)
    frequency = _frequency_hz(plan, machine, largest)
    inertias, turning = np.array([smallest, largest]), 2 * math.pi * frequency
    speed = np.abs(injection_to_speed(machine, inertias, frequency))  # rad/s per N·m
    torque = np.abs(injection_to_torque(machine, inertias, frequency))
    most = min(plan.excitation.amplitude_nm, AMPLITUDE_SHARE * plan.limits.torque_max_nm)
    amplitude = max(
        TORQUE_COUNTS * count / float(torque.min()),
        POSITION_COUNTS * resolution.position_rad * turning / float(speed.min()),
    )
    amplitude = min(amplitude, most)
    stroke_s = _stroke_s(plan, frequency)
    longest = min(LONGEST_RAD, STROKE_SHARE * abs(plan.motion.distance_rad or LONGEST_RAD),
                  SPEED_SHARE * plan.limits.speed_max_rad_s * stroke_s / 1.5)  # fmt: skip
    ripple = amplitude * float(speed.max())
    length = min(max(SPEED_OVER_RIPPLE * ripple * stroke_s / 1.5, SHORTEST_RAD), LONG_RAD, longest)
    slowest = _slowest_rad_s(plan, resolution)
    length = min(max(length, slowest * stroke_s / 1.5), longest)
    if slowest > 0:
        stroke_s = min(stroke_s, 1.5 * length / slowest)
    at_first = min(amplitude, UNPROVEN_COUNTS * _added_count(resolution))

    def stage(share: float, injected_nm: float, decisive: bool) -> Stage:
        distance = math.copysign(min(share * length, longest), _direction(plan))
        return Stage(_run(plan, frequency, injected_nm, distance, stroke_s), decisive)

    stages = []
    if plan.acquisition.mode == "csp" and plan.acquisition.sampling == "sync":
        stages.append(stage(0.0, at_first, False))
    for share in GROWING:
        if _is_felt(share * length, stroke_s, plan, resolution):
            stages.append(stage(share, max(at_first, share * amplitude), False))
    stages.append(stage(1.0, amplitude, True))
    for share in FURTHER:
        if share / 2 * amplitude < most or share / 2 * length < longest:
            stages.append(stage(share, min(share * amplitude, most), True))
    return Creep(tuple(stages), Belief(machine, frequency), resolution)


def _direction(plan: Plan) -> float:
    """That of the motion; where it has none, to where there is more room."""
    limits, start = plan.limits, plan.start_position_rad
    middle = (limits.position_min_rad + limits.position_max_rad) / 2
    return plan.motion.distance_rad or middle - start


def _frequency_hz(plan: Plan, machine: Machine, largest_kgm2: float) -> float:
    """A whole number of samples a period, well below the lowest believed anti-resonance; there where the cascade's
    answer to the motion is told best from the injected torque. Samples are those that are played or those that are
    recorded, whichever are fewer: a drive's trace may be slow."""
    rate = min(plan.grid_rate_hz, plan.recorded_rate_hz)
    highest = FREQUENCY_SHARE * float(anti_resonance_hz(machine, largest_kgm2))
    fewest = max(math.ceil(rate / highest), (2 if math.isinf(highest) else 1) * MIN_SAMPLES_PER_PERIOD)
    candidates = rate / np.arange(fewest, LOWEST_SHARE * fewest + 1)
    speed = injection_to_speed(machine, largest_kgm2, candidates)
    answer = speed * cascade(machine, candidates) / (2j * np.pi * candidates)
    apart = np.abs(answer.imag) / np.maximum(np.abs(answer), 1.0)  # from the injection, which has the angle 0
    return float(candidates[int(np.argmax(apart))])


def _stroke_s(plan: Plan, frequency_hz: float) -> float:
    """As long as the sine takes for its periods in the middle of the stroke, and no longer than a trace holds."""
    wanted, traced = PERIODS / frequency_hz / 0.7, plan.acquisition.trace_s
    if plan.acquisition.sampling == "trace" and traced > 0:
        return min(wanted, 0.7 * traced)
    return wanted


def _added_count(resolution: Resolution) -> float:
    added = resolution.torque_added_nm
    return added if math.isfinite(added) and added > 0 else resolution.torque_nm


def _slowest_rad_s(plan: Plan, resolution: Resolution) -> float:
    """The lowest peak speed that a drive is asked to make by itself: it takes whole counts."""
    told = plan.acquisition.mode == "pp" and math.isfinite(resolution.speed_rad_s)
    return LEAST_SPEED_COUNTS * resolution.speed_rad_s if told else 0.0


def _is_felt(distance: float, stroke_s: float, plan: Plan, resolution: Resolution) -> bool:
    """Whether such a stroke is more than nothing in counts."""
    slow = 1.5 * distance / stroke_s < _slowest_rad_s(plan, resolution)
    return distance >= LEAST_COUNTS * resolution.position_rad and not slow


def _run(
    plan: Plan, frequency_hz: float, amplitude_nm: float, distance_rad: float, stroke_s: float
) -> PlannedRun:
    period, rate = 1 / frequency_hz, plan.acquisition.sample_rate_hz
    by_setpoints = plan.acquisition.injecting == "setpoints"
    returns = plan.acquisition.sampling == "sync" and (plan.acquisition.mode == "csp" or plan.motion.returns)
    before = (RAMP_PERIODS + SETTLED_PERIODS) * period
    after = max(RAMP_PERIODS * period, 0.05)
    if not by_setpoints:  # the generator is on before the motion
        before, after = max(0.05, 2 / rate), 0.05
    motion = Motion(
        distance_rad=distance_rad,
        duration_s=stroke_s / 2 if distance_rad == 0 else stroke_s,
        start_time_s=math.ceil(before * rate) / rate,
        returns=returns,
        dwell_s=math.ceil(after * rate) / rate if distance_rad or not returns else after / 2,
    )
    excitation = Excitation(
        frequency_hz=frequency_hz,
        amplitude_nm=amplitude_nm,
        hold_s=plan.excitation.hold_s,
        ramp_s=RAMP_PERIODS * period if by_setpoints else None,
        end_s=motion.total_s - 0.5 * period if by_setpoints else None,
    )
    return PlannedRun("excited", 0, motion, excitation)


# ── carrying it out ──────────────────────────────────────────────────────────────────────────────────────────────────

#: Plays a run and records it without a gap.
Play = Callable[[PlannedRun], Recording]


def prove(
    drive: Drive,
    plan: Plan,
    creep: Creep,
    play: Play,
    go_back: Callable[[PlannedRun], None],
    keep: Callable[[Run, str], None],
) -> tuple[str, ...]:
    """Make the small motions of an enabled drive until its signs and units are proven; returns what has to be noted.

    `keep` gets each recorded stage with what it showed. Raises RefusedError with the relation that does not hold; who
    calls switches the drive off.
    """
    if plan.acquisition.mode == "csp":
        _require_following_command(drive)
    proof, known = None, False
    for stage in creep.stages:
        if known and not stage.decisive:
            continue
        run = run_of(play(stage.planned), stage.planned, plan, "drive")
        found = evidence_of(run, _counts(creep.resolution))
        proof = judge(found, creep.belief, last=stage is creep.stages[-1])
        keep(run, _told(proof))
        if proof.wrong is not None:
            raise RefusedError("creep", proof.wrong.text, proof.wrong.remedy)
        if stage.decisive:
            _require_followed(run, stage.planned.motion, abs(found.position.value), creep.resolution)
        go_back(stage.planned)
        known = proof.proven
        if known and stage.decisive:
            return proof.notes
    if proof is None or known:
        return ()
    raise RefusedError(
        "creep",
        f"the injected torque did not move the axis enough to prove {' and '.join(proof.unclear)}",
        "Is a brake closed, or something in the way? Else inject more (--amplitude) or allow more (--max-torque).",
    )


def _counts(resolution: Resolution) -> tuple[float, float, float]:
    speed = resolution.speed_rad_s
    return resolution.position_rad, speed if math.isfinite(speed) else 0.0, resolution.torque_nm


def _told(proof: Proof) -> str:
    findings = (
        f"{finding.name}: {finding.outcome}"
        + (f" ({finding.factor:.4g})" if math.isfinite(finding.factor) else "")
        for finding in proof.findings
    )
    return "; ".join((*findings, *proof.notes))


def _require_following_command(drive: Drive) -> None:
    """Bit 12 of the statusword, in cyclic synchronous position: the drive follows the command value (CiA 402-2)."""
    parameter = drive.parameter(0x6041)

    def word() -> int:
        raw = drive.read(parameter).raw
        return raw if isinstance(raw, int) else 0

    if not drive.clock.wait(lambda: bool(word() & cia402.SET_POINT_ACKNOWLEDGE), FOLLOWS_WITHIN_S):
        raise RefusedError(
            "creep",
            f"the drive does not follow its setpoints (statusword 0x{word():04X}, bit 12 is 0 in cyclic position)",
            "Look for a stop, a limit or a source of setpoints of the drive's own; or use --mode pp.",
        )


def _require_followed(run: Run, motion: Motion, ripple_rad: float, resolution: Resolution) -> None:
    """A stroke goes where it was sent."""
    assert run.motion is not None
    start = run.motion.stroke_starts_s[0]
    ends = np.searchsorted(run.time_s, [start, start + motion.duration_s + motion.dwell_s / 2])
    first, last = run.position_rad[np.minimum(ends, run.position_rad.size - 1)]
    went = float(last - first)
    slack = FOLLOWED * abs(motion.distance_rad) + 3 * ripple_rad + LEAST_COUNTS * resolution.position_rad
    if abs(went + motion.distance_rad) <= slack < abs(motion.distance_rad):
        raise RefusedError(
            "creep", f"the axis was sent {motion.distance_rad:.3g} rad and went the other way, {went:.3g} rad",
            "The drive turns demands, but not what it reports: look at 607E (polarity).",
        )  # fmt: skip
    if abs(went - motion.distance_rad) > slack:
        raise RefusedError(
            "creep", f"the axis was sent {motion.distance_rad:.3g} rad and went {went:.3g} rad",
            "Look for a brake, a limit of the drive (607D, 6080, 6072), or something in the way.",
        )  # fmt: skip
