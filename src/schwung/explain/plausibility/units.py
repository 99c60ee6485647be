"""Mistakes of unit and sign: speed against the change of position, torque against what the believed inertia needs.

Both are judged by one number over the whole session, a factor that should be 1. Wrong units make it a number that
everybody knows (9.55, 57.3, 1000, …); wrong beliefs and missing physics do not.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from schwung.drivetrain.inertia import InertiaTable
from schwung.drivetrain.machine import Machine
from schwung.explain.plausibility.inertia_factor import (
    KNOWN,
    Fitted,
    believed_inertia,
    change_of,
    inertia_factor,
    low_pass,
)
from schwung.explain.plausibility.values import Correction, Doubt, Signal, corrected
from schwung.session.imports.signals import white_noise
from schwung.session.model import Axis, Session

_TURN = 2 * np.pi
_DEGREE = np.pi / 180
_RPM = _TURN / 60
#: A factor is that of a unit within this much (relative); factors between 0.9 and 1.1 are not questioned.
_SAME_FACTOR, _NO_QUESTION = 0.03, 0.1
#: Speed and the change of position are one motion above this correlation.
_ONE_MOTION = 0.9
_CERTAIN = 10.0
#: An inertia may be believed wrong by up to this factor; beyond it a unit is wrong, or the whole belief.
_BELIEVABLE = 4.0
#: Torques are in another unit where the factor is that of the unit within this one: the belief need not be right.
_NEAR_UNIT = 2.2
#: Angles are in another unit where with it the inertia is known so much more clearly (factor over error).
_CLEARER = 3.0


@dataclass(frozen=True)
class _Mistake:
    """Reported speed over the change of reported position, where units are mixed up."""

    ratio: float
    text: str
    corrections: tuple[Correction, ...]


def _scales(*pairs: tuple[Signal, float]) -> tuple[Correction, ...]:
    return tuple(Correction(signal, "scale", value) for signal, value in pairs)


_SPEED_MISTAKES: dict[Axis, tuple[_Mistake, ...]] = {
    "rotary": (
        _Mistake(1 / _RPM, "speed is in rpm", _scales(("speed", _RPM))),
        _Mistake(1 / _DEGREE, "speed is in degrees per second", _scales(("speed", _DEGREE))),
        _Mistake(1 / _TURN, "speed is in turns per second", _scales(("speed", _TURN))),
        _Mistake(_DEGREE, "position is in degrees", _scales(("position", _DEGREE))),
        _Mistake(_TURN, "position is in turns", _scales(("position", _TURN))),
        _Mistake(
            _DEGREE / _RPM,
            "position is in degrees and speed in rpm",
            _scales(("position", _DEGREE), ("speed", _RPM)),
        ),
        _Mistake(
            60.0, "position is in turns and speed in rpm", _scales(("position", _TURN), ("speed", _RPM))
        ),
        _Mistake(1e3, "speed is in mrad/s", _scales(("speed", 1e-3))),
        _Mistake(1e-3, "position is in mrad", _scales(("position", 1e-3))),
    ),
    "linear": (
        _Mistake(1e3, "speed is in mm/s", _scales(("speed", 1e-3))),
        _Mistake(1e-3, "position is in mm", _scales(("position", 1e-3))),
        _Mistake(60.0, "speed is in m/min", _scales(("speed", 1 / 60))),
        _Mistake(6e4, "speed is in mm/min", _scales(("speed", 1e-3 / 60))),
    ),
}


def speed_doubts(session: Session, machine: Machine) -> list[Doubt]:
    """Speed against the change of position: units, signs, and whether they are one motion at all."""
    pairs = [
        (low_pass(run.speed_rad_s, run.sample_rate_hz), change_of(run))
        for run in session.runs
    ]  # fmt: skip
    speed, change = (np.concatenate(each) for each in zip(*pairs, strict=True))
    power, derived = float(speed @ speed), float(change @ change)
    if derived <= 0 or power <= 0:
        still = "speed" if power <= 0 else "position"
        return [
            Doubt(
                "no_motion", f"all runs/{still}", "does not change", "Record while the axis moves", "stop",
                still="Nothing can be said about the machine",
            )
        ]  # fmt: skip
    likeness = float(speed @ change) / np.sqrt(power * derived)
    ratio = float(np.sqrt(power / derived))
    if abs(likeness) < _ONE_MOTION:
        return [
            Doubt(
                "speed_unrelated", "all runs/speed",
                f"is not the change of position (correlation {likeness:.2f})",
                "Check which columns were recorded, or derive speed from position", "stop",
                (Correction("speed", "derive"),),
                "With speed from position everything else can be looked at",
            )
        ]  # fmt: skip
    doubts = []
    if likeness < 0:
        doubts.append(_opposed(session, machine))
    if abs(np.log(ratio)) > np.log(1 + _NO_QUESTION):
        doubts.append(_speed_unit(ratio, session.axis))
    return doubts


def _speed_unit(ratio: float, axis: Axis) -> Doubt:
    nearest = min(_SPEED_MISTAKES[axis], key=lambda mistake: abs(np.log(ratio / mistake.ratio)))
    if abs(np.log(ratio / nearest.ratio)) < _SAME_FACTOR:
        signal = nearest.corrections[0].signal
        factors = " and ".join(f"{each.signal} × {each.value:.6g}" for each in nearest.corrections)
        return Doubt(
            f"{signal}_unit", f"all runs/{signal}",
            f"reported speed is {ratio:.4g} times the change of position: {nearest.text}",
            f"Import again with the right unit, or apply {factors}", "stop", nearest.corrections,
            "With the unit put right everything can be looked at",
        )  # fmt: skip
    return Doubt(
        "speed_scale", "all runs/speed",
        f"reported speed is {ratio:.4g} times the change of position, which is no mixed-up unit",
        "Check the gear ratio and the scaling of both, or derive speed from position", "stop",
        (Correction("speed", "derive"),), "Positions, and speeds derived from them, may still be right",
    )  # fmt: skip


def _opposed(session: Session, machine: Machine) -> Doubt:
    """Speed and position run against each other: the torque says which of them is reversed."""
    fitted = inertia_factor(session, machine)
    signal: Signal = "speed"
    how = "position and torque agree"
    if fitted is None or abs(fitted.factor) < KNOWN * fitted.error:
        how = "which of both is not known, torque says nothing"
    elif fitted.factor < 0:
        signal, how = "position", "speed and torque agree"
    return Doubt(
        f"{signal}_sign", f"all runs/{signal}", f"is reversed against the other of speed and position ({how})",
        f"Import again with --{signal}-scale -1", "stop", _scales((signal, -1.0)),
        "With the sign put right everything can be looked at",
    )  # fmt: skip


def torque_doubts(session: Session, machine: Machine) -> list[Doubt]:
    """Torque against what the believed inertia needs: units, sign, and whether an inertia is determined at all."""
    fitted = inertia_factor(session, machine)
    force = "torque" if session.axis == "rotary" else "force"
    highest = max(float(np.max(np.abs(run.torque_nm))) for run in session.runs)
    if highest == 0:
        return [Doubt("no_torque", f"all runs/{force}", "is zero throughout", "Record the torque", "stop",
                      still="Only the motion can be looked at")]  # fmt: skip
    turned = _other_angles(session, machine, fitted)
    if turned is not None:
        return [turned]
    if fitted is None or not fitted.known:
        return [*_undetermined(fitted, machine, session), *_beyond_peak(session, machine, highest)]
    doubts = []
    if fitted.factor < 0 and abs(fitted.factor) > _CERTAIN * fitted.error:
        doubts.append(
            Doubt(
                "torque_sign", f"all runs/{force}", "is reversed: it brakes where the axis gathers speed",
                "Import again with --torque-scale -1", "stop", _scales(("torque", -1.0)),
                "With the sign put right everything can be looked at",
            )
        )  # fmt: skip
    factor = abs(fitted.factor)
    if machine.load_inertia is None and machine.coupling is not None:  # rigid: the motor's is all there is
        return [*doubts, *_beyond_peak(session, machine, highest)]
    unit = _torque_unit(factor, highest, machine, session)
    if unit is not None:
        return [*doubts, unit]
    if not 1 / _BELIEVABLE < factor < _BELIEVABLE:
        doubts.append(
            Doubt(
                "inertia_far_off", "machine/inertia",
                f"the recorded {force} is {factor:.3g} times what the believed inertia needs, by no known unit",
                "Check the inertias in the machine file and the scale of the torque", "warning",
                still="The shape of what is missing can be said, its size not",
            )
        )  # fmt: skip
    return [*doubts, *_beyond_peak(session, machine, highest)]


def _other_angles(session: Session, machine: Machine, fitted: Fitted | None) -> Doubt | None:
    """Angles and speeds both in degrees (or turns), where inertia changes with angle: only in rad the table fits."""
    if session.axis == "linear" or not isinstance(machine.load_inertia, InertiaTable):
        return None
    if fitted is not None and fitted.known and 1 / _BELIEVABLE < abs(fitted.factor) < _BELIEVABLE:
        return None
    clearness = abs(fitted.factor) / fitted.error if fitted is not None else 0.0
    for value, name in ((_DEGREE, "degrees"), (_TURN, "turns")):
        corrections = _scales(("position", value), ("speed", value))
        other = inertia_factor(corrected(session, corrections), machine)
        if other is None or not other.known or not 1 / _BELIEVABLE < abs(other.factor) < _BELIEVABLE:
            continue
        if abs(other.factor) / other.error > _CLEARER * clearness:
            return Doubt(
                "position_unit", "all runs/position",
                f"fits the believed inertia over angle only if position and speed are in {name}",
                f"Import again with the right units, or apply position × {value:.6g} and speed × {value:.6g}", "stop",
                corrections, "With the unit put right everything can be looked at",
            )  # fmt: skip
    return None


def _torque_unit(factor: float, highest: float, machine: Machine, session: Session) -> Doubt | None:
    """The unit that explains a factor of torque over need, None where none does."""
    linear = session.axis == "linear"
    force, milli, kilo = ("force", "mN", "kN") if linear else ("torque", "mN·m", "kN·m")
    share = highest / machine.motor.peak_torque_nm  # of the peak; far below 1 speaks for too large a unit
    found: list[tuple[float, str, tuple[Correction, ...]]] = [
        (1e3, f"{force} is in {milli}", _scales(("torque", 1e-3)))
    ]
    if share < 0.02:
        found.append((1e-3, f"{force} is in {kilo}", _scales(("torque", 1e3))))
    elif linear:
        found.append((1e-3, "position and speed are in mm", _scales(("position", 1e-3), ("speed", 1e-3))))
    else:
        both = _scales(("position", _DEGREE), ("speed", _DEGREE))
        found.append((_DEGREE, "position and speed are in degrees", both))
    rated = machine.motor.rated_torque_nm
    if rated is not None:
        found.append((100 / rated, f"{force} is in % of the rated one", _scales(("torque", rated / 100))))
        found.append(
            (1e3 / rated, f"{force} is in per mille of the rated one", _scales(("torque", rated / 1e3)))
        )
    near = [each for each in found if abs(np.log(factor / each[0])) < np.log(_NEAR_UNIT)]
    if not near or 1 / _BELIEVABLE < factor < _BELIEVABLE:
        return None
    _, text, corrections = min(near, key=lambda each: abs(np.log(factor / each[0])))
    signal = corrections[0].signal
    applied = " and ".join(f"{each.signal} × {each.value:.6g}" for each in corrections)
    return Doubt(
        f"{signal}_unit", f"all runs/{signal}",
        f"the recorded {force} is {factor:.3g} times what the believed inertia needs: {text}",
        f"Import again with the right unit, or apply {applied}", "stop", corrections,
        "With the unit put right everything can be looked at",
    )  # fmt: skip


def _undetermined(fitted: Fitted | None, machine: Machine, session: Session) -> list[Doubt]:
    inertia = "inertia" if session.axis == "rotary" else "mass"
    unit = "kg·m²" if session.axis == "rotary" else "kg"
    if fitted is None:
        return []  # nothing accelerates, which is said elsewhere
    if any(run.excitation is not None for run in session.runs):
        return []  # an injection turns the motor to and fro, whatever the motion between its ends does
    position = session.runs[0].position_rad
    total = float(np.mean(believed_inertia(machine, position)[0]))
    if abs(fitted.factor) < KNOWN * fitted.error:
        text = f"{abs(fitted.factor) * total:.2g} ± {1.96 * fitted.error * total:.2g} {unit}"
    else:
        low, high = min(fitted.within_parts) * total, max(fitted.within_parts) * total
        text = f"{fitted.factor * total:.2g} {unit} from all, {low:.2g} to {high:.2g} from within its parts"
    return [
        Doubt(
            "inertia_undetermined", "all runs/torque",
            f"the recording does not determine the {inertia} ({text}): hardly any torque goes into acceleration",
            "Record motions that accelerate harder", "warning",
            still="Friction, load and offset at the speeds that were run can still be named",
        )
    ]  # fmt: skip


def _beyond_peak(session: Session, machine: Machine, highest: float) -> list[Doubt]:
    noise = max(white_noise(run.torque_nm) for run in session.runs)
    peak = machine.motor.peak_torque_nm
    if highest - 5 * noise <= 1.2 * peak:
        return []
    unit = "N·m" if session.axis == "rotary" else "N"
    return [
        Doubt(
            "torque_beyond_peak", "all runs/torque",
            f"reaches {highest:.4g} {unit}, beyond the stated peak of {peak:.4g} {unit}",
            "Check the unit of the torque and peak_torque in the machine file", "warning",
        )
    ]  # fmt: skip
