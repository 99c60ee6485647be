"""Rows of the store as values."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import PurePath
from typing import Any

#: What a run may leave, by suffix; a file with another one is neither entered nor served.
MEDIA_TYPES = {
    ".h5": "application/x-hdf5",
    ".csv": "text/csv; charset=utf-8",
    ".toml": "application/toml",
    ".html": "text/html; charset=utf-8",
    ".json": "application/json",
    ".dcf": "text/plain; charset=utf-8",
    ".bin": "application/octet-stream",
    ".mat": "application/octet-stream",
    ".png": "image/png",
    ".zip": "application/zip",
    ".tnc": "text/plain; charset=utf-8",
    ".txt": "text/plain; charset=utf-8",
    ".st": "text/plain; charset=utf-8",
    ".md": "text/markdown; charset=utf-8",
    ".eds": "text/plain; charset=utf-8",
    ".dbc": "text/plain; charset=utf-8",
    ".log": "text/plain; charset=utf-8",
    ".asc": "text/plain; charset=utf-8",
    ".trc": "text/plain; charset=utf-8",
    ".blf": "application/octet-stream",
    ".mf4": "application/octet-stream",
    ".parquet": "application/octet-stream",
}


def media_type(name: str) -> str | None:
    """What HTTP calls a file of that name; None: it is none of a run's files."""
    return None if name.startswith(".") else MEDIA_TYPES.get(PurePath(name).suffix)


@dataclass(frozen=True)
class RunHead:
    """A run as a list shows it, without its documents."""

    id: str
    kind: str
    state: str
    who: str
    created: str
    drive_id: str | None


@dataclass(frozen=True)
class MachineRecord:
    """A machine that is believed in; its toml lies in the store's folder."""

    id: str
    name: str
    created: str
    who: str
    sha256: str


@dataclass(frozen=True)
class DriveRecord:
    """A drive: where it is, and which machine hangs on it. `identity` is what it said when it was last connected."""

    id: str
    name: str
    bus: str
    node_id: int
    profile: str | None
    machine_id: str | None
    identity: Mapping[str, Any] | None
    created: str
    who: str


@dataclass(frozen=True)
class FileRecord:
    """A file of a run."""

    id: str
    run_id: str
    name: str
    size: int
    sha256: str

    @property
    def media_type(self) -> str:
        """As HTTP calls it."""
        return media_type(self.name) or "application/octet-stream"


@dataclass(frozen=True)
class ResultRecord:
    """A session, estimate, explanation or export: what it is about, and its document."""

    id: str
    run_id: str
    created: str
    who: str
    document: Mapping[str, Any]
    verdict: str | None = None
    session_id: str | None = None
    drive_id: str | None = None
    machine_id: str | None = None
    file_id: str | None = None
    estimate_id: str | None = None


@dataclass(frozen=True)
class UnsafeRecord:
    """A drive that an interrupted run has left with changed parameters; `found` is how it was when looked at again."""

    id: str
    drive_id: str
    run_id: str
    created: str
    backup: str  # name of the file in the run's folder
    found: str | None
    settled: str | None
    how: str | None  # "restored" | "declined"
