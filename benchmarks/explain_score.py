"""Open the labels and score explanations against them; every figure of issue "The proof", as text, JSON and CSV."""

from __future__ import annotations

import csv
import json
from collections import Counter
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import asdict, dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
from explain_truth import COORDINATES, WORDS, intervals, overlap, parameter_errors

from schwung_sim.sealed import read_labels

NOTHING, FAILED = "(nothing)", "(failed)"
#: More probable than this is a name.
_NAMED = 0.5


@dataclass
class CaseScore:
    """One explanation against its label. `names` as found, `twins` what each is indistinguishable from."""

    case: str
    kind: str
    truth: list[str]
    strength: float
    verdict: str
    names: list[str]
    twins: list[list[str]]
    seconds: float
    floor_ratio: float = float("nan")  # the tool's floor over the label's
    after_over_floor: float = float("nan")  # held-out residual after, over the tool's floor
    coordinate: str = ""
    coordinate_right: bool | None = None
    interval_overlap: float | None = None
    parameters: list[tuple[str, str, float, bool | None]] = field(default_factory=list)
    error: str = ""

    @property
    def first(self) -> str:
        """What is named first."""
        return self.names[0] if self.names else (FAILED if self.error else NOTHING)

    @property
    def first_right(self) -> bool:
        """The first name is one of what is hidden."""
        return self.first in self.truth

    @property
    def first_twin(self) -> bool:
        """The first name is wrong, but what is hidden is said to be indistinguishable from it."""
        return not self.first_right and bool(self.twins) and not set(self.twins[0]).isdisjoint(self.truth)

    @property
    def all_named(self) -> bool:
        """Everything hidden is named."""
        return set(self.truth) <= set(self.names)

    @property
    def all_listed(self) -> bool:
        """Everything hidden is named, or said to be indistinguishable from something that is."""
        return set(self.truth) <= set(self.names).union(*self.twins)

    @property
    def extra(self) -> int:
        """Names of what is not hidden."""
        return len(set(self.names) - set(self.truth))


def score_case(label: Mapping[str, Any], folder: Path) -> CaseScore:
    """One case; `folder` holds its explanation.json, or error.txt."""
    truth = [WORDS.get(effect["physics"], effect["physics"]) for effect in label["effects"]]
    run_file = folder / "run.json"
    seconds = (
        json.loads(run_file.read_text(encoding="utf-8"))["seconds"] if run_file.exists() else float("nan")
    )
    base = (label["case"], label["kind"], truth, label["strength"])
    if not (folder / "explanation.json").exists():
        error = folder / "error.txt"
        text = error.read_text(encoding="utf-8").strip() if error.exists() else "was not run"
        return CaseScore(*base, "", [], [], seconds, error=text.splitlines()[-1])
    return score_document(
        label, json.loads((folder / "explanation.json").read_text(encoding="utf-8")), seconds
    )


def score_document(label: Mapping[str, Any], document: Mapping[str, Any], seconds: float) -> CaseScore:
    """The same of what is in an explanation.json."""
    findings = [one for one in document["names"] if one["probability"] is None or one["probability"] > _NAMED]
    score = CaseScore(
        label["case"],
        label["kind"],
        [WORDS.get(effect["physics"], effect["physics"]) for effect in label["effects"]],
        label["strength"],
        document["verdict"],
        [finding["physics"] for finding in findings],
        [finding["indistinguishable_from"] for finding in findings],
        seconds,
        floor_ratio=document["noise"]["torque_nm"] / label["floor_nm"],
        after_over_floor=document["proof"]["after"] if document["proof"] else float("nan"),
    )
    if label["kind"] in ("single", "two", "three"):
        _score_place(score, label, document["mismatch"])
        for effect in label["effects"]:
            for finding in findings:
                if finding["physics"] == effect["physics"]:
                    errors = parameter_errors(effect, finding["parameters"], label)
                    score.parameters += [(effect["physics"], *error) for error in errors]
    return score


def _score_place(score: CaseScore, label: Mapping[str, Any], mismatch: Sequence[Mapping[str, Any]]) -> None:
    """The first located mismatch has to be where one of the hidden effects is (the strongest are not told apart)."""
    score.coordinate_right = False
    if not mismatch:
        return
    score.coordinate = mismatch[0]["coordinate"]
    for effect in label["effects"]:
        if score.coordinate not in COORDINATES[effect["physics"]]:
            continue
        score.coordinate_right = True
        found = (float(mismatch[0]["interval"][0]), float(mismatch[0]["interval"][1]))
        overlaps = [overlap(found, true) for true in intervals(effect, score.coordinate, label)]
        if overlaps:
            score.interval_overlap = max(score.interval_overlap or 0.0, *overlaps)


def score_all(out: Path, way: str = "explanations") -> list[CaseScore]:
    """Open the seal and score every case of the folder; way: "former", or as `run` does it by default."""
    return [score_case(label, out / way / label["case"]) for label in read_labels(out)]


def _share(values: Iterable[bool]) -> str:
    flags = list(values)
    return f"{100 * np.mean(flags):5.1f} % ({sum(flags)}/{len(flags)})" if flags else "  –"


def summary(scores: Sequence[CaseScore]) -> dict[str, str]:
    """The figures of the demands, by what they are called there."""
    hidden = [s for s in scores if s.kind in ("single", "two", "three")]
    singles = [s for s in hidden if s.kind == "single"]
    several = [s for s in hidden if s.kind in ("two", "three")]
    silent, foreign = ([s for s in scores if s.kind == kind] for kind in ("none", "foreign"))
    lines: dict[str, str] = {}
    if singles:
        lines["right name first"] = _share(s.first_right for s in singles)
        lines["  or listed as indistinguishable"] = _share(s.first_right or s.first_twin for s in singles)
        lines["  further, wrong names beside"] = _share(s.extra > 0 and s.first_right for s in singles)
        lines["  nothing named"] = _share(s.first == NOTHING for s in singles)
    if several:
        lines["two or three: all named"] = _share(s.all_named for s in several)
        lines["  all named or indistinguishable"] = _share(s.all_listed for s in several)
        lines["  all named and nothing else"] = _share(s.all_named and s.extra == 0 for s in several)
        lines["  first name is one of them"] = _share(s.first_right for s in several)
    if silent:
        lines["nothing hidden: false alarms"] = _share(bool(s.names) for s in silent)
        lines["  verdict consistent"] = _share(s.verdict == "consistent" for s in silent)
    if foreign:
        lines["foreign: not named as something else"] = _share(not s.extra and not s.error for s in foreign)
        lines["  verdict unexplained or partly explained"] = _share(
            s.verdict in ("unexplained", "partly_explained") for s in foreign
        )
        lines["  claimed explained"] = _share(s.verdict == "explained" for s in foreign)
    placed = [s for s in hidden if s.coordinate_right is not None]
    if placed:
        lines["true coordinate first"] = _share(bool(s.coordinate_right) for s in placed)
        overlaps = [s.interval_overlap for s in placed if s.interval_overlap is not None]
        lines["  interval overlap ≥ 0.7"] = _share(value >= 0.7 for value in overlaps)
        lines["  interval overlap, median"] = f"{np.median(overlaps):5.2f}" if overlaps else "  –"
    known = [entry for s in hidden for entry in s.parameters]
    if known:
        lines["parameters: median error"] = f"{100 * np.median([entry[2] for entry in known]):5.1f} %"
        lines["  95 % intervals cover"] = _share(entry[3] for entry in known if entry[3] is not None)
    explained = [s.after_over_floor for s in scores if s.verdict == "explained"]
    if explained:
        lines["held-out residual after, over floor: median, worst"] = (
            f"{np.median(explained):5.2f}  {np.max(explained):.2f}"
        )
    floors = [s.floor_ratio for s in scores if np.isfinite(s.floor_ratio)]
    if floors:
        lines["the tool's floor over the label's: median"] = f"{np.median(floors):5.2f}"
    seconds = [s.seconds for s in scores if np.isfinite(s.seconds)]
    if seconds:
        lines["time per case: median, worst"] = f"{np.median(seconds):5.1f} s  {np.max(seconds):.1f} s"
    failed = [s for s in scores if s.error]
    if failed:
        lines["failed"] = f"{len(failed)}: " + "; ".join(sorted({s.error for s in failed})[:3])
    return lines


def by_effect(scores: Sequence[CaseScore]) -> list[str]:
    """A line per hidden effect: how often, named first, indistinguishable, place, parameters; what else was said."""
    heads = (
        ("n", 3),
        ("first", 5),
        ("twin", 4),
        ("named", 5),
        ("place", 5),
        ("IoU", 5),
        ("error", 7),
        ("ci95", 5),
    )
    lines = [" ".join([f"{'hidden':23}", *(f"{head:>{width}}" for head, width in heads), " said instead"])]
    for name in sorted({name for s in scores for name in s.truth}):
        mine = [s for s in scores if name in s.truth]
        single = [s for s in mine if len(s.truth) == 1]
        first = sum(s.first == name for s in mine)
        places = [s.coordinate_right for s in single if s.coordinate_right is not None]
        overlaps = [s.interval_overlap for s in single if s.interval_overlap is not None]
        entries = [entry for s in mine for entry in s.parameters if entry[0] == name]
        held = [entry[3] for entry in entries if entry[3] is not None]
        instead = Counter(other for s in mine for other in (s.names or [s.first]) if other not in s.truth)
        lines.append(
            f"{name:23} {len(mine):3} {first:5} {sum(s.first_twin for s in single):4} "
            f"{sum(name in s.names for s in mine):5} {_mean(places):>5} {_mean(overlaps):>5} "
            f"{100 * np.median([e[2] for e in entries]) if entries else float('nan'):6.1f}% {_mean(held):>5}  "
            + ", ".join(f"{other} {count}" for other, count in instead.most_common(4))
        )
    return lines


def _mean(values: Sequence[bool | float | None]) -> str:
    return f"{np.mean([float(value or 0.0) for value in values]):.2f}" if values else "–"


def confusion(scores: Sequence[CaseScore]) -> tuple[list[str], list[str], np.ndarray]:
    """Hidden (rows) against named first (columns); of two or three, a hidden effect that is named counts as that."""
    rows = sorted({name for s in scores for name in s.truth} | {NOTHING for s in scores if not s.truth})
    pairs: Counter[tuple[str, str]] = Counter()
    for s in scores:
        for name in s.truth or [NOTHING]:
            pairs[name, name if len(s.truth) > 1 and name in s.names else s.first] += 1
    columns = sorted({column for _, column in pairs})
    return rows, columns, np.array([[pairs[row, column] for column in columns] for row in rows])


def write_scores(out: Path, scores: Sequence[CaseScore]) -> None:
    """score.json with every case, score_confusion.csv beside it."""
    (out / "score.json").write_text(
        json.dumps({"summary": summary(scores), "cases": [asdict(s) for s in scores]}, indent=1),
        encoding="utf-8",
    )
    rows, columns, counts = confusion(scores)
    with (out / "score_confusion.csv").open("w", newline="", encoding="utf-8") as file:
        writer = csv.writer(file)
        writer.writerow(["hidden \\ named first", *columns])
        writer.writerows([row, *map(int, line)] for row, line in zip(rows, counts, strict=True))


def printed(scores: Sequence[CaseScore]) -> str:
    """Everything as text."""
    text = [f"{key:52}{value}" for key, value in summary(scores).items()]
    text += ["", *by_effect(scores), "", "Hidden, and what was named first:"]
    rows, columns, counts = confusion(scores)
    for row, line in zip(rows, counts, strict=True):
        said = sorted(((int(c), column) for c, column in zip(line, columns, strict=True) if c), reverse=True)
        text.append(f"  {row:23} " + ", ".join(f"{column} {count}" for count, column in said))
    return "\n".join(text)
