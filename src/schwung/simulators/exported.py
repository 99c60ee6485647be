"""What an export tells of a machine: parameters with values and units, and tables; the same for every language."""

from __future__ import annotations

import re
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from scipy.interpolate import PchipInterpolator

from schwung.drivetrain import plant
from schwung.drivetrain.effects import PHYSICS, Effects, check_physics, effects_of
from schwung.drivetrain.inertia import InertiaTable, LoadTorqueTable
from schwung.drivetrain.learned import shaft_torque
from schwung.drivetrain.machine import Machine
from schwung.drivetrain.residual import (
    OVER,
    UNDIRECTED,
    inertia_added,
    inertia_points,
    load_torque_table,
    residuals_of,
)
from schwung.drivetrain.residual_plane import NOTHING, PAIRS, planes_of
from schwung.errors import InputError
from schwung.motion import Array, Demand

#: Stands for "no limit": simulators dislike infinity in their files.
NO_LIMIT_NM = 1e12
#: Dry friction changes sign within this speed (rad/s), as in our own simulation.
SMOOTHING_RAD_S = plant.SMOOTHING_RAD_S
#: Ends of names, longest first, and units as FMI and Modelica write them.
UNITS = {
    "_nm_rad3": "N.m/rad3",
    "_nm_rad": "N.m/rad",
    "_nms2": "N.m.s2/rad2",
    "_nms": "N.m.s/rad",
    "_kgm2": "kg.m2",
    "_rad_s": "rad/s",
    "_rad": "rad",
    "_nm": "N.m",
    "_hz": "Hz",
    "_s": "s",
}
#: Numbers that a machine without a coupling has not.
OF_COUPLING = (
    "gap_rad", "stiffness_nm_rad", "damping_nms", "cubic_nm_rad3",
    "hysteresis_nm", "hysteresis_stiffness_nm_rad", "hysteresis_exponent",
    "stiffness_share", "stiffness_order", "stiffness_phase_rad",
    "kinematic_rad", "kinematic_order", "kinematic_phase_rad",
    "kinematic_second_rad", "kinematic_second_phase_rad",
)  # fmt: skip


@dataclass(frozen=True)
class Parameter:
    """One number that may be changed in the other simulator; SI, `unit` empty where it has none."""

    name: str
    value: float
    description: str

    @property
    def unit(self) -> str:
        """By the end of the name."""
        return next((unit for end, unit in UNITS.items() if self.name.endswith(end)), "")


@dataclass(frozen=True, eq=False)
class Exported:
    """A machine as another simulator gets it; tables (n, 3) have rows of angle (rad), value and slope."""

    name: str
    identifier: str  # as C, Modelica and MATLAB allow it
    rigid: bool
    parameters: tuple[Parameter, ...]
    effects: Effects
    inertia: Array
    load_torque: Array
    learned_load_torque: Array
    inertia_added: Array
    residuals: Mapping[str, Array]  # residual_<coordinate>, with _forward and _backward where that matters
    planes: Mapping[
        str, Array
    ]  # over two coordinates: the second's points, then rows of the first's and the torques
    at_rest: Mapping[
        str, float
    ]  # every state at the start angle, and `acting`, the torque that holds it there

    @property
    def tables(self) -> dict[str, Array]:
        """The tables by name."""
        return {
            "inertia": self.inertia,
            "load_torque": self.load_torque,
            "learned_load_torque": self.learned_load_torque,
            "inertia_added": self.inertia_added,
            **self.residuals,
        }

    def has(self, table: str) -> bool:
        """Whether a table does anything."""
        return bool(np.any(self.planes[table][1:, 1:] if table in self.planes else self.tables[table][:, 1]))

    def value(self, name: str) -> float:
        """The value of one parameter."""
        return next(one.value for one in self.parameters if one.name == name)


def exported(machine: Machine, start_rad: float | None = None) -> Exported:
    """What is told of a machine, with all that was learned about it.

    Args:
        machine: with a load inertia; terms as `schwung explain` wrote them.
        start_rad: motor angle (rad) at which it stands first; None: the middle of the inertia's table, or 0.

    Raises InputError where the load's inertia is unknown, or terms make no sense.
    """
    rigid = machine.coupling is None
    check_physics(machine.physics, rigid=rigid)
    body = plant.plant_of(machine, None)  # raises for an unknown or impossible inertia
    effects = effects_of(machine.physics)
    inertia = machine.load_inertia
    table = inertia if isinstance(inertia, InertiaTable) else None
    if start_rad is None:
        start_rad = 0.0 if table is None else float(table.position_rad[0] + table.position_rad[-1]) / 2
    constant = float(inertia) if isinstance(inertia, float) else 0.0
    given, found = machine.load.torque_table, load_torque_table(machine.physics)
    stands = Demand(np.full(2, start_rad), np.zeros(2), np.zeros(2))
    known = plant.learned_of(machine, body, np.array([0.0, 1.0]), stands, 0.0)
    masses, held = plant.learned_rest(known, start_rad)
    acting = shaft_torque(effects, held)
    return Exported(
        name=machine.name,
        identifier=identifier(machine.name),
        rigid=rigid,
        parameters=_parameters(machine, effects, start_rad),
        effects=effects,
        inertia=_level(constant) if table is None else _rows(table.position_rad, table.inertia_kgm2),
        load_torque=_torque_rows(given),
        learned_load_torque=_torque_rows(found),
        inertia_added=_added(machine),
        residuals=_residuals(machine),
        planes=_planes(machine),
        at_rest={name: float(value) for name, value in masses._asdict().items()} | {"acting": float(acting)},
    )


def identifier(name: str) -> str:
    """A name that C, Modelica and MATLAB allow."""
    words = re.sub(r"[^A-Za-z0-9]+", "_", name).strip("_")[:40].strip("_")
    return words if words[:1].isalpha() else f"machine_{words}".rstrip("_")


def file_name(path: Path, ending: str, what: str) -> str:
    """The name of what is in a file that has to be named alike. Raises InputError where it can be none."""
    if path.suffix != ending or identifier(path.stem) != path.stem:
        remedy = f"Write it as {identifier(path.stem)}{ending}."
        raise InputError(str(path), f"is no file name of a {what}", remedy)
    return path.stem


def _parameters(machine: Machine, effects: Effects, start_rad: float) -> tuple[Parameter, ...]:
    coupling = machine.coupling
    listed = [
        Parameter("start_angle_rad", start_rad, "motor angle at which the machine stands at first"),
        Parameter(
            "motion_start_s", 0.0, "when the motion leaves rest: an event in the load torque is after that"
        ),
        Parameter("session_share", 0.0, "how far through the session, 0 to 1: for a friction that drifts"),
        Parameter("smoothing_rad_s", SMOOTHING_RAD_S, "speed within which dry friction changes sign"),
        Parameter("motor_inertia_kgm2", machine.motor.inertia_kgm2, "inertia of the motor"),
        Parameter(
            "motor_viscous_friction_nms", machine.motor.viscous_friction_nms, "viscous friction of the motor"
        ),
        Parameter(
            "load_viscous_friction_nms", machine.load.viscous_friction_nms, "viscous friction of the load"
        ),
        Parameter(
            "load_torque_nm", machine.load.torque_nm or 0.0, "torque on the load, positive accelerates it"
        ),
    ]
    if coupling is not None:
        listed += [
            Parameter(
                "coupling_stiffness_nm_rad",
                coupling.stiffness_nm_rad,
                "stiffness of the coupling as believed",
            ),
            Parameter("coupling_damping_nms", coupling.damping_nms, "damping of the coupling as believed"),
        ]
    limit = min(effects.torque_limit_nm, NO_LIMIT_NM)
    for name, value in effects._replace(torque_limit_nm=limit)._asdict().items():
        if coupling is not None or name not in OF_COUPLING:
            listed.append(Parameter(name, float(value), _WORDS.get(name) or _origin(name)))
    return tuple(listed)


#: What a name alone leaves open.
_WORDS = {
    "coulomb_positive_nm": "dry friction in the positive direction",
    "coulomb_negative_nm": "dry friction in the negative direction",
    "stribeck_rise_nm": "stribeck_friction: breakaway torque minus Coulomb torque",
    "drift_nm": "friction_drift: of dry friction from the first run to the last (see session_share)",
    "viscous_nms": "viscous_friction, coefficient: of the motor",
    "load_viscous_nms": "viscous_friction, load_coefficient: behind the coupling",
    "drag_nms2": "quadratic_drag, coefficient: of the motor",
    "load_drag_nms2": "quadratic_drag, load_coefficient: behind the coupling",
    "torque_gain": "torque_constant: torque on the shaft over torque reported",
    "rotor_inertia_kgm2": "motor_inertia: in place of the believed one; 0: that",
    "stiffness_nm_rad": "coupling_stiffness: in place of the believed one; 0: that",
    "damping_nms": "coupling_damping: in place of the believed one; negative: that",
    "presliding_nm": "presliding_friction: what it is when it slides",
    "presliding_stiffness_nm_rad": "presliding_friction: of the spring that it is before",
    "hysteresis_nm": "coupling_hysteresis: the torque at which it yields",
    "hysteresis_stiffness_nm_rad": "coupling_hysteresis: of the spring that it is before",
    "carried_share": "load_dependent_friction: share of the torque that the shaft carries",
    "torque_filter_s": "torque_filter: of what the drive reports; has no part in this model",
    "inertia_shift_rad": "inertia_profile_shift: the inertia is the table's at angle + shift",
    "end_high_nm_rad": "end_spring: pushes the load back beyond end_high_rad",
    "end_high_rad": "end_spring: where it begins",
    "end_low_nm_rad": "end_spring, side -1: pushes the load back below end_low_rad",
    "end_low_rad": "end_spring, side -1: where it begins",
    "event_time_s": "load_event: after motion_start_s",
    "eccentricity_rad": "encoder_eccentricity: reported angle = angle + amplitude sin(angle + phase)",
    "kinematic_rad": "kinematic_error: the coupling is driven by angle + amplitude sin(order angle + phase)",
    "kinematic_second_rad": "kinematic_error: and + second amplitude sin(2 order angle + second phase)",
    "harmonic_rad": "encoder_harmonic: reported angle = angle + amplitude sin(order angle + phase)",
}


def _origin(field: str) -> str:
    """The terms of the file contract that set a field."""
    found = [
        f"{term}: {key}"
        for term, keys in PHYSICS.items()
        for key, one in keys.items()
        if one.field == field
        or (one.field == "coulomb" and field in ("coulomb_positive_nm", "coulomb_negative_nm"))
    ]
    return ", ".join(found) or field


def _added(machine: Machine) -> Array:
    """What learned profiles add to the inertia."""
    points = np.unique(inertia_points(machine.physics))
    return _rows(points, inertia_added(machine.physics, points)) if points.size else _level(0.0)


def _residuals(machine: Machine) -> dict[str, Array]:
    """Learned torques that are tables, zero where there is none."""
    found, tables = residuals_of(machine.physics), {}
    for over in OVER:
        one = found.get(over)
        ends = ("",) if over in UNDIRECTED else ("_forward", "_backward")
        for end in ends:
            values = None if one is None else one.backward_nm if end == "_backward" else one.forward_nm
            rows = _level(0.0) if one is None or values is None else _rows(one.x, values)
            tables[f"residual_{over}{end}"] = rows
    return tables


def _planes(machine: Machine) -> dict[str, Array]:
    """Learned torques over two coordinates, as tables with a head and a first column (n + 1, m + 1)."""
    found, tables = planes_of(machine.physics), {}
    for pair in PAIRS:
        sheet = found[pair].sheet if pair in found else NOTHING
        below = np.column_stack([sheet.x, sheet.torque])
        tables[f"residual_{'_'.join(pair)}_plane"] = np.vstack([np.append(0.0, sheet.y), below])
    return tables


def _level(value: float) -> Array:
    return np.array([[0.0, value, 0.0], [1.0, value, 0.0]])


def _rows(angle: Array, values: Array) -> Array:
    return np.column_stack([angle, values, PchipInterpolator(angle, values).derivative()(angle)])


def _torque_rows(table: LoadTorqueTable | None) -> Array:
    return _level(0.0) if table is None else _rows(table.position_rad, table.load_torque_nm)
