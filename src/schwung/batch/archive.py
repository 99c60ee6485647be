"""Which sessions an archive holds, which machine belongs to each, and the key by which a result is found again."""

from __future__ import annotations

import glob
import hashlib
import json
from collections.abc import Sequence
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Literal

from schwung.drivetrain import machine_files
from schwung.errors import InputError
from schwung.estimation.values import Inversion

Kind = Literal["estimate", "explain"]

#: What commissioning leaves beside every session, and what people put there.
MACHINE_NAMES = ("measured.toml", "machine.toml")
#: The motion after an export: one recording without injection, which gives no estimate.
_NO_SESSION = "verification.h5"


@dataclass(frozen=True)
class Wish:
    """What shall be done with every session; all but `kind` as `schwung estimate` and `explain` have it."""

    kind: Kind
    method: str = "auto"
    inversion: Inversion = "complex"
    frequency_hz: float | None = None
    points: int | None = None


@dataclass(frozen=True)
class Item:
    """One session of the archive and the machine file that is believed of it; absolute paths."""

    session: Path
    machine: Path | None  # None: there is none beside it


def items_of(patterns: Sequence[str], machine: Path | None) -> tuple[Item, ...]:
    """The sessions that patterns name: files, globs (`**` too), or folders with all *.h5 below them; each once.

    `machine`: of all of them; None: the one beside each session. Raises InputError for a pattern without a file.
    """
    found: dict[Path, None] = {}
    for pattern in patterns:
        for path in _files_of(pattern):
            found.setdefault(path.resolve(), None)
    return tuple(Item(path, machine.resolve() if machine else _beside(path)) for path in found)


def _files_of(pattern: str) -> list[Path]:
    folder = Path(pattern)
    if folder.is_dir():
        files = [path for path in folder.rglob("*.h5") if path.name != _NO_SESSION]
    elif folder.is_file():
        files = [folder]
    else:
        files = [Path(name) for name in glob.glob(pattern, recursive=True) if Path(name).is_file()]
    if not files:
        raise InputError(pattern, "names no session file", 'Give a folder, or a pattern as "plant/**/*.h5".')
    return sorted(files)


def _beside(session: Path) -> Path | None:
    there = (session.with_name(name) for name in MACHINE_NAMES)
    return next((path for path in there if path.is_file()), None)


def key_of(item: Item, wish: Wish) -> str:
    """SHA-256 (hexadecimal) of the session's bytes, of the machine file's and its tables', and of the wish.

    A file that was moved or renamed keeps its result; one of which a byte changed has none. Raises InputError where
    a file cannot be read, or no machine file is there.
    """
    if item.machine is None:
        names = " nor ".join(MACHINE_NAMES)
        raise InputError(str(item.session), f"has neither {names} beside it", "Give --machine.")
    whole = hashlib.sha256(json.dumps(asdict(wish), sort_keys=True).encode())
    for path in (item.session, *machine_files(item.machine)):
        whole.update(digest_of(path).encode())
    return whole.hexdigest()


def digest_of(path: Path) -> str:
    """SHA-256 of a file, hexadecimal. Raises InputError where it cannot be read."""
    try:
        with path.open("rb") as file:
            return hashlib.file_digest(file, "sha256").hexdigest()
    except OSError as error:
        reason = (error.strerror or str(error)).lower()
        raise InputError(str(path), f"cannot be read: {reason}", "Check path and permissions.") from None
