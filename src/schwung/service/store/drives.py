"""Drives: where each is, what it is, and which machine hangs on it."""

from __future__ import annotations

import json
import sqlite3
from collections.abc import Mapping
from typing import Any

from schwung.errors import InputError
from schwung.service.records import DriveRecord
from schwung.service.store.database import Database, now, unpacked
from schwung.service.values import new_id


class Drives(Database):
    """Drives that were added."""

    def add_drive(
        self, name: str, bus: str, node_id: int, profile: str | None, machine_id: str | None, who: str
    ) -> DriveRecord:
        """Add a drive. Raises InputError where one is at that place already."""
        record = DriveRecord(new_id(), name, bus, node_id, profile, machine_id, None, now(), who)
        try:
            self.insert("drive", **vars(record))
        except sqlite3.IntegrityError as error:
            raise InputError(
                f"bus {bus}, node {node_id}",
                "there is a drive at that place already",
                "Use it, or archive it first.",
            ) from error
        return record

    def change_drive(self, drive_id: str, **values: Any) -> DriveRecord:
        """Change name, profile, machine_id or identity."""
        self.row("drive", drive_id)
        allowed = {"name", "profile", "machine_id", "identity", "archived"}
        assert set(values) <= allowed
        if isinstance(values.get("identity"), Mapping):
            values["identity"] = json.dumps(dict(values["identity"]))
        with self.transaction() as db:
            for key, value in values.items():
                db.execute(f"UPDATE drive SET {key} = ? WHERE id = ?", (value, drive_id))
        return self.drive(drive_id)

    def drive(self, drive_id: str) -> DriveRecord:
        """One drive. Raises NotFoundError."""
        return _drive(self.row("drive", drive_id))

    def drives(self) -> list[DriveRecord]:
        """All drives that are not archived, the oldest first."""
        return [
            _drive(r) for r in self.rows("SELECT * FROM drive WHERE archived IS NULL ORDER BY created, id")
        ]


def _drive(row: sqlite3.Row) -> DriveRecord:
    return DriveRecord(
        row["id"], row["name"], row["bus"], row["node_id"], row["profile"], row["machine_id"],
        unpacked(row["identity"]), row["created"], row["who"],
    )  # fmt: skip
