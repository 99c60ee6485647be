"""What survives a reset of the drive: objects 1010 and 1011 (CiA 301 clauses 7.5.2.13, 7.5.2.14)."""

from __future__ import annotations

import json
import os
from collections.abc import Callable
from functools import partial
from pathlib import Path
from typing import Literal

from schwung_sim.drives.dictionary import AbortError, Code, NoAnswer, ObjectDictionary, Value, key
from schwung_sim.errors import BenchError

SAVE, LOAD = 0x65766173, 0x64616F6C  # "save", "load", least significant byte first

_GROUPS = {
    1: range(0x1000, 0xA000),
    2: range(0x1000, 0x2000),
    3: range(0x6000, 0xA000),
    4: range(0x2000, 0x6000),
}
#: commands and states of every drive, not parameters
_VOLATILE = {key(0x1003), key(0x6040)} | {key(index, n) for index in (0x1010, 0x1011) for n in range(5)}


#: What a memory holds after the supply failed while it was written: what it held before, nothing, or all that is new.
Cut = Literal["before", "defaults", "stored"]


class ParameterStore:
    """Parameters in non-volatile memory: a JSON file where `path` is given, else while this object lives.

    `ready` says whether the drive can store now, `volatile` which objects command and are never stored.
    Raises BenchError where the file is not one of ours.
    """

    def __init__(
        self, dictionary: ObjectDictionary, path: Path | None, ready: Callable[[], bool], volatile: set[int]
    ) -> None:
        self._dictionary, self._path, self._ready = dictionary, path, ready
        self._volatile = _VOLATILE | volatile
        self._cut: tuple[Cut, Callable[[], None]] | None = None
        self.was_cut = False  # the bench's own: the supply has failed while it stored
        self._stored: dict[int, Value] = self._read(path) if path is not None and path.exists() else {}
        for group in _GROUPS:
            dictionary.writers[key(0x1010, group)] = partial(self._save, group)
            dictionary.writers[key(0x1011, group)] = partial(self._restore, group)
            dictionary.readers[key(0x1010, group)] = dictionary.readers[key(0x1011, group)] = lambda: 1

    @staticmethod
    def _read(path: Path) -> dict[int, Value]:
        try:
            content = json.loads(path.read_text(encoding="utf-8"))
            return {int(k, 16): bytes.fromhex(v) if isinstance(v, str) else v for k, v in content.items()}
        except (OSError, ValueError, AttributeError, TypeError) as error:
            raise BenchError(
                str(path), f"is no drive memory ({error})", "Name a new file, or one that a bench wrote."
            ) from error

    def cut_power(self, left: Cut, power_cycle: Callable[[], None]) -> None:
        """Let the supply fail at the next command to store: nobody answers, and the drive boots with what is `left`.

        CiA 301 7.5.2.13 has storing confirmed when it is done: without an answer nobody knows. A memory is never left
        half written: drives keep two copies, or take their defaults where the checksum is wrong.
        """
        self._cut = left, power_cycle

    def keep_power(self) -> None:
        """The supply does not fail at the next command to store."""
        self._cut = None

    def power_up(self, only: range = _GROUPS[1]) -> None:
        """Defaults, then what was stored, for the objects in `only`; hooks are not called."""
        for k, entry in self._dictionary.entries.items():
            if entry.index in only and entry.index != 0x1018:
                self._dictionary.values[k] = self._stored.get(k, self._dictionary.defaults[k])

    def _save(self, group: int, signature: int) -> None:
        if signature != SAVE:
            raise AbortError(Code.CANNOT_STORE)
        self._check_ready()
        before, cut = dict(self._stored), self._cut
        for k, entry in self._dictionary.entries.items():
            if entry.index in _GROUPS[group] and entry.writable and k not in self._volatile:
                self._stored[k] = self._dictionary.values[k]
        if cut is not None and cut[0] != "stored":
            self._stored = before if cut[0] == "before" else {}
        self._write()
        if cut is not None:
            self._cut, self.was_cut = None, True
            cut[1]()
            raise NoAnswer

    def _restore(self, group: int, signature: int) -> None:
        if signature != LOAD:
            raise AbortError(Code.CANNOT_STORE)
        self._check_ready()
        self._stored = {k: v for k, v in self._stored.items() if k >> 8 not in _GROUPS[group]}
        self._write()

    def _check_ready(self) -> None:
        if not self._ready():
            raise AbortError(Code.DEVICE_STATE)

    def _write(self) -> None:
        if self._path is None:
            return
        content = {
            f"{k:06X}": v.hex() if isinstance(v, bytes) else v for k, v in sorted(self._stored.items())
        }
        new = self._path.with_name(self._path.name + ".new")
        try:
            new.write_text(json.dumps(content, indent=0))
            os.replace(new, self._path)
        except OSError as error:
            raise AbortError(Code.CANNOT_STORE) from error
