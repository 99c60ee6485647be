"""What to know of an answer beside names and curves: which scale its torques have, and what to measure first."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from schwung.drivetrain.machine import Machine
from schwung.explain.causes.along import Ranges
from schwung.explain.publishing.values import Published
from schwung.explain.values import Quantity

#: Angles over which an inertia is averaged.
_ANGLES = 129
_SCALES = frozenset(("load_inertia", "torque_constant"))


def advice(of: Published, belief: Machine, ranges: Ranges) -> Iterator[str]:
    """Sentences, as far as they are due."""
    scale = _inertia_s_scale(of, belief, ranges)
    if scale is not None:
        yield (
            "this session cannot tell torque_constant from load_inertia: if it is the torque constant that is off, "
            f"every torque named here has to be multiplied by {scale:.3g}"
        )
    gain = _torque_s_scale(of)
    if gain is not None:
        yield (
            "this session cannot tell torque_constant from load_inertia: if it is the inertia that is off, every "
            f"torque named here has to be divided by {gain:.3g}"
        )
    if _hangs_on_a_spring(of):
        yield (
            "the further mass is as much as the load inertia lacks: all in all the load is as heavy as believed, and a "
            "part of it hangs on a spring, or what the machine stands on gives way"
        )
    if of.lasting is not None and of.verdict == "unexplained":
        yield (
            "what differs from run to run was taken for noise: record again once the motor is as warm as it gets, and "
            "with a dwell after which nothing swings or creeps"
        )
    if of.axis == "rotary" and belief.load.inertia_table is None and of.verdict == "unexplained":
        yield (
            "the load inertia is believed to be alike at all angles; where it is not, measure it first "
            "(schwung commission writes measured.toml): what else is missing shows beside that"
        )


def _confused(of: Published) -> bool:
    """Whether inertia and torque constant stand in each other's place: torque is inertia times acceleration."""
    return any(frozenset(pair) == _SCALES for pair in of.confused)


def _inertia_s_scale(of: Published, belief: Machine, ranges: Ranges) -> float | None:
    """True over reported torque, if the named change of the inertia is one of the torque constant instead."""
    number = _number(of, "load_inertia", "scale")
    if number is None or not _confused(of):
        return None
    load = float(np.mean(belief.load_inertia_at(np.linspace(ranges.low_rad, ranges.high_rad, _ANGLES))))
    motor = belief.motor.inertia_kgm2
    changed = motor + number * load + (_number(of, "load_inertia", "delta_kgm2") or 0.0)
    return (motor + load) / changed if changed > 0 else None


def _torque_s_scale(of: Published) -> float | None:
    number = _number(of, "torque_constant", "gain")
    return number if number is not None and number > 0 and _confused(of) else None


def _hangs_on_a_spring(of: Published) -> bool:
    """Whether a further mass and a lighter load make up for each other, as far as both are known."""
    further, less = _told(of, "extra_compliance", "inertia_kgm2"), _told(of, "load_inertia", "delta_kgm2")
    if further is None or less is None or further.ci95 is None or less.ci95 is None:
        return False
    as_many_times = _number(of, "load_inertia", "scale") in (None, 1.0)
    return as_many_times and further.ci95[0] + less.ci95[0] <= 0 <= further.ci95[1] + less.ci95[1]


def _told(of: Published, name: str, key: str) -> Quantity | None:
    """Of what is in the file by its name."""
    return next((one.parameters.get(key) for one in of.names if one.physics == name and one.in_file), None)


def _number(of: Published, name: str, key: str) -> float | None:
    told = _told(of, name, key)
    return told.value if told is not None and isinstance(told.value, float) else None
