"""Runs: accepted, begun, ended, removed."""

from __future__ import annotations

import shutil
import sqlite3
from collections.abc import Mapping
from typing import Any

from schwung.errors import InputError
from schwung.service.records import RunHead
from schwung.service.store.database import now, packed, unpacked
from schwung.service.store.files import Files
from schwung.service.store.unsafe import Unsafe
from schwung.service.values import ENDED, RunState, RunView, new_id


class Runs(Files, Unsafe):
    """Runs, which end together with their files, and stay while a drive needs them."""

    def add_run(
        self, kind: str, request: Mapping[str, Any], who: str, drive_id: str | None, machine_id: str | None
    ) -> RunView:
        """Accept a run: queued, with a folder of its own."""
        run_id = new_id()
        (self.folder / "runs" / run_id).mkdir()
        self.insert(
            "run", id=run_id, kind=kind, state="queued", who=who, created=now(), drive_id=drive_id,
            machine_id=machine_id, request=packed(request),
        )  # fmt: skip
        return self.run(run_id)

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
                    None if result is None else packed(result),
                    None if error is None else packed(error),
                    run_id,
                ),
            )
        return self.run(run_id)

    def run(self, run_id: str) -> RunView:
        """One run. Raises NotFoundError."""
        return _run(self.row("run", run_id))

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

    def count_runs(self) -> dict[str, int]:
        """How many runs there are by state."""
        rows = self.rows("SELECT state, count(*) AS number FROM run GROUP BY state")
        return {str(row["state"]): int(row["number"]) for row in rows}


def _run(row: sqlite3.Row) -> RunView:
    return RunView(
        id=row["id"], kind=row["kind"], state=row["state"], who=row["who"], created=row["created"],
        started=row["started"], ended=row["ended"], drive_id=row["drive_id"], machine_id=row["machine_id"],
        request=unpacked(row["request"]), result=unpacked(row["result"]), error=unpacked(row["error"]),
    )  # fmt: skip
