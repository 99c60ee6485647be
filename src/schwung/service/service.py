"""The service itself: store, lanes, queue, latch and trail together. API and page use this, and nothing below it.

submit(request, who)       a dict with "kind", see requests.py; returns the RunView, queued
run, runs, active, cancel  RunView has state, progress, result, error
stop(who), release(who)    latch.stopped tells which STOP holds
status(drive_id)           DriveStatus: connected, busy_with, state
subscribe(listener)        called, from any thread, with each RunView, DriveStatus, Stopped (None: released)
live.scope(drive_id)       samples as they come, see live.py
store, trail, proposals    what is kept, who did what, what waits to be confirmed
"""

from __future__ import annotations

import contextlib
import logging
import shutil
import threading
from collections.abc import Callable, Iterator, Mapping
from functools import partial
from pathlib import Path
from typing import Any, BinaryIO, Self

from pydantic import ValidationError

from schwung.api.drives import Drive
from schwung.errors import InputError, RefusedError, SchwungError
from schwung.service.audit import Trail
from schwung.service.families import require_family
from schwung.service.incoming import ImportRequest, import_name, require_no_files
from schwung.service.jobs import Jobs, Shared
from schwung.service.lanes import DriveStatus, Lane
from schwung.service.latch import Latch, Stopped
from schwung.service.live import Live
from schwung.service.machines import write_machine_files
from schwung.service.meters import Meters
from schwung.service.proposals import Proposals
from schwung.service.records import DriveRecord
from schwung.service.recovery import has_recording, note_left, recover
from schwung.service.requests import Confirmed, SalvageRequest, parse_request
from schwung.service.store import NotFoundError, Store, now
from schwung.service.values import RunView, Settings
from schwung.service.work import KINDS
from schwung.service.workshop import Workshop

_log = logging.getLogger("schwung.service")
Change = RunView | DriveStatus | Stopped | None
#: What ends meanwhile is waited for so long: quick stop, power off, parameters back.
_ENDED_WITHIN_S = 20.0


class Service:
    """One process's service over one data folder. `start` before use, `close` at the end; or as a context manager."""

    def __init__(self, settings: Settings) -> None:
        self.settings = settings
        self.store = Store(settings.folder)
        self.trail = Trail(self.store)
        self.proposals = Proposals()
        self.latch = Latch()
        self._listeners: tuple[Callable[[Change], None], ...] = ()
        self._change = threading.Lock()
        self._workshop = Workshop()
        shared = Shared(self.store, self._workshop, self.proposals, self.trail)
        self._jobs = Jobs(shared, self._tell, settings.workers, self._after)
        self._lanes: dict[str, Lane] = {}
        store = self.store
        self._looks: dict[str, Callable[[str], object]] = {  # what a request may name has to be there
            "machine_id": store.machine, "session_id": store.session, "estimate_id": store.estimate,
            "file_id": store.file, "bode_run_id": store.run, "run_id": store.run, "second_file_id": store.file,
            "eds_file_id": store.file, "dbc_file_id": store.file,
        }  # fmt: skip
        self.live = Live(self._connected_drives)
        self.meters = Meters(self._named_drives, self.store.count_runs)

    def start(self) -> Self:
        """Open the lanes, and look after what an earlier process has left."""
        self._seed()
        left = recover(self.store, self.trail)
        for entry in self.settings.buses:
            self._lanes[entry.name] = Lane(
                entry,
                partial(self._drives_on, entry.name),
                self._tell,
                self.settings.poll_s,
                self.meters.stopped,
            )
        for request in left:
            with contextlib.suppress(SchwungError):  # a drive whose bus we were started without
                self._accept(request, "schwung serve")
        return self

    def close(self) -> None:
        """Stop what moves, put parameters back, keep what was recorded."""
        acting = self._acting()
        self._jobs.cancel_all(acting)
        if acting:
            self._pull()
        ended = self._jobs.close(_ENDED_WITHIN_S)
        for lane in self._lanes.values():
            ended = lane.close(_ENDED_WITHIN_S) and ended
        self._workshop.close()
        self.live.close()
        if ended:
            self.store.close()
        else:
            _log.error("what was under way has not ended within %g s", _ENDED_WITHIN_S)

    def __enter__(self) -> Self:
        return self.start()

    def __exit__(self, *_: object) -> None:
        self.close()

    # ── runs ─────────────────────────────────────────────────────────────────────────────────────────────────────

    def submit(self, request: Mapping[str, Any], who: str) -> RunView:
        """Accept what is asked for; it is done in its turn.

        Raises InputError where it is no request, or names what is not there; RefusedError while stopped, where it
        would move or write, or its proposal is not there any more.
        """
        try:
            asked = parse_request(dict(request))
        except ValidationError as error:
            first = error.errors()[0]
            place = ".".join(str(part) for part in first["loc"]) or "request"
            raise InputError(
                place, first["msg"][:200].lower(), "See the OpenAPI document of this service."
            ) from error
        return self._accept(asked, who)

    def _accept(self, asked: Any, who: str) -> RunView:
        """As `submit`, of a request that is one."""
        kind_name: str = asked.kind
        kind = KINDS[kind_name]
        if kind.acts:
            self.latch.require_free()
        drive_id, machine_id = getattr(asked, "drive_id", None), getattr(asked, "machine_id", None)
        if isinstance(asked, Confirmed):
            made = self.proposals.look(asked.proposal_id, kind_name, asked.digest)
            drive_id, machine_id = made.drive_id, made.machine_id
        self._look_for(asked)
        drive = None if drive_id is None else self.store.drive(drive_id)
        if kind.acts and kind_name != "restore" and drive is not None and self.store.unsettled(drive.id):
            raise RefusedError(
                f"drive {drive.name}", "holds parameters that an interrupted run has changed",
                "Put them back (propose_restore, restore), or decline that, first.",
            )  # fmt: skip
        bus = getattr(asked, "bus", None) if drive is None else drive.bus
        lane = self._lane(bus) if kind.on_bus and bus is not None else None
        if drive is not None and machine_id is None:
            machine_id = drive.machine_id
        run = self.store.add_run(asked.kind, asked.model_dump(mode="json"), who, drive_id, machine_id)
        if kind.acts:
            self.trail.add(who, asked.kind, drive_id, run.id, request=run.request)
        return self._jobs.submit(run, asked, kind.work, lane)

    def _look_for(self, asked: Any) -> None:
        """Raise NotFoundError where a request names what is not there."""
        for name, look in self._looks.items():
            if (wanted := getattr(asked, name, None)) is not None:
                look(wanted)

    def bring(self, content: BinaryIO, name: str, told: Mapping[str, Any], who: str) -> RunView:
        """Accept a file from outside, as a run of the kind "import". `name` tells its form by its suffix and no more;
        `told`: the fields of ImportRequest.

        Raises InputError for a suffix that does not belong to what it shall be, or options that name files;
        NotFoundError.
        """
        asked = ImportRequest.model_validate(
            {**told, "kind": "import", "name": import_name(told["what"], name)}
        )
        require_no_files(asked.options)
        self._look_for(asked)
        if asked.drive_id is not None:
            self.store.drive(asked.drive_id)
        run = self.store.add_run(
            "import", asked.model_dump(mode="json"), who, asked.drive_id, asked.machine_id
        )
        try:
            with (self.store.run_folder(run.id) / asked.name).open("wb") as target:
                shutil.copyfileobj(content, target)
        except OSError as error:
            self.store.end_run(run.id, "failed", None, {"type": "InputError", "text": "could not be kept"})
            raise InputError(
                "upload", f"could not be kept ({error.strerror})", "Is the disk full?"
            ) from error
        return self._jobs.submit(run, asked, KINDS["import"].work, None)

    def run(self, run_id: str) -> RunView:
        """One run, with its progress. Raises NotFoundError."""
        return self._jobs.view(run_id)

    def runs(self, **wanted: Any) -> list[RunView]:
        """Runs, the newest first; see Store.runs."""
        progress = {view.id: view for view in self._jobs.active()}
        return [progress.get(run.id, run) for run in self.store.runs(**wanted)]

    def active(self) -> list[RunView]:
        """All that is queued or running."""
        return self._jobs.active()

    def cancel(self, run_id: str, who: str) -> RunView:
        """End a run. Where it moves, its drive is stopped. Raises NotFoundError, InputError."""
        run = self._jobs.cancel(run_id)
        if run.drive_id is not None and run.state == "running" and KINDS[run.kind].acts:
            self._pull(run.drive_id)
        self.trail.add(who, "cancel", run.drive_id, run_id)
        return run

    def decline(self, unsafe_id: str, who: str) -> None:
        """Leave what an interrupted run has changed as it is: somebody answers for it by name. Raises InputError."""
        for unsafe in self.store.unsettled():
            if unsafe.id == unsafe_id:
                self.store.settle(unsafe_id, "declined", who)
                self.trail.add(
                    who, "declined to restore", unsafe.drive_id, unsafe.run_id, backup=unsafe.backup
                )
                return
        raise NotFoundError(
            f"unsafe {unsafe_id[:40]}", "there is none with this id, or it is settled", "List the drives."
        )

    def _after(self, run: RunView) -> None:
        """A run has ended: what it has left in the drive is noted, what it recorded is entered."""
        if KINDS[run.kind].acts and run.state != "done":
            note_left(self.store, run)
            if has_recording(self.store, run):
                self._accept(SalvageRequest(kind="salvage", run_id=run.id), run.who)

    # ── stop ─────────────────────────────────────────────────────────────────────────────────────────────────────

    def stop(self, who: str) -> Stopped:
        """STOP: nothing is begun any more, all drives get a quick stop, what moves or writes is cancelled. From any
        thread, never waits for the store, a lane or the event loop, never raises."""
        stopped = Stopped(who, now())
        self.latch.set(stopped)
        self._pull()
        self._jobs.cancel_all(self._acting())
        threading.Thread(
            target=self._note_stop, args=(stopped,), name="schwung stop noted", daemon=True
        ).start()
        return stopped

    def release(self, who: str) -> None:
        """End a STOP: what is asked for from now on may be begun."""
        self.trail.add(who, "release")
        self.latch.release()
        self._tell(None)

    def _acting(self) -> list[RunView]:
        return [run for run in self._jobs.active() if KINDS[run.kind].acts]

    def _pull(self, drive_id: str | None = None) -> None:
        for lane in self._lanes.values():
            lane.pull(drive_id)

    def _note_stop(self, stopped: Stopped) -> None:
        with contextlib.suppress(Exception):
            self.trail.add(stopped.who, "stop", since=stopped.at)
        self._tell(stopped)

    # ── drives ───────────────────────────────────────────────────────────────────────────────────────────────────

    def add_drive(
        self, name: str, bus: str, node_id: int, profile: str | None, machine_id: str | None, who: str
    ) -> DriveRecord:
        """Add a drive on one of our buses. Raises InputError for a bus, profile or machine that is not there."""
        self.settings.bus(bus)
        if machine_id is not None:
            self.store.machine(machine_id)
        if profile is not None:
            require_family(profile)
        record = self.store.add_drive(name, bus, node_id, profile, machine_id, who)
        self.trail.add(who, "add drive", record.id, name=name, bus=bus, node_id=node_id, profile=profile)
        return record

    def change_drive(self, drive_id: str, who: str, **values: str | None) -> DriveRecord:
        """Change a drive's name, profile or machine_id. Raises NotFoundError, InputError."""
        if (machine_id := values.get("machine_id")) is not None:
            self.store.machine(machine_id)
        if (profile := values.get("profile")) is not None:
            require_family(profile)
        changed = self.store.change_drive(drive_id, **values)
        self.trail.add(who, "change drive", drive_id, **values)
        return changed

    def archive_drive(self, drive_id: str, who: str) -> None:
        """Take a drive from the list; its runs stay. Raises RefusedError while it is needed, NotFoundError."""
        drive = self.store.drive(drive_id)
        if self.store.unsettled(drive_id) or any(run.drive_id == drive_id for run in self.active()):
            raise RefusedError(
                f"drive {drive.name}", "is busy, or holds what was not put back", "Settle that first."
            )
        self.store.change_drive(drive_id, archived=now())
        self.trail.add(who, "archive drive", drive_id)

    def status(self, drive_id: str) -> DriveStatus:
        """What is known of a drive at this moment. Raises NotFoundError."""
        record = self.store.drive(drive_id)
        lane = self._lanes.get(record.bus)
        if lane is None:
            return DriveStatus(drive_id, trouble=f'the service was started without its bus "{record.bus}"')
        return lane.status(drive_id)

    def _connected_drives(self) -> Iterator[tuple[str, Drive]]:
        for lane in list(self._lanes.values()):
            yield from lane.connected_drives()

    def _named_drives(self) -> Iterator[tuple[str, Drive]]:
        names = [
            (self.store.drive(drive_id).name, drive_id, drive) for drive_id, drive in self._connected_drives()
        ]
        for name, drive_id, drive in names:
            doubled = sum(other == name for other, _, _ in names) > 1
            yield f"{name} {drive_id}" if doubled else name, drive

    def silent_s(self) -> float:
        """How long ago the slowest owner of a bus has answered (s); asks all of them anew."""
        return max((lane.ask() for lane in list(self._lanes.values())), default=0.0)

    def _lane(self, bus: str) -> Lane:
        self.settings.bus(bus)
        return self._lanes[bus]

    def _drives_on(self, bus: str) -> list[DriveRecord]:
        return [drive for drive in self.store.drives() if drive.bus == bus]

    def _seed(self) -> None:
        places = {(drive.bus, drive.node_id) for drive in self.store.drives()}
        for seed in self.settings.drives:
            if (seed.bus, seed.node_id) not in places:
                machine_id = None
                if seed.machine_toml is not None:
                    machine_id = self.add_machine(
                        seed.machine_name, seed.machine_toml, {}, "schwung serve"
                    ).id
                self.store.add_drive(
                    seed.name, seed.bus, seed.node_id, seed.profile, machine_id, "schwung serve"
                )

    # ── machines ─────────────────────────────────────────────────────────────────────────────────────────────────

    def add_machine(self, name: str, toml: str, tables: Mapping[str, str], who: str) -> Any:
        """Add a machine from its toml and the tables that it names. Raises InputError where they are not sound."""
        folder = self.store.new_machine_folder()
        try:
            found = write_machine_files(folder, toml, tables)
        except BaseException:
            _remove(folder)
            raise
        record = self.store.add_machine(folder, name.strip() or found.name, who)
        self.trail.add(who, "add machine", name=record.name, machine_id=record.id, sha256=record.sha256)
        return record

    # ── being told ───────────────────────────────────────────────────────────────────────────────────────────────

    def subscribe(self, listener: Callable[[Change], None]) -> Callable[[], None]:
        """Call `listener`, from any thread, with what changes; it must not wait. Returns what ends that."""
        with self._change:
            self._listeners = (*self._listeners, listener)

        def unsubscribe() -> None:
            with self._change:
                self._listeners = tuple(one for one in self._listeners if one is not listener)

        return unsubscribe

    def _tell(self, change: Change) -> None:
        for listener in self._listeners:
            try:
                listener(change)
            except Exception:
                _log.exception("a listener failed")


def _remove(folder: Path) -> None:
    shutil.rmtree(folder, ignore_errors=True)
