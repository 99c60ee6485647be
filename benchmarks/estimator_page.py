"""docs/estimators.md: one table per question, from the scores of `estimators.py`; all numbers beside it as CSV."""

from __future__ import annotations

import csv
from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import asdict, fields
from pathlib import Path

import numpy as np
from estimator_cases import (
    ALL,
    BOUND,
    CLEAN,
    CONDITIONS,
    DURATIONS_S,
    MACHINES,
    PAIR,
    SLIDER_CRANK,
    USUAL_S,
    usual_runs,
)
from estimator_picture import draw
from estimator_score import Score

OURS = ("multiphase", "trajectory")
PAPER = ("former", "denoised")
WORDS = Path(__file__).with_name("estimator_words.md")
_REAL_TIME_HZ = 4000.0


def write_page(scores: Sequence[Score], folder: Path) -> None:
    """estimators.md, .csv and .png into the folder."""
    scores = sorted(
        scores,
        key=lambda s: (s.seed, -s.duration_s, list(CONDITIONS).index(s.condition), s.machine, s.method),
    )
    methods = ranked(scores)
    _write_csv(scores, folder / "estimators.csv")
    draw(scores, methods, folder / "estimators.png")
    tables = {
        "winners": _winners(scores, methods),
        "motion_times": _motion_times(scores, methods),
        "physics": _physics(scores, methods),
        "bound": _bound(scores, methods),
        "table1": _table1(scores),
        "bands": _bands(scores, methods),
        "runs": _runs(scores, methods),
        "costs": _costs(scores, methods),
        "extent": [_extent(scores)],
    }
    text = WORDS.read_text(encoding="utf-8")
    for name, lines in tables.items():
        text = text.replace(f"{{{name}}}", "\n".join(lines))
    (folder / "estimators.md").write_text(text, encoding="utf-8")


def ranked(scores: Iterable[Score]) -> list[str]:
    """The methods, the most accurate at 150 ms in the clean first."""
    scores = list(scores)
    names = sorted({s.method for s in scores} - {BOUND})
    return sorted(names, key=lambda m: np.nan_to_num(middle(scores, m, duration=0.15), nan=np.inf))


def chosen(
    scores: Iterable[Score],
    method: str,
    *,
    duration: float | None = None,
    condition: str | None = CLEAN,
    runs: int | None = None,
) -> list[Score]:
    """The scores of one method; `runs` None: those it is made for; `duration` or `condition` None: all of them."""
    return [
        s
        for s in scores
        if s.method == method
        and s.runs == (runs or usual_runs(method))
        and duration in (None, s.duration_s)
        and condition in (None, s.condition)
    ]


def middle(
    scores: Iterable[Score],
    method: str,
    *,
    quantity: str = "rmse",
    duration: float | None = None,
    condition: str | None = CLEAN,
    runs: int | None = None,
) -> float:
    """Median over machines of what was not refused; NaN where nothing was answered."""
    values = [
        getattr(s, quantity)
        for s in chosen(scores, method, duration=duration, condition=condition, runs=runs)
    ]
    return float(np.nanmedian(values)) if np.isfinite(values).any() else float("nan")


def milli(value: float) -> str:
    """In 10⁻³ kg·m², two digits."""
    return digits(1e3 * value)


def digits(value: float) -> str:
    """Two digits, or all of those before the point."""
    if not np.isfinite(value):
        return "–"
    return f"{value:.0f}" if abs(value) >= 99.5 else f"{value:.2g}"


def grid(head: Sequence[str], rows: Iterable[Sequence[str]]) -> list[str]:
    """A Markdown table; all but the first column to the right."""
    return [
        "| " + " | ".join(head) + " |",
        "|---" + "|--:" * (len(head) - 1) + "|",
        *("| " + " | ".join(row) + " |" for row in rows),
    ]


def _winners(scores: Sequence[Score], methods: Sequence[str]) -> list[str]:
    rivals = [m for m in methods if m not in (*OURS, *PAPER)]
    rows = []
    for duration in DURATIONS_S:
        of = {m: middle(scores, m, duration=duration) for m in methods}
        best = min(rivals, key=lambda m: np.nan_to_num(of[m], nan=np.inf))
        winner = min(of, key=lambda m: np.nan_to_num(of[m], nan=np.inf))
        named = {m: f"**{milli(v)}**" if m == winner else milli(v) for m, v in of.items()}
        rows.append(
            [f"{1e3 * duration:g} ms", *(named[m] for m in PAPER), f"{named[best]} ({best})"]
            + [named[m] for m in OURS]
        )
    return grid(("motion", *PAPER, "best rival", *OURS), rows)


def _motion_times(scores: Sequence[Score], methods: Sequence[str]) -> list[str]:
    rows = [
        [
            m,
            *(
                f"{milli(middle(scores, m, duration=d))} ({milli(middle(scores, m, duration=d, quantity='p95'))})"
                for d in DURATIONS_S
            ),
        ]
        for m in methods
    ]
    return grid(("method", *(f"{1e3 * d:g} ms" for d in DURATIONS_S)), rows)


def _physics(scores: Sequence[Score], methods: Sequence[str]) -> list[str]:
    def times(method: str, condition: str) -> str:
        of = chosen(scores, method, duration=USUAL_S, condition=condition)
        clean = {s.machine: s.rmse for s in chosen(scores, method, duration=USUAL_S)}
        ratios = np.array([s.rmse / clean[s.machine] for s in of if s.machine in clean])
        refused = int(np.sum(~np.isfinite(ratios)))
        if refused == ratios.size:
            return "refused"
        text = digits(float(np.nanmedian(ratios)))
        return text + (f" ({refused} refused)" if refused else "")

    others = [c for c in CONDITIONS if c != CLEAN]
    rows = [
        [
            m,
            milli(middle(scores, m, duration=USUAL_S)),
            *(f"× {times(m, c)}" if times(m, c) != "refused" else "refused" for c in others),
        ]
        for m in methods
    ]
    return grid(("method", "clean", *others), rows)


def _bound(scores: Sequence[Score], methods: Sequence[str]) -> list[str]:
    def cell(method: str, duration: float, runs: int) -> str:
        least = {s.machine: s.rmse for s in chosen(scores, BOUND, duration=duration, runs=runs)}
        of = chosen(scores, method, duration=duration, runs=runs)
        ratios = [s.rmse / least[s.machine] for s in of if s.machine in least and np.isfinite(s.rmse)]
        return digits(float(np.median(ratios))) if ratios else "–"

    head = ("method", "runs", *(f"{1e3 * d:g} ms" for d in DURATIONS_S))
    rows = [
        [
            "*the bound itself, 10⁻³ kg·m²*",
            str(runs),
            *(milli(middle(scores, BOUND, duration=d, runs=runs)) for d in DURATIONS_S),
        ]
        for runs in (PAIR, ALL)
    ]
    for m in methods:
        rows += [[m, str(usual_runs(m)), *(cell(m, d, usual_runs(m)) for d in DURATIONS_S)]]
    return grid(head, rows)


def _table1(scores: Sequence[Score]) -> list[str]:
    """Ours over the bound on the paper's machine."""
    of = [s for s in scores if s.machine == SLIDER_CRANK]
    rows = []
    for condition in (CLEAN, "clipped"):
        for method in OURS:
            cells = []
            for duration in DURATIONS_S:
                least = chosen(of, BOUND, duration=duration, condition=condition)
                made = chosen(of, method, duration=duration, condition=condition)
                squares = [
                    np.mean([s.rmse**2 for s in group]) if group else np.nan for group in (made, least)
                ]
                cells.append(digits(float(np.sqrt(squares[0] / squares[1]))))
            rows.append([condition, method, *cells])
    return grid(("condition", "method", *(f"{1e3 * d:g} ms" for d in DURATIONS_S)), rows)


def _bands(scores: Sequence[Score], methods: Sequence[str]) -> list[str]:
    hidden = [c for c in CONDITIONS if not CONDITIONS[c].modelled]
    signals = [c for c in CONDITIONS if CONDITIONS[c].modelled and c not in (CLEAN, "clipped")]
    groups: list[tuple[str, Callable[[Score], bool]]] = [
        ("clean, 200 ms and slower", lambda s: s.condition == CLEAN and s.duration_s >= 0.2),
        ("clean, faster", lambda s: s.condition == CLEAN and s.duration_s < 0.2),
        ("other signals", lambda s: s.condition in signals),
        ("clipped", lambda s: s.condition == "clipped"),
        ("hidden physics but backlash", lambda s: s.condition in hidden and s.condition != "backlash"),
        ("backlash", lambda s: s.condition == "backlash"),
    ]

    def cell(method: str, belongs: Callable[[Score], bool]) -> str:
        of = [s.band for s in chosen(scores, method, condition=None) if belongs(s) and np.isfinite(s.band)]
        return f"{100 * np.mean(of):.0f} %" if of else "–"

    rows = [[m, *(cell(m, belongs) for _, belongs in groups)] for m in methods]
    return grid(("method", *(name for name, _ in groups)), rows)


def _runs(scores: Sequence[Score], methods: Sequence[str]) -> list[str]:
    times = (0.25, 0.15, 0.1)
    head = ("method", *(f"{1e3 * d:g} ms, {runs} runs" for d in times for runs in (PAIR, ALL)))
    rows = [
        [m, *(milli(middle(scores, m, duration=d, runs=runs)) for d in times for runs in (PAIR, ALL))]
        for m in methods
    ]
    return grid(head, rows)


def _costs(scores: Sequence[Score], methods: Sequence[str]) -> list[str]:
    rows = []
    for m in methods:
        alone, whole = (
            float(np.nanmedian([getattr(s, q) for s in chosen(scores, m, condition=None)]))
            for q in ("method_us", "whole_us")
        )
        moving = middle(scores, m, duration=USUAL_S, quantity="moving_s")
        rows.append(
            [
                m,
                str(usual_runs(m)),
                f"{moving:.1f} s",
                digits(alone),
                digits(whole),
                digits(1e6 / _REAL_TIME_HZ / alone),
            ]
        )
    head = ("method", "runs", "machine moves, 250 ms strokes", "method, µs a sample", "whole estimate, µs a sample",
            "method, times real time at 4 kHz")  # fmt: skip
    return grid(head, rows)


def _extent(scores: Sequence[Score]) -> str:
    sessions = len({s.case for s in scores})
    machines, times, conditions = len(MACHINES), len(DURATIONS_S), len(CONDITIONS)
    whole = machines * times * conditions
    all_of_them = f"{machines} machines × {times} motion times × {conditions} conditions"
    if sessions < whole:
        return f"{sessions} of {whole} sessions ({all_of_them}; all clean ones and all at 250 ms come first)"
    return f"{sessions} sessions ({all_of_them})"


def _write_csv(scores: Sequence[Score], path: Path) -> None:
    """All scores; numbers to three digits."""
    names = [f.name for f in fields(scores[0])]

    def text(value: object) -> str:
        if isinstance(value, float):
            return f"{value:.3g}" if np.isfinite(value) else ""
        return str(value)

    def lines() -> Iterator[list[str]]:
        for s in scores:
            yield [text(value) for value in asdict(s).values()]

    with path.open("w", newline="", encoding="utf-8") as file:
        writer = csv.writer(file, lineterminator="\n")
        writer.writerow(names)
        writer.writerows(lines())
