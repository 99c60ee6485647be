"""The trail: who did what to which drive, appended only, each entry with the hash of the one before.

`hash` is the SHA-256 of the entry's other fields as JSON with sorted keys; `before` is the hash of the entry
before, 64 zeros for the first. Who changes or removes an entry, other than the last ones, breaks the chain:
`broken_at` names the place. The last hash, written down elsewhere (it is in every archive), guards the end, too.
"""

from __future__ import annotations

import hashlib
import json
import sqlite3
from collections.abc import Iterable, Mapping
from dataclasses import asdict, dataclass
from typing import Any

from schwung.service.store import Store, now

FIRST = "0" * 64


@dataclass(frozen=True)
class Entry:
    """One line of the trail. `number` counts from 1 without gaps."""

    number: int
    at: str
    who: str
    action: str
    drive_id: str | None
    run_id: str | None
    detail: Mapping[str, Any]
    before: str
    hash: str


def hash_of(entry: Mapping[str, Any]) -> str:
    """The hash that an entry has to have."""
    content = {key: value for key, value in entry.items() if key != "hash"}
    return hashlib.sha256(json.dumps(content, sort_keys=True, ensure_ascii=False).encode()).hexdigest()


def broken_at(entries: Iterable[Entry]) -> int | None:
    """Number of the first entry that is not what was written, or does not follow the one before; None where all are
    well."""
    before = FIRST
    for number, entry in enumerate(entries, start=1):
        if entry.number != number or entry.before != before or entry.hash != hash_of(asdict(entry)):
            return number
        before = entry.hash
    return None


class Trail:
    """The trail in a store; may be written from any thread."""

    def __init__(self, store: Store) -> None:
        self._store = store

    def add(
        self, who: str, action: str, drive_id: str | None = None, run_id: str | None = None, **detail: Any
    ) -> Entry:
        """Append; on the disk when this returns. `detail` is what JSON can hold."""
        plain = json.loads(json.dumps(detail, default=str))
        with self._store.transaction() as db:
            last = db.execute("SELECT number, hash FROM trail ORDER BY number DESC LIMIT 1").fetchone()
            content = {
                "number": 1 if last is None else last["number"] + 1, "at": now(), "who": who, "action": action,
                "drive_id": drive_id, "run_id": run_id, "detail": plain,
                "before": FIRST if last is None else last["hash"],
            }  # fmt: skip
            entry = Entry(**content, hash=hash_of(content))
            db.execute(
                "INSERT INTO trail (number, at, who, action, drive_id, run_id, detail, before, hash) "
                "VALUES (?, ?, ?, ?, ?, ?, ?, ?, ?)",
                (
                    *list(content.values())[:6],
                    json.dumps(plain, ensure_ascii=False),
                    entry.before,
                    entry.hash,
                ),
            )
        return entry

    def entries(self, after: int = 0, limit: int | None = None, run_id: str | None = None) -> list[Entry]:
        """Entries with a number above `after`, in order."""
        where, values = "number > ?", [after]
        if run_id is not None:
            where, values = f"{where} AND run_id = ?", [after, run_id]  # type: ignore[list-item]
        query = f"SELECT * FROM trail WHERE {where} ORDER BY number LIMIT ?"
        return [_entry(row) for row in self._store.rows(query, *values, -1 if limit is None else limit)]

    def verify(self) -> int | None:
        """See `broken_at`."""
        return broken_at(self.entries())


def _entry(row: sqlite3.Row) -> Entry:
    held = dict(row)
    return Entry(**{**held, "detail": json.loads(held["detail"])})
