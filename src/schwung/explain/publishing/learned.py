"""The belief with what was found in it, ready to be written: nothing twice, each term of the file a sum or a change.

A law that the belief has already takes the found numbers up; two that no one law can say (a second tight spot) become a
law and a curve over the coordinate.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from scipy.interpolate import PchipInterpolator

from schwung.drivetrain.effects import PHYSICS
from schwung.drivetrain.machine import Machine
from schwung.drivetrain.physics_term import PhysicsTerm
from schwung.drivetrain.residual import TABLES, law_of
from schwung.drivetrain.residual_plane import is_plane, plane_of
from schwung.motion import Array

#: Numbers of a table are written to so many digits.
_DIGITS = 7
_Parameters = dict[str, Any]


@dataclass(frozen=True, eq=False)
class Found:
    """What goes into the file: a law's numbers, or a table (`parameters`), and what else may be kept beside it."""

    law: str
    named: bool
    parameters: Mapping[str, Any]
    beside: Mapping[str, Any]  # probability
    sampled: Callable[[], Mapping[str, Any]] | None = None  # as a residual over its coordinate


def learned(machine: Machine, found: Sequence[Found]) -> Machine:
    """The machine with everything found; its own terms stay where they are."""
    terms = list(machine.physics)
    for one in found:
        _add(terms, one)
    return machine.model_copy(update={"physics": tuple(terms)})


def table(*columns: Array) -> list[list[float]]:
    """Rows of numbers as a file holds them."""
    return [[float(f"{x:.{_DIGITS}g}") for x in row] for row in np.column_stack(columns).tolist()]


def _add(terms: list[PhysicsTerm], one: Found) -> None:
    if one.law == "load_inertia" and one.parameters.get("scale", 1.0) != 1.0:
        _scale_added(terms, float(one.parameters["scale"]))
    for place, term in enumerate(terms):
        if law_of(term) != one.law or not _alike(term, one):
            continue
        both = _merged(one.law, term.parameters, one.parameters)
        if both is None:
            if one.sampled is None:
                continue
            curve = Found("residual", False, one.sampled(), {**one.beside, "law": one.law})
            return _add(terms, curve)
        named = one.named or term.name != "residual"
        kept = {key: value for key, value in term.parameters.items() if key not in ("like", "probability")}
        terms[place] = _term(one.law, named, {**kept, **one.beside, **both})
        return None
    terms.append(_term(one.law, one.named, {**one.beside, **one.parameters}))
    return None


def _term(law: str, named: bool, parameters: Mapping[str, Any]) -> PhysicsTerm:
    if named or law == "residual":
        return PhysicsTerm.model_validate({"name": law, **_allowed(law, parameters)})
    return PhysicsTerm.model_validate({"name": "residual", "like": law, **_allowed(law, parameters)})


def _allowed(law: str, parameters: Mapping[str, Any]) -> _Parameters:
    """Within what the file may say: an estimate about zero may be a little beyond it."""
    keys = PHYSICS[law]
    return {
        name: min(max(value, keys[name].lowest), keys[name].highest) if name in keys else value
        for name, value in parameters.items()
    }


def _alike(term: PhysicsTerm, one: Found) -> bool:
    """Whether two terms of one law are both tables over the same, or both numbers, and of one place."""
    if ("table" in term.parameters) != ("table" in one.parameters):
        return False
    if one.law == "end_spring":  # one at either end are two
        return bool(term.parameters.get("side", 1.0) == one.parameters.get("side", 1.0))
    return one.law != "residual" or all(
        _listed(term.parameters.get(key)) == _listed(one.parameters.get(key))
        for key in ("coordinate", "coordinates")
    )


def _listed(value: Any) -> Any:
    return list(value) if isinstance(value, tuple) else value


#: Laws whose numbers simply add up.
_SUMS = {
    "coulomb_friction": ("torque_nm",),
    "asymmetric_friction": ("torque_positive_nm", "torque_negative_nm"),
    "viscous_friction": ("coefficient_nms", "load_coefficient_nms"),
    "viscous_drift": ("change_nms",),
    "quadratic_drag": ("coefficient_nms2", "load_coefficient_nms2"),
    "friction_drift": ("change_nm",),
    "load_dependent_friction": ("share",),
    "load_side_friction": ("torque_nm",),
    "presliding_friction": ("torque_nm", "stiffness_nm_rad"),
    "torque_offset": ("torque_nm",),
    "offset_drift": ("change_nm",),
    "torque_lag": ("time_constant_s",),
    "torque_filter": ("time_constant_s",),
    "measurement_delay": ("delay_s",),
    "backlash": ("gap_rad",),
    "nonlinear_stiffness": ("cubic_nm_rad3",),
    "inertia_profile_shift": ("shift_rad",),
}
#: Amplitude and phase of a sine, and what else has to be alike for two to be one.
_SINES = {
    "load_torque": ("amplitude_nm", ()),
    "encoder_eccentricity": ("amplitude_rad", ()),
    "encoder_harmonic": ("amplitude_rad", ("order",)),
    "cogging": ("amplitude_nm", ("order",)),
    "torque_ripple": ("share", ("order",)),
    "stiffness_over_angle": ("share", ("order",)),
    "kinematic_error": ("amplitude_rad", ("order",)),
}
_PHASE = "phase_rad"
#: Of a law that has a second sine, that one's.
_SECOND = {
    "cogging": ("second_amplitude_nm", "second_phase_rad"),
    "kinematic_error": ("second_amplitude_rad", "second_phase_rad"),
}
#: Laws that become one where these are alike, and what then adds up.
_SHAPED = {
    "stribeck_friction": (
        ("stribeck_speed_rad_s", "exponent"),
        ("coulomb_torque_nm", "breakaway_torque_nm"),
    ),
    "local_friction": (("centre_rad", "width_rad", "sharpness"), ("torque_nm",)),
    "end_spring": (("position_rad",), ("stiffness_nm_rad",)),
    "load_event": (("time_s", "duration_s", "sharpness"), ("peak_nm",)),
    "torque_constant_drop": (("order",), ()),
    "torque_constant_fade": (("time_constant_s",), ()),
    "coupling_hysteresis": (("exponent",), ("torque_nm", "stiffness_nm_rad")),
}
#: Shapes that differ by less are one (relative).
_SAME = 1e-6


def _merged(law: str, had: Mapping[str, Any], new: Mapping[str, Any]) -> _Parameters | None:
    """The numbers of two terms of one law as one's; None where one cannot say both."""
    if is_plane(new):
        return plane_of(had).plus(plane_of(new)).parameters(_DIGITS)
    if "table" in new:
        return {"table": _added_tables(had["table"], new["table"], TABLES[law])}
    if law in _SINES:
        amplitude, alike = _SINES[law]
        merged: _Parameters = {}
        for size, phase in [(amplitude, _PHASE), *([_SECOND[law]] if law in _SECOND else [])]:
            if size in had or size in new:
                both = sum(one.get(size, 0.0) * np.exp(1j * one.get(phase, 0.0)) for one in (had, new))
                merged |= {size: float(np.abs(both)), phase: float(np.angle(both))}
        return merged if _same(law, alike, had, new) else None
    alike, summed = _SHAPED.get(law, ((), _SUMS.get(law, ())))
    if not _same(law, alike, had, new) or (law == "friction_drift" and had.get("settling", 0.0) != 0.0):
        return None
    given = [key for key in summed if key in had or key in new]
    return {key: had.get(key, 0.0) + new.get(key, 0.0) for key in given} or _changed(law, had, new)


def _changed(law: str, had: Mapping[str, Any], new: Mapping[str, Any]) -> _Parameters | None:
    """Of laws whose numbers do not add up."""
    scale, delta = had.get("scale", 1.0), had.get("delta_kgm2", 0.0)
    order = new.get("order", 1.0)
    share = new.get("share_at_peak", 0.0)
    drop, fade = (share / new.get("peak_nm", 1.0) ** power for power in (order, 2.0))
    changes: dict[str, Callable[[], _Parameters]] = {
        "motor_inertia": lambda: dict(new),
        "coupling_stiffness": lambda: dict(new),
        "coupling_damping": lambda: dict(new),
        "torque_constant": lambda: {"gain": had["gain"] + new["gain"] - 1},
        "torque_constant_drop": lambda: {
            "share_at_peak": had["share_at_peak"] + drop * had["peak_nm"] ** order
        },
        "torque_constant_fade": lambda: {"share_at_peak": had["share_at_peak"] + fade * had["peak_nm"] ** 2},
        "torque_saturation": lambda: {"limit_nm": min(had["limit_nm"], new["limit_nm"])},
        "load_inertia": lambda: {
            "scale": scale * new.get("scale", 1.0),
            "delta_kgm2": delta + new.get("delta_kgm2", 0.0),
        },
    }
    return changes[law]() if law in changes else None


def _scale_added(terms: list[PhysicsTerm], scale: float) -> None:
    """What the belief adds to the inertia is scaled with it."""
    for place, term in enumerate(terms):
        held = term.parameters
        if law_of(term) == "load_inertia" and "delta_kgm2" in held:
            changed: _Parameters = {"delta_kgm2": scale * held["delta_kgm2"]}
        elif law_of(term) == "inertia_profile":
            x, added = np.array(held["table"], dtype=float).T
            changed = {"table": table(x, scale * added)}
        else:
            continue
        terms[place] = PhysicsTerm.model_validate({"name": term.name, **held, **changed})


def _same(law: str, keys: Sequence[str], one: Mapping[str, Any], other: Mapping[str, Any]) -> bool:
    usual = {key: PHYSICS[law][key].optional for key in keys}
    pairs = [(one.get(key, usual[key]), other.get(key, usual[key])) for key in keys]
    return all(abs(a - b) <= _SAME * max(abs(a), abs(b)) for a, b in pairs)


def _added_tables(had: Any, new: Any, widths: Sequence[int]) -> list[list[float]]:
    """Two tables at the points of both; where one has no directions, it is the same in both."""
    one, other = (np.array(rows, dtype=float).T for rows in (had, new))
    size = max(len(one), len(other)) if len(widths) > 1 else widths[0]
    x = np.union1d(one[0], other[0])
    total = np.zeros((size - 1, x.size))
    for rows in (one, other):
        for column in range(size - 1):
            values = rows[min(column + 1, len(rows) - 1)]
            total[column] += PchipInterpolator(rows[0], values)(np.clip(x, rows[0][0], rows[0][-1]))
    return table(x, *total)
