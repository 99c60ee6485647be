"""What runs have led to: sessions, their estimates and explanations, exports."""

from __future__ import annotations

import sqlite3
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from schwung.service.records import ResultRecord
from schwung.service.store.database import now, packed, unpacked
from schwung.service.store.files import Files
from schwung.service.values import RunView, new_id


class Results(Files):
    """Values that rest on a file of a run, and those that rest on them."""

    def add_session(self, run: RunView, summary: Mapping[str, Any], name: str = "session.h5") -> ResultRecord:
        """Enter a recording that lies in a run's folder."""
        self.take_files(run.id)
        file = next(f for f in self.files(run.id) if f.name == name)
        session_id = new_id()
        self.insert(
            "session", id=session_id, run_id=run.id, file_id=file.id, drive_id=run.drive_id,
            machine_id=run.machine_id, created=now(), who=run.who, summary=packed(summary),
        )  # fmt: skip
        return self.session(session_id)

    def session(self, session_id: str) -> ResultRecord:
        """One session. Raises NotFoundError."""
        return _result(self.row("session", session_id))

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
        self.insert(
            table, id=found, run_id=run.id, session_id=session_id, created=now(), who=run.who, verdict=verdict,
            document=packed(document),
        )  # fmt: skip
        return _result(self.row(table, found))

    def estimate(self, estimate_id: str) -> ResultRecord:
        """One estimate. Raises NotFoundError."""
        return _result(self.row("estimate", estimate_id))

    def explanation(self, explanation_id: str) -> ResultRecord:
        """One explanation. Raises NotFoundError."""
        return _result(self.row("explanation", explanation_id))

    def add_export(self, run: RunView, estimate_id: str | None, document: Mapping[str, Any]) -> ResultRecord:
        """Enter what was written into a drive."""
        found = new_id()
        self.insert(
            "export", id=found, run_id=run.id, drive_id=run.drive_id, estimate_id=estimate_id, created=now(),
            who=run.who, document=packed(document),
        )  # fmt: skip
        return _result(self.row("export", found))

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


def _result(row: sqlite3.Row) -> ResultRecord:
    held = dict(row)
    known = {k: held[k] for k in ResultRecord.__dataclass_fields__ if k in held and k != "document"}
    if "drive_of" in held:
        known["drive_id"] = held["drive_of"]
    return ResultRecord(**known, document=unpacked(held.get("document", held.get("summary"))))
