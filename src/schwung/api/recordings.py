"""Recordings of others as sessions."""

from __future__ import annotations

from schwung.fieldbus.canlog import LogRecipe, import_can_log
from schwung.session import Session
from schwung.session.imports import Imported, import_recordings, make_recipe, read_recipe, write_session
from schwung.session.imports.canframes import log_kind
from schwung.session.imports.units import unit
from schwung.session.interchange import FORMATS, read_any, write_any

__all__ = [
    "FORMATS",
    "Imported",
    "LogRecipe",
    "Session",
    "import_can_log",
    "import_recordings",
    "log_kind",
    "make_recipe",
    "read_any",
    "read_recipe",
    "unit",
    "write_any",
    "write_session",
]
