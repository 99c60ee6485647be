"""The store's tables, and how an older store becomes a newer one: `user_version` counts the steps made."""

from __future__ import annotations

import re
import sqlite3
from collections.abc import Sequence
from pathlib import Path

from schwung.errors import InputError

#: One script per version, in order; a script that has been released is never changed.
MIGRATIONS: Sequence[str] = (
    """
    CREATE TABLE machine (
        id TEXT PRIMARY KEY, name TEXT NOT NULL, created TEXT NOT NULL, who TEXT NOT NULL,
        sha256 TEXT NOT NULL, archived TEXT
    ) STRICT;
    CREATE TABLE drive (
        id TEXT PRIMARY KEY, name TEXT NOT NULL, bus TEXT NOT NULL, node_id INTEGER NOT NULL, profile TEXT,
        machine_id TEXT REFERENCES machine(id), identity TEXT, created TEXT NOT NULL, who TEXT NOT NULL,
        archived TEXT
    ) STRICT;
    CREATE UNIQUE INDEX drive_place ON drive (bus, node_id) WHERE archived IS NULL;
    CREATE TABLE run (
        id TEXT PRIMARY KEY, kind TEXT NOT NULL, state TEXT NOT NULL, who TEXT NOT NULL, created TEXT NOT NULL,
        started TEXT, ended TEXT, drive_id TEXT REFERENCES drive(id), machine_id TEXT REFERENCES machine(id),
        request TEXT NOT NULL, result TEXT, error TEXT
    ) STRICT;
    CREATE INDEX run_created ON run (created);
    CREATE INDEX run_state ON run (state);
    CREATE TABLE file (
        id TEXT PRIMARY KEY, run_id TEXT NOT NULL REFERENCES run(id) ON DELETE CASCADE, name TEXT NOT NULL,
        size INTEGER NOT NULL, sha256 TEXT NOT NULL, UNIQUE (run_id, name)
    ) STRICT;
    CREATE TABLE session (
        id TEXT PRIMARY KEY, run_id TEXT NOT NULL REFERENCES run(id) ON DELETE CASCADE,
        file_id TEXT NOT NULL REFERENCES file(id) ON DELETE CASCADE, drive_id TEXT REFERENCES drive(id),
        machine_id TEXT REFERENCES machine(id), created TEXT NOT NULL, who TEXT NOT NULL, summary TEXT NOT NULL
    ) STRICT;
    CREATE TABLE estimate (
        id TEXT PRIMARY KEY, run_id TEXT NOT NULL REFERENCES run(id) ON DELETE CASCADE,
        session_id TEXT NOT NULL REFERENCES session(id) ON DELETE CASCADE, created TEXT NOT NULL, who TEXT NOT NULL,
        verdict TEXT NOT NULL, document TEXT NOT NULL
    ) STRICT;
    CREATE TABLE explanation (
        id TEXT PRIMARY KEY, run_id TEXT NOT NULL REFERENCES run(id) ON DELETE CASCADE,
        session_id TEXT NOT NULL REFERENCES session(id) ON DELETE CASCADE, created TEXT NOT NULL, who TEXT NOT NULL,
        verdict TEXT NOT NULL, document TEXT NOT NULL
    ) STRICT;
    CREATE TABLE export (
        id TEXT PRIMARY KEY, run_id TEXT NOT NULL REFERENCES run(id) ON DELETE CASCADE,
        drive_id TEXT NOT NULL REFERENCES drive(id), estimate_id TEXT, created TEXT NOT NULL, who TEXT NOT NULL,
        document TEXT NOT NULL
    ) STRICT;
    CREATE TABLE unsafe (
        id TEXT PRIMARY KEY, drive_id TEXT NOT NULL REFERENCES drive(id), run_id TEXT NOT NULL, created TEXT NOT NULL,
        backup TEXT NOT NULL, found TEXT, settled TEXT, how TEXT, who TEXT
    ) STRICT;
    CREATE TABLE trail (
        number INTEGER PRIMARY KEY, at TEXT NOT NULL, who TEXT NOT NULL, action TEXT NOT NULL, drive_id TEXT,
        run_id TEXT, detail TEXT NOT NULL, before TEXT NOT NULL, hash TEXT NOT NULL
    ) STRICT;
    CREATE TRIGGER trail_is_not_changed BEFORE UPDATE ON trail
        BEGIN SELECT RAISE(ABORT, 'the trail is only appended to'); END;
    CREATE TRIGGER trail_is_not_cut BEFORE DELETE ON trail
        BEGIN SELECT RAISE(ABORT, 'the trail is only appended to'); END;
    """,
)

_BUSY_S = 10.0


def open_store(path: Path, migrations: Sequence[str] = MIGRATIONS) -> sqlite3.Connection:
    """Open or make a store, and bring it to the newest version; one step is made whole or not at all.

    Raises InputError where the file is none of ours, is damaged, or is of a newer Schwung.
    """
    try:
        connection = sqlite3.connect(path, timeout=_BUSY_S, isolation_level=None, check_same_thread=False)
    except sqlite3.Error as error:
        raise InputError(str(path), f"cannot be opened ({error})", "Choose another --data folder.") from error
    try:
        connection.row_factory = sqlite3.Row
        connection.execute("PRAGMA journal_mode = WAL")
        connection.execute("PRAGMA synchronous = FULL")
        connection.execute("PRAGMA foreign_keys = ON")
        _migrate(connection, path, migrations)
    except sqlite3.DatabaseError as error:
        connection.close()
        raise InputError(
            str(path),
            f"is no store of Schwung's, or damaged ({error})",
            "Restore it from a copy, or move it away.",
        ) from error
    except BaseException:
        connection.close()
        raise
    return connection


def _migrate(connection: sqlite3.Connection, path: Path, migrations: Sequence[str]) -> None:
    version = _version(connection)
    if version > len(migrations):
        raise InputError(
            str(path),
            f"has version {version}, this Schwung knows {len(migrations)}",
            "Use the newer Schwung.",
        )
    while version < len(migrations):
        connection.execute("BEGIN IMMEDIATE")
        try:
            version = _version(connection)  # another process may have made this step meanwhile
            if version < len(migrations):
                for statement in _statements(migrations[version]):
                    connection.execute(statement)
                connection.execute(f"PRAGMA user_version = {version + 1}")
            connection.execute("COMMIT")
        except BaseException:
            connection.execute("ROLLBACK")
            raise
        version = _version(connection)


def _version(connection: sqlite3.Connection) -> int:
    return int(connection.execute("PRAGMA user_version").fetchone()[0])


def _statements(script: str) -> list[str]:
    """The statements of a script; `executescript` would commit before it begins."""
    found, begun = [], ""
    for piece in re.split(r"(?<=;)", script):
        begun += piece
        if sqlite3.complete_statement(begun):
            found.append(begun)
            begun = ""
    if begun.strip():
        raise ValueError(f"unfinished statement: {begun}")
    return found
