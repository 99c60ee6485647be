"""What a sealed session can hide: for every named effect a random shape whose size is one number, set by its strength.

A shape is drawn to be physically sensible on the machine at hand: a tight spot lies within the stroke, an event within
the shortest motion, cogging and disturbances within the band that residuals are compared in. `highest` is the largest
size that such a machine could have; an effect that is not strong enough with it is drawn again.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass

import numpy as np

from schwung_sim.plants.concealed import Value
from schwung_sim.sealed.machines import Chance, DrawnMachine

Parameters = Mapping[str, Value]
#: Cogging and disturbances stay below this (Hz).
_HIGHEST_HZ = 120.0
_PI = float(np.pi)


@dataclass(frozen=True, eq=False)
class Shape:
    """An effect but for its size: parameters at a size, and the largest size that makes sense."""

    name: str
    at: Callable[[float], Parameters]
    highest: float


def _sign(chance: Chance, positive: float = 0.5) -> float:
    return 1.0 if chance.uniform() < positive else -1.0


def _torque(drawn: DrawnMachine) -> float:
    """The torque that an effect may have at most: well within what the motor has."""
    return 0.25 * drawn.drive.peak_torque_nm


def _within(chance: Chance, drawn: DrawnMachine, low: float, high: float) -> float:
    """An angle between these shares of the stroke."""
    return float(drawn.distance_rad * chance.uniform(low, high))


def _mean_inertia(drawn: DrawnMachine) -> float:
    return float(np.mean(drawn.profile.at(drawn.angles_rad())))


def _coulomb(chance: Chance, drawn: DrawnMachine) -> Shape:
    return Shape("coulomb_friction", lambda size: {"torque_nm": size}, _torque(drawn))


def _stribeck(chance: Chance, drawn: DrawnMachine) -> Shape:
    """Coulomb a share of breakaway; a Stribeck speed that the motion passes through."""
    share, speed = chance.uniform(0.3, 0.65), chance.uniform(0.06, 0.2) * drawn.peak_speed_rad_s
    return Shape(
        "stribeck_friction",
        lambda size: {
            "coulomb_torque_nm": share * size,
            "breakaway_torque_nm": size,
            "stribeck_speed_rad_s": speed,
        },
        _torque(drawn),
    )


def _asymmetric(chance: Chance, drawn: DrawnMachine) -> Shape:
    uneven = chance.uniform(0.25, 0.7) * _sign(chance)
    return Shape(
        "asymmetric_friction",
        lambda size: {"torque_positive_nm": size * (1 + uneven), "torque_negative_nm": size * (1 - uneven)},
        _torque(drawn) / 1.7,
    )


def _viscous(chance: Chance, drawn: DrawnMachine) -> Shape:
    """More of it, seldom less: the machine's total never turns negative."""
    present = drawn.drive.rotor_viscous_nms
    if chance.uniform() < 0.2:
        return Shape("viscous_friction", lambda size: {"coefficient_nms": -size}, 0.9 * present)
    highest = _torque(drawn) / drawn.peak_speed_rad_s
    return Shape("viscous_friction", lambda size: {"coefficient_nms": size}, highest)


def _drag(chance: Chance, drawn: DrawnMachine) -> Shape:
    highest = _torque(drawn) / drawn.peak_speed_rad_s**2
    return Shape("quadratic_drag", lambda size: {"coefficient_nms2": size}, highest)


def _local(chance: Chance, drawn: DrawnMachine) -> Shape:
    centre = _within(chance, drawn, 0.25, 0.75)
    width = min(chance.uniform(0.15, 0.6), 0.4 * abs(drawn.distance_rad))
    return Shape(
        "local_friction",
        lambda size: {"torque_nm": size, "centre_rad": centre, "width_rad": width},
        _torque(drawn),
    )


def _drift(chance: Chance, drawn: DrawnMachine) -> Shape:
    motions = float(len(drawn.runs))
    return Shape("friction_drift", lambda size: {"change_nm": size, "motions": motions}, _torque(drawn))


def _load_torque(chance: Chance, drawn: DrawnMachine) -> Shape:
    """Gravity on an arm, or a table: up and down over the stroke."""
    if chance.uniform() < 0.65:
        phase = chance.uniform(-_PI, _PI)
        return Shape("load_torque", lambda size: {"amplitude_nm": size, "phase_rad": phase}, _torque(drawn))
    count = int(chance.integers(5, 9))
    margin = 0.1 * abs(drawn.distance_rad)
    low, high = min(0.0, drawn.distance_rad) - margin, max(0.0, drawn.distance_rad) + margin
    angles, values = np.linspace(low, high, count), chance.uniform(-1.0, 1.0, count)
    values /= np.max(np.abs(values))
    return Shape(
        "load_torque",
        lambda size: {"table": tuple(zip(angles.tolist(), (size * values).tolist(), strict=True))},
        _torque(drawn),
    )


def _offset(chance: Chance, drawn: DrawnMachine) -> Shape:
    sign = _sign(chance)
    return Shape("torque_offset", lambda size: {"torque_nm": sign * size}, _torque(drawn))


def _event(chance: Chance, drawn: DrawnMachine) -> Shape:
    shortest = min(run.stroke.duration_s for run in drawn.runs)
    time, duration = chance.uniform(0.15, 0.7) * shortest, chance.uniform(0.015, 0.05)
    sign = _sign(chance)
    return Shape(
        "load_event",
        lambda size: {"time_s": time, "duration_s": duration, "peak_nm": sign * size},
        2 * _torque(drawn),
    )


def _periodic(chance: Chance, drawn: DrawnMachine) -> Shape:
    """Of a frequency that is not the injection's or its double."""
    frequency = chance.uniform(12.0, _HIGHEST_HZ)
    while min(abs(frequency / drawn.injection_hz - order) for order in (1, 2, 3)) < 0.12:
        frequency = chance.uniform(12.0, _HIGHEST_HZ)
    return Shape(
        "periodic_disturbance",
        lambda size: {"frequency_hz": frequency, "amplitude_nm": size},
        _torque(drawn),
    )


def _cogging(chance: Chance, drawn: DrawnMachine) -> Shape:
    """Of an order that is within the band at most speeds."""
    highest = int(min(48, max(7, 2 * _PI * _HIGHEST_HZ / (0.7 * drawn.peak_speed_rad_s))))
    order, phase = float(chance.integers(6, highest + 1)), chance.uniform(-_PI, _PI)
    return Shape(
        "cogging",
        lambda size: {"order": order, "amplitude_nm": size, "phase_rad": phase},
        _torque(drawn),
    )


def _constant(chance: Chance, drawn: DrawnMachine) -> Shape:
    sign = _sign(chance)
    return Shape("torque_constant", lambda size: {"gain": 1 + sign * size}, 0.3)


def _lag(chance: Chance, drawn: DrawnMachine) -> Shape:
    return Shape("torque_lag", lambda size: {"time_constant_s": size}, 4e-3)


def _saturation(chance: Chance, drawn: DrawnMachine, peak_nm: float) -> Shape:
    """Below the torque that the session's runs need."""
    return Shape("torque_saturation", lambda size: {"limit_nm": peak_nm * (1 - size)}, 0.5)


def _delay(chance: Chance, drawn: DrawnMachine) -> Shape:
    return Shape("measurement_delay", lambda size: {"delay_s": size}, 4e-3)


def _eccentricity(chance: Chance, drawn: DrawnMachine) -> Shape:
    return Shape("encoder_eccentricity", lambda size: {"amplitude_rad": size}, 0.05)


def _twist(drawn: DrawnMachine) -> float:
    """Wind-up of the coupling (rad) under about the motion's torque."""
    return 0.4 * drawn.drive.peak_torque_nm / drawn.drive.stiffness_nm_rad


def _backlash(chance: Chance, drawn: DrawnMachine) -> Shape:
    return Shape("backlash", lambda size: {"gap_rad": size}, 0.03)


def _stiffness(chance: Chance, drawn: DrawnMachine) -> Shape:
    sign, present = _sign(chance), drawn.drive.stiffness_nm_rad
    return Shape("coupling_stiffness", lambda size: {"stiffness_nm_rad": present * np.exp(sign * size)}, 0.8)


def _damping(chance: Chance, drawn: DrawnMachine) -> Shape:
    sign, present = _sign(chance, 0.7), drawn.drive.damping_nms
    return Shape("coupling_damping", lambda size: {"damping_nms": present * np.exp(sign * size)}, 1.5)


def _cubic(chance: Chance, drawn: DrawnMachine) -> Shape:
    """At most ten times stiffer at full wind-up."""
    highest = 10 * drawn.drive.stiffness_nm_rad / _twist(drawn) ** 2
    return Shape("nonlinear_stiffness", lambda size: {"cubic_nm_rad3": size}, highest)


def _third_mass(chance: Chance, drawn: DrawnMachine) -> Shape:
    """A mass that swings on the load at 20 to 90 Hz; its size is its inertia."""
    rate = 2 * _PI * chance.uniform(20.0, 90.0)
    damping = 2 * chance.uniform(0.02, 0.12)
    return Shape(
        "extra_compliance",
        lambda size: {
            "inertia_kgm2": size,
            "stiffness_nm_rad": size * rate**2,
            "damping_nms": damping * size * rate,
        },
        0.5 * _mean_inertia(drawn),
    )


def _inertia(chance: Chance, drawn: DrawnMachine) -> Shape:
    """A payload (delta), or a table that is off by a factor."""
    sign = _sign(chance, 0.7)
    if drawn.profile_kind == "constant" or chance.uniform() < 0.5:
        lowest = float(np.min(drawn.profile.at(drawn.angles_rad())))
        return Shape("load_inertia", lambda size: {"delta_kgm2": sign * size}, 0.6 * lowest)
    return Shape("load_inertia", lambda size: {"scale": float(np.exp(sign * size)), "delta_kgm2": 0.0}, 0.5)


def _shift(chance: Chance, drawn: DrawnMachine) -> Shape | None:
    """Nothing to shift where the inertia is the same everywhere."""
    sign = _sign(chance)
    if drawn.profile_kind == "constant":
        return None
    return Shape("inertia_profile_shift", lambda size: {"shift_rad": sign * size}, 0.4)


_SHAPES: Mapping[str, Callable[[Chance, DrawnMachine], Shape | None]] = {
    "coulomb_friction": _coulomb,
    "stribeck_friction": _stribeck,
    "asymmetric_friction": _asymmetric,
    "viscous_friction": _viscous,
    "quadratic_drag": _drag,
    "local_friction": _local,
    "friction_drift": _drift,
    "load_torque": _load_torque,
    "torque_offset": _offset,
    "load_event": _event,
    "periodic_disturbance": _periodic,
    "cogging": _cogging,
    "torque_constant": _constant,
    "torque_lag": _lag,
    "measurement_delay": _delay,
    "encoder_eccentricity": _eccentricity,
    "backlash": _backlash,
    "coupling_stiffness": _stiffness,
    "coupling_damping": _damping,
    "nonlinear_stiffness": _cubic,
    "extra_compliance": _third_mass,
    "load_inertia": _inertia,
    "inertia_profile_shift": _shift,
}

#: Every effect that a sealed session can hide and that the tool has a name for.
NAMES = (*_SHAPES, "torque_saturation")

#: Effects of which a session hides at most one: together they are one of them with other numbers.
EXCLUSIVE = (
    frozenset({"coulomb_friction", "stribeck_friction", "asymmetric_friction"}),
    frozenset({"torque_offset", "asymmetric_friction"}),
    frozenset({"torque_offset", "load_torque"}),
    frozenset({"load_inertia", "extra_compliance"}),
    frozenset({"coupling_stiffness", "nonlinear_stiffness"}),
    frozenset({"torque_lag", "measurement_delay"}),
    frozenset({"torque_constant", "torque_saturation"}),
)


def draw_shape(chance: Chance, drawn: DrawnMachine, name: str, peak_nm: float) -> Shape | None:
    """A random shape of an effect on this machine, whose session needs `peak_nm`; None where it has none."""
    if name == "torque_saturation":
        return _saturation(chance, drawn, peak_nm)
    return _SHAPES[name](chance, drawn)
