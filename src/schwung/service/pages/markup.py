"""Small pieces of HTML, escaped: tables, tags, checks, numbers. What people read is written here once."""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping, Sequence
from html import escape
from typing import Any, Literal

Tone = Literal["", "good", "doubtful", "unusable", "live", "off"]


class Safe(str):
    """Text that is HTML already; everything else is escaped."""

    __slots__ = ()


def text(value: Any) -> Safe:
    """Anything as HTML."""
    return (
        value
        if isinstance(value, Safe)
        else Safe(escape("–" if value is None or value == "" else str(value)))
    )


def tag(word: str, tone: Tone = "") -> Safe:
    """A word with a sign and a colour."""
    return Safe(f'<span class="tag {tone}">{escape(word)}</span>')


def link(url: str, word: str) -> Safe:
    """A link within the service."""
    return Safe(f'<a href="{escape(url, quote=True)}">{escape(word)}</a>')


def muted(word: str) -> Safe:
    """What matters less."""
    return Safe(f'<span class="muted">{escape(word)}</span>')


def table(
    heads: Sequence[str], rows: Iterable[Sequence[Any]], numbers: Sequence[int] = (), empty: str = ""
) -> Safe:
    """A table; columns in `numbers` are aligned to the right. `empty`: said where there is no row."""

    def cells(values: Sequence[Any], element: str) -> str:
        parts = (
            f"<{element}{' class=number' if n in numbers else ''}>{text(value)}</{element}>"
            for n, value in enumerate(values)
        )
        return "".join(parts)

    body = "".join(f"<tr>{cells(row, 'td')}</tr>" for row in rows)
    if not body:
        return Safe(f'<div class="sw-empty">{escape(empty or "Nothing yet.")}</div>')
    head = f"<thead><tr>{cells([Safe(escape(h)) for h in heads], 'th')}</tr></thead>"
    return Safe(f'<div class="sw-scroll"><table class="sw">{head}<tbody>{body}</tbody></table></div>')


def facts(pairs: Iterable[tuple[str, Any]]) -> Safe:
    """Names and values, one below the other."""
    return Safe(
        '<dl class="sw">' + "".join(f"<dt>{escape(k)}</dt><dd>{text(v)}</dd>" for k, v in pairs) + "</dl>"
    )


def numbers(items: Iterable[tuple[str, str, str]]) -> Safe:
    """A row of figures: value, unit, what it is."""
    cells = (
        f"<div><b>{text(v)} <small>{escape(u)}</small></b><span>{escape(w)}</span></div>" for v, u, w in items
    )
    return Safe(f'<div class="sw-numbers">{"".join(cells)}</div>')


_SEVERITY: Mapping[str, tuple[str, Tone]] = {
    "ok": ("ok", "good"),
    "note": ("note", ""),
    "warning": ("warning", "doubtful"),
    "stop": ("stop", "unusable"),
}


def checks(found: Iterable[Mapping[str, Any]]) -> Safe:
    """Findings with their remedies, the gravest first."""
    order = list(_SEVERITY)[::-1]
    items = sorted(found, key=lambda c: order.index(c["severity"]) if c["severity"] in order else 0)
    parts = []
    for check in items:
        word, tone = _SEVERITY.get(check["severity"], (check["severity"], ""))
        remedy = f'<span class="remedy">{escape(check["remedy"])}</span>' if check.get("remedy") else ""
        name = f'<span class="name">{escape(check["name"])}</span>'
        parts.append(
            f"<li><span>{tag(word, tone)}</span>{name}<span>{escape(check['text'])}{remedy}</span></li>"
        )
    return Safe(f'<ul class="sw-checks">{"".join(parts)}</ul>')


def verdict(tone: Tone, word: str, reasons: Sequence[str]) -> Safe:
    """A judgement in words, and why."""
    why = "".join(f"<li>{escape(reason)}</li>" for reason in reasons)
    listed = f"<ul>{why}</ul>" if why else ""
    return Safe(f'<div class="sw-verdict {tone}"><div>{tag(word, tone)}</div><div>{listed}</div></div>')


def problem(error: Mapping[str, Any] | BaseException) -> Safe:
    """What went wrong, and what to do: the sentence and the remedy of a SchwungError."""
    if isinstance(error, BaseException):
        place, what, remedy = (getattr(error, key, "") for key in ("place", "problem", "remedy"))
        told, notes = str(error), list(getattr(error, "__notes__", ()))
    else:
        place, what, remedy = (str(error.get(key) or "") for key in ("place", "problem", "remedy"))
        told, notes = str(error.get("text") or error.get("detail") or ""), list(error.get("notes") or ())
    sentence = f"{place}: {what}" if what else told
    parts = [f"<b>{escape(sentence)}</b>"]
    parts += [f"<span>{escape(remedy)}</span>"] if remedy else []
    parts += [f"<div>{escape(str(note))}</div>" for note in notes]
    return Safe(f'<div class="sw-problem" role="alert">{"".join(parts)}</div>')


def si(value: Any, digits: int = 4) -> str:
    """A number to so many significant digits, without an exponent where people write none; – where there is none."""
    if not isinstance(value, int | float) or isinstance(value, bool) or not math.isfinite(value):
        return "–"
    if value == 0:
        return "0"
    size = math.floor(math.log10(abs(value)))
    if -4 <= size < 6:
        return f"{value:.{max(0, digits - 1 - size)}f}".replace("-", "−")
    return f"{value:.{digits - 1}e}".replace("-", "−").replace("e+0", "e").replace("e−0", "e−")


def percent(share: Any) -> str:
    """A share of one, as people read it."""
    return f"{si(100 * share, 3)} %" if isinstance(share, int | float) and math.isfinite(share) else "–"


def time_left(seconds: float | None) -> str:
    """How long something goes on yet."""
    if seconds is None or not math.isfinite(seconds):
        return ""
    if seconds < 90:
        return f"{max(round(seconds), 1)} s left"
    return f"{round(seconds / 60)} min left"


def moment(iso: str | None) -> str:
    """A time stamp of the store, as a list shows it (UTC)."""
    return (iso or "").replace("T", " ")[:19] or "–"
