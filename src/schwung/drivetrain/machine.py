"""What is believed about a machine: its drive train and controller, and the file `machine.toml` that says so.

An attribute is named as the key in the file with its unit behind it: `motor.inertia_kgm2` is `inertia` in
`[motor]`.
"""

from __future__ import annotations

import tomllib
from collections.abc import Mapping
from dataclasses import replace
from difflib import get_close_matches
from pathlib import Path
from typing import Annotated, Any, Self

import numpy as np
import tomli_w
from pydantic import (
    AliasGenerator,
    BaseModel,
    ConfigDict,
    Field,
    InstanceOf,
    ValidationError,
    model_validator,
)

from schwung.drivetrain.effects import ALIKE, check_physics
from schwung.drivetrain.inertia import (
    InertiaTable,
    LoadTorqueTable,
    read_inertia_csv,
    read_load_torque_csv,
    slider_crank_inertia,
    write_inertia_csv,
    write_load_torque_csv,
)
from schwung.drivetrain.physics_term import PhysicsTerm
from schwung.errors import InputError
from schwung.files import replace_file
from schwung.motion import Array
from schwung.quantities import Effort

#: Ends of attribute names, longest first, and the unit each stands for.
_UNITS = {
    "_nm_rad": "N·m/rad",
    "_per_s": "1/s",
    "_nm_a": "N·m/A",
    "_ohm": "Ω",
    "_kgm2": "kg·m²",
    "_nms": "N·m·s/rad",
    "_nm": "N·m",
    "_hz": "Hz",
    "_s": "s",
}


def _unit_end(name: str) -> str:
    return next((end for end in _UNITS if name.endswith(end)), "")


def _file_key(name: str) -> str:
    """The key in the file: the attribute's name without its unit."""
    return name.removesuffix(_unit_end(name))


class _Table(BaseModel):
    """A table of the file: strict numbers, unknown keys kept."""

    model_config = ConfigDict(
        frozen=True,
        extra="allow",
        strict=True,
        validate_by_name=True,
        alias_generator=AliasGenerator(validation_alias=_file_key, serialization_alias=_file_key),
    )

    @model_validator(mode="after")
    def _spelled(self) -> Self:
        """What may be left out and is misspelled, or has its unit in the key, would be left out without a word."""
        extra = self.model_extra or {}
        given = self.model_fields_set - set(extra)
        left_out = {_file_key(name) for name in type(self).model_fields if name not in given}
        for name in extra:
            near = get_close_matches(_file_key(name), left_out, 1, ALIKE)
            if near:
                table = type(self).__name__.lower()
                place = name if table == "machine" else f"{table}.{name}"
                raise InputError(place, "is no key of a machine file", f"Is it {near[0]}?")
        return self


def _positive(upper: float) -> Any:
    return Field(gt=0, le=upper, allow_inf_nan=False)


def _not_negative(upper: float) -> Any:
    return Field(ge=0, le=upper, allow_inf_nan=False)


# The upper ends are far beyond any servo axis; they are there to catch g·cm² for kg·m² and ms for s.
Inertia = Annotated[float, _positive(1e5)]
Torque = Annotated[float, _positive(1e6)]
Friction = Annotated[float, _not_negative(1e5)]

#: Peak torque over rotor inertia of any servo motor, from large direct drives to 4 mm micromotors (rad/s²).
_ACCELERATION_RANGE = (10.0, 1e8)
#: The lower end where the machine is one rigid mass, all of which may be stated as the motor's: a table on a ball screw
#: reaches a few m/s².
_RIGID_ACCELERATION = 2.5
#: Load inertias above this many rotor inertias are mistakes of unit.
_MAX_INERTIA_RATIO = 1e4


class Electrical(_Table):
    """What a torque costs: resistance·(torque/torque_constant)² is lost in copper, iron_loss·ω² in iron (W).

    `iron_loss_nms` is beside the viscous friction, not in it.
    """

    resistance_ohm: Annotated[float, _positive(1e4)]
    torque_constant_nm_a: Annotated[float, _positive(1e5)]
    iron_loss_nms: Friction = 0.0

    @property
    def copper_w_nm2(self) -> float:
        """Copper loss (W) per squared torque (N²m²)."""
        return self.resistance_ohm / self.torque_constant_nm_a**2


class Motor(_Table):
    """The rotor and its torque. `torque_over_speed`: pairs of rad/s and N·m, the torque falling ever faster."""

    inertia_kgm2: Annotated[float, _positive(1e3)]
    viscous_friction_nms: Friction
    peak_torque_nm: Torque
    rated_torque_nm: Torque | None = None
    electrical: Electrical | None = None
    torque_over_speed: Annotated[tuple[tuple[float, float], ...] | None, Field(strict=False)] = None

    @model_validator(mode="after")
    def _plausible(self) -> Motor:
        self.require_acceleration(_RIGID_ACCELERATION)
        if self.rated_torque_nm is not None and self.rated_torque_nm > self.peak_torque_nm:
            raise InputError(
                "motor.rated_torque",
                f"is {self.rated_torque_nm:g} N·m, more than peak_torque, {self.peak_torque_nm:g} N·m",
                "Exchange them, or correct one.",
            )
        if self.torque_over_speed is not None:
            _require_falling(np.array(self.torque_over_speed, dtype=float))
        return self

    def require_acceleration(self, lowest: float) -> None:
        """Raise InputError where peak torque and inertia cannot be one motor's."""
        acceleration = self.peak_torque_nm / self.inertia_kgm2
        if not lowest <= acceleration <= _ACCELERATION_RANGE[1]:
            raise InputError(
                "motor.inertia",
                f"is {self.inertia_kgm2:g}, with which {self.peak_torque_nm:g} N·m accelerate the rotor "
                f"by {acceleration:.2g} rad/s²",
                "No servo motor does; give the inertia in kg·m² (1 kg·cm² = 1e-4, 1 g·cm² = 1e-7), "
                "the torque in N·m, and what is carried as load.inertia.",
            )


def _require_falling(pairs: Array) -> None:
    """Raise InputError for what is no torque-speed curve: speeds up, torques down, and ever more steeply."""
    good = pairs.ndim == 2 and len(pairs) > 1 and bool(np.all(np.isfinite(pairs) & (pairs >= 0)))
    if good:
        steps = np.diff(pairs, axis=0)
        good = bool(np.all(steps[:, 0] > 0))
        slopes = steps[:, 1] / np.where(steps[:, 0] > 0, steps[:, 0], 1.0)
        good = good and bool(np.all(slopes <= 0) and np.all(np.diff(slopes) <= 1e-9))
    if not good:
        raise InputError(
            "motor.torque_over_speed",
            "is not a curve of pairs [rad/s, N·m] whose torque falls, and ever more steeply",
            "Write [[0, 233], [150, 233], [220, 120]], as on the motor's data sheet.",
        )


class Coupling(_Table):
    """The shaft between rotor and load."""

    stiffness_nm_rad: Annotated[float, _positive(1e10)]
    damping_nms: Annotated[float, _not_negative(1e7)]


class Load(_Table):
    """What the motor moves. Its inertia is a number, a table over the load angle, or unknown (neither)."""

    viscous_friction_nms: Friction = 0.0
    inertia_kgm2: Inertia | None = None
    inertia_table: InstanceOf[InertiaTable] | None = None
    trust: str | None = None  # the verdict on a measured table: good, doubtful or unusable
    torque_nm: Annotated[float, Field(ge=-1e6, le=1e6, allow_inf_nan=False)] | None = None
    torque_table: InstanceOf[LoadTorqueTable] | None = None

    @model_validator(mode="after")
    def _one_of_each(self) -> Load:
        for key, number, table in (
            ("inertia", self.inertia_kgm2, self.inertia_table),
            ("torque", self.torque_nm, self.torque_table),
        ):
            if number is not None and table is not None:
                raise InputError(f"load.{key}", f"is given beside {key}_table", "Keep one of the two.")
        return self


class Control(_Table):
    """The drive's cascade: T = K_ps (e + ∫e/T_n), e = K_pp (θ* − θ) − ω."""

    position_gain_per_s: Annotated[float, _positive(1e4)]
    speed_gain_nms: Annotated[float, _positive(1e6)]
    speed_integral_time_s: Annotated[float, _positive(5.0)]
    sample_rate_hz: Annotated[float, Field(ge=100, le=1e6, allow_inf_nan=False)]


class Machine(_Table):
    """A machine as believed. `coupling` None: rigid, one mass. `control` None: the gains are not known."""

    name: str
    motor: Motor
    coupling: Coupling | None = None
    load: Load = Load()
    control: Control | None = None
    physics: Annotated[tuple[PhysicsTerm, ...], Field(strict=False)] = ()
    effort: Effort = "torque"
    """"current": the file is in A instead of N·m throughout, inertias in A·s²/rad; N·m per A is unknown."""

    @model_validator(mode="after")
    def _plausible(self) -> Machine:
        if self.coupling is not None:
            self.motor.require_acceleration(_ACCELERATION_RANGE[0])
        inertia = self.load_inertia
        highest = inertia if isinstance(inertia, float) else inertia and float(inertia.inertia_kgm2.max())
        if highest and highest > _MAX_INERTIA_RATIO * self.motor.inertia_kgm2:
            raise InputError(
                "load.inertia" if isinstance(inertia, float) else "load.inertia_table",
                f"reaches {highest:g}, {highest / self.motor.inertia_kgm2:.2g} times the motor's",
                "Give both in kg·m² (1 kg·cm² = 1e-4, 1 g·cm² = 1e-7).",
            )
        check_physics(self.physics, rigid=self.coupling is None)
        return self

    def require_torque(self, what: str) -> None:
        """Raise InputError where the machine is in A: `what` needs N·m."""
        if self.effort == "current":
            raise InputError(
                f'machine "{self.name}"', f'is in A (effort = "current"), and {what} needs N·m',
                "Multiply what has A in its unit by the motor's N·m per ampere, and drop effort.",
            )  # fmt: skip

    @property
    def load_inertia(self) -> InertiaTable | float | None:
        """J_l as believed: a table, one number (kg·m²), or None where it is unknown."""
        return self.load.inertia_table if self.load.inertia_table is not None else self.load.inertia_kgm2

    def load_inertia_at(self, position_rad: Array) -> Array:
        """J_l (kg·m²) at the given load angles (rad), same shape. Raises InputError where it is unknown."""
        inertia = self.load_inertia
        if inertia is None:
            raise InputError(
                f'machine "{self.name}"',
                "load.inertia is not known",
                "Estimate it, or give load.inertia or load.inertia_table.",
            )
        return inertia.at(position_rad) if isinstance(inertia, InertiaTable) else 0.0 * position_rad + inertia

    def load_torque_at(self, position_rad: Array) -> Array:
        """Torque that the load exerts on its shaft (N·m) at the given load angles (rad), same shape."""
        if self.load.torque_table is not None:
            return self.load.torque_table.at(position_rad)
        return 0.0 * position_rad + (self.load.torque_nm or 0.0)

    def required_control(self) -> Control:
        """The controller. Raises InputError where the file has none."""
        if self.control is None:
            raise InputError(
                f'machine "{self.name}"',
                "has no [control]",
                "Add position_gain, speed_gain, speed_integral_time and sample_rate of the drive.",
            )
        return self.control


def paper_machine() -> Machine:
    """The simulated machine of the paper, Table 1, with the control gains of its simulation.

    J_l over 0…π is *inferred* (`slider_crank_inertia`): the paper only draws it.
    """
    angle = np.linspace(0.0, np.pi, 361)
    return Machine(
        name="Two-mass machine of the paper, Table 1 (load inertia inferred)",
        motor=Motor(inertia_kgm2=0.012, viscous_friction_nms=0.2, peak_torque_nm=233.0),
        coupling=Coupling(stiffness_nm_rad=24963.0, damping_nms=8.62),
        load=Load(viscous_friction_nms=0.1, inertia_table=InertiaTable(angle, slider_crank_inertia(angle))),
        control=Control(
            position_gain_per_s=60.0,
            speed_gain_nms=7.0,
            speed_integral_time_s=8e-3,
            sample_rate_hz=8000.0,
        ),
    )


def load_machine(path: str | Path) -> Machine:
    """Read `machine.toml` and the tables that it names (files.md). Raises InputError for every defect."""
    path = Path(path)
    data = _read_toml(path)
    load = data.get("load")
    if isinstance(load, dict):
        if "viscous_friction" not in load:
            raise InputError(f"{path}: load.viscous_friction", "is missing", "Add it to [load] in N·m·s/rad.")
        _read_tables(load, path)
        table = load.get("inertia_table")
        if isinstance(table, InertiaTable) and table.effort != data.get("effort", "torque"):
            unit = "A·s²/rad" if table.effort == "current" else "kg·m²"
            raise InputError(f"{path}: load.inertia_table", f"is in {unit}, the machine file is not",
                             'A machine in A says effort = "current" at its top.')  # fmt: skip
    try:
        return Machine.model_validate(data, by_alias=True, by_name=False)
    except InputError as error:
        raise InputError(f"{path}: {error.place}", error.problem, error.remedy) from None
    except ValidationError as error:
        raise _explained(error, path) from None


def machine_files(path: str | Path) -> tuple[Path, ...]:
    """The machine file and the tables that it names: all that its content depends on.

    Raises InputError where the file cannot be read; whether its tables are there is for `load_machine` to say.
    """
    path = Path(path)
    load = _read_toml(path).get("load")
    tables = [load.get(key) for key in _TABLES] if isinstance(load, dict) else []
    return (path, *(path.parent / name for name in tables if isinstance(name, str) and name))


def _read_toml(path: Path) -> dict[str, Any]:
    try:
        return tomllib.loads(path.read_text(encoding="utf-8"))
    except OSError as error:
        reason = (error.strerror or str(error)).lower()
        raise InputError(str(path), f"cannot be read: {reason}", "Give the path of a machine.toml.") from None
    except UnicodeDecodeError:
        raise InputError(str(path), "is not UTF-8 text", "Give the path of a machine.toml.") from None
    except (ValueError, RecursionError) as error:
        named = path.suffix.lower() == ".toml"
        remedy = (
            "Correct that line." if named else "Give a machine.toml; load.inertia_table in it names a table."
        )
        raise InputError(str(path), f"is not TOML: {error}", remedy) from None


_TABLES = {"inertia_table": read_inertia_csv, "torque_table": read_load_torque_csv}


def _read_tables(load: dict[str, Any], path: Path) -> None:
    """Replace the names of tables by the tables; names are relative to the machine file."""
    for key, read in _TABLES.items():
        if key not in load:
            continue
        if not isinstance(load[key], str) or not load[key]:
            raise InputError(f"{path}: load.{key}", f"is {load[key]!r}", "Give the name of a CSV file.")
        try:
            load[key] = read(path.parent / load[key])
        except InputError as error:
            problem = f"{error.problem} (load.{key} in {path.name} names it)"
            raise InputError(error.place, problem, error.remedy) from None


_MODELS: Mapping[str, type[BaseModel]] = {
    "motor": Motor,
    "electrical": Electrical,
    "coupling": Coupling,
    "load": Load,
    "control": Control,
}


def _explained(error: ValidationError, path: Path) -> InputError:
    """The first defect in one sentence: where, what, and in which unit it is wanted."""
    first = error.errors()[0]
    table, key = str(first["loc"][-2 if len(first["loc"]) > 2 else 0]), str(first["loc"][-1])
    fields = _MODELS[table].model_fields if table in _MODELS else {}
    end = next((_unit_end(name) for name in fields if _file_key(name) == key), "")
    unit = f" in {_UNITS[end]}" if end else ""
    place = f"{path}: {'.'.join(str(part) for part in first['loc'])}"
    if first["type"] == "missing":
        return InputError(place, "is missing", f"Add it{unit}.")
    if first["type"] == "model_type":
        return InputError(place, f"is {first['input']!r}, not a table", f"Write it as [{key}].")
    wanted = first["msg"].replace("Input should be", "It must be")
    return InputError(place, f"is {first['input']!r}", f"{wanted}{unit}.")


def write_machine(machine: Machine, path: str | Path) -> None:
    """Write `machine.toml` and its tables beside it (`<stem>_inertia.csv`, `<stem>_load_torque.csv`).

    `load_machine` gives the same machine again, learned terms and unknown keys included. The machine file
    comes last and all at once: it never names a table that is not there. Raises InputError where it cannot
    be written.
    """
    path = Path(path)
    tables = {"load": {"inertia_table", "torque_table"}}
    data = machine.model_dump(by_alias=True, exclude_none=True, exclude=tables)
    if not machine.physics:
        del data["physics"]
    if machine.effort == "torque":
        del data["effort"]
    if machine.load.inertia_table is not None:
        data["load"]["inertia_table"] = f"{path.stem}_inertia.csv"
        table = replace(machine.load.inertia_table, effort=machine.effort)
        write_inertia_csv(table, path.with_name(data["load"]["inertia_table"]))
    if machine.load.torque_table is not None:
        data["load"]["torque_table"] = f"{path.stem}_load_torque.csv"
        write_load_torque_csv(machine.load.torque_table, path.with_name(data["load"]["torque_table"]))
    replace_file(path, tomli_w.dumps(data))
