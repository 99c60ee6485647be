"""A session that is whole already -> its file."""

from __future__ import annotations

import os
from pathlib import Path

from schwung.errors import InputError
from schwung.session.hdf5 import SessionWriter
from schwung.session.model import Session


def write_session(session: Session, path: Path, overwrite: bool = False) -> None:
    """Write a session file whole or not at all. Raises InputError where it exists already or cannot be written."""
    if path.exists() and not overwrite:
        raise InputError(str(path), "exists already", "Choose another --out, or add --overwrite.")
    unfinished = path.with_name(f".{path.name}.{os.getpid()}.import")
    try:
        writer = SessionWriter(
            unfinished, source=session.source, created=session.created, drive=session.drive, axis=session.axis,
            effort=session.effort, overwrite=True,
        )  # fmt: skip
        try:
            with writer:
                for run in session.runs:
                    writer.append(run)
        except InputError as error:
            raise InputError(str(path), error.problem, error.remedy) from error
        os.replace(unfinished, path)
    finally:
        unfinished.unlink(missing_ok=True)
