"""modelDescription.xml of an FMU: FMI 2.0.4 section 2.2 and 4.3, FMI 3.0.2 section 2.4 and 4.3."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal
from xml.etree import ElementTree
from xml.etree.ElementTree import Element, SubElement

from schwung import __version__
from schwung.simulators.exported import Exported

Causality = Literal["independent", "input", "output", "parameter"]

#: Exponents of a unit's base units.
_BASE: dict[str, dict[str, int]] = {
    "s": {"s": 1},
    "rad": {"rad": 1},
    "rad/s": {"rad": 1, "s": -1},
    "Hz": {"s": -1},
    "kg.m2": {"kg": 1, "m": 2},
    "N.m": {"kg": 1, "m": 2, "s": -2},
    "N.m/rad": {"kg": 1, "m": 2, "s": -2, "rad": -1},
    "N.m/rad3": {"kg": 1, "m": 2, "s": -2, "rad": -3},
    "N.m.s/rad": {"kg": 1, "m": 2, "s": -1, "rad": -1},
    "N.m.s2/rad2": {"kg": 1, "m": 2, "rad": -2},
}


@dataclass(frozen=True)
class Variable:
    """A variable of the FMU; its value reference is its place in the list."""

    name: str
    causality: Causality
    unit: str
    description: str
    start: float = 0.0

    @property
    def variability(self) -> str:
        """A start angle is fixed; all other parameters may be changed while it runs."""
        if self.causality != "parameter":
            return "continuous"
        return "fixed" if self.name == "start_angle_rad" else "tunable"


def variables(told: Exported) -> tuple[Variable, ...]:
    """All variables: time, torque in, motion out, parameters."""
    return (
        Variable("time", "independent", "s", "simulated time"),
        Variable("torque", "input", "N.m", "motor torque as the drive reports it, held over each step"),
        Variable("motor_angle", "output", "rad", "angle of the motor as the drive reads it"),
        Variable("motor_speed", "output", "rad/s", "speed of the motor as the drive reads it"),
        Variable("load_angle", "output", "rad", "angle of the load"),
        Variable("load_speed", "output", "rad/s", "speed of the load"),
        *(Variable(one.name, "parameter", one.unit, one.description, one.value) for one in told.parameters),
    )


def model_description(
    told: Exported, listed: tuple[Variable, ...], fmi: int, token: str, sources: tuple[str, ...]
) -> bytes:
    """The file's text. `sources`: the C files that are compiled, in `sources/`."""
    root = Element("fmiModelDescription", fmiVersion=f"{fmi}.0", modelName=told.name)
    root.set("guid" if fmi == 2 else "instantiationToken", token)
    root.set("description", "Motor, coupling and load with an inertia over its angle, as learned by Schwung")
    root.set("generationTool", f"Schwung {__version__}")
    root.set("variableNamingConvention", "flat")
    if fmi == 2:
        root.set("numberOfEventIndicators", "0")
    able = {
        "modelIdentifier": told.identifier,
        "canHandleVariableCommunicationStepSize": "true",
        "canGetAndSetFMUstate" if fmi == 2 else "canGetAndSetFMUState": "true",
        "canSerializeFMUstate" if fmi == 2 else "canSerializeFMUState": "true",
    }
    simulation = SubElement(root, "CoSimulation", able)
    if fmi == 2:
        files = SubElement(simulation, "SourceFiles")
        for name in sources:
            SubElement(files, "File", name=name)
    _add_units(root, {one.unit for one in listed if one.unit})
    categories = SubElement(root, "LogCategories")
    SubElement(categories, "Category", name="logStatusError")
    SubElement(root, "DefaultExperiment", startTime="0", stopTime="1", stepSize="0.000125")
    known = SubElement(root, "ModelVariables")
    for number, one in enumerate(listed):
        _add_variable(known, number, one, fmi)
    structure = SubElement(root, "ModelStructure")
    outputs = [number for number, one in enumerate(listed) if one.causality == "output"]
    if fmi == 2:
        for group in ("Outputs", "InitialUnknowns"):
            held = SubElement(structure, group)
            for number in outputs:
                SubElement(held, "Unknown", index=str(number + 1))
    else:
        for kind in ("Output", "InitialUnknown"):
            for number in outputs:
                SubElement(structure, kind, valueReference=str(number))
    return _text(root)


def build_description(identifier: str, sources: tuple[str, ...]) -> bytes:
    """sources/buildDescription.xml of FMI 3.0 (section 2.5.1.3)."""
    root = Element("fmiBuildDescription", fmiVersion="3.0")
    built = SubElement(root, "BuildConfiguration", modelIdentifier=identifier)
    files = SubElement(built, "SourceFileSet", language="C99")
    for name in sources:
        SubElement(files, "SourceFile", name=name)
    return _text(root)


def _add_units(root: Element, used: set[str]) -> None:
    definitions = SubElement(root, "UnitDefinitions")
    for unit, base in _BASE.items():
        if unit in used:
            exponents = {name: str(power) for name, power in base.items()}
            SubElement(SubElement(definitions, "Unit", name=unit), "BaseUnit", exponents)


def _add_variable(known: Element, number: int, one: Variable, fmi: int) -> None:
    named = {
        "name": one.name,
        "valueReference": str(number),
        "causality": one.causality,
        "variability": one.variability,
        "description": one.description,
    }
    started = one.causality in ("input", "parameter")
    if one.causality == "output":
        named["initial"] = "calculated"
    real = {"unit": one.unit} if one.unit else {}
    if started:
        real["start"] = repr(one.start)
    if fmi == 2:
        SubElement(SubElement(known, "ScalarVariable", named), "Real", real)
    else:
        SubElement(known, "Float64", named | real)


def _text(root: Element) -> bytes:
    ElementTree.indent(root)
    return bytes(ElementTree.tostring(root, encoding="utf-8", xml_declaration=True)) + b"\n"
