"""`schwung optimise --play`: the motion found is made on the machine, and held against what was promised."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from schwung import Connection, LimitWishes, Machine
    from schwung.api.optimising import Cost, Interval, Played, Playing, Task
    from schwung.cli.console import Terminal

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


def play_and_show(
    connection: Connection,
    machine: Machine,
    task: Task,
    wishes: LimitWishes,
    playing: Playing,
    out: Path,
    terminal: Terminal,
    confirm: Callable[[str], bool],
    dry_run: bool = False,
) -> dict[str, Any]:
    """Find the motion from where the axis stands, within the drive's limits, and play it beside the reference.

    Returns the machine-readable result. Raises RefusedError where preflight or the user say no, and what finding and
    playing raise.
    """
    from schwung.api.optimising import plan_play, play, standard_names, write_optimised, write_played
    from schwung.cli.console import observing
    from schwung.cli.flow import PreflightRefusedError
    from schwung.cli.optimised import tell
    from schwung.errors import RefusedError
    from schwung.files import json_text, replace_file

    planned = plan_play(connection, machine, task, wishes, playing)
    if task.duration_s is None:
        terminal.say(
            f"The {standard_names()[playing.against]} takes {planned.reference_duration_s * 1e3:.1f} ms "
            f"within the same limits, the best motion {planned.found.stroke.duration_s * 1e3:.1f} ms"
        )
    tell(terminal, planned.found)
    terminal.checks((c.name, c.severity, c.text, c.remedy) for c in planned.checks)
    result = planned.to_json()
    try:
        planned.prepared.preflight.require()
    except RefusedError as refusal:
        raise PreflightRefusedError(refusal, result) from None
    if dry_run:
        terminal.say("Dry run: nothing was changed, nothing moved.")
        return result
    with observing(terminal) as observer:
        played = play(connection, planned, out, confirm=confirm, observer=observer)
    result["played"] = tell_played(terminal, played.costs, playing.against)
    files = write_optimised(planned.found, out, playing.sample_rate_hz, result)
    files += write_played(planned, played, out)
    result["files"] = {path.name: str(path) for path in [*files, out / "played.h5"]}
    replace_file(out / "optimised.json", json_text(result))
    terminal.say(f"Motion, tables, cams and pictures: [bold]{out}[/]")
    return result


def tell_played(terminal: Terminal, played: Played, against: str) -> dict[str, Any]:
    """Measured beside predicted, for people and, as returned, for machines."""

    from schwung.api.optimising import interval, standard_names

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
        ("", standard_names()[against], "optimised", "saved"),
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
