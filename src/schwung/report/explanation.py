"""The page of an explanation: verdict in one sentence, findings, before and after, where, and the proof."""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass
from html import escape
from pathlib import Path

from schwung.drivetrain.machine import Machine
from schwung.explain.values import Explanation, Finding
from schwung.explain.words import told_apart_by, words_of
from schwung.quantities import sentences_of
from schwung.report.content import LINEAR, ROTARY, Units, units_of
from schwung.report.figures_explanation import (
    judged,
    map_figure,
    overlay_figure,
    probability,
    proof_figure,
    shown_overlay,
)
from schwung.report.html import bullets, drawn_figure, page, section, write_page
from schwung.report.pictures import Picture
from schwung.report.pictures_explanation import MAP, located_pictures, named_pictures
from schwung.report.wording import listed, parameter_lines, place_of, runs_text, unbroken
from schwung.session import Session

_HEAD = ("Physics", "Parameters (95 % interval)", "Where", "Could as well be")
_TONES = {
    "consistent": ("good", "✓ Consistent"),
    "explained": ("good", "✓ Explained"),
    "partly_explained": ("doubtful", "! Partly explained"),
    "unexplained": ("unusable", "✗ Unexplained"),
}


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
    what = listed([words_of(finding.physics, linear=linear).name for finding in explanation.findings])
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


def tone_of(explanation: Explanation) -> str:
    """How good the answer is, as the look of the page has it."""
    return _TONES[explanation.verdict][0]


def tables(explanation: Explanation) -> list[tuple[str, tuple[str, ...], list[tuple[str, ...]]]]:
    """Everything in words: title, heads of the columns, and rows of each table that has some."""
    linear = explanation.axis == "linear"
    units, fit = LINEAR if linear else ROTARY, explanation.fit
    errors = [("belief", fit.before.torque_rmse_nm)]
    errors += [("belief + physics", fit.after.torque_rmse_nm)] if explanation.findings else []
    errors += [("noise floor", explanation.noise_floor.torque_nm)]
    runs = f"error on runs {runs_text(fit.heldout_runs)}, kept aside"
    every: list[tuple[str, tuple[str, ...], list[tuple[str, ...]]]] = [
        ("Left out", _HEAD, [finding_row(one, linear=linear) for one in explanation.findings]),
        ("Error", (runs, f"RMS, {units.torque}"), [(name, f"{value:.3g}") for name, value in errors]),
    ]
    return [(title, head, rows) for title, head, rows in every if rows]


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
    rows = [finding_row(finding, linear=content.linear) for finding in content.explanation.findings]
    if not rows:
        return ""
    top = "".join(f"<th>{text}</th>" for text in _HEAD)
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
        f"{place_of(finding.where)}\n{share}, {unbroken(f'p {probability(finding.where.p_value)}')}",
        "\n".join(others) or "nothing else known",
    )


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


def _proof_caption(explanation: Explanation) -> str:
    fit = explanation.fit
    text = f"Runs {runs_text(fit.heldout_runs)} took no part in choosing or fitting anything. "
    text += f"Noise floor: {explanation.noise_floor.how.rstrip('.')}."
    return text + (
        " Dashed: 1.2 times the floor, up to which an error counts as explained."
        if explanation.findings
        else ""
    )
