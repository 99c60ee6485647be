"""The page of an explanation by probabilities: names, curves without a name, the proof of the published file."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from html import escape
from pathlib import Path

from schwung.drivetrain.effects import PHYSICS
from schwung.drivetrain.machine import Machine
from schwung.explain.publishing.values import Curve, Published, Where, over_words, percent
from schwung.explain.values import Overlay
from schwung.explain.weighing.values import NAMED
from schwung.explain.words import told_apart_by, words_of
from schwung.quantities import sentences_of
from schwung.report.content import Units, units_of
from schwung.report.figures_explanation import judged, map_figure, overlay_figure, shown_overlay, speed_figure
from schwung.report.figures_probabilities import (
    curve_figure,
    plane_figure,
    presliding_figure,
    probabilities_figure,
)
from schwung.report.html import bullets, drawn_figure, page, rows_table, section, write_page
from schwung.report.pictures import Picture
from schwung.report.pictures_explanation import MAP, located_pictures, named_pictures
from schwung.report.wording import parameter_lines, runs_text
from schwung.session import Session


@dataclass(frozen=True, eq=False)
class ExplanationContent:
    """Everything that the page shows. `believed` is the machine before anything was learned."""

    title: str
    published: Published
    believed: Machine
    session: Session | None = None
    machine_file: str = ""  # the learned machine.toml as written

    @property
    def units(self) -> Units:
        """Units and words of this axis."""
        return units_of(self.published.axis, self.believed.effort)


def write_explanation(content: ExplanationContent, path: Path) -> Path:
    """Write the page to `path`, whole or not at all; folders are made. Raises InputError where it cannot be."""
    return write_page(render_explanation(content), path)


def tables(of: Published) -> list[tuple[str, tuple[str, ...], list[tuple[str, ...]]]]:
    """Everything in words: title, heads of the columns, and rows of each table that has some."""
    every: list[tuple[str, tuple[str, ...], list[tuple[str, ...]]]] = [
        ("Names", NAME_HEAD, [*name_rows(of)]),
        ("Modelled, unnamed", CURVE_HEAD, [*curve_rows(of)]),
        ("What has no name comes near to", PLAIN_HEAD, [*plain_rows(of)]),
        ("What the mismatch follows, in words", PLACE_HEAD, [*place_rows(of)]),
        ("Sets of causes", SET_HEAD, [*set_rows(of)]),
        ("What cannot be told apart", APART_HEAD, [*separations(of)]),
        ("Proof, noise, and what is left", ("", ""), [*fact_rows(of, units_of(of.axis, of.effort))]),
    ]
    return [(title, head, rows) for title, head, rows in every if rows]


def render_explanation(content: ExplanationContent) -> str:
    """The whole page as text."""
    of = content.published
    file = (
        f'<div class="wide long" tabindex="0"><pre>{escape(content.machine_file)}</pre></div>'
        if content.machine_file
        else ""
    )
    parts = [
        _header(content),
        _verdict(of),
        *(_table(one) for one in tables(of) if one[0] in _FIRST),
        *(section(picture.title, drawn_figure(picture)) for picture in explanation_pictures(content)),
        *(_table(one) for one in tables(of) if one[0] not in _FIRST),
        section("Notes", bullets(of.notes)),
        section("The learned machine", file),
        "<footer>Written by Schwung. This file needs nothing else: keep it, mail it, print it.</footer>",
    ]
    return sentences_of(content.believed.effort)(page(content.title, parts))


#: Tables that stand before the pictures.
_FIRST = ("Names", "Modelled, unnamed")


def _table(one: tuple[str, tuple[str, ...], list[tuple[str, ...]]]) -> str:
    title, head, rows = one
    return section(title, rows_table(head if any(head) else (), rows))


def _header(content: ExplanationContent) -> str:
    session, facts = content.session, [content.believed.name]
    if session is not None:
        facts = [session.created.replace("T", " ", 1), session.source, *facts]
    line = " · ".join(escape(fact) for fact in dict.fromkeys(facts) if fact)
    return f"<header><h1>{escape(content.title)}</h1><p>{line}</p></header>"


def tone_of(of: Published) -> str:
    """How good the answer is, as the look of the page has it."""
    return _TONES[of.verdict]


_TONES = {
    "consistent": "good",
    "explained": "good",
    "partly_explained": "doubtful",
    "unexplained": "unusable",
}


def _verdict(of: Published) -> str:
    text = of.headline[:1].upper() + of.headline[1:]
    return f'<section class="verdict {tone_of(of)}"><strong>{escape(text)}</strong></section>'


# ------------------------------------------------------------------------------------------- in words

#: What is less probable and not published is in explanation.json alone.
_WORTH = 0.05
#: Samples that count as fewer by this are told.
_COLOURED = 1.05
NAME_HEAD = ("physics", "probability", "parameters (95 %)", "where", "machine.toml")
PLAIN_HEAD = ("physics", "parameters", "share of it, all together")
PLACE_HEAD, APART_HEAD = ("missed by", "where"), ("one, or the other", "what would tell")
SET_HEAD = ("together", "probability", "machine.toml")
CURVE_HEAD = ("over", "probability", "torque, RMS", "where", "what is known of it", "machine.toml")


def name_rows(of: Published) -> list[tuple[str, ...]]:
    """Names for a table; lines within a cell by line feeds."""
    linear = of.axis == "linear"
    return [
        (
            f"{words_of(one.physics, linear=linear).name.capitalize()}\n{one.physics}",
            percent(one.probability),
            one.formula or "\n".join(parameter_lines(one.parameters, linear=linear)) or "a curve",
            _place(one.where),
            "yes" if one.in_file else "no",
        )
        for one in of.names
        if one.in_file or one.probability >= _WORTH
    ]


def _place(where: Where | None) -> str:
    """Where it acts, and how much of the mismatch that is."""
    if where is None:
        return ""
    text = where.text or "wherever the axis was"
    if where.share is None:
        return f"{text}\nbetween the shafts"
    return f"{text}\n{100 * where.share:.0f} % of what the belief misses"


def curve_rows(of: Published) -> list[tuple[str, ...]]:
    """What has no name, for a table."""
    unit = units_of(of.axis, "torque").torque
    return [
        (
            one.over,
            percent(one.probability),
            f"{one.torque_nm:.2g} {unit}" if one.torque_nm > 0 else "",
            _place(one.where),
            _known_of(one, of),
            "residual" if one.in_file else "no",
        )
        for one in of.curves
        if one.in_file or one.probability >= _WORTH
    ]


def _known_of(one: Curve, of: Published) -> str:
    if one.formula:
        missed = f" (misses {one.formula_missed:.3g} σ)" if one.formula_missed is not None else ""
        return f"{one.formula}, as good as the curve on runs kept aside{missed}"
    if one.like:
        name = words_of(one.like, linear=of.axis == "linear").name
        return f"like {name} ({one.like}), without being surely it"
    return "a curve: see its picture" if one.drawn is not None or one.plane is not None else "a curve"


def fact_rows(of: Published, units: Units) -> list[tuple[str, str]]:
    """Proof, noise and what is left."""
    rows = []
    if of.proof is not None:
        runs = f"run{'s' * (len(of.proof.runs) > 1)} {runs_text(of.proof.runs)}"
        before, after = (
            f", {value:.3g} {units.torque} RMS" if value is not None else ""
            for value in (of.proof.before_nm, of.proof.after_nm)
        )
        rows.append(
            (
                f"missed on {runs}, kept aside, by the belief",
                f"{of.proof.before:.3g} σ of the noise{before}",
            )
        )
        rows.append(("missed there by machine.toml, read back", f"{of.proof.after:.3g} σ{after}"))
        if of.verdict != "consistent" and of.proof.before > 1:  # of nothing there is no share
            left = f"{100 * (1 - of.proof.taken):.0f} %"
            rows.append(("left unexplained there, of what is beyond noise", left))
    if of.missed_runs:
        missed = ", ".join(f"{run} ({sigma:.3g} σ)" for run, sigma in of.missed_runs)
        rows.append(("plainly missed by machine.toml on runs that were fitted", missed))
    share = (
        f", and {100 * of.noise.torque_share:.2g} % of the {units.torque_word}"
        if of.noise.torque_share > 0
        else ""
    )
    rows.append((f"noise of the {units.torque_word}", f"{of.noise.torque_nm:.2g} {units.torque}{share}"))
    rows.append(("noise of the speed", f"{of.noise.speed_rad_s:.2g} {units.speed}"))
    rows.append((f"noise of the {units.position_word}", f"{of.noise.position_rad:.2g} {units.position}"))
    rows.append(timing_row(of, units))
    if of.noise.jitter_s > 0:
        rows.append(("samples are early or late by", f"{1e6 * of.noise.jitter_s:.2g} µs"))
    if of.lasting is not None:
        size = f"{of.lasting.torque_nm:.2g} {units.torque}, {of.lasting.over_noise:.2g} times what is noise"
        rows.append(("repeats of a motion differ, from run to run, by", size))
    if of.excess > _COLOURED:
        rows.append(("noise is coloured: samples count as", f"1/{of.excess:.2g} of their number"))
    return rows


def timing_row(of: Published, units: Units) -> tuple[str, str]:
    """By how much torque and speed, or angle, are reported apart, and whether drives usually are."""
    timing, later = of.timing, units.torque_word
    value, low, high = (
        1e6 * each for each in (timing.later_s.value, timing.later_s.low, timing.later_s.high)
    )
    sooner = "speed" if timing.than == "speed" else units.position_word
    if value < 0:
        later, sooner, value, low, high = sooner, later, -value, -high, -low
    usual = ", as is usual" if value < 1.96e6 * timing.usual_s else ""
    told = f"{value:.3g} µs ({low:.3g} … {high:.3g}){usual}".replace("-", "−")
    return f"the {later} is reported later than the {sooner}, beyond the belief, by", told


def set_rows(of: Published) -> list[tuple[str, str, str]]:
    """Whole sets of causes, where there is more than the published one."""
    rows = [
        (_set_text(names, of), percent(p), "this" if names == of.in_file else "")
        for names, p in of.runners_up
    ]
    return rows if len(rows) > 1 or any(not this for *_, this in rows) else []


def plain_rows(of: Published) -> list[tuple[str, str, str]]:
    """Laws that come near to all that is published without a name: a description, not a finding."""
    if of.plain is None:
        return []
    linear, share = of.axis == "linear", percent(of.plain.share)
    return [
        (words_of(name, linear=linear).name, "\n".join(parameter_lines(numbers, linear=linear)), share)
        for name, numbers in of.plain.laws.items()
    ]


def place_rows(of: Published) -> list[tuple[str, str]]:
    """Which coordinates the mismatch follows: what the belief misses, and what is left of it."""
    return [
        *(("the belief", one.text) for one in of.mismatch),
        *(("machine.toml", one.text) for one in of.remainder),
    ]


def separations(of: Published) -> Iterator[tuple[str, str]]:
    """A row for each pair of names that two sets of causes have in each other's place: what would tell them."""
    linear = of.axis == "linear"
    for first, other in of.confused:
        one, instead = (words_of(name, linear=linear).name for name in (first, other))
        yield f"{one.capitalize()}, or {instead} ({other})?", told_apart_by(first, other, linear=linear)


def _set_text(names: Sequence[str], of: Published) -> str:
    linear = of.axis == "linear"
    told = [
        words_of(name, linear=linear).name if name in PHYSICS else f"a curve over {over_words(name)}"
        for name in names
    ]
    return ", ".join(told) or "nothing"


# ------------------------------------------------------------------------------------------- pictures


def _speed_picture(of: Published, shown: Overlay, units: Units) -> Iterator[Picture]:
    """What the reported speed misses, where the mismatch is one of that: the torque shows nothing of it."""
    figure = speed_figure(shown, of.noise.speed_rad_s, units, named=bool(of.in_file))
    if figure is not None and any(one.of == "speed" for one in of.mismatch):
        caption = f"Run {shown.run}. What is missed is the reported speed, not the {units.torque_word}."
        yield Picture("reported_speed", "The reported speed", caption, figure)


def explanation_pictures(content: ExplanationContent) -> Iterator[Picture]:
    """Every picture for which there is something to show, in reading order."""
    of, units = content.published, content.units
    if of.names or of.curves:
        caption = (
            "Green: named in machine.toml. Blue: modelled without a name. Grey: told, but not published by this name. "
            f"The line is at {100 * NAMED:.0f} %."
        )
        yield Picture("probabilities", "Probabilities", caption, probabilities_figure(of))
    shown, runs, named = shown_overlay(of.overlays), judged(of.overlays), bool(of.in_file)
    if shown is not None:
        aside = "kept aside from fitting" if shown.heldout else "which was fitted"
        learned = " Green: the same by machine.toml, as it was read back." if named else ""
        caption = (
            f"Run {shown.run}, {aside}. Orange: the {units.torque_word} that the belief asks for the recorded motion."
            f"{learned} Within the grey band is noise."
        )
        share = of.noise.torque_share
        figure = overlay_figure(shown, of.noise.torque_nm, units, named=named, floor_share=share)
        yield Picture(
            "before_after", "Before and after" if named else "Measured and believed", caption, figure
        )
        yield from _speed_picture(of, shown, units)
    if runs and of.verdict != "consistent":
        yield Picture(
            "map", "Where it is missing", MAP, map_figure(runs, of.noise.torque_nm, units, named=named)
        )
    yield from named_pictures([one for one in of.names if one.in_file], of.overlays, content.believed, units)
    for name in of.names:
        if name.physics == "presliding_friction" and name.in_file:
            torque, stiffness = (name.parameters[key].value for key in ("torque_nm", "stiffness_nm_rad"))
            if isinstance(torque, float) and isinstance(stiffness, float) and min(torque, stiffness) > 0:
                title = "Friction that is a spring before it slides"
                caption = "Dahl's law with the values of the table above."
                yield Picture("presliding", title, caption, presliding_figure(torque, stiffness, units))
    for number, one in enumerate(of.curves):
        if one.plane is not None and one.in_file:
            title = f"Without a name, over {one.over}"
            caption = "Over the first, at five values of the second. Constant beyond the ends."
            yield Picture(f"unnamed{number}", title, caption, plane_figure(one, units))
        if one.drawn is not None and one.in_file:
            caption = "Band: 95 %. Constant beyond the ends. " + (
                f"Formula: {one.formula}." if one.formula else ""
            )
            title = f"Without a name, over {one.over}"
            yield Picture(f"unnamed{number}", title, caption, curve_figure(one, units))
    yield from located_pictures(of.mismatch, of.remainder)
