"""The store: what outlives the process. SQLite for what is looked for, files beside it for what is recorded.

    folder/schwung.db            drives, machines, runs, sessions, estimates, explanations, exports, the trail
    folder/runs/<id>/            the files of one run: session.h5, *.backup.json, inertia.csv, report.html, …
    folder/machines/<id>/        machine.toml with its tables

Ids come from `new_id`; names of files are ours. Every method may be called from any thread; each change is one
transaction, on the disk when the method returns. Times are ISO 8601, UTC. Raises NotFoundError for an id that is
not there.
"""

from __future__ import annotations

import hashlib
import json
import shutil
import sqlite3
import threading
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from datetime import UTC, datetime
from pathlib import Path
from typing import Any

from schwung.errors import InputError
from schwung.files import json_text
from schwung.service.records import (
    DriveRecord,
    FileRecord,
    MachineRecord,
    ResultRecord,
    RunHead,
    UnsafeRecord,
    media_type,
)
from schwung.service.schema import open_store
from schwung.service.values import ENDED, RunState, RunView, is_id, new_id


class NotFoundError(InputError):
    """There is nothing with that id."""


def now() -> str:
    """This instant, ISO 8601, UTC, in milliseconds."""
    return datetime.now(UTC).isoformat(timespec="milliseconds")


class Store:
    """See the module. Closed by `close`, after which nothing may be called."""

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

    def _row(self, table: str, id: str) -> sqlite3.Row:
        if is_id(id):
            found = self.rows(f"SELECT * FROM {table} WHERE id = ?", id)
            if found:
                return found[0]
        raise NotFoundError(
            f"{table} {id[:40]}", "there is none with this id", f"List what there is: GET /api/{table}s."
        )

    def _insert(self, table: str, **values: Any) -> None:
        names, marks = ", ".join(values), ", ".join("?" * len(values))
        with self.transaction() as db:
            db.execute(f"INSERT INTO {table} ({names}) VALUES ({marks})", tuple(values.values()))

    def count_runs(self) -> dict[str, int]:
        """How many runs there are by state."""
        rows = self.rows("SELECT state, count(*) AS number FROM run GROUP BY state")
        return {str(row["state"]): int(row["number"]) for row in rows}

    # ── machines ─────────────────────────────────────────────────────────────────────────────────────────────────

    def machine_folder(self, machine_id: str) -> Path:
        """Where a machine's files lie. Raises NotFoundError."""
        return self.folder / "machines" / str(self._row("machine", machine_id)["id"])

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
        self._insert("machine", **vars(record))
        return record

    def machine(self, machine_id: str) -> MachineRecord:
        """One machine. Raises NotFoundError."""
        return _machine(self._row("machine", machine_id))

    def machines(self) -> list[MachineRecord]:
        """All machines, the newest first."""
        return [
            _machine(r)
            for r in self.rows("SELECT * FROM machine WHERE archived IS NULL ORDER BY created DESC")
        ]

    # ── drives ───────────────────────────────────────────────────────────────────────────────────────────────────

    def add_drive(
        self, name: str, bus: str, node_id: int, profile: str | None, machine_id: str | None, who: str
    ) -> DriveRecord:
        """Add a drive. Raises InputError where one is at that place already."""
        record = DriveRecord(new_id(), name, bus, node_id, profile, machine_id, None, now(), who)
        try:
            self._insert("drive", **vars(record))
        except sqlite3.IntegrityError as error:
            raise InputError(
                f"bus {bus}, node {node_id}",
                "there is a drive at that place already",
                "Use it, or archive it first.",
            ) from error
        return record

    def change_drive(self, drive_id: str, **values: Any) -> DriveRecord:
        """Change name, profile, machine_id or identity."""
        self._row("drive", drive_id)
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
        return _drive(self._row("drive", drive_id))

    def drives(self) -> list[DriveRecord]:
        """All drives that are not archived, the oldest first."""
        return [
            _drive(r) for r in self.rows("SELECT * FROM drive WHERE archived IS NULL ORDER BY created, id")
        ]

    # ── runs ─────────────────────────────────────────────────────────────────────────────────────────────────────

    def add_run(
        self, kind: str, request: Mapping[str, Any], who: str, drive_id: str | None, machine_id: str | None
    ) -> RunView:
        """Accept a run: queued, with a folder of its own."""
        run_id = new_id()
        (self.folder / "runs" / run_id).mkdir()
        self._insert(
            "run", id=run_id, kind=kind, state="queued", who=who, created=now(), drive_id=drive_id,
            machine_id=machine_id, request=_json(request),
        )  # fmt: skip
        return self.run(run_id)

    def run_folder(self, run_id: str) -> Path:
        """Where a run's files lie. Raises NotFoundError."""
        return self.folder / "runs" / str(self._row("run", run_id)["id"])

    def begin_run(self, run_id: str) -> None:
        """queued → running."""
        with self.transaction() as db:
            db.execute("UPDATE run SET state = 'running', started = ? WHERE id = ?", (now(), run_id))

    def end_run(
        self, run_id: str, state: RunState, result: Mapping[str, Any] | None = None,
        error: Mapping[str, Any] | None = None,
    ) -> RunView:  # fmt: skip
        """To a last state, together with its files, which are looked at here."""
        assert state in ENDED
        with self.transaction() as db:
            self.take_files(run_id)
            db.execute(
                "UPDATE run SET state = ?, ended = ?, result = ?, error = ? WHERE id = ?",
                (
                    state,
                    now(),
                    None if result is None else _json(result),
                    None if error is None else _json(error),
                    run_id,
                ),
            )
        return self.run(run_id)

    def run(self, run_id: str) -> RunView:
        """One run. Raises NotFoundError."""
        return _run(self._row("run", run_id))

    def runs(
        self, *, state: str | None = None, kind: str | None = None, drive_id: str | None = None, limit: int = 200,
        before: str | None = None,
    ) -> list[RunView]:  # fmt: skip
        """Runs, the newest first; `before`: only those made before that time, for the next page."""
        given = {"state = ?": state, "kind = ?": kind, "drive_id = ?": drive_id, "created < ?": before}
        wanted = {clause: value for clause, value in given.items() if value is not None}
        where = f"WHERE {' AND '.join(wanted)}" if wanted else ""
        query = f"SELECT * FROM run {where} ORDER BY created DESC, id LIMIT ?"
        return [_run(row) for row in self.rows(query, *wanted.values(), limit)]

    def run_heads(
        self, *, kind: str | None = None, drive_id: str | None = None, limit: int = 200
    ) -> list[RunHead]:
        """Runs, the newest first, without their documents: a list of plans would read megabytes."""
        given = {"kind = ?": kind, "drive_id = ?": drive_id}
        wanted = {clause: value for clause, value in given.items() if value is not None}
        where = f"WHERE {' AND '.join(wanted)}" if wanted else ""
        query = f"SELECT id, kind, state, who, created, drive_id FROM run {where} ORDER BY created DESC, id LIMIT ?"
        return [RunHead(**row) for row in self.rows(query, *wanted.values(), limit)]

    def ids_that_begin(self, table: str, begin: str) -> list[str]:
        """Ids of runs or estimates that begin so, a few of them; `begin` is hexadecimal."""
        assert table in ("run", "estimate")
        rows = self.rows(f"SELECT id FROM {table} WHERE substr(id, 1, ?) = ? LIMIT 9", len(begin), begin)
        return [str(row["id"]) for row in rows]

    def unfinished(self) -> list[RunView]:
        """Runs that are queued or running by their rows: after a start, those that a death has left."""
        return [
            _run(r)
            for r in self.rows("SELECT * FROM run WHERE state IN ('queued', 'running') ORDER BY created")
        ]

    def remove_run(self, run_id: str) -> None:
        """Remove an ended run with its files and all that rests on it. The trail keeps what it says of it.

        Raises InputError where it has not ended, or is still needed to put a drive back.
        """
        run = self.run(run_id)
        if run.state not in ENDED:
            raise InputError(f"run {run_id}", f"is {run.state}", "Cancel it first.")
        if any(found.run_id == run_id for found in self.unsettled()):
            raise InputError(
                f"run {run_id}", "holds parameters that were not put back", "Restore or decline first."
            )
        folder = self.run_folder(run_id)
        with self.transaction() as db:
            db.execute("DELETE FROM run WHERE id = ?", (run_id,))
        shutil.rmtree(folder, ignore_errors=True)

    # ── files ────────────────────────────────────────────────────────────────────────────────────────────────────

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
        self._row("run", run_id)
        return [_file(r) for r in self.rows("SELECT * FROM file WHERE run_id = ? ORDER BY name", run_id)]

    def file(self, file_id: str) -> FileRecord:
        """One file. Raises NotFoundError."""
        return _file(self._row("file", file_id))

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

    # ── results ──────────────────────────────────────────────────────────────────────────────────────────────────

    def add_session(self, run: RunView, summary: Mapping[str, Any], name: str = "session.h5") -> ResultRecord:
        """Enter a recording that lies in a run's folder."""
        self.take_files(run.id)
        file = next(f for f in self.files(run.id) if f.name == name)
        session_id = new_id()
        self._insert(
            "session", id=session_id, run_id=run.id, file_id=file.id, drive_id=run.drive_id,
            machine_id=run.machine_id, created=now(), who=run.who, summary=_json(summary),
        )  # fmt: skip
        return self.session(session_id)

    def session(self, session_id: str) -> ResultRecord:
        """One session. Raises NotFoundError."""
        return _result(self._row("session", session_id))

    def session_path(self, session_id: str) -> Path:
        """Its recording, checked against its SHA-256. Raises NotFoundError, InputError."""
        file_id = self.session(session_id).file_id
        assert file_id is not None
        return self.file_path(file_id, check=True)

    def add_estimate(
        self, run: RunView, session_id: str, verdict: str, document: Mapping[str, Any]
    ) -> ResultRecord:
        """Enter an estimate of a session."""
        return self._add_found("estimate", run, session_id, verdict, document)

    def add_explanation(
        self, run: RunView, session_id: str, verdict: str, document: Mapping[str, Any]
    ) -> ResultRecord:
        """Enter an explanation of a session."""
        return self._add_found("explanation", run, session_id, verdict, document)

    def _add_found(
        self, table: str, run: RunView, session_id: str, verdict: str, document: Mapping[str, Any]
    ) -> ResultRecord:
        found = new_id()
        self._insert(
            table, id=found, run_id=run.id, session_id=session_id, created=now(), who=run.who, verdict=verdict,
            document=_json(document),
        )  # fmt: skip
        return _result(self._row(table, found))

    def estimate(self, estimate_id: str) -> ResultRecord:
        """One estimate. Raises NotFoundError."""
        return _result(self._row("estimate", estimate_id))

    def explanation(self, explanation_id: str) -> ResultRecord:
        """One explanation. Raises NotFoundError."""
        return _result(self._row("explanation", explanation_id))

    def add_export(self, run: RunView, estimate_id: str | None, document: Mapping[str, Any]) -> ResultRecord:
        """Enter what was written into a drive."""
        found = new_id()
        self._insert(
            "export", id=found, run_id=run.id, drive_id=run.drive_id, estimate_id=estimate_id, created=now(),
            who=run.who, document=_json(document),
        )  # fmt: skip
        return _result(self._row("export", found))

    def results(self, table: str, drive_id: str | None = None, limit: int = 200) -> list[ResultRecord]:
        """Sessions, estimates, explanations or exports ("session", …), the newest first, of one drive where named."""
        assert table in ("session", "estimate", "explanation", "export")
        joined = f"SELECT t.*, run.drive_id AS drive_of FROM {table} t JOIN run ON run.id = t.run_id"
        where = "" if drive_id is None else " WHERE run.drive_id = ?"
        values = [] if drive_id is None else [drive_id]
        return [
            _result(r) for r in self.rows(f"{joined}{where} ORDER BY t.created DESC LIMIT ?", *values, limit)
        ]

    def of_run(self, table: str, run_id: str) -> list[ResultRecord]:
        """What a run has led to, of one kind."""
        assert table in ("session", "estimate", "explanation", "export")
        return [
            _result(r) for r in self.rows(f"SELECT * FROM {table} WHERE run_id = ? ORDER BY created", run_id)
        ]

    # ── drives that were left ────────────────────────────────────────────────────────────────────────────────────

    def add_unsafe(self, drive_id: str, run_id: str, backup: str) -> None:
        """Note that a drive holds what an interrupted run has changed; once per backup."""
        if not any(u.run_id == run_id and u.backup == backup for u in self.unsettled(drive_id)):
            self._insert(
                "unsafe", id=new_id(), drive_id=drive_id, run_id=run_id, created=now(), backup=backup
            )

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


def _json(document: Mapping[str, Any]) -> str:
    return json_text(document)


def _loaded(text: str | None) -> Any:
    return None if text is None else json.loads(text)


def _machine(row: sqlite3.Row) -> MachineRecord:
    return MachineRecord(row["id"], row["name"], row["created"], row["who"], row["sha256"])


def _drive(row: sqlite3.Row) -> DriveRecord:
    return DriveRecord(
        row["id"], row["name"], row["bus"], row["node_id"], row["profile"], row["machine_id"],
        _loaded(row["identity"]), row["created"], row["who"],
    )  # fmt: skip


def _run(row: sqlite3.Row) -> RunView:
    return RunView(
        id=row["id"], kind=row["kind"], state=row["state"], who=row["who"], created=row["created"],
        started=row["started"], ended=row["ended"], drive_id=row["drive_id"], machine_id=row["machine_id"],
        request=_loaded(row["request"]), result=_loaded(row["result"]), error=_loaded(row["error"]),
    )  # fmt: skip


def _file(row: sqlite3.Row) -> FileRecord:
    return FileRecord(row["id"], row["run_id"], row["name"], row["size"], row["sha256"])


def _unsafe(row: sqlite3.Row) -> UnsafeRecord:
    return UnsafeRecord(**{key: row[key] for key in UnsafeRecord.__dataclass_fields__})


def _result(row: sqlite3.Row) -> ResultRecord:
    held = dict(row)
    known = {k: held[k] for k in ResultRecord.__dataclass_fields__ if k in held and k != "document"}
    if "drive_of" in held:
        known["drive_id"] = held["drive_of"]
    return ResultRecord(**known, document=_loaded(held.get("document", held.get("summary"))))
