"""Files of runs: entered with their SHA-256, found again, checked."""

from __future__ import annotations

import hashlib
import sqlite3
from pathlib import Path

from schwung.errors import InputError
from schwung.service.records import FileRecord, media_type
from schwung.service.store.database import Database
from schwung.service.values import new_id


class Files(Database):
    """Files of runs; which run each belongs to is known by its id alone."""

    def take_files(self, run_id: str) -> list[FileRecord]:
        """Enter the files that lie in a run's folder, as they are now; what has a name we do not know is left out."""
        for path in sorted(self.run_folder(run_id).iterdir()):
            if media_type(path.name) is not None and path.is_file():
                with path.open("rb") as file:
                    digest = hashlib.file_digest(file, "sha256").hexdigest()
                with self.transaction() as db:
                    db.execute(
                        "INSERT INTO file (id, run_id, name, size, sha256) VALUES (?, ?, ?, ?, ?) "
                        "ON CONFLICT (run_id, name) DO UPDATE SET size = excluded.size, sha256 = excluded.sha256",
                        (new_id(), run_id, path.name, path.stat().st_size, digest),
                    )
        return self.files(run_id)

    def files(self, run_id: str) -> list[FileRecord]:
        """The files of a run."""
        self.row("run", run_id)
        return [_file(r) for r in self.rows("SELECT * FROM file WHERE run_id = ? ORDER BY name", run_id)]

    def file(self, file_id: str) -> FileRecord:
        """One file. Raises NotFoundError."""
        return _file(self.row("file", file_id))

    def file_path(self, file_id: str, *, check: bool = False) -> Path:
        """Where a file lies. Raises NotFoundError, and InputError where it is gone, or with `check` not what it was."""
        record = self.file(file_id)
        path = self.folder / "runs" / record.run_id / record.name
        if not path.is_file():
            raise InputError(
                f"file {record.name} of run {record.run_id}", "is gone", "Restore it from a copy."
            )
        if check:
            with path.open("rb") as file:
                if hashlib.file_digest(file, "sha256").hexdigest() != record.sha256:
                    raise InputError(
                        f"file {record.name} of run {record.run_id}", "is not what it was: its SHA-256 differs",
                        "Restore it from a copy.",
                    )  # fmt: skip
        return path


def _file(row: sqlite3.Row) -> FileRecord:
    return FileRecord(row["id"], row["run_id"], row["name"], row["size"], row["sha256"])
