"""The best motion played beside a usual one."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import asdict
from typing import Any

from schwung.api.computing import load_machine
from schwung.api.drives import Connection
from schwung.api.optimising import PlannedPlay, Playing, plan_play, write_optimised, write_played
from schwung.api.optimising import play as play_planned
from schwung.api.stages import LimitWishes
from schwung.files import json_text, replace_file
from schwung.service.jobs import Task
from schwung.service.work.computing import task_of
from schwung.service.work.estimating import chosen_machine


def propose_play(task: Task) -> Mapping[str, Any]:
    """See ProposePlayRequest."""
    asked = task.request
    machine = load_machine(chosen_machine(task))
    playing = Playing(asked.against, asked.repeats, asked.sample_rate_hz, asked.rivals)
    task.phase("Finding the motion from where the axis stands")
    limits = LimitWishes(**asked.limits.model_dump())
    connection = _connection(task)
    planned = plan_play(connection, machine, task_of(machine, asked.model_dump()), limits, playing)
    document = planned.to_json() | {
        "can_start": not planned.prepared.preflight.stops,
        "repeats": asked.repeats,
    }
    document["checks"] = document.pop("preflight")
    return task.proposals.add("play", task.drive_record.id, document, planned).to_json()


def play(task: Task) -> Mapping[str, Any]:
    """See PlayRequest."""
    made = task.proposals.take(task.request.proposal_id, "play", task.request.digest)
    planned: PlannedPlay = made.content
    played = play_planned(
        _connection(task), planned, task.folder, confirm=lambda _question: True, observer=task
    )
    task.phase("Writing what came of it")
    document = {**made.document, "costs": asdict(played.costs)}
    write_optimised(planned.found, task.folder, planned.playing.sample_rate_hz, document)
    write_played(planned, played, task.folder)
    replace_file(task.folder / "optimised.json", json_text(document))
    return {"digest": made.digest, "played": document}


def _connection(task: Task) -> Connection:
    found = task.connect()
    return Connection(found.drive, found.profile)
