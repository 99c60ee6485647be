"""Sessions by the name of their file: HDF5, MDF4, Parquet."""

from __future__ import annotations

from pathlib import Path

from schwung.errors import InputError
from schwung.session.hdf5 import read_session
from schwung.session.interchange.mdf import read_mdf_session, write_mdf
from schwung.session.interchange.parquet import read_parquet_session, write_parquet
from schwung.session.model import Session
from schwung.session.writing import write_session

#: What a file's name ends with, and what that is.
FORMATS = {".h5": "HDF5", ".hdf5": "HDF5", ".mf4": "MDF4", ".parquet": "Parquet"}


def read_any(path: Path) -> Session:
    """A session in whichever of the formats. Raises InputError where the file is not there, or holds no session."""
    if not path.is_file():
        raise InputError(str(path), "there is no such file", "Check the path.")
    kind = _kind(path)
    if kind == "HDF5":
        return read_session(path)
    found = read_mdf_session(path) if kind == "MDF4" else read_parquet_session(path)
    if found is None:
        raise InputError(
            str(path), "holds signals, but no session of Schwung's",
            f"Make one: schwung import {path.name} --position NAME --torque NAME.",
        )  # fmt: skip
    return found


def write_any(session: Session, path: Path, overwrite: bool = False) -> None:
    """Write a session in the format that the name says, whole or not at all. Raises InputError for another name, a file
    that exists already, or one that cannot be written."""
    kind = _kind(path)
    if path.exists() and not overwrite:
        raise InputError(str(path), "exists already", "Choose another name, or add --overwrite.")
    if kind == "HDF5":
        write_session(session, path, overwrite)
    elif kind == "MDF4":
        write_mdf(session, path)
    else:
        write_parquet(session, path)


def _kind(path: Path) -> str:
    kind = FORMATS.get(path.suffix.lower())
    if kind is None:
        raise InputError(str(path), "its ending says no format", f"Use one of {', '.join(FORMATS)}.")
    return kind
