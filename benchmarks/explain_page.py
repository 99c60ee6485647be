"""The tables of docs/sealed-benchmark.md, from folders that benchmarks/explain.py has scored.

    python benchmarks/explain_page.py DIR      DIR/single, DIR/weak, … as of `explain.py all --out DIR/KIND --kind KIND`
    python benchmarks/explain_page.py DIR former            of `explain.py run --former`

Prints Markdown: every demand with what was measured, on which seeds; each effect; the confusion matrix; every miss.
"""

from __future__ import annotations

import sys
from collections.abc import Iterable, Sequence
from itertools import chain
from pathlib import Path

import numpy as np
from explain_score import NOTHING, CaseScore, confusion, score_all

from schwung_sim.sealed import read_labels

KINDS = ("single", "weak", "gross", "two", "three", "none", "foreign")
_OF = {
    "single": "one, clear (8 to 30 floors)", "weak": "one, weak (3 floors)", "gross": "one, gross (30 to 100 floors)",
    "two": "two", "three": "three", "none": "nothing", "foreign": "one that the library lacks",
}  # fmt: skip


def share(flags: Iterable[bool]) -> str:
    """Percentage and counts."""
    values = [bool(flag) for flag in flags]
    return f"{100 * np.mean(values):.0f} % ({sum(values)}/{len(values)})" if values else "not run"


def table(heads: Sequence[str], rows: Iterable[Sequence[str]]) -> str:
    """A Markdown table."""
    lines = [heads, ["---"] * len(heads), *rows]
    return "\n".join("| " + " | ".join(line) + " |" for line in lines)


def demands(of: dict[str, list[CaseScore]], folder: Path) -> str:
    """The table of the demands: what is asked, what was measured."""
    single, weak, gross, none, foreign = (of[k] for k in ("single", "weak", "gross", "none", "foreign"))
    several = of["two"] + of["three"]
    every = list(chain(*of.values()))
    hidden = [s for s in every if s.truth and s.kind != "foreign"]
    overlaps = [s.interval_overlap for s in hidden if s.interval_overlap is not None]
    known = [entry for s in hidden for entry in s.parameters]
    proven = [s.after_over_floor for s in every if s.verdict == "explained"]
    held = share(entry[3] for entry in known if entry[3] is not None)
    error = 100 * np.median([entry[2] for entry in known]) if known else float("nan")
    right, extra = "right name first", "further, wrong names beside it"
    rows = [
        ("one effect, clear: " + right, "≥ 95 %", share(s.first_right for s in single)),
        ("… or said to be indistinguishable", "", share(s.first_right or s.first_twin for s in single)),
        ("… " + extra, "", share(s.extra > 0 for s in single if s.first_right)),
        ("one effect, weak: " + right, "≥ 85 %", share(s.first_right for s in weak)),
        ("… or said to be indistinguishable", "", share(s.first_right or s.first_twin for s in weak)),
        ("… " + extra, "", share(s.extra > 0 for s in weak if s.first_right)),
        ("one effect, gross: " + right, "", share(s.first_right for s in gross)),
        ("two or three: all named", "≥ 80 %", share(s.all_named for s in several)),
        ("… two", "", share(s.all_named for s in of["two"])),
        ("… three", "", share(s.all_named for s in of["three"])),
        ("… all named, and nothing else", "", share(s.all_named and not s.extra for s in several)),
        ("nothing hidden: false alarms", "≤ 2 %", share(bool(s.names) for s in none)),
        ("… verdict other than consistent", "", share(s.verdict != "consistent" for s in none)),
        (
            "foreign effect: not named as something else",
            "≥ 90 %",
            share(not s.extra and not s.error for s in foreign),
        ),
        ("true coordinate first", "≥ 90 %", share(bool(s.coordinate_right) for s in hidden)),
        ("interval overlap ≥ 0.7", "", share(value >= 0.7 for value in overlaps)),
        ("interval overlap, mean", "≥ 0.7", f"{np.mean(overlaps):.2f}" if overlaps else "not run"),
        ("parameters: median error", "≤ 3 %", f"{error:.2f} %"),
        ("95 % intervals hold the truth", "90 to 98 %", held),
        ("held-out residual ≤ 1.2 floors when explained", "all", share(value <= 1.2 for value in proven)),
    ]
    text = table(("what", "demand", "measured"), rows)
    lost = folder / "control" / "control.txt"
    return text + ("\n\n" + lost.read_text(encoding="utf-8").strip() if lost.exists() else "")


def sets(of: dict[str, list[CaseScore]], folder: Path) -> str:
    """What was run: kind, number, seeds."""
    rows = []
    for kind, scores in of.items():
        if not scores:
            continue
        ran = {s.case for s in scores}
        seeds = [label["seed"] for label in read_labels(folder / kind) if label["case"] in ran]
        rows.append(
            (_OF[kind], str(len(scores)), f"{min(seeds)} to {max(seeds)}",
             f"`explain.py all --kind {kind} --cases {len(scores)} --first {min(seeds)} --out DIR/{kind}`")
        )  # fmt: skip
    return table(("hidden", "sessions", "seeds", "command"), rows)


def effects(of: dict[str, list[CaseScore]]) -> str:
    """Every effect, over the clear, weak and gross singles and the combinations."""
    rows = []
    alone = {kind: of[kind] for kind in ("single", "weak", "gross")}
    several = of["two"] + of["three"]
    every = list(chain(*alone.values(), several))
    for name in sorted({name for s in every for name in s.truth}):
        cells = [
            f"{sum(s.first == name for s in mine)}/{len(mine)}" if mine else "–"
            for mine in ([s for s in scores if name in s.truth] for scores in alone.values())
        ]
        among = [s for s in several if name in s.truth]
        entries = [entry for s in every for entry in s.parameters if entry[0] == name]
        held = [entry[3] for entry in entries if entry[3] is not None]
        rows.append(
            (f"`{name}`", *cells, f"{sum(name in s.names for s in among)}/{len(among)}" if among else "–",
             f"{100 * np.median([e[2] for e in entries]):.2f} %" if entries else "–",
             f"{sum(map(bool, held))}/{len(held)}" if held else "–")
        )  # fmt: skip
    heads = ("hidden", "clear", "weak", "gross", "among others", "median error", "interval holds")
    return table(heads, rows)


def matrix(scores: Sequence[CaseScore]) -> str:
    """Hidden against named first, where they differ."""
    rows, columns, counts = confusion(scores)
    lines = []
    for row, line in zip(rows, counts, strict=True):
        said = sorted(((int(c), column) for c, column in zip(line, columns, strict=True) if c), reverse=True)
        lines.append((row, ", ".join(f"{column} {count}" for count, column in said)))
    return table(("hidden", "named first"), lines)


def misses(of: dict[str, list[CaseScore]], folder: Path) -> str:
    """Every session that was not answered exactly, plainly."""
    rows = []
    for kind, scores in of.items():
        seeds = {label["case"]: label["seed"] for label in (read_labels(folder / kind) if scores else ())}
        for s in scores:
            wrong = (
                s.extra > 0 if kind in ("none", "foreign") else not (s.first_right and s.all_named) or s.extra
            )
            if wrong or s.error:
                said = ", ".join(s.names) or s.error or NOTHING
                rows.append((_OF[kind], str(seeds[s.case]), ", ".join(s.truth) or NOTHING, said, s.verdict))
    return table(("set", "seed", "hidden", "named", "verdict"), rows) if rows else "None."


def _run(folder: Path, way: str) -> list[CaseScore]:
    """The cases that were run, however they ended."""
    return [s for s in score_all(folder, way) if (folder / way / s.case / "run.json").exists()]


def page(folder: Path, way: str = "explanations") -> str:
    """All tables of the scored sets in a folder, as Markdown."""
    of = {kind: _run(folder / kind, way) if (folder / kind).exists() else [] for kind in KINDS}
    parts = (
        ("The demands", demands(of, folder)),
        ("What was run", sets(of, folder)),
        ("Effect by effect", effects(of)),
        ("Confusion of the clear single effects", matrix(of["single"])),
        ("Every miss", misses(of, folder)),
    )
    return "\n\n".join(f"## {title}\n\n{text}" for title, text in parts)


if __name__ == "__main__":
    print(page(Path(sys.argv[1]), *sys.argv[2:]))
