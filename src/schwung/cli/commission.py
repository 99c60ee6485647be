"""`schwung commission`: plan, preflight, ask, move, estimate, report, and where wanted export."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from schwung.cli.options import (
    Bitrate,
    BusOption,
    Channel,
    Interface,
    Json,
    Machine,
    Node,
    Profile,
    Reference,
    Yes,
    bus_options,
    export_choice,
    measured,
)

_MOTION, _LIMITS, _INJECTION = "Motion", "Limits", "Injection and recording"


def commission(
    machine: Machine,
    distance: Annotated[
        float,
        typer.Option(
            parser=measured("angle", signed=True),
            metavar="RAD",
            help="Stroke, signed; e.g. 180deg.",
            rich_help_panel=_MOTION,
        ),
    ],
    duration: Annotated[
        float,
        typer.Option(
            parser=measured("time"),
            metavar="S",
            help="Time of one stroke; e.g. 250ms.",
            rich_help_panel=_MOTION,
        ),
    ],
    profile_kind: Annotated[
        str, typer.Option(help="third, poly5, scurve or cosine.", rich_help_panel=_MOTION)
    ] = "third",
    one_way: Annotated[
        bool, typer.Option("--one-way", help="Do not move back after the stroke.", rich_help_panel=_MOTION)
    ] = False,
    mode: Annotated[
        str,
        typer.Option(
            help="csp: setpoints over the bus; pp: the drive's own profile.", rich_help_panel=_MOTION
        ),
    ] = "csp",
    min_position: Annotated[
        float | None,
        typer.Option(
            parser=measured("angle", signed=True),
            metavar="RAD",
            help="Lower end of the window.",
            rich_help_panel=_LIMITS,
        ),
    ] = None,
    max_position: Annotated[
        float | None,
        typer.Option(
            parser=measured("angle", signed=True),
            metavar="RAD",
            help="Upper end of the window.",
            rich_help_panel=_LIMITS,
        ),
    ] = None,
    max_speed: Annotated[
        float | None,
        typer.Option(parser=measured("speed"), metavar="RAD/S", help="Speed limit.", rich_help_panel=_LIMITS),
    ] = None,
    max_torque: Annotated[
        float | None,
        typer.Option(parser=measured("torque"), metavar="NM", help="Torque limit.", rich_help_panel=_LIMITS),
    ] = None,
    following_error: Annotated[
        float | None,
        typer.Option(
            parser=measured("angle"),
            metavar="RAD",
            help="Tolerated following error.",
            rich_help_panel=_LIMITS,
        ),
    ] = None,
    frequency: Annotated[
        float | None,
        typer.Option(
            parser=measured("frequency"), metavar="HZ", help="Injected frequency.", rich_help_panel=_INJECTION
        ),
    ] = None,
    amplitude: Annotated[
        float | None,
        typer.Option(
            parser=measured("torque"), metavar="NM", help="Injected amplitude.", rich_help_panel=_INJECTION
        ),
    ] = None,
    rate: Annotated[
        float,
        typer.Option(
            parser=measured("frequency"), metavar="HZ", help="SYNC rate.", rich_help_panel=_INJECTION
        ),
    ] = 1000.0,
    repeats: Annotated[
        int, typer.Option(min=1, help="How often everything is made.", rich_help_panel=_INJECTION)
    ] = 2,
    phases: Annotated[
        int,
        typer.Option(
            help="1: each excited motion beside one without injection; 4: four excited motions, the injection "
            "shifted by a quarter period each: several times more accurate, and for faster motions.",
            rich_help_panel=_INJECTION,
        ),
    ] = 1,
    max_jitter: Annotated[
        float | None,
        typer.Option(
            parser=measured("time"),
            metavar="S",
            help="Tolerated SYNC jitter (p99); default: a tenth of the period.",
            rich_help_panel=_INJECTION,
        ),
    ] = None,
    export: Annotated[
        str | None,
        typer.Option(
            metavar="FORM",
            help="Write the result into the drive, unless unusable: table, mean, max or at=ANGLE.",
        ),
    ] = None,
    store: Annotated[bool, typer.Option(help="Save an export in the drive's memory (1010).")] = True,
    reference: Reference = None,
    out: Annotated[
        Path | None, typer.Option(help="Folder for session, table, report; default: schwung-<time>.")
    ] = None,
    dry_run: Annotated[
        bool, typer.Option("--dry-run", help="Plan and check; change and move nothing.")
    ] = False,
    yes: Yes = False,
    interface: Interface = None,
    channel: Channel = None,
    bitrate: Bitrate = None,
    bus: BusOption = None,
    node: Node = 1,
    profile: Profile = None,
    json_output: Json = False,
) -> None:
    """Measure the load inertia over angle on the running machine.

    Moves from where the axis stands, first without and then with an injected torque. Nothing moves before the
    motion was simulated within all limits and you said yes.

    [bold]Examples[/]

      schwung commission -m machine.toml --distance 180deg --duration 250ms -i socketcan -c can0 -n 3 --dry-run

      schwung commission -m machine.toml --distance 180deg --duration 250ms -i socketcan -c can0 -n 3 --export table

      schwung commission -m machine.toml --distance 1.2 --duration 0.4 --min-position -0.1 --max-position 1.4 -y
    """  # fmt: skip
    from schwung.cli.console import Terminal
    from schwung.cli.drives import open_drive
    from schwung.cli.flow import Ending, commission_and_show, finish
    from schwung.cli.folders import planned_folder
    from schwung.cli.sessions import standard_of
    from schwung.commissioning import LimitWishes, Wishes
    from schwung.commissioning.procedure import MAX_JITTER_SHARE
    from schwung.drivetrain import load_machine
    from schwung.errors import InputError

    terminal = Terminal(json_output)
    believed = load_machine(machine)
    choice = export_choice(export) if export else None
    if mode not in ("csp", "pp"):
        raise InputError("--mode", f'is "{mode}"', "Use csp or pp.")
    wishes = Wishes(
        distance_rad=distance,
        duration_s=duration,
        limits=LimitWishes(min_position, max_position, max_speed, max_torque, following_error),
        kind=profile_kind,
        returns=not one_way,
        mode="pp" if mode == "pp" else "csp",
        sample_rate_hz=rate,
        frequency_hz=frequency,
        amplitude_nm=amplitude,
        repeats=repeats,
        phases=phases,
        max_jitter_share=MAX_JITTER_SHARE if max_jitter is None else max_jitter * rate,
    )
    standard = standard_of(believed, reference)
    ending = Ending(choice, store, standard.table, standard.label)
    options = bus_options(interface, channel, bitrate, bus)
    folder = planned_folder(out)
    with open_drive(options, node, profile) as opened:
        result = commission_and_show(
            opened.drive, opened.profile, believed, wishes, folder, terminal,
            confirm=lambda question: yes or terminal.ask(question),
            ending=ending, dry_run=dry_run,
        )  # fmt: skip
    finish(terminal, result)
