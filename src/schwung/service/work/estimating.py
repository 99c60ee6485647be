"""Runs that compute from what is stored."""

from __future__ import annotations

import json
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from schwung.errors import InputError
from schwung.service.jobs import Task
from schwung.service.work.computing import (
    estimate_session,
    explain_session,
    optimise_motion,
    session_summary,
    work_through,
)
from schwung.service.work.reading import check_family, draft_family, reproduce_paper


def estimate(task: Task) -> Mapping[str, Any]:
    """See EstimateRequest."""
    asked, store = task.request, task.store
    session = store.session(asked.session_id)
    machine_id = _machine_of(asked.machine_id or session.machine_id)
    found = task.compute(
        estimate_session, session=store.session_path(session.id), machine=store.machine_path(machine_id),
        folder=task.folder, method=asked.method, inversion=asked.inversion, frequency_hz=asked.frequency_hz,
        points=asked.points,
    )  # fmt: skip
    kept = store.add_estimate(task.run, session.id, found["verdict"], found["document"])
    return {"estimate_id": kept.id, "session_id": session.id, "verdict": found["verdict"]}


def explain(task: Task) -> Mapping[str, Any]:
    """See ExplainRequest."""
    asked, store = task.request, task.store
    session = store.session(asked.session_id)
    machine_id = _machine_of(asked.machine_id or session.machine_id)
    found = task.compute(
        explain_session, session=store.session_path(session.id), machine=store.machine_path(machine_id),
        folder=task.folder, next_motion=asked.next_motion,
    )  # fmt: skip
    kept = store.add_explanation(task.run, session.id, found["verdict"], found["document"])
    return {"explanation_id": kept.id, "session_id": session.id, "verdict": found["verdict"]}


def optimise(task: Task) -> Mapping[str, Any]:
    """See OptimiseRequest."""
    document = task.compute(
        optimise_motion, machine=chosen_machine(task), folder=task.folder, asked=task.request.model_dump(),
        sample_rate_hz=task.request.sample_rate_hz,
    )  # fmt: skip
    return {"optimised": document}


def chosen_machine(task: Task) -> Path:
    """The machine as an estimate has measured it, or as believed. Raises InputError where neither or both are named."""
    asked, store = task.request, task.store
    if (asked.estimate_id is None) == (asked.machine_id is None):
        raise InputError("estimate_id", "and machine_id: exactly one is needed", "Name what was measured.")
    if asked.estimate_id is not None:
        return store.run_folder(store.estimate(asked.estimate_id).run_id) / "measured.toml"
    return store.machine_path(asked.machine_id)


def batch(task: Task) -> Mapping[str, Any]:
    """See BatchRequest. What a session gives stands in the summary; sessions without a machine are failures there."""
    asked, store = task.request, task.store
    sessions = [store.session(one) for one in asked.session_ids] or store.results("session", limit=10_000)
    if not sessions:
        raise InputError(
            "session_ids", "there is no session yet", "Commission a drive, or import a recording."
        )
    items = []
    for session in sessions:
        machine_id = asked.machine_id or session.machine_id
        machine = None if machine_id is None else store.machine_path(machine_id)
        assert session.file_id is not None
        items.append((store.run_folder(session.run_id) / store.file(session.file_id).name, machine))
    wish = {
        "method": asked.method,
        "inversion": asked.inversion,
        "frequency_hz": asked.frequency_hz,
        "points": asked.points,
    }
    found = task.compute(
        work_through, items=items, kind=asked.work, wish=wish, jobs=asked.jobs, folder=task.folder, alone=True
    )
    shown: dict[str, Any] = json.loads(json.dumps(found).replace(f"{store.folder}/", ""))
    return shown


def reproduce(task: Task) -> Mapping[str, Any]:
    """See ReproduceRequest."""
    found: dict[str, Any] = task.compute(reproduce_paper, what=list(task.request.what), folder=task.folder)
    return found


def check_profile(task: Task) -> Mapping[str, Any]:
    """See CheckProfileRequest."""
    asked = task.request
    eds = None if asked.eds_file_id is None else task.store.file_path(asked.eds_file_id)
    found: dict[str, Any] = task.compute(check_family, family=asked.family, eds=eds)
    return found


def draft_profile(task: Task) -> Mapping[str, Any]:
    """See DraftProfileRequest."""
    asked = task.request
    eds = task.store.file_path(asked.eds_file_id)
    found: dict[str, Any] = task.compute(draft_family, eds=eds, family=asked.family, folder=task.folder)
    return found


def salvage(task: Task) -> Mapping[str, Any]:
    """See SalvageRequest. The session belongs to the run that recorded it."""
    store = task.store
    run = store.run(task.request.run_id)
    path = store.run_folder(run.id) / "session.h5"
    summary = task.compute(session_summary, session=path)
    session = store.add_session(run, summary)
    return {"session_id": session.id, **summary}


def _machine_of(machine_id: str | None) -> str:
    if machine_id is None:
        raise InputError("machine_id", "is missing, and the session names none", "Name the machine.")
    return machine_id
