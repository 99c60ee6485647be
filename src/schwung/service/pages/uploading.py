"""Forms that send a file from the visitor's computer: plain HTML, sent by static/upload.js to the API."""

from __future__ import annotations

from collections.abc import Mapping
from html import escape

from schwung.service.incoming import NAMES, What
from schwung.service.pages.confirming import NOT_LOGGED_IN
from schwung.service.pages.desk import Desk, html
from schwung.service.pages.markup import Safe

_WORDS: Mapping[What, str] = {
    "recording": "a recording: CSV, TwinCAT Scope, MATLAB, MDF, Parquet",
    "session": "a session that Schwung wrote",
    "can_log": "a log of a CAN bus",
    "configuration": "a drive's configuration: DCF, EDS, concise DCF, backup",
}


def upload_form(
    desk: Desk, word: str, *, what: What | None = None, drive_id: str = "", drives: Mapping[str, str] | None = None,
    machines: Mapping[str, str] | None = None,
) -> None:  # fmt: skip
    """A form whose run is shown next. `what`: of a kind that is clear here; None: it is asked for."""
    asked = what is None
    first: What = "recording" if what is None else what
    parts = [_kind(first) if asked else f'<input type="hidden" name="what" value="{first}">']
    every = sorted({suffix for one in _WORDS for suffix in NAMES[one]}) if asked else sorted(NAMES[first])
    parts.append(
        _field(
            "File", f'<input class="sw-native" type="file" name="file" required accept="{",".join(every)}">'
        )
    )
    if asked:
        parts += [
            _field("EDS of the drive", _file("eds", ".eds,.dcf"), "can_log", "What its objects are."),
            _field("Node", '<input class="sw-native" type="number" name="node" min="1" max="127">', "can_log",
                   "Empty: the only one in the log."),
            _field("or a DBC", _file("dbc", ".dbc"), "can_log", "Signals by name, columns are guessed then."),
        ]  # fmt: skip
    if drive_id:
        parts.append(f'<input type="hidden" name="drive_id" value="{escape(drive_id, quote=True)}">')
    for name, label, options in (
        ("drive_id", "Drive", drives),
        ("machine_id", "Machine behind it", machines),
    ):
        if options:
            parts.append(
                _field(label, _select(name, {"": "none"} | dict(options)), "recording session can_log")
            )
    off = "" if desk.may_act else f' aria-disabled="true" title="{escape(NOT_LOGGED_IN, quote=True)}"'
    parts.append(
        f'<div class="sw-row"><button class="sw-button primary" type="submit"{off}>{escape(word)}</button></div>'
    )
    parts.append('<div class="said muted" role="status"></div>')
    html(f'<form class="sw-upload sw-column" data-what="{first}">{"".join(parts)}</form>')


def _kind(first: What) -> str:
    return _field("What it is", _select("what", {str(key): word for key, word in _WORDS.items()}, first))


def _select(name: str, options: Mapping[str, str], chosen: str = "") -> str:
    inner = "".join(
        f'<option value="{escape(key, quote=True)}"{" selected" if key == chosen else ""}>{escape(word)}</option>'
        for key, word in options.items()
    )
    return f'<select class="sw-native" name="{name}">{inner}</select>'


def _file(name: str, accept: str) -> str:
    return f'<input class="sw-native" type="file" name="{name}" accept="{accept}">'


def _field(label: str, control: str, belongs: str = "", help: str = "") -> Safe:
    shown = f' data-for="{belongs}"' if belongs else ""
    told = f'<span class="help">{escape(help)}</span>' if help else ""
    return Safe(
        f'<label class="sw-field"{shown}><span class="sw-label">{escape(label)}</span>{control}{told}</label>'
    )
