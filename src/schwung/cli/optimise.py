"""`schwung optimise`: the best motion between two rests for the machine as measured."""

from __future__ import annotations

import math
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from schwung.cli.options import (
    FollowingError,
    Json,
    Machine,
    MaxPosition,
    MaxSpeed,
    MaxTorque,
    MinPosition,
    quantity,
)

if TYPE_CHECKING:
    from schwung.cli.console import Terminal
    from schwung.drivetrain import Machine as Believed
    from schwung.optimise.comparison import Comparison, Contender
    from schwung.optimise.values import Objective

_MOTION = "Motion"
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
        float, quantity("angle", "RAD", "Where the motor stands at first.", _MOTION, signed=True)
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
    out: Annotated[Path, typer.Option(help="Folder for motion, tables, cams and pictures.")] = Path(
        "optimised"
    ),
    json_output: Json = False,
) -> None:
    """Find the motion that costs the least, within every limit, of motor and load.

    Takes the measured table and every [[physics]] of the machine file, and holds the result against the profiles that
    machines usually get. What it writes can be taken to the controller: setpoints with torque, and cams.

    [bold]Examples[/]

      schwung optimise -m measured.toml --distance 180deg --duration 100ms

      schwung optimise -m measured.toml --distance 180deg --fastest --max-speed 60 --json

      schwung optimise -m measured.toml --distance 180deg --duration 200ms --objective energy --no-regeneration
    """
    from schwung.cli.console import Terminal, json_text
    from schwung.cli.folders import make_folder, planned_folder
    from schwung.drivetrain import load_machine
    from schwung.errors import InputError
    from schwung.files import replace_file
    from schwung.optimise.values import MotionLimits, Task

    if (duration is None) == (not fastest):
        raise InputError("--duration", "is given beside --fastest, or neither is", "Give one of the two.")
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
    found = solve(believed, task, rivals)
    make_folder(folder)
    tell(terminal, believed, found)
    document = summary(believed, found)
    files = write_result(folder, believed, found, rate, document)
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


def solve(believed: Believed, task: Any, rivals: bool) -> Comparison:
    """The comparison. Raises InputError where the extra is not installed."""
    from schwung.errors import InputError

    try:
        from schwung.optimise.comparison import optimise as optimise_task
    except ImportError as error:
        raise InputError(
            "schwung optimise", f"needs CasADi ({error})", 'Install it: pip install "schwung[optimise]".'
        ) from None
    return optimise_task(believed, task, rivals)


def tell(terminal: Terminal, believed: Believed, found: Comparison) -> None:
    """The comparison as people read it."""
    electrical = believed.motor.electrical is not None
    head = ["", "ms", "RMS N·m", "peak N·m", "copper", "residual mrad", "breaks"]
    if electrical:
        head.insert(5, "drawn J")
    base = found.reference.merits.copper_n2m2s

    def row(contender: Contender) -> list[str]:
        merits = contender.merits
        cells = [
            contender.name,
            f"{contender.duration_s * 1e3:.1f}",
            f"{merits.rms_torque_nm:.2f}",
            f"{merits.peak_torque_nm:.1f}",
            f"{merits.copper_n2m2s / base:.1%}",
            f"{merits.residual_rad * 1e3:.4f}",
            ", ".join(contender.broken),
        ]
        if merits.drawn_j is not None and merits.drawn_one_way_j is not None:
            drawn = merits.drawn_j if found.task.regeneration else merits.drawn_one_way_j
            cells.insert(5, f"{drawn:.2f}")
        return cells

    terminal.table("Motions, each in its own time", head, [row(c) for c in (found.ours, *found.rivals)])
    saved = 1 - found.ours.merits.copper_n2m2s / base
    terminal.say(
        f"Copper loss [bold]{saved:.1%}[/] below the 1/3 trapezoid's in the same time; "
        f"found in {found.stroke.iterations} iterations"
    )
    if found.left_out:
        terminal.say(f"[yellow]Not planned with:[/] {', '.join(found.left_out)}")


def summary(believed: Believed, found: Comparison) -> dict[str, Any]:
    """The comparison for machines."""
    task = found.task
    return {
        "machine": believed.name,
        "distance_rad": task.distance_rad,
        "duration_s": found.stroke.duration_s,
        "weights": dict(task.weights) if task.duration_s is not None else {"fastest": 1.0},
        "active_limits": dict(found.stroke.active),
        "not_planned_with": list(found.left_out),
        "copper_saving": 1 - found.ours.merits.copper_n2m2s / found.reference.merits.copper_n2m2s,
        "motions": [
            {"name": c.name, "duration_s": c.duration_s, "breaks": list(c.broken), **c.merits.to_json()}
            for c in (found.ours, *found.rivals)
        ],
    }


def write_result(
    folder: Path, believed: Believed, found: Comparison, rate: float, document: dict[str, Any]
) -> list[Path]:
    """Formats and pictures."""
    import numpy as np

    from schwung.files import replace_file
    from schwung.optimise.formats import write_all
    from schwung.report.optimised import Shown, angle_figure, motion_figure
    from schwung.report.style import to_png

    paths = write_all(folder, believed.name, found.stroke, found.back, rate, {"result": document})
    shown = []
    for contender in (found.ours, found.reference):
        f = contender.followed
        until = f.time_s <= 1.3 * f.duration_s
        shown.append(
            Shown(
                contender.name,
                f.time_s[until],
                f.position_rad[until],
                f.speed_rad_s[until],
                f.torque_nm[until],
            )
        )
    angle = np.linspace(min(found.task.ends_rad), max(found.task.ends_rad), 400)
    figures = {
        "motion.png": motion_figure(shown[0], shown[1], found.task.limits.torque_max_nm),
        "angle.png": angle_figure(shown[0], shown[1], angle, believed.load_inertia_at(angle)),
    }
    for name, figure in figures.items():
        replace_file(folder / name, to_png(figure))
    return [*paths, *(folder / name for name in figures)]
