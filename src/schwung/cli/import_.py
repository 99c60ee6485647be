"""`schwung import`: recordings from elsewhere to a session."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from schwung.cli.options import Json

if TYPE_CHECKING:
    from schwung.api.recordings import Session

_COLUMNS, _UNITS, _TIME, _RUNS, _CAN, _GUESS = "Columns", "Units", "Time", "Runs", "CAN logs", "Looking first"

_COLUMN_KEYS = ("time", "position", "speed", "torque", "position_demand", "torque_added")


def import_(
    files: Annotated[
        list[Path] | None, typer.Argument(help="CSV, TwinCAT Scope, MAT, MDF, Parquet; CAN logs.")
    ] = None,
    out: Annotated[Path, typer.Option("-o", "--out", help="The session to write.")] = Path("session.h5"),
    recipe: Annotated[
        Path | None, typer.Option(metavar="TOML", help="Options from a file; those given here come first.")
    ] = None,
    time: Annotated[
        str | None,
        typer.Option(
            metavar="COLUMN",
            rich_help_panel=_COLUMNS,
            help="Time stamps; names, numbers from 0, data\\[:,2] or data(:,3).",
        ),
    ] = None,
    position: Annotated[
        str | None, typer.Option(metavar="COLUMN", rich_help_panel=_COLUMNS, help="Motor position.")
    ] = None,
    speed: Annotated[
        str | None,
        typer.Option(metavar="COLUMN", rich_help_panel=_COLUMNS, help="Motor speed; default: from position."),
    ] = None,
    torque: Annotated[
        str | None, typer.Option(metavar="COLUMN", rich_help_panel=_COLUMNS, help="Motor torque or force.")
    ] = None,
    position_demand: Annotated[
        str | None, typer.Option(metavar="COLUMN", rich_help_panel=_COLUMNS, help="Demanded position.")
    ] = None,
    torque_added: Annotated[
        str | None, typer.Option(metavar="COLUMN", rich_help_panel=_COLUMNS, help="Injected torque.")
    ] = None,
    axis: Annotated[
        str | None,
        typer.Option(rich_help_panel=_UNITS, help="rotary or linear; default: by --position-unit."),
    ] = None,
    time_unit: Annotated[
        str | None, typer.Option(metavar="UNIT", rich_help_panel=_UNITS, help="s, ms, us, ns.")
    ] = None,
    position_unit: Annotated[
        str | None,
        typer.Option(
            metavar="UNIT",
            rich_help_panel=_UNITS,
            help="rad, deg, rev, m, mm, um, counts=N per turn (or metre).",
        ),
    ] = None,
    speed_unit: Annotated[
        str | None,
        typer.Option(metavar="UNIT", rich_help_panel=_UNITS, help="rad/s, rpm, deg/s, rev/s, m/s, mm/s, …"),
    ] = None,
    torque_unit: Annotated[
        str | None,
        typer.Option(
            metavar="UNIT",
            rich_help_panel=_UNITS,
            help="N·m, mN·m, kN·m, N, kN, %=RATED, permille=RATED, A=N·m per ampere.",
        ),
    ] = None,
    position_scale: Annotated[
        str | None,
        typer.Option(metavar="FACTOR", rich_help_panel=_UNITS, help="Before the unit; -1 turns the sign."),
    ] = None,
    speed_scale: Annotated[
        str | None, typer.Option(metavar="FACTOR", rich_help_panel=_UNITS, help="Likewise.")
    ] = None,
    torque_scale: Annotated[
        str | None,
        typer.Option(metavar="FACTOR", rich_help_panel=_UNITS, help="Likewise, or a number in the MAT file."),
    ] = None,
    rate: Annotated[
        float | None,
        typer.Option(metavar="HZ", rich_help_panel=_TIME, help="Without --time, or to be resampled to."),
    ] = None,
    resample: Annotated[
        bool | None,
        typer.Option(
            "--resample/--no-resample",
            rich_help_panel=_TIME,
            help="Bring samples that are not uniform on a uniform time base.",
        ),
    ] = None,
    unwrap: Annotated[
        bool | None,
        typer.Option("--unwrap/--no-unwrap", rich_help_panel=_TIME, help="Undo jumps of a whole turn."),
    ] = None,
    split: Annotated[
        str | None,
        typer.Option(
            metavar="HOW",
            rich_help_panel=_RUNS,
            help="auto: motions between rests, there and back together, or cycles; rest; reverse; none; 6.24s.",
        ),
    ] = None,
    role: Annotated[
        str | None, typer.Option(rich_help_panel=_RUNS, help="reference or excited (with the injected sine).")
    ] = None,
    excitation: Annotated[
        str | None,
        typer.Option(
            metavar="HZ,N·m[,RAD]",
            rich_help_panel=_RUNS,
            help="The injected sine over the file's time: frequency, amplitude, phase.",
        ),
    ] = None,
    eds: Annotated[
        Path | None,
        typer.Option(
            metavar="EDS", rich_help_panel=_CAN, help="The drive's EDS, or DCF as it was configured."
        ),
    ] = None,
    node: Annotated[
        int | None,
        typer.Option(
            "-n", "--node", min=1, max=127, rich_help_panel=_CAN, help="Which drive, where there are several."
        ),
    ] = None,
    profile: Annotated[
        str | None,
        typer.Option(
            rich_help_panel=_CAN, help="Device profile that says the units; default: by identity in the log."
        ),
    ] = None,
    dbc: Annotated[
        Path | None,
        typer.Option(
            metavar="DBC", rich_help_panel=_CAN, help="Signals by a DBC instead; columns: Message.Signal."
        ),
    ] = None,
    channel: Annotated[
        str | None,
        typer.Option("-c", "--channel", rich_help_panel=_CAN, help="Which bus, where the log has several."),
    ] = None,
    guess: Annotated[
        bool,
        typer.Option(
            "--guess", rich_help_panel=_GUESS, help="Propose what is not given, and show why in a picture."
        ),
    ] = False,
    yes: Annotated[
        bool, typer.Option("-y", "--yes", rich_help_panel=_GUESS, help="Do what is guessed.")
    ] = False,
    joint: Annotated[
        str | None,
        typer.Option(
            metavar="NAME",
            rich_help_panel=_GUESS,
            help="With --guess, which axis of several. Else what stands for {joint} in columns' names: 1,2,3.",
        ),
    ] = None,
    picture: Annotated[
        Path | None,
        typer.Option(
            metavar="PNG", rich_help_panel=_GUESS, help="Draw what is imported, and what it must satisfy."
        ),
    ] = None,
    overwrite: Annotated[bool, typer.Option("--overwrite", help="Replace a session of that name.")] = False,
    json_output: Json = False,
) -> None:
    """Make a session of recordings from elsewhere: CSV, TwinCAT Scope, MATLAB, logs of a CAN bus.

    [bold]Examples[/]

      schwung import scope.csv --position Axis.ActPos --position-unit deg --torque Axis.ActTorque

      schwung import emps.mat --axis linear --time t --position qm --torque vir --torque-scale gtau

      schwung import candump.log --eds drive.eds

      schwung import robot.csv --guess

      schwung import robot.csv --position q{joint} --torque tau{joint} --joint 1,2

      schwung import --recipe emps.toml --out emps.h5
    """
    from schwung.api.recordings import (
        import_log,
        import_recordings,
        log_kind,
        make_recipe,
        read_recipe,
        write_session,
    )
    from schwung.cli.console import Terminal
    from schwung.cli.guess import guess as propose
    from schwung.cli.guess import picture_of
    from schwung.errors import InputError

    terminal = Terminal(json_output)
    options: dict[str, Any] = {
        "time": time, "position": position, "speed": speed, "torque": torque,
        "position_demand": position_demand, "torque_added": torque_added, "axis": axis, "time_unit": time_unit,
        "position_unit": position_unit, "speed_unit": speed_unit, "torque_unit": torque_unit,
        "position_scale": position_scale, "speed_scale": speed_scale, "torque_scale": torque_scale, "rate": rate,
        "resample": resample, "unwrap": unwrap, "split": split, "role": role,
        "excitation": _excitation(excitation), "dbc": None if dbc is None else str(dbc), "channel": channel,
    }  # fmt: skip
    given = {key: value for key, value in options.items() if value is not None}
    if eds is not None:
        logged = import_log(files or [], eds, node, profile, given)
        write_session(logged.session, out, overwrite)
        _show(terminal, logged.session, logged.notes, out)
        terminal.result(_document(logged.session, logged.notes, out))
        return
    for option, value in (("--node", node), ("--profile", profile)):
        if value is not None:
            raise InputError(
                option, "belongs to a CAN log with an EDS", "Add --eds DRIVE.eds, or leave it out."
            )
    kept = read_recipe(recipe) if recipe else {}
    files = files or [Path(name) for name in kept.get("files", ())]
    if "dbc" not in kept | given and (logs := [path for path in files if log_kind(path) is not None]):
        raise InputError(str(logs[0]), "is a log of a CAN bus", "Add --eds DRIVE.eds, or --dbc BUS.dbc.")
    place = str(recipe) if recipe else "schwung import"
    if guess:
        propose(terminal, files, kept | given, out, joint, yes=yes, overwrite=overwrite)
        return
    if joint is not None:
        for each in joint.split(","):
            own = _of_joint(kept | given, each.strip())
            target = out.with_name(f"{out.stem}-{each.strip()}{out.suffix}")
            made = import_recordings(files, make_recipe(own, place))
            write_session(made.session, target, overwrite)
            _show(terminal, made.session, made.notes, target)
        return
    wanted = make_recipe(kept | given, place)
    imported = import_recordings(files, wanted)
    if picture is not None:
        picture_of(files, kept | given, imported, picture)
        terminal.say(f"Picture: [bold]{picture}[/]")
    write_session(imported.session, out, overwrite)
    _show(terminal, imported.session, imported.notes, out)
    terminal.result(_document(imported.session, imported.notes, out))


def _of_joint(options: dict[str, Any], joint: str) -> dict[str, Any]:
    """Options with `{joint}` filled in. Raises InputError where no column's name has it."""
    from schwung.errors import InputError

    filled = {
        key: value.replace("{joint}", joint) if isinstance(value, str) and key in _COLUMN_KEYS else value
        for key, value in options.items()
    }
    if filled == options or not joint:
        raise InputError(
            "--joint", "stands for nothing", "Write --position 'q{joint}' --torque 'tau{joint}'."
        )
    return filled


def _excitation(text: str | None) -> dict[str, float] | None:
    """FREQUENCY,AMPLITUDE[,PHASE] as numbers. Raises InputError for anything else."""
    from schwung.errors import InputError

    if text is None:
        return None
    keys = ("frequency_hz", "amplitude_nm", "phase_rad")
    try:
        values = [float(part) for part in text.split(",")]
    except ValueError:
        values = []
    if len(values) not in (2, 3):
        raise InputError("--excitation", f'is "{text}"', "Write FREQUENCY,AMPLITUDE[,PHASE]: 50,20,0.")
    return dict(zip(keys, values, strict=False))


def _show(terminal: Any, session: Session, notes: tuple[str, ...], out: Path) -> None:
    from rich.markup import escape

    unit = "rad" if session.axis == "rotary" else "m"
    rows = [
        (str(k), str(run.extra["source_file"]), f"{run.extra['source_start_s']:.4g}",
         f"{len(run) / run.sample_rate_hz:.4g}", f"{run.sample_rate_hz:g}",
         f"{run.position_rad.min():.4g} … {run.position_rad.max():.4g}",
         f"{run.extra['same_motion']}", str(run.repeat))
        for k, run in enumerate(session.runs)
    ]  # fmt: skip
    columns = ("run", "file", "from s", "long s", "Hz", f"position {unit}", "motion", "repeat")
    terminal.table("Runs", columns, rows)
    for note in notes:
        terminal.say(f"[cyan]i[/] {escape(note)}")
    terminal.say(f"Session: [bold]{escape(str(out))}[/]")


def _document(session: Session, notes: tuple[str, ...], out: Path) -> dict[str, Any]:
    return {
        "session": str(out),
        "axis": session.axis,
        "source": session.source,
        "runs": [
            {
                "role": run.role,
                "repeat": run.repeat,
                "samples": len(run),
                "sample_rate_hz": run.sample_rate_hz,
            }
            | dict(run.extra)
            for run in session.runs
        ],
        "notes": list(notes),
    }
