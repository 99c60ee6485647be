"""`schwung optimise --play`: the motion found is made on the machine, and held against what was promised."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from schwung.cli.console import Terminal
    from schwung.commissioning import LimitWishes
    from schwung.commissioning.played import Cost, Interval, Played
    from schwung.commissioning.playing import PlayPrepared
    from schwung.drivetrain import Machine
    from schwung.fieldbus.drive import Drive
    from schwung.fieldbus.profile import DeviceProfile
    from schwung.motion import MotionKind
    from schwung.optimise.values import Task
    from schwung.session import Run

#: What is told of a motion: words, unit, factor to it, and the value.
_ROWS: tuple[tuple[str, str, float, str], ...] = (
    ("copper loss", "N²m²s", 1.0, "copper_n2m2s"),
    ("RMS torque", "N·m", 1.0, "rms_torque_nm"),
    ("peak torque", "N·m", 1.0, "peak_torque_nm"),
    ("put in, nothing got back", "J", 1.0, "mechanical_j"),
    ("drawn, with regeneration", "J", 1.0, "drawn_j"),
    ("following error, peak", "mrad", 1e3, "peak_following_rad"),
    ("following error, RMS", "mrad", 1e3, "rms_following_rad"),
    ("settling", "ms", 1e3, "settling_s"),
    ("residual speed, RMS", "mrad/s", 1e3, "residual_rad_s"),
)


@dataclass(frozen=True)
class Playing:
    """How the motion shall be played."""

    against: MotionKind = "third"  # kind of the reference motion
    repeats: int = 3
    sample_rate_hz: float = 1000.0
    rivals: bool = True
    dry_run: bool = False


def play_and_show(
    drive: Drive,
    profile: DeviceProfile,
    machine: Machine,
    task: Task,
    wishes: LimitWishes,
    playing: Playing,
    out: Path,
    terminal: Terminal,
    confirm: Callable[[str], bool],
) -> dict[str, Any]:
    """Find the motion from where the axis stands, within the drive's limits, and play it beside the reference.

    Returns the machine-readable result. Raises RefusedError where preflight or the user say no, and what finding and
    playing raise.
    """
    from schwung.api.folders import make_folder
    from schwung.cli.console import observing
    from schwung.cli.flow import PreflightRefusedError
    from schwung.cli.optimised import summary, tell, write_result
    from schwung.commissioning.checks import COMFORT
    from schwung.commissioning.played import Played, cost_of_run, cost_of_simulated
    from schwung.commissioning.playing import play, prepare_play, stand_of
    from schwung.errors import RefusedError
    from schwung.files import json_text, replace_file
    from schwung.motion import Motion
    from schwung.optimise.comparison import STANDARD, optimise, shortest_profile
    from schwung.optimise.formats import cycle_torque

    stand = stand_of(drive, profile, machine, wishes)
    limits = replace(
        task.limits,
        torque_max_nm=COMFORT * stand.limits.torque_max_nm,  # the controller wants some, too
        position_min_rad=stand.limits.position_min_rad,
        position_max_rad=stand.limits.position_max_rad,
        speed_max_rad_s=COMFORT * stand.limits.speed_max_rad_s,
    )
    wanted = replace(task, start_rad=stand.start_rad, limits=limits)
    found = optimise(machine, wanted, playing.rivals)
    stroke, back = found.stroke, found.back
    duration = stroke.duration_s
    if task.duration_s is None:
        duration = shortest_profile(machine, wanted, playing.against)
        terminal.say(
            f"The {STANDARD[playing.against]} takes {duration * 1e3:.1f} ms within the same limits, "
            f"the best motion {stroke.duration_s * 1e3:.1f} ms"
        )
    reference = Motion(kind=playing.against, distance_rad=stroke.distance_rad, duration_s=duration)
    prepared = prepare_play(
        drive,
        profile,
        stand,
        reference,
        stroke.motion(back),
        lambda motion, time: cycle_torque(stroke, back, motion, time) - stroke.hold_start_nm,
        repeats=playing.repeats,
        sample_rate_hz=playing.sample_rate_hz,
    )
    tell(terminal, machine, found)
    terminal.checks((c.name, c.severity, c.text, c.remedy) for c in prepared.preflight.checks)
    result: dict[str, Any] = summary(machine, found) | {"reference_duration_s": duration}
    result |= {"preflight": [vars(check) for check in prepared.preflight.checks]}
    try:
        prepared.preflight.require()
    except RefusedError as refusal:
        raise PreflightRefusedError(refusal, result) from None
    if playing.dry_run:
        terminal.say("Dry run: nothing was changed, nothing moved.")
        return result
    if not confirm("The machine will move. Is it clear?"):
        raise RefusedError("optimise --play", "you said no", "Nothing was changed, nothing moved.")
    make_folder(out)
    with observing(terminal) as observer:
        recorded = play(drive, prepared, out, observer)
    plan = prepared.plan
    assert plan.optimised is not None
    before, after = prepared.predicted
    played = Played(
        reference=tuple(cost_of_run(run, machine) for run in recorded.runs[0::2]),
        optimised=tuple(cost_of_run(run, machine) for run in recorded.runs[1::2]),
        predicted_reference=cost_of_simulated(before, plan.motion, machine),
        predicted_optimised=cost_of_simulated(after, plan.optimised, machine),
    )
    result["played"] = tell_played(terminal, played, playing.against)
    files = write_result(out, machine, found, playing.sample_rate_hz, result)
    files += _pictures(out, prepared, recorded.runs[0], recorded.runs[1], playing.against)
    result["files"] = {path.name: str(path) for path in [*files, out / "played.h5"]}
    replace_file(out / "optimised.json", json_text(result))
    terminal.say(f"Motion, tables, cams and pictures: [bold]{out}[/]")
    return result


def tell_played(terminal: Terminal, played: Played, against: MotionKind) -> dict[str, Any]:
    """Measured beside predicted, for people and, as returned, for machines."""
    from schwung.commissioning.played import interval
    from schwung.optimise.comparison import STANDARD

    rows, document = [], {}
    for words, unit, factor, name in _ROWS:

        def of(cost: Cost, name: str = name) -> float:
            return float(getattr(cost, name))

        if played.predicted_reference.drawn_j is None and name == "drawn_j":
            continue
        measured = [interval([of(c) for c in costs]) for costs in (played.reference, played.optimised)]
        saving, predicted = played.saving(of), played.predicted_saving(of)
        cells = [f"{words} ({unit})"]
        for found, promised in zip(
            measured, (played.predicted_reference, played.predicted_optimised), strict=True
        ):
            half = _half(found.half, found.mean, factor)
            cells.append(f"{found.mean * factor:.4g}{half} ({of(promised) * factor:.4g})")
        rows.append([*cells, _saved(saving, predicted)])
        document[name] = {
            "reference": vars(measured[0]),
            "optimised": vars(measured[1]),
            "predicted_reference": of(played.predicted_reference),
            "predicted_optimised": of(played.predicted_optimised),
            "saving": saving and vars(saving),
            "predicted_saving": predicted,
        }
    terminal.table(
        "Played: measured ± 95 %, in brackets as predicted",
        ("", STANDARD[against], "optimised", "saved"),
        rows,
    )
    return {"against": against, "repeats": len(played.reference), **document}


def _saved(saving: Interval | None, predicted: float | None) -> str:
    """A saving in words."""
    if saving is None or predicted is None:
        return "–"
    half = "" if saving.half is None else f" ± {saving.half:.2%}"
    return f"{saving.mean:.1%}{half} ({predicted:.1%})"


def _half(half: float | None, mean: float, factor: float) -> str:
    """Half an interval in words; rounding errors are none."""
    if half is None:
        return ""
    return f" ± {half * factor:.2g}" if half > 1e-9 * abs(mean) else " ± 0"


def _pictures(
    out: Path, prepared: PlayPrepared, reference: Run, optimised: Run, against: MotionKind
) -> list[Path]:
    """Both motions as recorded over time, with what was predicted, and over the angle."""
    from schwung.files import replace_file
    from schwung.optimise.comparison import STANDARD
    from schwung.report.optimised import Shown, played_angle_figure, played_figure
    from schwung.report.style import to_png

    pairs = []
    names = (f"{STANDARD[against]}, measured", "optimised, measured")
    for name, run, simulated in zip(names, (reference, optimised), prepared.predicted, strict=True):
        motion = run.motion
        assert motion is not None
        begin, end = motion.start_time_s - 0.02, motion.start_time_s + motion.duration_s + motion.dwell_s
        pair = []
        for made in (run, simulated):
            shown = (made.time_s >= begin) & (made.time_s <= end)
            time = made.time_s[shown] - motion.start_time_s
            pair.append(
                Shown(name, time, made.position_rad[shown], made.speed_rad_s[shown], made.torque_nm[shown])
            )
        pairs.append((pair[0], pair[1]))
    figures = {"played.png": played_figure(pairs), "played-angle.png": played_angle_figure(pairs)}
    for name, figure in figures.items():
        replace_file(out / name, to_png(figure))
    return [out / name for name in figures]
