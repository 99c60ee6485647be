"""Colours and files of the page: the report's palette as CSS, and the scripts that the browser gets from us alone."""

from __future__ import annotations

from pathlib import Path

from schwung.api.looks import PALETTE

STATIC = Path(__file__).parent / "static"
#: Where the browser finds them.
STATIC_URL = "/page"


def palette_css() -> str:
    """The report's colours as variables, for both themes; theme.css adds what only a page needs."""
    light = "".join(f"--{colour.name}:{colour.light};" for colour in PALETTE)
    dark = "".join(f"--{colour.name}:{colour.dark};" for colour in PALETTE)
    return f':root{{color-scheme:light;{light}}}:root[data-theme="dark"]{{color-scheme:dark;{dark}}}'


def head_html(version: str) -> str:
    """What stands in the head of every page: theme first, so that nothing is painted in the wrong one."""
    return (
        f'<script src="{STATIC_URL}/theme.js?{version}"></script>'
        f'<script src="{STATIC_URL}/in_order.js?{version}"></script>'
        f"<style>{palette_css()}</style>"
        f'<link rel="stylesheet" href="{STATIC_URL}/theme.css?{version}">'
        f'<script src="{STATIC_URL}/panels.js?{version}"></script>'
        f'<script src="{STATIC_URL}/upload.js?{version}"></script>'
    )


def stop_html(port: int | None, version: str) -> str:
    """STOP: plain HTML before everything else in the body, and its script. `port`: of STOP's own listener."""
    return (
        f'<div id="stop-bar"><button id="stop" type="button" data-port="{port or ""}" '
        'aria-label="STOP: quick stop of all drives, now" '
        'title="Quick stop of all drives: Escape or S. It is no safety function: keep the emergency stop in reach.">'
        'STOP<small aria-hidden="true">Esc or S</small></button>'
        '<div id="stop-word" role="alert" aria-live="assertive"></div></div>'
        f'<script src="{STATIC_URL}/stop.js?{version}"></script>'
    )
