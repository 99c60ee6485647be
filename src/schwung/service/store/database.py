"""The SQLite file of the store and the folders beside it: transactions, rows, ids that are not there."""

from __future__ import annotations

import json
import sqlite3
import threading
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from datetime import UTC, datetime
from pathlib import Path
from typing import Any

from schwung.errors import InputError
from schwung.files import json_text
from schwung.service.store.schema import open_store
from schwung.service.values import is_id


class NotFoundError(InputError):
    """There is nothing with that id."""


def now() -> str:
    """This instant, ISO 8601, UTC, in milliseconds."""
    return datetime.now(UTC).isoformat(timespec="milliseconds")


class Database:
    """What the tables' classes rest on; knows none of them, but which folder belongs to which row."""

    def __init__(self, folder: Path) -> None:
        try:
            for place in (folder, folder / "runs", folder / "machines"):
                place.mkdir(parents=True, exist_ok=True)
        except OSError as error:
            reason = (error.strerror or str(error)).lower()
            raise InputError(
                str(folder), f"cannot be made: {reason}", "Choose another --data folder."
            ) from error
        self.folder = folder
        self._db = open_store(folder / "schwung.db")
        self._lock = threading.RLock()

    def close(self) -> None:
        """Close the database."""
        with self._lock:
            self._db.close()

    @contextmanager
    def transaction(self) -> Iterator[sqlite3.Connection]:
        """All of the block or nothing of it; may be nested."""
        with self._lock:
            outer = not self._db.in_transaction
            if outer:
                self._db.execute("BEGIN IMMEDIATE")
            try:
                yield self._db
            except BaseException:
                if outer:
                    self._db.execute("ROLLBACK")
                raise
            if outer:
                self._db.execute("COMMIT")

    def rows(self, query: str, *values: Any) -> list[sqlite3.Row]:
        """Rows of a query that only reads."""
        with self._lock:
            return self._db.execute(query, values).fetchall()

    def row(self, table: str, id: str) -> sqlite3.Row:
        """The row with that id. Raises NotFoundError."""
        if is_id(id):
            found = self.rows(f"SELECT * FROM {table} WHERE id = ?", id)
            if found:
                return found[0]
        raise NotFoundError(
            f"{table} {id[:40]}", "there is none with this id", f"List what there is: GET /api/{table}s."
        )

    def insert(self, table: str, **values: Any) -> None:
        """Add one row, its values by the names of the columns."""
        names, marks = ", ".join(values), ", ".join("?" * len(values))
        with self.transaction() as db:
            db.execute(f"INSERT INTO {table} ({names}) VALUES ({marks})", tuple(values.values()))

    def machine_folder(self, machine_id: str) -> Path:
        """Where a machine's files lie. Raises NotFoundError."""
        return self.folder / "machines" / str(self.row("machine", machine_id)["id"])

    def run_folder(self, run_id: str) -> Path:
        """Where a run's files lie. Raises NotFoundError."""
        return self.folder / "runs" / str(self.row("run", run_id)["id"])


def packed(document: Mapping[str, Any]) -> str:
    """A document as a row holds it."""
    return json_text(document)


def unpacked(text: str | None) -> Any:
    """And back; None where there is none."""
    return None if text is None else json.loads(text)
