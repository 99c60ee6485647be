"""`schwung optimise`: the best motion between two rests for the machine as measured."""

from __future__ import annotations

import math
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, Literal

import typer

from schwung.cli.options import (
    Bitrate,
    BusOption,
    CanLog,
    Channel,
    DryRun,
    FollowingError,
    Interface,
    Json,
    Machine,
    MaxPosition,
    MaxSpeed,
    MaxTorque,
    MinPosition,
    Node,
    Profile,
    Yes,
    connected,
    one_of,
    quantity,
)

if TYPE_CHECKING:
    from schwung.api.optimising import Objective

_MOTION, _PLAY = "Motion", "On the machine"
_GOALS = ("copper", "energy", "peak", "vibration")


def optimise(
    machine: Machine,
    distance: Annotated[
        float, quantity("angle", "RAD", "Stroke, signed; e.g. 180deg.", _MOTION, signed=True)
    ],
    duration: Annotated[
        float | None, quantity("time", "S", "Time of one stroke; e.g. 100ms.", _MOTION)
    ] = None,
    fastest: Annotated[
        bool, typer.Option("--fastest", help="As fast as the limits allow.", rich_help_panel=_MOTION)
    ] = False,
    start: Annotated[
        float,
        quantity(
            "angle", "RAD", "Where the motor stands at first (--play: as it stands).", _MOTION, signed=True
        ),
    ] = 0.0,
    objective: Annotated[
        str,
        typer.Option(
            help="copper (RMS torque), energy (drawn), peak (torque), vibration (rate of wind-up), or weights of "
            "them: copper=1,peak=0.5; each counts in shares of what the fifth-order polynomial has.",
            rich_help_panel=_MOTION,
        ),
    ] = "copper",
    regeneration: Annotated[
        bool, typer.Option(help="Whether braking gives energy back.", rich_help_panel=_MOTION)
    ] = True,
    payload: Annotated[
        list[float] | None,
        typer.Option(
            metavar="KG·M²",
            help="A further load inertia, with which all limits hold, too; repeatable.",
            rich_help_panel=_MOTION,
        ),
    ] = None,
    robust: Annotated[
        bool,
        typer.Option("--robust", help="The same over the table's band of ±2 σ.", rich_help_panel=_MOTION),
    ] = False,
    min_position: MinPosition = None,
    max_position: MaxPosition = None,
    max_speed: MaxSpeed = None,
    max_torque: MaxTorque = None,
    max_jerk: Annotated[
        float | None,
        typer.Option(metavar="RAD/S³", help="Jerk limit of motor and load.", rich_help_panel="Limits"),
    ] = None,
    following_error: FollowingError = None,
    rate: Annotated[float, quantity("frequency", "HZ", "Setpoints per second in setpoints.csv.")] = 1000.0,
    rivals: Annotated[
        bool, typer.Option(help="Run the genetic algorithm and TOPP-RA beside the standard profiles.")
    ] = True,
    front: Annotated[
        bool,
        typer.Option(
            "--front", help="The Pareto front, too: over time with --fastest, else between two objectives."
        ),
    ] = False,
    out: Annotated[Path, typer.Option(help="Folder for motion, tables, cams and pictures.")] = Path(
        "optimised"
    ),
    play: Annotated[
        bool,
        typer.Option(
            "--play", help="Make it on the machine, beside a reference motion.", rich_help_panel=_PLAY
        ),
    ] = False,
    against: Annotated[
        str,
        typer.Option(
            help="Reference motion: third, poly5, scurve, cosine or cycloid.", rich_help_panel=_PLAY
        ),
    ] = "third",
    repeats: Annotated[
        int, typer.Option(min=1, help="How often both motions are made, in turn.", rich_help_panel=_PLAY)
    ] = 3,
    dry_run: DryRun = False,
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
    """Find the motion that costs the least, within every limit, of motor and load.

    Takes the measured table and the learned physics of the machine file, names what of it no plan can have, and holds
    the result against the profiles that machines usually get. What it writes can be taken to the controller: setpoints
    with torque, and cams.

    [bold]Examples[/]

      schwung optimise -m measured.toml --distance 180deg --duration 100ms

      schwung optimise -m measured.toml --distance 180deg --fastest --max-speed 60 --json

      schwung optimise -m measured.toml --distance 180deg --duration 200ms --objective energy --no-regeneration

      schwung optimise -m measured.toml --distance 180deg --duration 250ms --play -i socketcan -c can0 -n 3
    """
    from schwung import LimitWishes, load_machine
    from schwung.api.folders import make_folder, planned_folder
    from schwung.api.optimising import (
        MotionLimits,
        Playing,
        Task,
        require_optimiser,
        write_front,
        write_optimised,
    )
    from schwung.api.optimising import optimise as optimise_task
    from schwung.cli.console import Terminal
    from schwung.cli.optimised import tell
    from schwung.cli.playing import play_and_show
    from schwung.errors import InputError
    from schwung.files import json_text, replace_file

    if (duration is None) == (not fastest):
        raise InputError("--duration", "is given beside --fastest, or neither is", "Give one of the two.")
    require_optimiser()
    terminal = Terminal(json_output)
    believed = load_machine(machine)
    task = Task(
        start_rad=start,
        distance_rad=distance,
        limits=MotionLimits(
            torque_max_nm=max_torque or believed.motor.peak_torque_nm,
            position_min_rad=min_position,
            position_max_rad=max_position,
            speed_max_rad_s=max_speed,
            jerk_max_rad_s3=max_jerk,
            following_error_rad=following_error,
        ),
        duration_s=duration,
        weights=weights_of(objective),
        regeneration=regeneration,
        payloads_kgm2=(0.0, *(payload or ())),
        band_sigmas=2.0 if robust else 0.0,
    )
    folder = planned_folder(out, beside_session=True)
    if play:
        if (folder / "played.h5").exists():
            raise InputError(str(folder), "holds played motions already", "Choose another --out.")
        wishes = LimitWishes(min_position, max_position, max_speed, max_torque, following_error)
        reference: Any = one_of(
            "--against", against, Literal["third", "poly5", "scurve", "cosine", "cycloid"]
        )
        playing = Playing(reference, repeats, rate, rivals)
        with connected(interface, channel, bitrate, bus, node, profile, can_log) as connection:
            result = play_and_show(
                connection, believed, task, wishes, playing, folder, terminal,
                confirm=lambda question: yes or terminal.ask(question), dry_run=dry_run,
            )  # fmt: skip
        terminal.result(result)
        return
    found = optimise_task(believed, task, rivals=rivals)
    make_folder(folder)
    tell(terminal, found)
    document = found.to_json()
    files = write_optimised(found, folder, rate, document)
    if front:
        document["front"], drawn = write_front(folder, believed, task)
        files += drawn
    document |= {"files": {path.name: str(path) for path in files}}
    replace_file(folder / "optimised.json", json_text(document))
    terminal.say(f"Motion, tables, cams and pictures: [bold]{folder}[/]")
    terminal.result(document)


def weights_of(text: str) -> dict[Objective, float]:
    """A name, or weights of several: copper=1,peak=0.5. Raises InputError for anything else."""
    from schwung.errors import InputError

    weights: dict[Any, float] = {}
    for part in text.split(","):
        name, _, number = part.strip().partition("=")
        try:
            weight = float(number) if number else 1.0
        except ValueError:
            weight = math.nan
        if name not in _GOALS or not (math.isfinite(weight) and weight >= 0):
            raise InputError(
                "--objective",
                f'is "{text}"',
                f"Use {', '.join(_GOALS)}, or weights of them: copper=1,peak=0.5.",
            )
        weights[name] = weight
    return weights
