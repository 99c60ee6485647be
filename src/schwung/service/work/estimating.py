"""Runs that compute from what is stored."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from schwung.errors import InputError
from schwung.service.jobs import Task
from schwung.service.work.computing import estimate_session


def estimate(task: Task) -> Mapping[str, Any]:
    """See EstimateRequest."""
    asked, store = task.request, task.store
    session = store.session(asked.session_id)
    machine_id = asked.machine_id or session.machine_id
    if machine_id is None:
        raise InputError("machine_id", "is missing, and the session names none", "Name the machine.")
    found = task.compute(
        estimate_session, session=store.session_path(session.id), machine=store.machine_path(machine_id),
        folder=task.folder, method=asked.method, inversion=asked.inversion, frequency_hz=asked.frequency_hz,
        points=asked.points,
    )  # fmt: skip
    kept = store.add_estimate(task.run, session.id, found["verdict"], found["document"])
    return {"estimate_id": kept.id, "session_id": session.id, "verdict": found["verdict"]}
