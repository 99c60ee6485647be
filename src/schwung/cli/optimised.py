"""What `schwung optimise` found, as people read it and for machines; pictures and files of it."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from schwung.cli.console import Terminal
    from schwung.drivetrain import Machine
    from schwung.optimise.comparison import Comparison, Contender
    from schwung.optimise.values import Task


def tell(terminal: Terminal, believed: Machine, found: Comparison) -> None:
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


def summary(believed: Machine, found: Comparison) -> dict[str, Any]:
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
    folder: Path, believed: Machine, found: Comparison, rate: float, document: dict[str, Any]
) -> list[Path]:
    """Formats and pictures."""
    import numpy as np

    from schwung.files import replace_file
    from schwung.optimise.formats import write_all
    from schwung.report.optimised import angle_figure, motion_figure, shown_of
    from schwung.report.style import to_png

    paths = write_all(folder, believed.name, found.stroke, found.back, rate, {"result": document})
    shown = [shown_of(c.name, c.followed) for c in (found.ours, found.reference)]
    angle = np.linspace(min(found.task.ends_rad), max(found.task.ends_rad), 400)
    figures = {
        "motion.png": motion_figure(shown[0], shown[1], found.task.limits.torque_max_nm),
        "angle.png": angle_figure(shown[0], shown[1], angle, believed.load_inertia_at(angle)),
    }
    for name, figure in figures.items():
        replace_file(folder / name, to_png(figure))
    return [*paths, *(folder / name for name in figures)]


def write_front(folder: Path, believed: Machine, task: Task) -> tuple[list[dict[str, Any]], list[Path]]:
    """The Pareto front of a task: for machines, and its picture and table in a folder that is there."""
    from schwung.files import replace_file
    from schwung.optimise.front import front
    from schwung.report.optimised import front_figure
    from schwung.report.style import to_png

    points = front(believed, task)
    rows: list[dict[str, Any]] = [
        {"duration_s": p.duration_s, "weights": dict(p.weights), **p.merits.to_json()} for p in points
    ]
    names = [name for name in rows[0] if name != "weights" and rows[0][name] is not None]
    lines = [",".join(names), *(",".join(f"{row[name]:.9g}" for name in names) for row in rows)]
    replace_file(folder / "front.csv", "\n".join(lines) + "\n")
    over_time = task.duration_s is None
    x = [row["duration_s"] * 1e3 if over_time else row["copper_n2m2s"] for row in rows]
    names_of = ("time of the stroke (ms)" if over_time else "copper loss (N²m²s)", "copper loss (N²m²s)")
    second = "copper_n2m2s" if over_time else "peak_torque_nm"
    if not over_time:
        chosen = next((name for name in task.weights if name != "copper"), "peak")
        second = {"energy": "drawn_j", "peak": "peak_torque_nm", "vibration": "residual_rad"}[chosen]
        words = {
            "drawn_j": "drawn (J)",
            "peak_torque_nm": "peak torque (N·m)",
            "residual_rad": "residual (rad)",
        }
        names_of = (names_of[0], words[second])
    figure = front_figure(x, [row[second] for row in rows], *names_of)
    replace_file(folder / "front.png", to_png(figure))
    return rows, [folder / "front.csv", folder / "front.png"]
