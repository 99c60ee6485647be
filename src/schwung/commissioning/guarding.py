"""What the drive shall keep by itself for a plan, and what it cannot keep, in words."""

from __future__ import annotations

from collections.abc import Iterable, Sequence

import numpy as np

from schwung.commissioning.checks import Check
from schwung.commissioning.limits import Limits
from schwung.drivetrain import Machine
from schwung.drivetrain.response import injection_to_speed
from schwung.fieldbus.drive import DriveLimits, Guard
from schwung.motion import Excitation, Motion

#: The drive may turn so much faster than the motion is meant to: overshoot, and what the belief is off by.
SPEED_MARGIN = 1.5
#: The following error may be too large for so long (s): its limit has its own margin, noise alone is to be bridged.
FOLLOWING_TIME_S = 0.02

#: What is relied upon where a drive lacks an object, by the names of DriveLimits.lacking.
_RELIED = {
    "607D": "where the axis may be is watched by Schwung's own setpoints alone",
    "6065": "nothing stops an axis that does not follow",
    "6066": "how long an axis may be off is the drive's own affair",
    "6072": "torque is bounded by the motor's data in the drive alone",
    "6080 and 607F": "speed is bounded by the setpoints and the following error alone",
    "6085": "how hard a quick stop brakes is the drive's own affair",
}
#: The same where a drive has no objects.
_REGISTERS = {
    "position limits": "607D", "following error": "6065", "following error time": "6066", "torque limit": "6072",
    "speed limit": "6080 and 607F",
}  # fmt: skip
#: The rated torque of the drive may be off that of the machine file by this factor, and its peak torque above it.
_RATED_MARGIN, _PEAK_MARGIN = 1.5, 20.0


def travel_of(strokes: Sequence[tuple[float, Motion]]) -> tuple[float, float]:
    """Between which ends the axis is sent by motions from where each starts (rad)."""
    ends = [end for start, motion in strokes for end in (start, start + motion.distance_rad)]
    return min(ends), max(ends)


def guard_of(
    machine: Machine,
    limits: Limits,
    motions: Sequence[Motion],
    excitations: Sequence[Excitation],
    travel_rad: tuple[float, float],
    largest_inertia_kgm2: float,
) -> Guard:
    """The limits for motions between the two ends of `travel_rad`: no wider than the machine's, no faster than needed.

    A quick stop from the highest speed shall end between where the strokes end and where the window does, as far as the
    torque limit lets the largest believed inertia be braked.
    """
    room = min(travel_rad[0] - limits.position_min_rad, limits.position_max_rad - travel_rad[1])
    needed = max(motion.peak_speed_rad_s for motion in motions) + _ripple(
        machine, excitations, largest_inertia_kgm2
    )
    speed = min(limits.speed_max_rad_s, SPEED_MARGIN * needed)
    hardest = hardest_stop(machine, limits, largest_inertia_kgm2)
    return Guard(
        limits.position_min_rad,
        limits.position_max_rad,
        limits.torque_max_nm,
        limits.following_error_rad,
        following_error_time_s=FOLLOWING_TIME_S,
        speed_max_rad_s=speed,
        stop_deceleration_rad_s2=min(speed**2 / (2 * room), hardest) if room > 0 else hardest,
        travel_rad=travel_rad,
    )


def _ripple(machine: Machine, excitations: Sequence[Excitation], inertia_kgm2: float) -> float:
    """What the injection adds to the speed at the most (rad/s)."""
    if machine.control is None:
        return 0.0
    answers = (
        np.sum(np.abs(excitation.phasors_nm * injection_to_speed(machine, inertia_kgm2, excitation.lines_hz)))
        for excitation in excitations
    )
    return float(max(answers))


def hardest_stop(machine: Machine, limits: Limits, inertia_kgm2: float) -> float:
    """The deceleration that the torque limit makes of the believed inertia (rad/s²)."""
    return limits.torque_max_nm / (machine.motor.inertia_kgm2 + inertia_kgm2)


def guard_checks(guard: Guard, seen: DriveLimits, machine: Machine, hardest_rad_s2: float) -> Iterable[Check]:
    """What the drive lacks of these limits, and whether a quick stop ends within the window.

    `hardest_rad_s2`: the deceleration that the torque limit allows, see `hardest_stop`.
    """
    yield from lacking_checks(seen)
    yield from _wrap(guard, seen)
    yield from _stop(guard, seen, hardest_rad_s2)
    yield from _rated(seen, machine)


def lacking_checks(seen: DriveLimits) -> Iterable[Check]:
    """By what the drive cannot be guarded, and what is relied upon instead."""
    for name in seen.lacking:
        relied = _RELIED.get(_REGISTERS.get(name, name), "")
        yield Check("guard", "note", f"the drive has no {name}: {relied}")


def _wrap(guard: Guard, seen: DriveLimits) -> Iterable[Check]:
    if seen.range_rad is None or guard.travel_rad is None:
        return
    (low, high), (first, last) = seen.range_rad, guard.travel_rad
    if not (low < first and last < high):
        yield Check(
            "position range", "stop",
            f"positions wrap at {low:.4g} and {high:.4g} rad (607B); the motion is from {first:.4g} to {last:.4g} rad",
            "Move the axis away from there, home it elsewhere, or switch the range off (607B: both ends 0).",
        )  # fmt: skip


def _stop(guard: Guard, seen: DriveLimits, hardest_rad_s2: float) -> Iterable[Check]:
    speed, travel = guard.speed_max_rad_s, guard.travel_rad
    wanted = guard.stop_deceleration_rad_s2
    if speed is None or travel is None or wanted is None:
        return
    held = seen.stop_deceleration_rad_s2
    kept = wanted if held is None else max(held, wanted)
    way = speed**2 / (2 * min(kept, hardest_rad_s2))
    room = min(travel[0] - guard.position_min_rad, guard.position_max_rad - travel[1])
    text = f"from {speed:.3g} rad/s the axis stops within {way:.3g} rad; the window leaves {room:.3g} rad"
    if way > room * (1 + 1e-9):
        yield Check(
            "quick stop", "warning", f"{text}: the torque limit lets the believed inertia be braked no harder",
            "Take longer (--duration), keep further from the ends, or trust the mechanical stops.",
        )  # fmt: skip
    elif held is None:
        yield Check(
            "quick stop", "note", f"{text}, if the drive brakes with {wanted:.3g} rad/s²; it does not tell"
        )
    else:
        yield Check("quick stop", "ok", text)


def _rated(seen: DriveLimits, machine: Machine) -> Iterable[Check]:
    """The drive's rated torque (6076) scales every torque; the machine file may know better."""
    rated, motor = seen.rated_torque_nm, machine.motor
    if rated is None:
        return
    remedy = "Correct 6076 in the drive, its scale in the profile, or [motor] in the machine file."
    if motor.rated_torque_nm is not None:
        if not 1 / _RATED_MARGIN <= rated / motor.rated_torque_nm <= _RATED_MARGIN:
            yield Check(
                "rated torque", "stop",
                f"is {rated:.3g} N·m in the drive (6076) and {motor.rated_torque_nm:.3g} N·m in the machine file",
                remedy,
            )  # fmt: skip
    elif not rated <= _RATED_MARGIN * motor.peak_torque_nm <= _PEAK_MARGIN * _RATED_MARGIN * rated:
        yield Check(
            "rated torque", "warning",
            f"is {rated:.3g} N·m in the drive (6076), and the motor's peak torque {motor.peak_torque_nm:.3g} N·m",
            remedy,
        )  # fmt: skip
