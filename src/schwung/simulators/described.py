"""An FMU's own description, as FMPy reads it: variables, units, interfaces, and whether it can be played here."""

from __future__ import annotations

import zipfile
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Literal

from schwung.errors import InputError
from schwung.extras import require

Interface = Literal["co-simulation", "model-exchange"]


@dataclass(frozen=True)
class DescribedVariable:
    """One variable of the FMU."""

    name: str
    reference: int
    causality: str
    unit: str | None
    real: bool


@dataclass(frozen=True)
class Described:
    """What an FMU says of itself. `base_units`: exponents of kg, m, s, and the factor to SI, by the unit's name."""

    path: Path
    name: str
    fmi: str
    interfaces: tuple[Interface, ...]
    variables: Mapping[str, DescribedVariable]
    base_units: Mapping[str, tuple[tuple[int, int, int], float]]
    fixed_step_s: float | None
    steps_vary: bool

    def of(self, causality: str) -> list[str]:
        """Names of the variables of one causality."""
        return [one.name for one in self.variables.values() if one.causality == causality]


def describe(path: str | Path) -> Described:
    """Read an FMU's description. Raises InputError for what is no FMU, or none that can be played on this computer."""
    path = Path(path)
    require("--belief with an FMU", "fmi")
    import fmpy  # heavy, and an extra

    if not path.is_file():
        raise InputError(str(path), "is not there", "Give the path of an FMU.")
    if not zipfile.is_zipfile(path):
        raise InputError(str(path), "is no FMU: not a zip archive", "Give the path of a file *.fmu.")
    try:
        told = fmpy.read_model_description(str(path), validate=False)
        platforms = fmpy.supported_platforms(str(path))
    except Exception as error:  # FMPy raises whatever its parsers raise
        first = (str(error).strip() or type(error).__name__).splitlines()[0].rstrip(".")[:160]
        raise InputError(str(path), f"is no FMU that can be read: {first}", "Export it again.") from None
    _require_playable(path, told, platforms, fmpy.platform)
    return _described(path, told)


def _require_playable(path: Path, told: Any, platforms: list[str], here: str) -> None:
    version = str(told.fmiVersion)
    if not version.startswith(("2.", "3.")):
        raise InputError(str(path), f"is of FMI {version}", "Export it with FMI 2.0 or 3.0.")
    if told.coSimulation is None and told.modelExchange is None:
        raise InputError(
            str(path), "has neither co-simulation nor model exchange", "Export it for one of these two."
        )
    if here in platforms:
        return
    built = [one for one in platforms if one != "c-code"]
    holds = f"holds binaries for {', '.join(built)} only" if built else "holds no binary"
    remedy = (
        f"It has its C sources: `python -m fmpy compile {path}` builds it here."
        if "c-code" in platforms
        else "Export it for this platform, or with its sources."
    )
    raise InputError(str(path), f"{holds}; this computer is {here}", remedy)


def _described(path: Path, told: Any) -> Described:
    interfaces: list[Interface] = []
    if told.coSimulation is not None:
        interfaces.append("co-simulation")
    if told.modelExchange is not None:
        interfaces.append("model-exchange")
    variables = {}
    for one in told.modelVariables:
        unit = one.unit or (one.declaredType.unit if one.declaredType is not None else None)
        real = str(one.type) in ("Real", "Float64")
        variables[one.name] = DescribedVariable(
            one.name, int(one.valueReference), str(one.causality or "local"), unit or None, real
        )
    bases = {}
    for unit in told.unitDefinitions or []:
        base = unit.baseUnit
        if base is not None and not base.offset and not (base.A or base.K or base.mol or base.cd):
            bases[unit.name] = ((int(base.kg), int(base.m), int(base.s)), float(base.factor))
    simulation = told.coSimulation
    fixed = getattr(simulation, "fixedInternalStepSize", None) if simulation is not None else None
    return Described(
        path=path,
        name=str(told.modelName or path.stem),
        fmi=str(told.fmiVersion),
        interfaces=tuple(interfaces),
        variables=variables,
        base_units=bases,
        fixed_step_s=float(fixed) if fixed else None,
        steps_vary=bool(simulation is not None and simulation.canHandleVariableCommunicationStepSize),
    )
