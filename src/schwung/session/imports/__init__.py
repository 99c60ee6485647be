"""Recordings from elsewhere (CSV, TwinCAT Scope, MATLAB, MDF, Parquet, CAN logs) -> a session."""

from schwung.session.imports.build import Imported, import_recordings, read_table
from schwung.session.imports.motions import motion_identity, repeats
from schwung.session.imports.recipe import Recipe, make_recipe, read_recipe
from schwung.session.writing import write_session

__all__ = [
    "Imported",
    "Recipe",
    "import_recordings",
    "make_recipe",
    "motion_identity",
    "read_recipe",
    "read_table",
    "repeats",
    "write_session",
]
