"""The report as one HTML file: no requests, no scripts, every text escaped."""

from __future__ import annotations

import os
import tempfile
from collections.abc import Iterable, Mapping, Sequence
from html import escape
from importlib import resources
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from schwung.errors import InputError
from schwung.report.content import ReportContent, deviation
from schwung.report.pictures import Picture, pictures
from schwung.report.signals import shown_run
from schwung.report.style import css_variables, to_svg

if TYPE_CHECKING:
    from schwung.estimation import Estimate

_VERDICTS = {
    "good": "✓ Good: this table can be believed",
    "doubtful": "! Doubtful: read the reasons before you export",
    "unusable": "✗ Unusable: do not write this table into a drive",
    "none": "No estimate: the session was recorded, nothing has been computed from it yet",
}
_MARKS = {"ok": "✓ ok", "warning": "! warning", "refused": "✗ refused", "info": "· note"}


def write_report(content: ReportContent, path: Path) -> Path:
    """Write the report to `path`, whole or not at all (temporary file, then rename).

    Raises InputError where the folder cannot be written.
    """
    page = render(content)
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        handle, name = tempfile.mkstemp(dir=path.parent, prefix=f".{path.name}.", suffix=".part")
    except OSError as error:
        raise InputError(
            str(path), f"cannot be written ({error.strerror})", "Choose another folder."
        ) from error
    temporary = Path(name)
    try:
        with os.fdopen(handle, "w", encoding="utf-8") as file:
            file.write(page)
        temporary.chmod(0o644)
        temporary.replace(path)
    except OSError as error:
        raise InputError(
            str(path), f"cannot be written ({error.strerror})", "Choose another file."
        ) from error
    finally:
        temporary.unlink(missing_ok=True)
    return path


def render(content: ReportContent) -> str:
    """The whole page as text."""
    drawn = pictures(content)
    first, rest = drawn[: content.estimate is not None], drawn[content.estimate is not None :]
    body = [
        _header(content),
        _verdict(content.estimate),
        _numbers(content),
        *(_figure(picture) for picture in first),
        *(_section(picture.title, _figure(picture)) for picture in rest),
        *_tables(content),
        "<footer>Written by Schwung. Self-contained: keep it, mail it, print it.</footer>",
    ]
    css = css_variables() + resources.files("schwung.report").joinpath("page.css").read_text("utf-8")
    return (
        '<!doctype html>\n<html lang="en">\n<head>\n<meta charset="utf-8">\n'
        '<meta name="viewport" content="width=device-width,initial-scale=1">\n'
        "<meta http-equiv=\"Content-Security-Policy\" content=\"default-src 'none';style-src 'unsafe-inline'\">\n"
        f"<title>{escape(content.title)}</title>\n<style>\n{css}</style>\n</head>\n<body><main>\n"
        + "\n".join(part for part in body if part)
        + "\n</main></body>\n</html>\n"
    )


def _header(content: ReportContent) -> str:
    session = content.session
    facts = [session.created, session.source, content.machine.name if content.machine else ""]
    line = " · ".join(escape(fact) for fact in facts if fact)
    return f"<header><h1>{escape(content.title)}</h1><p>{line}</p></header>"


def _verdict(estimate: Estimate | None) -> str:
    verdict = estimate.trust.verdict if estimate else "none"
    reasons = "".join(f"<li>{escape(reason)}</li>" for reason in (estimate.trust.reasons if estimate else ()))
    listing = f"<ul>{reasons}</ul>" if reasons else ""
    return f'<section class="verdict {verdict}"><strong>{_VERDICTS[verdict]}</strong>{listing}</section>'


def _numbers(content: ReportContent) -> str:
    """The key numbers, those that there are: (name, value, small print)."""
    units, estimate = content.units, content.estimate
    cards: list[tuple[str, str, str]] = []
    if estimate is not None and content.reference is not None:
        cards.extend(_accuracy(content, estimate))
    if content.following_error is not None:
        errors = content.following_error
        cards.append(("Following error RMS", f"{errors.after_rms_rad * 1e3:.3g} m{units.position}",
                      f"before the export {errors.before_rms_rad * 1e3:.3g} m{units.position}"))  # fmt: skip
    if estimate is not None:
        trust, position = estimate.trust, estimate.table.position_rad
        cards.append(("MIV", f"{trust.miv_kgm2:.3g} {units.inertia}",
                      f"{100 * trust.relative_miv:.0f} % of the mean {units.inertia_word}"))  # fmt: skip
        if trust.dpr is not None:
            cards.append(("DPR", f"{trust.dpr:.2g}", "injected over commanded speed"))
        degrees = f"{np.degrees(position[0]):.0f}° to {np.degrees(position[-1]):.0f}°"
        cards.append((f"Covered {units.position_word}", f"{position[0]:.3g} … {position[-1]:.3g} {units.position}",
                      degrees if content.session.axis == "rotary" else ""))  # fmt: skip
    if content.session.runs:
        cards.extend(_experiment(content))
    items = "".join(
        f"<div><dt>{escape(name)}</dt><dd>{escape(value)}<small>{escape(small)}</small></dd></div>"
        for name, value, small in cards
    )
    return f'<dl class="numbers">{items}</dl>' if items else ""


def _accuracy(content: ReportContent, estimate: Estimate) -> list[tuple[str, str, str]]:
    if content.reference is None:
        return []
    off = deviation(estimate.table, content.reference)
    if off is None:
        return []
    small = f"largest {off.max_kgm2:.2g}"
    former = deviation(content.contrast.table, content.reference) if content.contrast else None
    if former is not None and content.contrast is not None:
        small += f"; {content.contrast.method} method {former.rmse_kgm2:.2g}"
    return [(f"RMSE to {content.reference_label}", f"{off.rmse_kgm2:.2g} {content.units.inertia}", small)]


def _experiment(content: ReportContent) -> list[tuple[str, str, str]]:
    run, units, cards = shown_run(content), content.units, []
    if run.motion is not None:
        kind = "there and back" if run.motion.returns else "one way"
        cards.append(("Motion", f"{run.motion.duration_s * 1e3:g} ms",
                      f"{abs(run.motion.distance_rad):.3g} {units.position} {kind}, {run.motion.kind}"))  # fmt: skip
    if run.excitation is not None:
        small = f"{run.excitation.amplitude_nm:.3g} {units.torque}"
        if content.machine is not None:
            share = run.excitation.amplitude_nm / content.machine.motor.peak_torque_nm
            small += f", {100 * share:.0f} % of the peak"
        cards.append(("Injected sine", f"{run.excitation.frequency_hz:g} Hz", small))
    session = content.session
    cards.append(("Recorded", f"{len(session.runs)} runs",
                  f"{len(session.references)} without, {len(session.excited)} with injection, "
                  f"{run.sample_rate_hz:g} Hz"))  # fmt: skip
    return cards


def _figure(picture: Picture) -> str:
    return (
        f"<figure>{to_svg(picture.figure, picture.name, picture.title)}"
        f"<figcaption>{escape(picture.caption)}</figcaption></figure>"
    )


def _section(title: str, inner: str) -> str:
    return f"<section><h2>{escape(title)}</h2>{inner}</section>" if inner else ""


def _tables(content: ReportContent) -> Iterable[str]:
    checks = [(_Mark(row.status), row.name, row.found, row.allowed, row.remark) for row in content.preflight]
    yield _section("Preflight", _table(("", "Check", "Found", "Allowed", "Remark"), checks))
    changes = [(row.parameter, row.old, row.new, row.remark) for row in content.changes]
    yield _section("Parameters changed in the drive", _table(("Parameter", "Old", "New", ""), changes))
    sync = [
        (row.run, row.producer, f"{row.period_s * 1e3:g} ms", f"{row.rms_s * 1e6:.0f} µs", f"{row.p99_s * 1e6:.0f} µs",
         f"{row.max_s * 1e6:.0f} µs", str(row.lost))
        for row in content.sync
    ]  # fmt: skip
    yield _section(
        "SYNC timing", _table(("Run", "Made by", "Period", "RMS", "99 %", "Maximum", "Lost samples"), sync)
    )
    yield _section("Settings", _table((), list(content.settings.items())))
    yield _section("Drive", _table((), list(_flat(content.session.drive or {}))))
    notes = (*content.notes, *(content.estimate.notes if content.estimate else ()))
    items = "".join(f"<li>{escape(note)}</li>" for note in notes)
    yield _section("Notes", f"<ul>{items}</ul>" if items else "")


class _Mark(str):
    """A check's status, drawn as a coloured mark with its word."""


def _table(head: Sequence[str], rows: Sequence[Sequence[str]]) -> str:
    """A table without the columns that no row fills; empty text when there is no row."""
    if not rows:
        return ""
    used = [column for column in range(len(rows[0])) if any(row[column] for row in rows)]
    top = "".join(f"<th>{escape(head[column])}</th>" for column in used) if head else ""
    lines = "".join("<tr>" + "".join(_cell(row[column]) for column in used) + "</tr>" for row in rows)
    thead = f"<thead><tr>{top}</tr></thead>" if top else ""
    return f'<div class="wide"><table>{thead}<tbody>{lines}</tbody></table></div>'


def _cell(text: str) -> str:
    if isinstance(text, _Mark):
        return f'<td class="mark {text}">{_MARKS[text]}</td>'
    return f"<td>{escape(text)}</td>"


def _flat(values: Mapping[str, Any], prefix: str = "") -> Iterable[tuple[str, str]]:
    """Nested JSON as rows: "identity / serial", "1"."""
    for name, value in values.items():
        label = f"{prefix}{name}"
        if isinstance(value, Mapping):
            yield from _flat(value, f"{label} / ")
        elif isinstance(value, (list, tuple)):
            yield label, ", ".join(str(item) for item in value)
        elif value is not None:
            yield label, str(value)
