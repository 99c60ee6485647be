"""What the API answers with."""

from __future__ import annotations

import time
from dataclasses import asdict
from typing import Any, Literal

from pydantic import BaseModel

from schwung.service.lanes import DriveStatus
from schwung.service.records import DriveRecord, FileRecord, MachineRecord, ResultRecord, UnsafeRecord
from schwung.service.values import RunView


class ProgressModel(BaseModel):
    """How far a run is; `share` 0…1, `left_s` in seconds, null where nobody knows."""

    phase: str
    share: float | None
    left_s: float | None
    notes: list[str]


class RunModel(BaseModel):
    """A run: what was asked for, by whom, how far it is, what came of it."""

    id: str
    kind: str
    state: Literal["queued", "running", "done", "failed", "cancelled", "interrupted"]
    who: str
    created: str
    started: str | None
    ended: str | None
    drive_id: str | None
    machine_id: str | None
    request: dict[str, Any]
    result: dict[str, Any] | None
    error: dict[str, Any] | None
    progress: ProgressModel | None

    @classmethod
    def of(cls, run: RunView) -> RunModel:
        """A run as told."""
        return cls.model_validate(asdict(run))


class FileModel(BaseModel):
    """A file of a run."""

    id: str
    run_id: str
    name: str
    size: int
    sha256: str
    media_type: str

    @classmethod
    def of(cls, file: FileRecord) -> FileModel:
        """A file as told."""
        return cls(**asdict(file), media_type=file.media_type)


class MachineModel(BaseModel):
    """A machine that is believed in."""

    id: str
    name: str
    created: str
    who: str
    sha256: str

    @classmethod
    def of(cls, machine: MachineRecord) -> MachineModel:
        """A machine as told."""
        return cls(**asdict(machine))


class StateModel(BaseModel):
    """A drive as it was seen last."""

    nmt: str
    cia402: str
    position_rad: float | None
    error: str
    others: str
    voltage: bool | None
    remote: bool | None
    inputs: int | None
    age_s: float


class UnsafeModel(BaseModel):
    """What an interrupted run has left in a drive."""

    id: str
    run_id: str
    created: str
    backup: str
    found: str | None

    @classmethod
    def of(cls, record: UnsafeRecord) -> UnsafeModel:
        """As told."""
        return cls(
            id=record.id,
            run_id=record.run_id,
            created=record.created,
            backup=record.backup,
            found=record.found,
        )


class DriveModel(BaseModel):
    """A drive, and what is known of it now."""

    id: str
    name: str
    bus: str
    node_id: int
    profile: str | None
    machine_id: str | None
    identity: dict[str, Any] | None
    created: str
    who: str
    connected: bool
    busy_with: str | None
    trouble: str
    state: StateModel | None
    unsafe: list[UnsafeModel]

    @classmethod
    def of(cls, drive: DriveRecord, status: DriveStatus, unsafe: list[UnsafeRecord]) -> DriveModel:
        """A drive as told."""
        return cls(
            **asdict(drive), connected=status.connected, busy_with=status.busy_with, trouble=status.trouble,
            state=_state(status), unsafe=[UnsafeModel.of(one) for one in unsafe],
        )  # fmt: skip


def _state(status: DriveStatus) -> StateModel | None:
    if status.state is None or status.seen_s is None:
        return None
    seen = asdict(status.state)
    if seen["position_rad"] != seen["position_rad"]:
        seen["position_rad"] = None
    return StateModel(**seen, age_s=time.monotonic() - status.seen_s)


class ResultModel(BaseModel):
    """A session, estimate, explanation or export."""

    id: str
    run_id: str
    created: str
    who: str
    document: dict[str, Any]
    verdict: str | None
    session_id: str | None
    drive_id: str | None
    machine_id: str | None
    file_id: str | None
    estimate_id: str | None

    @classmethod
    def of(cls, record: ResultRecord) -> ResultModel:
        """As told."""
        return cls.model_validate(asdict(record))


class StoppedModel(BaseModel):
    """A STOP that holds, or none."""

    stopped: bool
    who: str | None = None
    at: str | None = None
