"""The best motion between two rests: found, held against its rivals, written down, and played on the machine."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from schwung import drivetrain
from schwung.api.drives import Connection
from schwung.api.folders import make_folder
from schwung.api.moving import Confirm, Silent, ask
from schwung.api.shown import Shown, number
from schwung.api.values import Machine, machine_shown
from schwung.commissioning import LimitWishes, Observer
from schwung.commissioning.checks import COMFORT, Check
from schwung.commissioning.played import Cost, Interval, Played, cost_of_run, cost_of_simulated, interval
from schwung.commissioning.playing import PlayPrepared, prepare_play, stand_of
from schwung.commissioning.playing import play as play_motions
from schwung.errors import RefusedError
from schwung.extras import require
from schwung.files import replace_file
from schwung.motion import Motion, MotionKind
from schwung.optimise.values import MotionLimits, Objective, Task
from schwung.session import Run

if TYPE_CHECKING:
    from matplotlib.axes import Axes

    from schwung.optimise.comparison import Comparison, Contender
    from schwung.optimise.values import Stroke

__all__ = [
    "Contender",
    "Cost",
    "Interval",
    "MotionLimits",
    "Objective",
    "Optimised",
    "PlannedPlay",
    "Played",
    "PlayedMotions",
    "Playing",
    "Task",
    "interval",
    "optimise",
    "plan_play",
    "play",
    "require_optimiser",
    "standard_names",
    "write_front",
    "write_optimised",
    "write_played",
]


@dataclass(frozen=True, eq=False)
class Optimised(Shown):
    """The best motion of a task, there and back, beside its rivals.

    Attributes: `stroke` and `back` (at the nodes of an even grid, arrays (n,): shares of stroke and time, `torque_nm`
    in N·m; `motion(back)` makes the motion to play), `ours` and `rivals` (time in s, torque in N·m, losses in N²m²s and
    J), `reference` (the 1/3 trapezoid), `left_out` (physics that was not planned with), `task`, `machine`.

    Raises what `optimise` does.

    >>> best.copper_saving > 0.1
    True
    """

    machine: Machine
    task: Task
    stroke: Stroke
    back: Stroke
    ours: Contender
    rivals: tuple[Contender, ...]
    left_out: tuple[str, ...]

    @property
    def reference(self) -> Contender:
        """The 1/3 trapezoid, which machines are commissioned with."""
        return self.rivals[0]

    @property
    def copper_saving(self) -> float:
        """Share of the copper loss that is saved against the 1/3 trapezoid in the same time."""
        return float(1 - self.ours.merits.copper_n2m2s / self.reference.merits.copper_n2m2s)

    def to_json(self) -> dict[str, Any]:
        """The comparison, JSON-ready."""
        task = self.task
        return {
            "machine": self.machine.name,
            "distance_rad": task.distance_rad,
            "duration_s": self.stroke.duration_s,
            "weights": dict(task.weights) if task.duration_s is not None else {"fastest": 1.0},
            "active_limits": dict(self.stroke.active),
            "not_planned_with": list(self.left_out),
            "copper_saving": self.copper_saving,
            "motions": [
                {"name": c.name, "duration_s": c.duration_s, "breaks": list(c.broken), **c.merits.to_json()}
                for c in (self.ours, *self.rivals)
            ],
        }

    def _facts(self) -> Sequence[tuple[str, str]]:
        merits = self.ours.merits
        return [
            ("motion", f"{self.task.distance_rad:.4g} rad in {self.stroke.duration_s * 1e3:.4g} ms"),
            ("torque", f"RMS {number(merits.rms_torque_nm)}, peak {number(merits.peak_torque_nm, 'N·m')}"),
            ("copper loss", f"{self.copper_saving:.1%} below the 1/3 trapezoid's"),
            *((("not planned with", ", ".join(self.left_out)),) if self.left_out else ()),
        ]

    def _draw(self, axes: Axes) -> None:
        from schwung.report.axes import draw_torques
        from schwung.report.optimised import shown_of

        shown = [shown_of(c.name, c.followed) for c in (self.ours, self.reference)]
        curves = tuple((s.name, s.time_s, s.torque_nm) for s in shown)
        draw_torques(axes, curves, self.task.limits.torque_max_nm)

    def _columns(self) -> Mapping[str, Any]:
        rows = self.to_json()["motions"]
        return {name: [row[name] for row in rows] for name in rows[0] if name != "breaks"}


def _optimised(machine: drivetrain.Machine, found: Comparison) -> Optimised:
    return Optimised(
        machine_shown(machine), found.task, found.stroke, found.back, found.ours, found.rivals, found.left_out
    )


def require_optimiser() -> None:
    """Raise InputError where the extra is not installed: early, before anything is planned or moved."""
    require("schwung optimise", "optimise")


def optimise(machine: drivetrain.Machine, task: Task, *, rivals: bool = True) -> Optimised:
    """Find the motion between two rests that costs the least, within every limit, of motor and load.

    Args:
        machine: the belief, as a rule measured: table, limits and learned physics take part, what of it no plan can
            have is in `left_out`; SI.
        task: stroke (rad), time (s; None: as fast as the limits allow), limits (rad, rad/s, N·m) and weights.
        rivals: also run the genetic algorithm and TOPP-RA beside the standard profiles.

    Returns the motion at even nodes, arrays (n,), and what it and its rivals cost.
    Raises InputError where the extra is not installed, or no motion keeps the limits, and says which.

    >>> task = schwung.Task(0.0, 3.14, schwung.MotionLimits(torque_max_nm=233.0), duration_s=0.25)
    >>> schwung.optimise(done.machine, task, rivals=False).stroke.duration_s
    0.25
    """
    require_optimiser()
    from schwung.optimise.comparison import optimise as optimise_task

    return _optimised(machine, optimise_task(machine, task, rivals))


def standard_names() -> Mapping[str, str]:
    """The standard profiles, by the names of `Motion.kind`."""
    from schwung.optimise.comparison import STANDARD

    return STANDARD


def write_optimised(
    found: Optimised, folder: Path, sample_rate_hz: float, document: Mapping[str, Any] | None = None
) -> list[Path]:
    """Setpoints, cams, the motion and pictures in a folder that is there. Raises InputError where it cannot write."""
    from schwung.optimise.formats import write_all
    from schwung.report.optimised import angle_figure, motion_figure, shown_of
    from schwung.report.style import to_png

    result = {"result": found.to_json() if document is None else dict(document)}
    paths = write_all(folder, found.machine.name, found.stroke, found.back, sample_rate_hz, result)
    shown = [shown_of(c.name, c.followed) for c in (found.ours, found.reference)]
    angle = np.linspace(min(found.task.ends_rad), max(found.task.ends_rad), 400)
    figures = {
        "motion.png": motion_figure(shown[0], shown[1], found.task.limits.torque_max_nm),
        "angle.png": angle_figure(shown[0], shown[1], angle, found.machine.load_inertia_at(angle)),
    }
    for name, figure in figures.items():
        replace_file(folder / name, to_png(figure))
    return [*paths, *(folder / name for name in figures)]


def write_front(
    folder: Path, machine: drivetrain.Machine, task: Task
) -> tuple[list[dict[str, Any]], list[Path]]:
    """The Pareto front of a task: for machines, and its picture and table in a folder that is there."""
    from schwung.optimise.front import front
    from schwung.report.optimised import front_figure
    from schwung.report.style import to_png

    points = front(machine, task)
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


@dataclass(frozen=True)
class Playing:
    """How the motion shall be played."""

    against: MotionKind = "third"  # kind of the reference motion
    repeats: int = 3
    sample_rate_hz: float = 1000.0
    rivals: bool = True


@dataclass(frozen=True, eq=False)
class PlannedPlay:
    """The motion found from where the axis stands, the reference beside it, and the checks of both."""

    found: Optimised
    reference_duration_s: float
    playing: Playing
    prepared: PlayPrepared

    @property
    def checks(self) -> tuple[Check, ...]:
        """What preflight found."""
        return self.prepared.preflight.checks

    def to_json(self) -> dict[str, Any]:
        """The comparison and the checks, JSON-ready."""
        checks = [vars(check) for check in self.checks]
        return self.found.to_json() | {
            "reference_duration_s": self.reference_duration_s, "preflight": checks,
        }  # fmt: skip


@dataclass(frozen=True, eq=False)
class PlayedMotions:
    """What both motions cost as measured and as predicted, and their recordings in turn."""

    costs: Played
    runs: tuple[Run, ...]


def plan_play(
    connection: Connection,
    machine: drivetrain.Machine,
    task: Task,
    limits: LimitWishes,
    playing: Playing,
) -> PlannedPlay:
    """Find the motion from where the axis stands, within the drive's limits, and check it. Changes and moves nothing.

    Raises InputError as `optimise`, where limits are missing, or the drive adds a torque of its own already.
    """
    require_optimiser()
    from schwung.optimise.comparison import optimise as optimise_task
    from schwung.optimise.comparison import shortest_profile
    from schwung.optimise.formats import cycle_torque

    drive, profile = connection.drive, connection.profile
    stand = stand_of(drive, profile, machine, limits)
    within = replace(
        task.limits,
        torque_max_nm=COMFORT * stand.limits.torque_max_nm,  # the controller wants some, too
        position_min_rad=stand.limits.position_min_rad,
        position_max_rad=stand.limits.position_max_rad,
        speed_max_rad_s=COMFORT * stand.limits.speed_max_rad_s,
    )
    wanted = replace(task, start_rad=stand.start_rad, limits=within)
    found = _optimised(machine, optimise_task(machine, wanted, playing.rivals))
    stroke, back = found.stroke, found.back
    duration = stroke.duration_s
    if task.duration_s is None:
        duration = shortest_profile(machine, wanted, playing.against)
    prepared = prepare_play(
        drive,
        profile,
        stand,
        Motion(kind=playing.against, distance_rad=stroke.distance_rad, duration_s=duration),
        stroke.motion(back),
        lambda motion, time: cycle_torque(stroke, back, motion, time) - stroke.hold_start_nm,
        repeats=playing.repeats,
        sample_rate_hz=playing.sample_rate_hz,
    )
    return PlannedPlay(found, duration, playing, prepared)


def play(
    connection: Connection,
    planned: PlannedPlay,
    out: Path,
    *,
    confirm: Confirm = ask,
    observer: Observer | None = None,
) -> PlayedMotions:
    """Make both motions on the machine in turn, the reference first; what is recorded lies in `out/played.h5`.

    Raises RefusedError where a check says stop, the axis has been moved since, or the answer is no; else what
    `commission` does.
    """
    prepared = planned.prepared
    prepared.preflight.require()
    if not confirm("The machine will move. Is it clear?"):
        raise RefusedError("optimise --play", "you said no", "Nothing was changed, nothing moved.")
    stands = connection.drive.state().position_rad
    if abs(stands - prepared.plan.start_position_rad) > prepared.plan.limits.following_error_rad:
        raise RefusedError("plan", f"the axis stands at {stands:.4g} rad now", "Plan anew, and look at that.")
    make_folder(out)
    recorded = play_motions(connection.drive, prepared, out, observer or Silent())
    plan, machine = prepared.plan, planned.found.machine
    assert plan.optimised is not None
    before, after = prepared.predicted
    costs = Played(
        reference=tuple(cost_of_run(run, machine) for run in recorded.runs[0::2]),
        optimised=tuple(cost_of_run(run, machine) for run in recorded.runs[1::2]),
        predicted_reference=cost_of_simulated(before, plan.motion, machine),
        predicted_optimised=cost_of_simulated(after, plan.optimised, machine),
    )
    return PlayedMotions(costs, tuple(recorded.runs))


def write_played(planned: PlannedPlay, played: PlayedMotions, folder: Path) -> list[Path]:
    """Pictures of both motions as recorded, with what was predicted, over time and over the angle."""
    from schwung.report.optimised import Shown as Curves
    from schwung.report.optimised import played_angle_figure, played_figure
    from schwung.report.style import to_png

    pairs = []
    names = (f"{standard_names()[planned.playing.against]}, measured", "optimised, measured")
    for name, run, simulated in zip(names, played.runs[:2], planned.prepared.predicted, strict=True):
        motion = run.motion
        assert motion is not None
        begin, end = motion.start_time_s - 0.02, motion.start_time_s + motion.duration_s + motion.dwell_s
        pair = []
        for made in (run, simulated):
            shown = (made.time_s >= begin) & (made.time_s <= end)
            time = made.time_s[shown] - motion.start_time_s
            pair.append(
                Curves(name, time, made.position_rad[shown], made.speed_rad_s[shown], made.torque_nm[shown])
            )
        pairs.append((pair[0], pair[1]))
    figures = {"played.png": played_figure(pairs), "played-angle.png": played_angle_figure(pairs)}
    for name, figure in figures.items():
        replace_file(folder / name, to_png(figure))
    return [folder / name for name in figures]
