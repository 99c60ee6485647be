"""What comes from outside: which files, and the names that they get here; no name of theirs reaches the disk."""

from __future__ import annotations

from pathlib import PurePosixPath
from typing import Any, Literal

from pydantic import Field

from schwung.errors import InputError
from schwung.service.requests import Id, Request

What = Literal["session", "recording", "can_log", "configuration", "eds", "dbc"]

#: Suffixes that a file from outside may have, and the name that it gets.
NAMES: dict[What, dict[str, str]] = {
    "session": {suffix: f"upload{suffix}" for suffix in (".h5", ".mf4", ".parquet")},
    "recording": {suffix: f"recording{suffix}" for suffix in (".csv", ".txt", ".mat", ".mf4", ".parquet")},
    "can_log": {suffix: f"bus{suffix}" for suffix in (".log", ".asc", ".blf", ".trc", ".txt", ".mf4")},
    "configuration": {".dcf": "drive.dcf", ".bin": "drive.bin", ".json": "drive.backup.json", ".eds": "drive.eds"},
    "eds": {".eds": "drive.eds", ".dcf": "drive.dcf"},
    "dbc": {".dbc": "bus.dbc"},
}  # fmt: skip
#: What is kept as it is, for other runs to use.
KEPT: tuple[What, ...] = ("configuration", "eds", "dbc")
#: Options that name files: those come by their ids.
_FILES = {"files", "dbc", "eds"}


class ImportRequest(Request):
    """A file that came from outside and lies in the run's folder; asked for by an upload, never by name."""

    kind: Literal["import"]
    what: What
    name: str  # of the file in the run's folder; ours
    machine_id: Id | None = None
    drive_id: Id | None = None
    eds_file_id: Id | None = None
    dbc_file_id: Id | None = None
    guess: bool = False
    options: dict[str, Any] = Field(default_factory=dict)


def import_name(what: What, name: str) -> str:
    """Our name for a file from outside. Raises InputError where its suffix does not belong to what it shall be."""
    known = NAMES[what]
    suffix = PurePosixPath(name.replace("\\", "/")).suffix.lower()
    if suffix not in known:
        article = "an" if what == "eds" else "a"
        called = what.replace("_", " ").replace("eds", "EDS").replace("dbc", "DBC").replace("can", "CAN")
        raise InputError(
            "file", f"has a suffix that {article} {called} does not have", f"Send one of: {', '.join(known)}."
        )
    return known[suffix]


def require_no_files(options: dict[str, Any]) -> None:
    """Raise InputError for options that name files, which nobody may from here."""
    if taken := _FILES & set(options):
        raise InputError(
            f"options.{min(taken)}", "names files, which nobody may from here", "Upload it, and give its id."
        )
