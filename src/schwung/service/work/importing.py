"""Runs that take in what comes from outside, and give out what others can read."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any

from schwung.errors import InputError
from schwung.service.incoming import KEPT, require_no_files
from schwung.service.jobs import Task
from schwung.service.work.reading import convert_session, guess_columns, import_session


def import_file(task: Task) -> Mapping[str, Any]:
    """See ImportRequest."""
    asked, store = task.request, task.store
    path = task.folder / asked.name
    kept = {"file_id": _entered(task, asked.name)} if asked.what != "session" else {}
    if asked.what in KEPT:
        return kept
    options = _with_dbc(task, asked.options, asked.dbc_file_id)
    if asked.guess:
        found: dict[str, Any] = task.compute(guess_columns, path=path, options=options, folder=task.folder)
        return kept | found
    eds = None if asked.eds_file_id is None else store.file_path(asked.eds_file_id)
    return kept | _taken_in(task, path, asked.what, options, eds)


def import_as(task: Task) -> Mapping[str, Any]:
    """See ImportAsRequest."""
    asked, store = task.request, task.store
    require_no_files(asked.options)
    path = store.file_path(asked.file_id, check=True)
    run = store.run(store.file(asked.file_id).run_id)
    if run.kind != "import" or path.name != run.request["name"] or run.request["what"] in (*KEPT, "session"):
        raise InputError(f"file {path.name}", "is no recording that was uploaded", "Upload it first.")
    options = _with_dbc(task, asked.options, asked.dbc_file_id or run.request["dbc_file_id"])
    if asked.guess:
        found: dict[str, Any] = task.compute(guess_columns, path=path, options=options, folder=task.folder)
        return {"file_id": asked.file_id, **found}
    return _taken_in(task, path, "recording", options, None)


def convert(task: Task) -> Mapping[str, Any]:
    """See ConvertRequest."""
    session, target = task.store.session_path(task.request.session_id), f"session.{task.request.form}"
    made: dict[str, Any] = task.compute(convert_session, session=session, target=task.folder / target)
    return made | {"file_id": _entered(task, target)}


def _taken_in(task: Task, path: Path, what: str, options: dict[str, Any], eds: Path | None) -> dict[str, Any]:
    summary = task.compute(import_session, path=path, what=what, options=options, eds=eds, folder=task.folder)
    session = task.store.add_session(task.run, summary)
    return {"session_id": session.id, **summary}


def _with_dbc(task: Task, options: Mapping[str, Any], dbc_file_id: str | None) -> dict[str, Any]:
    dbc = {} if dbc_file_id is None else {"dbc": str(task.store.file_path(dbc_file_id))}
    return {**options, **dbc}


def _entered(task: Task, name: str) -> str:
    return next(file.id for file in task.store.take_files(task.run.id) if file.name == name)
