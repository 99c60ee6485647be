"""The tables of docs/sealed-benchmark.md, from folders that benchmarks/explain.py has scored.

    python benchmarks/explain_page.py DIR      DIR/single, DIR/weak, … as of `explain.py all --out DIR/KIND --kind KIND`

Prints Markdown: every demand with what was measured, beside the same of the former way where `explain.py run --former`
was run on the same sessions; on which seeds; each effect; the confusion matrix; every miss, of both.
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


def demands(now: dict[str, list[CaseScore]], former: dict[str, list[CaseScore]]) -> str:
    """The table of the demands: what is asked, what was measured, and what of the former way."""
    if not any(former.values()):
        return table(("what", "demand", "measured"), figures(now))
    pairs = zip(figures(now), figures(former), strict=True)
    return table(("what", "demand", "measured", "formerly"), [(*new, old[-1]) for new, old in pairs])


def figures(of: dict[str, list[CaseScore]]) -> list[tuple[str, str, str]]:
    """What is asked, how much of it, and what was measured."""
    single, weak, gross, none, foreign = (of[k] for k in ("single", "weak", "gross", "none", "foreign"))
    several = of["two"] + of["three"]
    every = list(chain(*of.values()))
    hidden = [s for s in every if s.truth and s.kind != "foreign"]
    overlaps = [s.interval_overlap for s in hidden if s.interval_overlap is not None]
    known = [entry for s in hidden for entry in s.parameters]
    proven = [s.after_over_floor for s in every if s.verdict == "explained"]
    error = f"{100 * np.median([entry[2] for entry in known]):.2f} %" if known else "not run"
    alone = [*single, *weak, *gross]
    return [
        ("one effect, clear: right name first", "≥ 97 %", share(s.first_right for s in single)),
        ("one effect, weak: right name first", "≥ 90 %", share(s.first_right for s in weak)),
        ("one effect, gross: right name first", "", share(s.first_right for s in gross)),
        (
            "… or said to be indistinguishable, all three",
            "",
            share(s.first_right or s.first_twin for s in alone),
        ),
        ("… further, wrong names beside it", "", share(s.extra > 0 for s in alone if s.first_right)),
        ("two: all named", "≥ 90 %", share(s.all_named for s in of["two"])),
        ("three: all named", "≥ 90 %", share(s.all_named for s in of["three"])),
        ("… all named, and nothing else", "", share(s.all_named and not s.extra for s in several)),
        ("nothing hidden: false alarms", "≤ 1 %", share(bool(s.names) for s in none)),
        ("… verdict other than consistent", "", share(s.verdict != "consistent" for s in none)),
        (
            "foreign effect: not named as something else",
            "≥ 97 %",
            share(not s.extra and not s.error for s in foreign),
        ),
        ("true coordinate first", "≥ 90 %", share(bool(s.coordinate_right) for s in hidden)),
        ("interval overlap ≥ 0.7", "", share(value >= 0.7 for value in overlaps)),
        ("parameters: median error", "≤ 3 %", error),
        ("95 % intervals hold the truth", "93 to 97 %", share(e[3] for e in known if e[3] is not None)),
        ("held-out residual ≤ 1.2 floors when explained", "all", share(value <= 1.2 for value in proven)),
        ("seconds of a session, median", "", seconds(every)),
    ]


def seconds(scores: Sequence[CaseScore]) -> str:
    """Median and the longest."""
    took = [s.seconds for s in scores if s.seconds]
    return f"{np.median(took):.0f} (longest {max(took):.0f})" if took else "not run"


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


def page(folder: Path) -> str:
    """All tables of the scored sets in a folder, as Markdown; the former way counts where both were run."""
    now = {kind: _run(folder / kind, "explanations") if (folder / kind).exists() else [] for kind in KINDS}
    both = {kind: {s.case for s in scores} for kind, scores in now.items()}
    former = {
        kind: [s for s in _run(folder / kind, "former") if s.case in both[kind]] if both[kind] else []
        for kind in KINDS
    }
    parts = [
        ("The demands", demands(now, former)),
        ("What was run", sets(now, folder)),
        ("Effect by effect", effects(now)),
        ("Confusion of the clear single effects", matrix(now["single"])),
        ("Every miss", misses(now, folder)),
    ]
    if any(former.values()):
        parts.append(("Every miss of the former way", misses(former, folder)))
    return "\n\n".join(f"## {title}\n\n{text}" for title, text in parts)


if __name__ == "__main__":
    print(page(Path(sys.argv[1])))
