"""`schwung export`: an inertia table into drive parameters or a DCF file; a machine into other simulators."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from schwung.cli.options import (
    Bitrate,
    BusOption,
    CanLog,
    Channel,
    Interface,
    Json,
    Node,
    Profile,
    Yes,
    connected,
    export_choice,
)

if TYPE_CHECKING:
    from schwung import InertiaTable
    from schwung.api.choices import ExportChoice
    from schwung.cli.console import Terminal


def export(
    table: Annotated[
        Path | None, typer.Argument(help="The inertia table, inertia.csv; for a simulator the machine's own.")
    ] = None,
    form: Annotated[
        str, typer.Option("--as", metavar="FORM", help="table, harmonics, mean, max or at=ANGLE.")
    ] = "table",
    dcf: Annotated[
        Path | None,
        typer.Option(help="Write a DCF (CiA 306) for the profile's EDS instead of asking a drive."),
    ] = None,
    store: Annotated[bool, typer.Option(help="Save in the drive's memory (1010).")] = True,
    verify: Annotated[
        Path | None,
        typer.Option(
            metavar="SESSION", help="Make this session's reference motion before and after. Needs --machine."
        ),
    ] = None,
    machine: Annotated[
        Path | None,
        typer.Option(
            "-m",
            "--machine",
            help="The believed machine: for a simulator, --verify, and drives that want the motor's inertia.",
        ),
    ] = None,
    fmu: Annotated[
        Path | None,
        typer.Option(metavar="FILE", help="Write an FMU for co-simulation, with sources; compiled with cc."),
    ] = None,
    fmi: Annotated[int, typer.Option(metavar="2|3", help="The FMU's version of FMI.")] = 2,
    modelica: Annotated[
        Path | None, typer.Option(metavar="FILE", help="Write a Modelica model, *.mo.")
    ] = None,
    matlab: Annotated[
        Path | None, typer.Option(metavar="FILE", help="Write a MATLAB function for ode45, *.m.")
    ] = None,
    out: Annotated[Path | None, typer.Option(help="Folder for the backup; default: schwung-<time>.")] = None,
    dry_run: Annotated[bool, typer.Option("--dry-run", help="Show what would be written.")] = False,
    yes: Yes = False,
    interface: Interface = None,
    channel: Channel = None,
    bitrate: Bitrate = None,
    bus: BusOption = None,
    can_log: CanLog = None,
    node: Node = 1,
    profile: Profile = None,
    json_output: Json = False,
) -> None:
    """Write an inertia table into a drive: written, read back, compared, stored; the old values are backed up.

    With --verify the machine moves: the following error is measured before and after.

    With --fmu, --modelica or --matlab no drive is asked: the machine of --machine, with all that was learned about
    it, becomes a model of another simulator.

    [bold]Examples[/]

      schwung export inertia.csv -i socketcan -c can0 -n 3

      schwung export inertia.csv -i socketcan -c can0 -n 3 --verify session.h5 -m machine.toml

      schwung export inertia.csv --as max -i socketcan -c can0 -n 3 --dry-run

      schwung export inertia.csv --profile schwung-bench -n 3 --dcf drive.dcf

      schwung export -m explanation/machine.toml --fmu machine.fmu --fmi 3
    """
    from schwung import export as export_table
    from schwung import load_machine, plan, plan_export, read_inertia, read_session
    from schwung.api.folders import planned_folder
    from schwung.api.moving import wishes_of
    from schwung.cli.console import Terminal, describe_table, observing
    from schwung.cli.flow import show_export, show_plan
    from schwung.cli.models import ModelFiles, write_models
    from schwung.errors import InputError

    terminal = Terminal(json_output)
    if fmu or modelica or matlab:
        write_models(terminal, machine, table, ModelFiles(fmu, fmi, modelica, matlab))
        return
    if table is None:
        raise InputError(
            "schwung export", "no inertia table is given", "Name one, or add --fmu with --machine."
        )
    inertia, choice = read_inertia(table), export_choice(form)
    believed = load_machine(machine) if machine else None
    if dcf is not None:
        motor_inertia = believed.motor.inertia_kgm2 if believed is not None else None
        _write_dcf(dcf, profile, node, inertia, choice, motor_inertia, terminal)
        return
    if verify is not None and believed is None:
        raise InputError("--verify", "needs a machine file, too", "Give --machine.")
    wishes = wishes_of(read_session(verify)) if verify else None
    folder = planned_folder(out)
    terminal.say(describe_table(inertia))
    with connected(interface, channel, bitrate, bus, node, profile, can_log) as connection:
        changes = plan_export(connection, inertia, choice, machine=believed)
        rows = [(c.parameter.label, c.old, c.new) for c in changes]
        terminal.table("Parameters", ("object", "now", "new"), rows)
        document: dict[str, object] = {
            "parameters": [{"parameter": p, "old": o, "new": n} for p, o, n in rows]
        }
        planned = None
        if wishes is not None and believed is not None:
            planned = plan(connection, believed, wishes)
            show_plan(terminal, planned)
            planned.require()
        if dry_run:
            terminal.say("Dry run: nothing was written, nothing moved.")
            terminal.result(document)
            return
        with observing(terminal) as observer:
            exported = export_table(
                connection, inertia, choice, folder, machine=believed, verify=planned, store=store,
                confirm=lambda question: yes or terminal.ask(question), observer=observer,
            )  # fmt: skip
    show_export(terminal, exported)
    if exported.after is not None:
        document["export"] = exported.to_json()
    terminal.result(document)


def _write_dcf(
    path: Path,
    family: str | None,
    node: int,
    table: InertiaTable,
    choice: ExportChoice,
    motor_inertia_kgm2: float | None,
    terminal: Terminal,
) -> None:
    from schwung.api.configurations import write_export
    from schwung.cli.console import describe_table
    from schwung.errors import InputError

    if family is None:
        raise InputError("--dcf", "needs to know the drive family", "Add --profile.")
    count = write_export(path, family, table, choice, node=node, motor_inertia_kgm2=motor_inertia_kgm2)
    terminal.say(describe_table(table))
    terminal.say(f"{count} parameters in [bold]{path}[/]")
    terminal.result({"dcf": str(path), "parameters": count})
