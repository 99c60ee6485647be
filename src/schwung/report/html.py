"""The report as one HTML file: no requests, no scripts, every text escaped."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Sequence
from html import escape
from importlib import resources
from pathlib import Path

import numpy as np

from schwung.drivetrain.inertia import deviation
from schwung.errors import InputError
from schwung.estimation.values import Estimate
from schwung.files import replace_file
from schwung.quantities import sentences_of
from schwung.report.content import ReportContent
from schwung.report.pictures import Picture, pictures
from schwung.report.rows import rows_of
from schwung.report.style import css_variables, to_svg

_VERDICTS = {
    "good": "✓ Good: this table can be believed",
    "doubtful": "! Doubtful: read the reasons before you export",
    "unusable": "✗ Unusable: do not write this table into a drive",
    "none": "No estimate: what was recorded is shown, nothing has been computed from it",
}
_MARKS = {"ok": "✓ ok", "note": "· note", "warning": "! warning", "stop": "✗ stop"}
_KINDS = {
    "third": "1/3 profile", "poly5": "polynomial", "scurve": "S-curve", "cosine": "cosine", "cycloid": "cycloid",
    "points": "optimised",
}  # fmt: skip
_LONG = 16  # rows; longer tables scroll within the page, and are whole on paper
_POLICY = "default-src 'none';style-src 'unsafe-inline'"  # the page may not fetch anything, whoever edits it


def write_report(content: ReportContent, path: Path) -> Path:
    """Write the report to `path`, whole or not at all; folders are made.

    Raises InputError where it cannot be written.
    """
    return write_page(render(content), path)


def write_page(text: str, path: Path) -> Path:
    """Write a page, whole or not at all; folders are made. Raises InputError where it cannot be written."""
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        reason = (error.strerror or str(error)).lower()
        raise InputError(str(path.parent), f"cannot be made: {reason}", "Choose another place.") from None
    replace_file(path, text)
    return path


def render(content: ReportContent) -> str:
    """The whole page as text."""
    drawn = list(pictures(content))
    leading = drawn.pop(0) if content.estimate is not None else None
    parts = [
        _header(content),
        _verdict(content.estimate),
        _numbers(content),
        drawn_figure(leading) if leading else "",
        *(section(picture.title, drawn_figure(picture)) for picture in drawn),
        *_tables(content),
        "<footer>Written by Schwung. This file needs nothing else: keep it, mail it, print it.</footer>",
    ]
    return sentences_of(content.session.effort)(page(content.title, parts))


def page(title: str, parts: Iterable[str]) -> str:
    """A whole page of HTML sections: escaped title, the look of every report, nothing fetched from anywhere."""
    css = css_variables() + resources.files("schwung.report").joinpath("page.css").read_text("utf-8")
    body = "\n".join(part for part in parts if part)
    return f"""<!doctype html>
<html lang="en">
<head>
<meta charset="utf-8">
<meta name="viewport" content="width=device-width,initial-scale=1">
<meta http-equiv="Content-Security-Policy" content="{_POLICY}">
<title>{escape(title)}</title>
<style>
{css}</style>
</head>
<body><main>
{body}
</main></body>
</html>
"""


def _header(content: ReportContent) -> str:
    created = content.session.created.replace("T", " ", 1)
    facts = (created, content.session.source, content.machine.name if content.machine else "")
    line = " · ".join(escape(fact) for fact in facts if fact)
    return f"<header><h1>{escape(content.title)}</h1><p>{line}</p></header>"


def _verdict(estimate: Estimate | None) -> str:
    verdict = estimate.trust.verdict if estimate else "none"
    reasons = estimate.trust.reasons if estimate else ()
    listing = bullets(reason[:1].upper() + reason[1:] for reason in reasons)
    return f'<section class="verdict {verdict}"><strong>{_VERDICTS[verdict]}</strong>{listing}</section>'


def _numbers(content: ReportContent) -> str:
    items = "".join(
        f"<div><dt>{escape(name)}</dt><dd>{escape(value)}<small>{escape(small)}</small></dd></div>"
        for name, value, small in (*_results(content), *_experiment(content))
    )
    return f'<dl class="numbers">{items}</dl>' if items else ""


def _results(content: ReportContent) -> Iterator[tuple[str, str, str]]:
    """Key numbers of what came out: name, value, small print."""
    units, estimate = content.units, content.estimate
    off = deviation(estimate.table, content.reference) if estimate else None
    if off is not None:
        small = f"largest {off.max_kgm2:.2g}"
        former = deviation(content.contrast.table, content.reference) if content.contrast else None
        if former is not None and content.contrast is not None:
            small += f"; {content.contrast.method} {former.rmse_kgm2:.2g}"
        yield f"RMSE to {content.reference_label}", f"{off.rmse_kgm2:.2g} {units.inertia}", small
    if content.following_error is not None:
        before, after = content.following_error.before_rms_rad, content.following_error.after_rms_rad
        small = f"{before * 1e3:.3g} m{units.position} before the export"
        yield "Following error RMS", f"{after * 1e3:.3g} m{units.position}", small
    if estimate is not None:
        trust = estimate.trust
        share = f"{100 * trust.relative_miv:.0f} % of the mean {units.inertia_word}"
        if estimate.traces:
            yield "MIV", f"{trust.miv_kgm2:.3g} {units.inertia}", share
        if trust.dpr is not None:
            yield "DPR", f"{trust.dpr:.2g}", "injected over commanded speed"
        if content.reach is not None:
            least = f"1σ; at best ±{content.reach.bound_kgm2:.2g} from this recording"
            yield "Good to", f"±{content.reach.table_kgm2:.2g} {units.inertia}", least
        yield _coverage(content, estimate)


def _coverage(content: ReportContent, estimate: Estimate) -> tuple[str, str, str]:
    units, first, last = content.units, *estimate.table.position_rad[[0, -1]]
    digits = max(0, 2 - int(np.floor(np.log10(last - first))))
    value = f"{_plain(first, digits)} … {_plain(last, digits)} {units.position}"
    degrees = f"{_plain(np.degrees(first), 0)}° to {_plain(np.degrees(last), 0)}°"
    return f"Covered {units.position_word}", value, degrees if content.session.axis == "rotary" else ""


def _plain(value: float, digits: int) -> str:
    """Rounded, with a proper minus, and without one before zero."""
    return f"{round(float(value), digits) + 0.0:.{digits}f}".replace("-", "−")


def _experiment(content: ReportContent) -> Iterator[tuple[str, str, str]]:
    """Key numbers of what was done."""
    run, units, session = content.shown_run, content.units, content.session
    if run is None:
        return
    if run.motion is not None:
        way = "there and back" if run.motion.returns else "one way"
        small = f"{abs(run.motion.distance_rad):.3g} {units.position} {way}, {_KINDS[run.motion.kind]}"
        yield "Motion", f"{run.motion.duration_s * 1e3:g} ms", small
    if run.excitation is not None:
        small = f"{run.excitation.amplitude_nm:.3g} {units.torque}"
        if content.machine is not None:
            share = run.excitation.amplitude_nm / content.machine.motor.peak_torque_nm
            small += f", {100 * share:.0f} % of the peak"
        yield "Injected sine", f"{run.excitation.frequency_hz:g} Hz", small
    small = f"{len(session.excited)} with injection, {run.sample_rate_hz:g} Hz"
    yield "Recorded", f"{len(session.runs)} run{'s' * (len(session.runs) != 1)}", small


def drawn_figure(picture: Picture) -> str:
    """A picture with its caption."""
    caption = f"<figcaption>{escape(picture.caption)}</figcaption>" if picture.caption else ""
    return f"<figure>{to_svg(picture.figure, picture.name, picture.title)}{caption}</figure>"


def section(title: str, inner: str) -> str:
    """A titled section; nothing where there is nothing in it."""
    return f"<section><h2>{escape(title)}</h2>{inner}</section>" if inner else ""


def _tables(content: ReportContent) -> Iterator[str]:
    checks = [(row.severity, row.name, row.text, row.remedy) for row in content.preflight]
    yield section("Preflight", rows_table(("Result", "Check", "Found", "Remedy"), checks, marked=True))
    changes = [(row.parameter, row.old, row.new, row.remark) for row in content.changes]
    head: tuple[str, ...] = ("Parameter", "Old", "New", "Remark")
    yield section("Parameters changed in the drive", rows_table(head, changes))
    head = ("Run", "Made by", "Period", "Off its grid, RMS", "99 %", "Maximum")
    sync = [
        (row.run, row.producer, *map(_time, (row.period_s, row.rms_s, row.p99_s, row.max_s)))
        for row in content.sync
    ]
    yield section("SYNC timing", rows_table(head, sync))
    linear, drive = content.session.axis == "linear", dict(content.session.drive or {})
    made = drive.pop("settings", None)  # what commissioning was told; its reasons are among the notes
    known = {key: value for key, value in made.items() if key != "reasons"} if isinstance(made, dict) else {}
    settings = (*content.settings.items(), *rows_of(known, linear))
    yield section("Settings", rows_table((), settings))
    yield section("Drive", rows_table((), list(rows_of(drive, linear))))
    yield section("Believed machine", rows_table((), list(_machine(content))))
    notes = (
        *((content.reach.text,) if content.reach else ()),
        *content.notes,
        *(content.estimate.notes if content.estimate else ()),
    )
    yield section("Notes", bullets(dict.fromkeys(notes)))  # each once, whoever passed it on


def bullets(texts: Iterable[str]) -> str:
    """A list; nothing where it is empty."""
    items = "".join(f"<li>{escape(text)}</li>" for text in texts)
    return f"<ul>{items}</ul>" if items else ""


def rows_table(head: Sequence[str], rows: Sequence[Sequence[str]], *, marked: bool = False) -> str:
    """A table without the columns that no row fills; nothing at all when there is no row.

    `marked`: the first column is a check's severity, written as a coloured mark with its word.
    """
    if not rows:
        return ""
    used = [column for column in range(len(rows[0])) if any(row[column] for row in rows)]
    top = "".join(f"<th>{escape(head[column])}</th>" for column in used) if head else ""
    lines = "".join(
        "<tr>" + "".join(_cell(row[column], marked and column == 0) for column in used) + "</tr>"
        for row in rows
    )
    kind = (
        'class="wide"' if len(rows) <= _LONG else 'class="wide long" tabindex="0"'
    )  # scrolled by keys as well
    return f"<div {kind}><table><thead><tr>{top}</tr></thead><tbody>{lines}</tbody></table></div>"


def _cell(text: str, mark: bool) -> str:
    if mark and text in _MARKS:
        return f'<td class="mark {text}">{_MARKS[text]}</td>'
    return f"<td>{escape(text)}</td>"


def _time(seconds: float) -> str:
    return f"{seconds * 1e3:g} ms" if seconds >= 1e-3 else f"{seconds * 1e6:.3g} µs"


def _machine(content: ReportContent) -> Iterable[tuple[str, str]]:
    """The believed parameters with their units; tables are drawn, not listed."""
    if content.machine is None:
        return ()
    tables = {"load": {"inertia_table", "torque_table"}}
    believed = content.machine.model_dump(exclude_none=True, exclude=tables)
    return rows_of(believed, content.session.axis == "linear")
