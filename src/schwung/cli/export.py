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
    bus_options,
    export_choice,
)

if TYPE_CHECKING:
    from schwung.cli.console import Terminal
    from schwung.commissioning import ExportChoice, Exported
    from schwung.drivetrain import InertiaTable
    from schwung.session import Run


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
    from schwung.api.folders import make_folder, planned_folder
    from schwung.cli.console import Terminal, describe_table, observing
    from schwung.cli.drives import open_drive
    from schwung.cli.flow import show_plan
    from schwung.cli.models import ModelFiles, write_models
    from schwung.commissioning import (
        export_table,
        export_values,
        prepare,
        repeat_reference,
        wishes_of,
    )
    from schwung.drivetrain import load_machine, read_inertia_csv
    from schwung.errors import InputError
    from schwung.session import read_session

    terminal = Terminal(json_output)
    if fmu or modelica or matlab:
        write_models(terminal, machine, table, ModelFiles(fmu, fmi, modelica, matlab))
        return
    if table is None:
        raise InputError(
            "schwung export", "no inertia table is given", "Name one, or add --fmu with --machine."
        )
    inertia, choice = read_inertia_csv(table), export_choice(form)
    believed = load_machine(machine) if machine else None
    motor_inertia = believed.motor.inertia_kgm2 if believed is not None else None
    if dcf is not None:
        _write_dcf(dcf, profile, node, inertia, choice, motor_inertia, terminal)
        return
    if verify is not None and machine is None:
        raise InputError("--verify", "needs a machine file, too", "Give --machine.")
    wishes = wishes_of(read_session(verify)) if verify else None
    folder = planned_folder(out)
    terminal.say(describe_table(inertia))
    with open_drive(bus_options(interface, channel, bitrate, bus, can_log), node, profile) as opened:
        drive = opened.drive
        values = export_values(
            drive.parameter,
            opened.profile,
            inertia,
            choice,
            read=drive.read,
            motor_inertia_kgm2=motor_inertia,
        )
        rows = [(v.parameter.label, drive.read(v.parameter).raw, v.raw) for v in values]
        terminal.table("Parameters", ("object", "now", "new"), rows)
        document: dict[str, object] = {
            "parameters": [{"parameter": p, "old": o, "new": n} for p, o, n in rows]
        }
        prepared = None
        if wishes is not None and believed is not None:
            prepared = prepare(drive, opened.profile, believed, wishes)
            show_plan(terminal, prepared)
            prepared.preflight.require()
        if dry_run:
            terminal.say("Dry run: nothing was written, nothing moved.")
            terminal.result(document)
            return
        if not yes:
            _ask(terminal, moves=prepared is not None)
        make_folder(folder)
        with observing(terminal) as observer:
            before = repeat_reference(drive, prepared, folder, "before", observer) if prepared else None
            observer.phase(f"Writing {len(values)} parameters")
            exported = export_table(
                drive, opened.profile, inertia, choice,
                backup_path=folder / "export.backup.json", store=store, motor_inertia_kgm2=motor_inertia,
            )  # fmt: skip
            after = repeat_reference(drive, prepared, folder, "after", observer) if prepared else None
    document |= _told(terminal, exported, before, after)
    terminal.result(document)


def _told(terminal: Terminal, exported: Exported, before: Run | None, after: Run | None) -> dict[str, object]:
    """Say what was written and, where it was verified, what it was good for; the same for the document."""
    from schwung.cli.flow import Verification, export_summary, show_verification

    terminal.say(
        f"{len(exported.changes)} parameters written, read back equal{', stored' if exported.stored else ''}; "
        f"the old values are in [bold]{exported.backup_path}[/]"
    )
    if before is None or after is None:
        return {}
    verification = Verification(exported, before, after)
    show_verification(terminal, verification)
    return {"export": export_summary(verification)}


def _ask(terminal: Terminal, *, moves: bool) -> None:
    """Raise RefusedError unless the user says yes."""
    from schwung.errors import RefusedError

    if not terminal.ask(f"Write these parameters{', and move the machine' if moves else ''}?"):
        raise RefusedError("export", "you said no", "Nothing was written, nothing moved.")


def _write_dcf(
    path: Path,
    family: str | None,
    node: int,
    table: InertiaTable,
    choice: ExportChoice,
    motor_inertia_kgm2: float | None,
    terminal: Terminal,
) -> None:
    from schwung.cli.console import describe_table
    from schwung.commissioning import export_values
    from schwung.errors import InputError
    from schwung.fieldbus.dcf import dictionary_lookup, write_dcf
    from schwung.fieldbus.profile import load_canopen_profile

    if family is None:
        raise InputError("--dcf", "needs to know the drive family", "Add --profile.")
    profile = load_canopen_profile(family)
    lookup = dictionary_lookup(profile.eds_path, node)
    values = export_values(lookup, profile, table, choice, motor_inertia_kgm2=motor_inertia_kgm2)
    write_dcf(profile.eds_path, node, values, path)
    terminal.say(describe_table(table))
    terminal.say(f"{len(values)} parameters in [bold]{path}[/]")
    terminal.result({"dcf": str(path), "parameters": len(values)})
