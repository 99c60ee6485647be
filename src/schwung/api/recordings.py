"""Recordings of others as sessions."""

from __future__ import annotations

from pathlib import Path

from schwung.fieldbus.canlog import LogRecipe, import_can_log
from schwung.files import replace_file
from schwung.session import Session
from schwung.session.guess import Guess, Proposal, propose
from schwung.session.imports import (
    Imported,
    import_recordings,
    make_recipe,
    read_recipe,
    read_table,
    write_session,
)
from schwung.session.imports.canframes import log_kind
from schwung.session.imports.units import unit
from schwung.session.interchange import FORMATS, read_any, write_any

__all__ = [
    "FORMATS",
    "Guess",
    "Imported",
    "LogRecipe",
    "Proposal",
    "Session",
    "draw_import",
    "import_can_log",
    "import_recordings",
    "log_kind",
    "make_recipe",
    "propose",
    "read_any",
    "read_recipe",
    "read_table",
    "unit",
    "write_any",
    "write_session",
]


def draw_import(proposal: Proposal, session: Session, title: str, path: Path) -> None:
    """What is taken for what, and why, as a PNG. Raises InputError where it cannot be written."""
    from schwung.report.figures_import import import_figure
    from schwung.report.style import to_png

    replace_file(path, to_png(import_figure(proposal, session, title)))
