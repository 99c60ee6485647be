"""The page of an explanation: verdict in one sentence, findings, before and after, where, and the proof."""

from __future__ import annotations

import math
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from html import escape
from itertools import pairwise
from pathlib import Path

from matplotlib.figure import Figure

from schwung.drivetrain.machine import Machine
from schwung.explain.values import Explanation, Finding, Located, Overlay, Quantity
from schwung.explain.words import View, told_apart_by, words_of
from schwung.quantities import sentences_of
from schwung.report.content import LINEAR, ROTARY, Units, units_of
from schwung.report.explanation_terms import Term, coupling_figure, term_figure
from schwung.report.figures_explanation import (
    judged,
    located_figure,
    map_figure,
    overlay_figure,
    probability,
    proof_figure,
    shown_overlay,
)
from schwung.report.html import bullets, drawn_figure, page, section, write_page
from schwung.report.pictures import Picture
from schwung.session import Session

_TONES = {
    "consistent": ("good", "✓ Consistent"),
    "explained": ("good", "✓ Explained"),
    "partly_explained": ("doubtful", "! Partly explained"),
    "unexplained": ("unusable", "✗ Unexplained"),
}
_COORDINATES = {
    "position": "position",
    "speed": "speed",
    "direction": "direction of motion",
    "acceleration": "acceleration",
    "torque": "torque",
    "time_in_motion": "time in the motion",
    "frequency": "frequency",
    "run": "number of the run",
}
_DRAWN: dict[View, str] = {
    "speed": "over speed",
    "position": "over {u.position_word}",
    "torque": "over {u.torque_word}",
    "torque_rate": "over the rate of change of the {u.torque_word}: the line's slope is the time",
    "acceleration": "over acceleration",
    "time": "over time",
    "frequency": "over frequency",
    "run": "over the session",
    "wind_up": "over the coupling's wind-up",
}
_DOTS = (
    "Dots: the measured {u.torque_word} minus everything that the model needs without this term, in all recorded "
    "runs. Green: the term as fitted. "
)
_SPECTRUM = "Orange: what the model leaves without this term; green: with it. "
_DRIFT = "Dots: the mean of what acts against the motion in each run; green: the term as fitted. "
_WIND_UP = "Grey: what the coupling had to carry in the recorded runs; beyond it nothing was seen. "
MAP = (
    "Orange: the machine needed more than the model knows; blue: less; the stronger, the more. "
    "Empty: the axis was not there."
)
_UNIT_WORDS = {"1/rev": "per turn"}
_SMALL = 0.1  # s, rad, m: below it they are written in thousandths
_LARGEST_POWER = 6  # numbers beyond are written with a power of ten
_UNIT_ENDS = (
    "_nm_rad3", "_nm_rad", "_rad_s", "_kgm2", "_nms2", "_nms", "_nm", "_rad", "_hz", "_s",
)  # fmt: skip


@dataclass(frozen=True, eq=False)
class ExplanationContent:
    """Everything that the page shows. `believed` is the machine before anything was learned."""

    title: str
    explanation: Explanation
    believed: Machine
    session: Session | None = None
    machine_file: str = ""  # the learned machine.toml as written

    @property
    def units(self) -> Units:
        """Units and words of this axis."""
        return units_of(self.explanation.axis, self.believed.effort)

    @property
    def linear(self) -> bool:
        """Whether the axis is a linear one."""
        return self.explanation.axis == "linear"


def write_explanation(content: ExplanationContent, path: Path) -> Path:
    """Write the page to `path`, whole or not at all; folders are made. Raises InputError where it cannot be."""
    return write_page(render_explanation(content), path)


def render_explanation(content: ExplanationContent) -> str:
    """The whole page as text."""
    explanation = content.explanation
    parts = [
        _header(content),
        _verdict(content),
        _numbers(content),
        section("What was left out", _findings_table(content)),
        section("What cannot be told apart", bullets(separations(explanation))),
        *(section(picture.title, drawn_figure(picture)) for picture in explanation_pictures(content)),
        section("Notes", bullets(dict.fromkeys(explanation.notes))),
        section("The learned machine", _machine_file(content)),
        "<footer>Written by Schwung. This file needs nothing else: keep it, mail it, print it.</footer>",
    ]
    return sentences_of(content.believed.effort)(page(content.title, parts))


def _header(content: ExplanationContent) -> str:
    session = content.session
    facts = [content.believed.name]
    if session is not None:
        facts = [session.created.replace("T", " ", 1), session.source, *facts]
    line = " · ".join(escape(fact) for fact in facts if fact)
    return f"<header><h1>{escape(content.title)}</h1><p>{line}</p></header>"


def _verdict(content: ExplanationContent) -> str:
    explanation = content.explanation
    tone, word = _TONES[explanation.verdict]
    reasons = [finding.text for finding in explanation.findings] or [w.text for w in explanation.mismatch]
    if explanation.verdict == "partly_explained":
        reasons += [f"Left: {where.text}" for where in explanation.remainder]
    return (
        f'<section class="verdict {tone}"><strong>{word}: {escape(headline(explanation))}</strong>'
        f"{bullets(reasons)}</section>"
    )


# ------------------------------------------------------------------------------------------- in words


def headline(explanation: Explanation) -> str:
    """The verdict in one sentence, without the verdict's own word."""
    linear = explanation.axis == "linear"
    units = LINEAR if linear else ROTARY
    fit, floor = explanation.fit, explanation.noise_floor.torque_nm
    before, after = fit.before.torque_rmse_nm, fit.after.torque_rmse_nm
    at_floor = f"noise floor {floor:.3g} {units.torque}"
    what = _listed([words_of(finding.physics, linear=linear).name for finding in explanation.findings])
    if explanation.verdict == "consistent":
        return f"the belief misses {before:.3g} {units.torque}, no more than the {at_floor} allows"
    if explanation.verdict == "unexplained":
        where = explanation.remainder or explanation.mismatch
        place = f", most of it over {place_of(where[0])}" if where else ""
        missing = f"{before:.3g} {units.torque} are missing{place}"
        return f"{missing}, and no term of the library accounts for them ({at_floor})"
    gain = f"with it the error falls from {before:.3g} to {after:.3g} {units.torque} ({at_floor})"
    gain = gain.replace("with it", "with them") if len(explanation.findings) > 1 else gain
    if explanation.verdict == "explained":
        return f"the belief leaves out {what}; {gain}"
    left = f"; what is left lies over {place_of(explanation.remainder[0])}" if explanation.remainder else ""
    return f"the belief leaves out {what}; {gain}{left}"


def _listed(names: Sequence[str]) -> str:
    return " and ".join([", ".join(names[:-1]), names[-1]]) if len(names) > 1 else "".join(names)


def place_of(where: Located) -> str:
    """'speed, −20 … 20 rad/s'; the interval is left out where a coordinate has none that is worth reading."""
    name = _COORDINATES.get(where.coordinate, where.coordinate)
    low, high = where.interval
    if where.coordinate == "direction":
        sides = {(True, False): ", backward", (False, True): ", forward"}
        return name + sides.get((low < 0, high > 0), "")
    if not (math.isfinite(low) and math.isfinite(high)):
        return name
    return f"{name}, {_plain(low)} … {_plain(high)}{_spaced(where.unit)}"


def value_text(quantity: Quantity) -> str:
    """'2.10 N·m (2.04 … 2.16)': as many digits as the 95 % interval deserves; a table by its extent."""
    value = quantity.value
    if not isinstance(value, int | float):
        heights = [pair[1] for pair in value]
        span = f", {_plain(min(heights))} … {_plain(max(heights))}" if heights else ""
        return f"{len(value)} points{span}{_spaced(quantity.unit)}"
    milli = quantity.unit in ("s", "rad", "m") and 0 < abs(value) < _SMALL
    factor, unit = (1e3, f"m{quantity.unit}") if milli else (1.0, quantity.unit)
    if quantity.ci95 is None:
        return f"{_plain(factor * value)}{_spaced(unit)}"
    low, high = (factor * end for end in quantity.ci95)
    known = math.isfinite(high - low) and high > low
    digits = -math.floor(math.log10((high - low) / 3)) if known else 4
    shown = [_rounded(number, digits) for number in (factor * value, low, high)]
    return f"{shown[0]}{_spaced(unit)} {_unbroken(f'({shown[1]} … {shown[2]})')}"


def _spaced(unit: str) -> str:
    return f" {_UNIT_WORDS.get(unit, unit)}" if unit and unit != "1" else ""


def _rounded(value: float, digits: int) -> str:
    """To so many decimals, with a proper minus; very large and very small ones with a power of ten."""
    if not math.isfinite(value):
        return f"{value:g}".replace("-", "−").replace("inf", "∞")
    size = math.floor(math.log10(abs(value))) if value else 0
    if value and (size >= _LARGEST_POWER or digits > _LARGEST_POWER):
        power = str(size).translate(str.maketrans("-0123456789", "⁻⁰¹²³⁴⁵⁶⁷⁸⁹"))
        return f"{value / 10**size:.{min(max(digits + size, 0), 6)}f}·10{power}".replace("-", "−")
    return f"{round(value, digits) + 0.0:.{max(digits, 0)}f}".replace("-", "−")


def _unbroken(text: str) -> str:
    return text.replace(" ", "\u00a0")


def _plain(value: float) -> str:
    return f"{value:.3g}".replace("-", "−")


def label_of(key: str) -> str:
    """A parameter's key in words: 'stribeck speed' for stribeck_speed_rad_s."""
    end = next((end for end in _UNIT_ENDS if key.endswith(end)), "")
    words = key.removesuffix(end).replace("_", " ").strip()
    return words.replace("torque constant", "time constant") if key == "time_constant_s" else words or key


def runs_text(runs: Iterable[int]) -> str:
    """'0–3, 7' for (0, 1, 2, 3, 7)."""
    ordered = sorted(set(runs))
    if not ordered:
        return "none"
    starts = [ordered[0], *(b for a, b in pairwise(ordered) if b != a + 1)]
    ends = [*(a for a, b in pairwise(ordered) if b != a + 1), ordered[-1]]
    return ", ".join(
        f"{a}" if a == b else f"{a}, {b}" if b == a + 1 else f"{a}–{b}"
        for a, b in zip(starts, ends, strict=True)
    )


def separations(explanation: Explanation) -> Iterator[str]:
    """One sentence for each pair of names that this session cannot tell apart: the motion that would."""
    seen, linear = set(), explanation.axis == "linear"
    for finding in explanation.findings:
        for other in finding.indistinguishable_from:
            if frozenset((finding.physics, other)) not in seen:
                seen.add(frozenset((finding.physics, other)))
                first, second = (words_of(name, linear=linear).name for name in (finding.physics, other))
                yield (
                    f"{first.capitalize()}, or {second} ({other})? "
                    f"{told_apart_by(finding.physics, other, linear=linear)}"
                )


# -------------------------------------------------------------------------------------- as HTML


def _numbers(content: ExplanationContent) -> str:
    items = "".join(
        f"<div><dt>{escape(name)}</dt><dd>{escape(value)}<small>{escape(small)}</small></dd></div>"
        for name, value, small in _key_numbers(content)
    )
    return f'<dl class="numbers">{items}</dl>'


def _key_numbers(content: ExplanationContent) -> Iterator[tuple[str, str, str]]:
    explanation, units = content.explanation, content.units
    fit, floor = explanation.fit, explanation.noise_floor
    word = units.torque_word.capitalize()
    if explanation.findings:
        small = f"{fit.before.torque_rmse_nm:.3g} {units.torque} by the belief"
        yield f"{word} error, physics named", f"{fit.after.torque_rmse_nm:.3g} {units.torque}", small
    else:
        yield f"{word} error of the belief", f"{fit.before.torque_rmse_nm:.3g} {units.torque}", "RMS"
    yield "Noise floor", f"{floor.torque_nm:.3g} {units.torque}", floor.how
    if math.isfinite(fit.after.speed_rmse_rad_s) and fit.after.speed_rmse_rad_s > 0:
        small = (
            f"{fit.before.speed_rmse_rad_s:.3g} {units.speed} by the belief"
            if explanation.findings
            else "RMS"
        )
        yield "Speed error", f"{fit.after.speed_rmse_rad_s:.3g} {units.speed}", small
    yield (
        "Judged on runs",
        runs_text(fit.heldout_runs),
        f"kept aside; chosen and fitted on {runs_text(fit.train_runs)}",
    )


def _findings_table(content: ExplanationContent) -> str:
    head = ("Physics", "Parameters (95 % interval)", "Where", "Could as well be")
    rows = [finding_row(finding, linear=content.linear) for finding in content.explanation.findings]
    if not rows:
        return ""
    top = "".join(f"<th>{text}</th>" for text in head)
    lines = "".join(_row(*row) for row in rows)
    return f'<div class="wide"><table><thead><tr>{top}</tr></thead><tbody>{lines}</tbody></table></div>'


def _row(name: str, *cells: str) -> str:
    words, _, key = name.partition("\n")
    first = f"<td><strong>{escape(words)}</strong><br><code>{escape(key)}</code></td>"
    rest = ("<br>".join(escape(line) for line in cell.split("\n")) for cell in cells)
    return f"<tr>{first}{''.join(f'<td>{cell}</td>' for cell in rest)}</tr>"


def finding_row(finding: Finding, *, linear: bool = False) -> tuple[str, str, str, str]:
    """One finding for a table, lines within a cell by line feeds: physics, parameters, where, what else it could be."""
    others = [words_of(other, linear=linear).name for other in finding.indistinguishable_from]
    share = f"{100 * finding.where.share_of_energy:.0f} % of the mismatch"
    return (
        f"{words_of(finding.physics, linear=linear).name.capitalize()}\n{finding.physics}",
        "\n".join(parameter_lines(finding.parameters, linear=linear)),
        f"{place_of(finding.where)}\n{share}, {_unbroken(f'p {probability(finding.where.p_value)}')}",
        "\n".join(others) or "nothing else known",
    )


def parameter_lines(parameters: Mapping[str, Quantity], *, linear: bool) -> Iterator[str]:
    """Parameters with units and intervals, one a line."""
    for key, quantity in parameters.items():
        label = label_of(key).replace("torque", "force") if linear else label_of(key)
        yield f"{label}: {value_text(quantity)}"


def _machine_file(content: ExplanationContent) -> str:
    if not content.machine_file:
        return ""
    learned = (
        "Use this file in place of the one you gave: all that simulates has the learned terms."
        if content.explanation.findings
        else "Nothing was learned: this is the machine as you gave it."
    )
    return f'<p>{learned}</p><div class="wide"><pre>{escape(content.machine_file)}</pre></div>'


# ------------------------------------------------------------------------------------------- pictures


def explanation_pictures(content: ExplanationContent) -> Iterator[Picture]:
    """Every picture for which the explanation has something to show, in reading order."""
    explanation, units = content.explanation, content.units
    floor, named = explanation.noise_floor.torque_nm, bool(explanation.findings)
    shown, runs = shown_overlay(explanation.overlays), judged(explanation.overlays)
    if shown is not None:
        aside = "kept aside from fitting" if shown.heldout else "which was fitted"
        caption = (
            f"Run {shown.run}, {aside}. Needed: the {units.torque_word} that the model asks for the recorded motion. "
            "Within the grey band nothing can be told from noise."
        )
        title = "Before and after" if named else "Measured and believed"
        yield Picture("overlay", title, caption, overlay_figure(shown, floor, units, named=named))
    if runs and explanation.verdict != "consistent":
        yield Picture("map", "Where it is missing", MAP, map_figure(runs, floor, units, named=named))
    texts = {finding.physics: finding.text for finding in explanation.findings}
    yield from named_pictures(explanation.findings, explanation.overlays, content.believed, units, texts)
    yield Picture("proof", "The proof", _proof_caption(explanation), proof_figure(explanation, units))
    left = explanation.remainder if named or not explanation.mismatch else ()
    yield from located_pictures(explanation.mismatch, left)


def located_pictures(mismatch: Sequence[Located], remainder: Sequence[Located]) -> Iterator[Picture]:
    """Which coordinates the mismatch follows, and what is left of it."""
    for name, title, located in (
        ("located", "What the mismatch follows", mismatch),
        ("remainder", "What is left", remainder),
    ):
        if located:
            caption = (
                "Share of its energy that follows from each coordinate. What several could predict is credited to "
                "the simplest; one that this session cannot tell from another is listed with it. Grey: may be chance."
            )
            places = [place_of(where) for where in located]
            yield Picture(name, title, caption, located_figure(located, places, "Share of the energy, %"))


def named_pictures(
    terms: Sequence[Term],
    runs: Sequence[Overlay],
    believed: Machine,
    units: Units,
    texts: Mapping[str, str] | None = None,
) -> Iterator[Picture]:
    """Each named term over its own coordinate; all that was named of the coupling's law in one picture."""
    told = texts or {}
    for number, term in enumerate(terms):
        figure = term_figure(term, runs, units)
        if figure is not None:
            yield _term_picture(units, f"term{number}", [term], figure, told)
    law = [term for term in terms if words_of(term.physics).view == "wind_up"]
    figure = coupling_figure(law, runs, believed, units) if law else None
    if figure is not None:
        yield _term_picture(units, "coupling", law, figure, told)


def _term_picture(
    units: Units, name: str, terms: Sequence[Term], figure: Figure, texts: Mapping[str, str]
) -> Picture:
    words = [words_of(term.physics, linear=units.position == "m") for term in terms]
    where, _, slope = _DRAWN[words[0].view].format(u=units).partition(": ")
    called = _listed([each.name for each in words])
    own = {"wind_up": _WIND_UP, "frequency": _SPECTRUM, "run": _DRIFT}
    caption = own.get(words[0].view, _DOTS.format(u=units))
    caption += " ".join(texts[term.physics] for term in terms if term.physics in texts)
    caption += f" {slope.capitalize()}." if slope else ""
    return Picture(name, f"{called[:1].upper()}{called[1:]}, {where}", caption, figure)


def _proof_caption(explanation: Explanation) -> str:
    fit = explanation.fit
    text = f"Runs {runs_text(fit.heldout_runs)} took no part in choosing or fitting anything. "
    text += f"Noise floor: {explanation.noise_floor.how.rstrip('.')}."
    return text + (
        " Dashed: 1.2 times the floor, up to which an error counts as explained."
        if explanation.findings
        else ""
    )
