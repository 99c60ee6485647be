"""What interrupted runs have left in drives, until it is put back or somebody declines to."""

from __future__ import annotations

import sqlite3

from schwung.service.records import UnsafeRecord
from schwung.service.store.database import Database, now
from schwung.service.values import new_id


class Unsafe(Database):
    """Backups that were not put back."""

    def add_unsafe(self, drive_id: str, run_id: str, backup: str) -> None:
        """Note that a drive holds what an interrupted run has changed; once per backup."""
        if not any(u.run_id == run_id and u.backup == backup for u in self.unsettled(drive_id)):
            self.insert("unsafe", id=new_id(), drive_id=drive_id, run_id=run_id, created=now(), backup=backup)

    def unsettled(self, drive_id: str | None = None) -> list[UnsafeRecord]:
        """What has been neither put back nor declined."""
        rows = self.rows("SELECT * FROM unsafe WHERE settled IS NULL ORDER BY created, id")
        return [_unsafe(r) for r in rows if drive_id is None or r["drive_id"] == drive_id]

    def note_found(self, unsafe_id: str, found: str) -> None:
        """How the drive was when it was looked at again."""
        with self.transaction() as db:
            db.execute("UPDATE unsafe SET found = ? WHERE id = ?", (found, unsafe_id))

    def settle(self, unsafe_id: str, how: str, who: str) -> None:
        """It has been put back, or somebody has declined to."""
        with self.transaction() as db:
            db.execute(
                "UPDATE unsafe SET settled = ?, how = ?, who = ? WHERE id = ?", (now(), how, who, unsafe_id)
            )


def _unsafe(row: sqlite3.Row) -> UnsafeRecord:
    return UnsafeRecord(**{key: row[key] for key in UnsafeRecord.__dataclass_fields__})
