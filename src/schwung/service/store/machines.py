"""Machines that are believed in: their rows, and the folders of their files."""

from __future__ import annotations

import hashlib
import sqlite3
from pathlib import Path

from schwung.service.records import MachineRecord
from schwung.service.store.database import Database, now
from schwung.service.values import new_id


class Machines(Database):
    """Machines and their files."""

    def machine_path(self, machine_id: str) -> Path:
        """The machine.toml of a machine."""
        return self.machine_folder(machine_id) / "machine.toml"

    def new_machine_folder(self) -> Path:
        """A folder for a machine that is about to be added; its name is the id."""
        folder = self.folder / "machines" / new_id()
        folder.mkdir()
        return folder

    def add_machine(self, folder: Path, name: str, who: str) -> MachineRecord:
        """Add the machine whose files lie in a folder of `new_machine_folder`."""
        digest = hashlib.sha256()
        for path in sorted(folder.iterdir()):
            digest.update(path.name.encode() + b"\0" + path.read_bytes())
        record = MachineRecord(folder.name, name, now(), who, digest.hexdigest())
        self.insert("machine", **vars(record))
        return record

    def machine(self, machine_id: str) -> MachineRecord:
        """One machine. Raises NotFoundError."""
        return _machine(self.row("machine", machine_id))

    def machines(self) -> list[MachineRecord]:
        """All machines, the newest first."""
        return [
            _machine(r)
            for r in self.rows("SELECT * FROM machine WHERE archived IS NULL ORDER BY created DESC")
        ]


def _machine(row: sqlite3.Row) -> MachineRecord:
    return MachineRecord(row["id"], row["name"], row["created"], row["who"], row["sha256"])
