"""`schwung export --fmu`, `--modelica`, `--matlab`: a machine as a model of another simulator."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, NamedTuple

if TYPE_CHECKING:
    from schwung.cli.console import Terminal


class ModelFiles(NamedTuple):
    """What is to be written; None: not."""

    fmu: Path | None
    fmi: int
    modelica: Path | None
    matlab: Path | None


def write_models(terminal: Terminal, machine: Path | None, table: Path | None, files: ModelFiles) -> None:
    """Write the machine as every model that is asked for. Raises InputError where one cannot be."""
    from rich.markup import escape

    from schwung import load_machine, read_inertia
    from schwung.api.simulators import check_fmi, write_fmu, write_matlab, write_modelica
    from schwung.errors import InputError

    if not (files.fmu or files.modelica or files.matlab):
        raise InputError(
            "schwung export", "no inertia table is given", "Name one, or add --fmu and the machine file."
        )
    if machine is None:
        raise InputError(
            "--machine", "is missing", "A model is made of a machine file: give -m machine.toml."
        )
    version = check_fmi(files.fmi)
    believed = load_machine(machine)
    if table is not None:
        load = believed.load.model_copy(update={"inertia_kgm2": None, "inertia_table": read_inertia(table)})
        believed = believed.model_copy(update={"load": load})
    document: dict[str, object] = {"machine": str(machine), "physics": [t.name for t in believed.physics]}
    if files.fmu is not None:
        fmu = write_fmu(believed, files.fmu, fmi=version)
        built = f"for {fmu.platform}" if fmu.platform else "sources only"
        terminal.say(
            f"FMI {version}.0 for co-simulation, {built}: [bold]{fmu.path}[/]  "
            f"torque in, motor_angle, motor_speed, load_angle, load_speed out, {len(fmu.parameters)} parameters"
        )
        if fmu.note:
            terminal.say(f"[cyan]i[/] {escape(fmu.note)}")
        document["fmu"] = {
            "path": str(fmu.path),
            "fmi": version,
            "platform": fmu.platform,
            "model_identifier": fmu.model_identifier,
            "parameters": list(fmu.parameters),
            "note": fmu.note,
        }
    if files.modelica is not None:
        model = write_modelica(believed, files.modelica)
        terminal.say(f"Modelica model {model.name}: [bold]{model.path}[/]")
        document["modelica"] = {"path": str(model.path), "model": model.name}
    if files.matlab is not None:
        function = write_matlab(believed, files.matlab)
        terminal.say(f"MATLAB function {function.name}: [bold]{function.path}[/]")
        document["matlab"] = {"path": str(function.path), "function": function.name}
    terminal.result(document)
