"""`schwung export`: an inertia table into drive parameters, a CSV, JSON or DCF file."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from schwung.cli.options import (
    Bitrate,
    BusOption,
    Channel,
    Interface,
    Json,
    Node,
    Profile,
    Yes,
    bus_options,
)

if TYPE_CHECKING:
    from schwung.commissioning import ExportChoice
    from schwung.drivetrain import InertiaTable


def export(
    table: Annotated[Path, typer.Argument(help="The inertia table, inertia.csv.")],
    form: Annotated[
        str, typer.Option("--as", metavar="FORM", help="table, mean, max or at=ANGLE.")
    ] = "table",
    dcf: Annotated[
        Path | None,
        typer.Option(help="Write a DCF (CiA 306) for the profile's EDS instead of asking a drive."),
    ] = None,
    store: Annotated[bool, typer.Option(help="Save in the drive's memory (1010).")] = True,
    backup: Annotated[Path, typer.Option(help="Where the old values go.")] = Path("export.backup.json"),
    dry_run: Annotated[bool, typer.Option("--dry-run", help="Show what would be written.")] = False,
    yes: Yes = False,
    interface: Interface = None,
    channel: Channel = None,
    bitrate: Bitrate = None,
    bus: BusOption = None,
    node: Node = 1,
    profile: Profile = None,
    json_output: Json = False,
) -> None:
    """Write an inertia table into a drive: written, read back, compared, stored; the old values are backed up.

    [bold]Examples[/]

      schwung export inertia.csv -i socketcan -c can0 -n 3

      schwung export inertia.csv --as max -i socketcan -c can0 -n 3 --dry-run

      schwung export inertia.csv --profile schwung-bench -n 3 --dcf drive.dcf
    """
    from schwung.cli.console import Terminal
    from schwung.cli.drives import open_drive
    from schwung.commissioning import export_table, export_values, parse_choice
    from schwung.drivetrain import read_inertia_csv
    from schwung.errors import InputError, RefusedError

    terminal = Terminal(json_output)
    inertia, choice = read_inertia_csv(table), parse_choice(form)
    if dcf is not None:
        if profile is None:
            raise InputError("--dcf", "needs to know the drive family", "Add --profile.")
        written = _write_dcf(dcf, profile, node, inertia, choice)
        terminal.say(f"{written} parameters in [bold]{dcf}[/]")
        terminal.result({"dcf": str(dcf), "parameters": written})
        return
    with open_drive(bus_options(interface, channel, bitrate, bus), node, profile) as opened:
        values = export_values(opened.drive.parameter, opened.profile, inertia, choice)
        rows = [(v.parameter.label, opened.drive.read(v.parameter).raw, v.raw) for v in values]
        terminal.table("Parameters", ("object", "now", "new"), rows)
        document = {"parameters": [{"parameter": p, "old": o, "new": n} for p, o, n in rows]}
        if dry_run:
            terminal.say("Dry run: nothing was written.")
        elif yes or typer.confirm("Write these parameters?", err=json_output):
            done = export_table(
                opened.drive, opened.profile, inertia, choice, backup_path=backup, store=store
            )
            terminal.say(
                f"{len(done.changes)} parameters written, read back equal{', stored' if done.stored else ''}; "
                f"the old values are in [bold]{backup}[/]"
            )
        else:
            raise RefusedError("export", "you said no", "Nothing was written.")
    terminal.result(document)


def _write_dcf(path: Path, profile_name: str, node: int, inertia: InertiaTable, choice: ExportChoice) -> int:
    from schwung.commissioning import export_values
    from schwung.fieldbus.dcf import dictionary_lookup, write_dcf
    from schwung.fieldbus.profile import load_profile

    profile = load_profile(profile_name)
    values = export_values(dictionary_lookup(profile.eds_path, node), profile, inertia, choice)
    write_dcf(profile.eds_path, node, values, path)
    return len(values)
