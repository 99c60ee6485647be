"""map.toml: which variables of an FMU are torque and motion, in which units and with which signs."""

from __future__ import annotations

import difflib
import tomllib
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Any, Literal

from pydantic import BaseModel, ConfigDict, Field, ValidationError

from schwung.errors import InputError
from schwung.simulators.described import Described, DescribedVariable
from schwung.simulators.units import UNITS, in_si, of_base_units

Interface = Literal["co-simulation", "model-exchange"]
QUANTITIES = ("torque", "position", "speed", "acceleration")


class _Table(BaseModel):
    model_config = ConfigDict(frozen=True, extra="forbid", strict=True)


class Signal(_Table):
    """One variable. `sign` −1: it counts the other way round than the recording."""

    variable: Annotated[str, Field(min_length=1)]
    unit: str | None = None
    sign: Literal[1, -1] = 1


class Start(_Table):
    """Parameter that sets the angle at first; its unit is that of `position` unless it says another."""

    position: str | None = None


class Solver(_Table):
    """How the FMU is played. `step_s`: communication step; `tolerance`: relative, of the variable step."""

    interface: Interface | None = None
    step_s: Annotated[float, Field(gt=0, le=0.1, allow_inf_nan=False)] | None = None
    tolerance: Annotated[float, Field(gt=0, lt=1)] = 1e-8


class Map(_Table):
    """The file."""

    torque: Signal
    position: Signal
    speed: Signal | None = None
    acceleration: Signal | None = None
    start: Start = Start()
    solver: Solver = Solver()
    parameters: Mapping[str, float | int | bool | str] = Field(default_factory=dict)


@dataclass(frozen=True)
class Port:
    """A variable as it is played: SI = factor · value."""

    name: str
    reference: int
    factor: float


@dataclass(frozen=True)
class Ports:
    """Everything that playing an FMU has to know of it."""

    interface: Interface
    inverse: bool  # motion in, torque out
    torque: Port
    position: Port
    speed: Port | None
    acceleration: Port | None
    start: Port | None
    parameters: Mapping[str, float | int | bool | str]
    step_s: float | None
    own_step: bool  # that is the FMU's own, of which whole ones may be taken; else the map's
    tolerance: float


def read_map(path: str | Path) -> Map:
    """Read map.toml. Raises InputError for every defect, naming file and key."""
    path = Path(path)
    try:
        data = tomllib.loads(path.read_text(encoding="utf-8"))
    except OSError as error:
        reason = (error.strerror or str(error)).lower()
        raise InputError(str(path), f"cannot be read: {reason}", "Give the path of a map.toml.") from None
    except UnicodeDecodeError:
        raise InputError(str(path), "is not UTF-8 text", "Give the path of a map.toml.") from None
    except ValueError as error:
        raise InputError(str(path), f"is not TOML: {error}", "Correct that line.") from None
    try:
        return Map.model_validate(data)
    except ValidationError as error:
        raise _explained(path, error) from None


def _explained(path: Path, error: ValidationError) -> InputError:
    first = error.errors()[0]
    place = f"{path}: {'.'.join(str(part) for part in first['loc'])}"
    if first["type"] == "missing":
        what = str(first["loc"][-1])
        wanted = f'Write [{what}] with variable = "…".' if what in QUANTITIES else "Add it."
        return InputError(place, "is missing", wanted)
    if first["type"] == "extra_forbidden":
        known = [
            *QUANTITIES,
            "start",
            "solver",
            "parameters",
            "variable",
            "unit",
            "sign",
            "interface",
            "step_s",
        ]
        return InputError(place, "is not known", _nearest(str(first["loc"][-1]), known))
    return InputError(
        place, f"is {first['input']!r}", f"{first['msg'].replace('Input should be', 'It must be')}."
    )


def ports(given: Map, fmu: Described, place: str) -> Ports:
    """What of the FMU is torque and what is motion; `place` names the map.

    Raises InputError for variables that the FMU has not, units that nobody gives, and directions that make no sense.
    """
    torque, position = _variable(fmu, given.torque.variable, f"{place}: torque"), given.position.variable
    if torque.causality not in ("input", "output"):
        raise InputError(
            f"{place}: torque",
            f'"{torque.name}" is neither input nor output of the FMU but {torque.causality}',
            f"Inputs are {_listed(fmu.of('input'))}; outputs {_listed(fmu.of('output'))}.",
        )
    inverse = torque.causality == "output"
    wanted = ("input", "output")[inverse], ("output", "input")[inverse]
    found = {name: _port(name, getattr(given, name), fmu, place) for name in QUANTITIES}
    for name in QUANTITIES[1:]:
        signal = getattr(given, name)
        variable = fmu.variables[signal.variable] if signal is not None else None
        if (
            variable is None
            or variable.causality == wanted[1]
            or (not inverse and variable.causality == "local")
        ):
            continue
        raise InputError(
            f"{place}: {name}",
            f'"{variable.name}" is {variable.causality} of the FMU where the torque is its {wanted[0]}',
            "A model has torque in and motion out, or motion in and torque out.",
        )
    port = found["position"]
    assert found["torque"] is not None
    assert port is not None
    interface = _interface(given, fmu, place)
    _check_parameters(given, fmu, place)
    return Ports(
        interface=interface,
        inverse=inverse,
        torque=found["torque"],
        position=port,
        speed=found["speed"],
        acceleration=found["acceleration"] if inverse else None,
        start=_start(given, fmu, port, position, place),
        parameters=dict(given.parameters),
        step_s=given.solver.step_s or fmu.fixed_step_s,
        own_step=given.solver.step_s is None,
        tolerance=given.solver.tolerance,
    )


def _interface(given: Map, fmu: Described, place: str) -> Interface:
    wanted = given.solver.interface
    if wanted is not None and wanted not in fmu.interfaces:
        raise InputError(
            f"{place}: solver.interface",
            f'is "{wanted}", which the FMU has not',
            f"It has {' and '.join(fmu.interfaces)}.",
        )
    return wanted or fmu.interfaces[0]


def _check_parameters(given: Map, fmu: Described, place: str) -> None:
    for name in given.parameters:
        _variable(fmu, name, f"{place}: parameters")


def _start(given: Map, fmu: Described, position: Port, of: str, place: str) -> Port | None:
    name = given.start.position
    if name is None:
        return None
    variable = _variable(fmu, name, f"{place}: start.position")
    sign = given.position.sign
    own = _declared("position", variable, fmu)
    return Port(name, variable.reference, sign * own if own is not None else position.factor)


def _port(quantity: str, signal: Signal | None, fmu: Described, place: str) -> Port | None:
    if signal is None:
        return None
    here = f"{place}: {quantity}"
    variable = _variable(fmu, signal.variable, here)
    if not variable.real:
        raise InputError(here, f'"{variable.name}" is not a real number in the FMU', "Name another variable.")
    if signal.unit is not None:
        factor: float | None = in_si(quantity, signal.unit, f"{here}.unit")
    else:
        factor = _declared(quantity, variable, fmu)
    if factor is None:
        said = f'has the unit "{variable.unit}"' if variable.unit else "has no unit"
        raise InputError(
            here,
            f'"{variable.name}" {said} in the FMU, which says nothing of a {quantity}',
            f'Add unit = "{next(iter(UNITS[quantity]))}".',
        )
    return Port(variable.name, variable.reference, signal.sign * factor)


def _declared(quantity: str, variable: DescribedVariable, fmu: Described) -> float | None:
    """One of the unit that the FMU itself gives, in SI; None where that is no unit of the quantity."""
    if variable.unit is None:
        return None
    known = UNITS[quantity].get(variable.unit)
    if known is not None:
        return known
    base = fmu.base_units.get(variable.unit)
    return None if base is None else of_base_units(quantity, base[0], base[1])


def _variable(fmu: Described, name: str, place: str) -> DescribedVariable:
    found = fmu.variables.get(name)
    if found is None:
        raise InputError(place, f'the FMU has no variable "{name}"', _nearest(name, list(fmu.variables)))
    return found


def _nearest(name: str, known: list[str]) -> str:
    """What may have been meant."""
    lower = {one.lower(): one for one in known}
    close = difflib.get_close_matches(name.lower(), list(lower), n=3, cutoff=0.5)
    if close:
        return f'Did you mean "{lower[close[0]]}"?'
    return f"There are {_listed(known)}."


def _listed(names: list[str] | tuple[str, ...], most: int = 12) -> str:
    shown = ", ".join(names[:most]) or "none"
    return f"{shown} and {len(names) - most} more" if len(names) > most else shown


def as_document(of: Ports) -> dict[str, Any]:
    """The ports as plain values, for a process of its own."""

    def one(port: Port | None) -> dict[str, Any] | None:
        return (
            None if port is None else {"reference": port.reference, "factor": port.factor, "name": port.name}
        )

    return {
        "interface": of.interface,
        "inverse": of.inverse,
        "parameters": dict(of.parameters),
        "tolerance": of.tolerance,
        **{name: one(getattr(of, name)) for name in (*QUANTITIES, "start")},
    }
