"""What the parts of the service exchange."""

from __future__ import annotations

import re
import secrets
from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, Literal

from schwung.api.drives import BusOptions
from schwung.errors import InputError

RunState = Literal["queued", "running", "done", "failed", "cancelled", "interrupted"]
#: States that nothing follows.
ENDED: tuple[RunState, ...] = ("done", "failed", "cancelled", "interrupted")

DEFAULT_PORT = 8737
#: Largest upload (bytes): half an hour of 1 kHz samples, with room.
MAX_UPLOAD_BYTES = 256 << 20
#: Largest body that is no upload (bytes): a machine with its tables.
MAX_BODY_BYTES = 4 << 20

_ID = re.compile(r"[0-9a-f]{16}")


def new_id() -> str:
    """An id: 16 hexadecimal digits, by chance, so that nobody guesses another's and none becomes a path."""
    return secrets.token_hex(8)


def is_id(text: str) -> bool:
    """Whether a text has the form of an id."""
    return _ID.fullmatch(text) is not None


@dataclass(frozen=True)
class BusEntry:
    """A bus that the service was started with. `name` is all that clients know of it."""

    name: str
    options: BusOptions

    @property
    def text(self) -> str:
        """As people read it."""
        return f"{self.options.interface or 'default'} {self.options.channel or ''}".strip()


@dataclass(frozen=True)
class DriveSeed:
    """A drive that is there from the start (the demo's); it is added where the store does not have it yet."""

    name: str
    bus: str
    node_id: int
    profile: str | None = None
    machine_toml: str | None = None
    machine_name: str = ""


@dataclass(frozen=True)
class Settings:
    """How a service runs.

    `folder` holds store and files. `poll_s`: an idle drive that is connected is looked at so often (s); 0: never.
    """

    folder: Path
    buses: tuple[BusEntry, ...] = ()
    drives: tuple[DriveSeed, ...] = ()
    host: str = "127.0.0.1"
    port: int = DEFAULT_PORT
    stop_port: int | None = None  # None: the port after `port`, any where that is any; 0: any
    names: tuple[str, ...] = ()  # further host names under which we are reached
    poll_s: float = 1.0
    workers: int = 1  # computing jobs at a time
    demo: bool = False

    @property
    def is_loopback(self) -> bool:
        """Nobody but this computer reaches us."""
        return self.host in ("127.0.0.1", "localhost", "::1")

    def bus(self, name: str) -> BusEntry:
        """The bus of that name. Raises InputError where there is none."""
        for entry in self.buses:
            if entry.name == name:
                return entry
        known = ", ".join(entry.name for entry in self.buses) or "none"
        raise InputError("bus", f'there is no bus "{name}"', f"The service was started with: {known}.")


@dataclass(frozen=True)
class Progress:
    """How far a run is. `share` is None where nobody knows, `left_s` too."""

    phase: str = ""
    share: float | None = None
    left_s: float | None = None
    notes: tuple[str, ...] = ()


@dataclass(frozen=True)
class RunView:
    """One run as the store and the queue know it. `request` is what was asked for, `result` what came of it."""

    id: str
    kind: str
    state: RunState
    who: str
    created: str  # ISO 8601, UTC
    started: str | None = None
    ended: str | None = None
    drive_id: str | None = None
    machine_id: str | None = None
    request: Mapping[str, Any] = field(default_factory=dict)
    result: Mapping[str, Any] | None = None
    error: Mapping[str, Any] | None = None
    progress: Progress | None = None  # while it is queued or running
