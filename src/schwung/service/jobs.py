"""The queue: what was asked for is done in order, told of while it is done, and kept when it ends.

What touches a bus is done in that bus's lane, what only computes in a thread that waits for a process of its own
(`workshop.py`). A `Task` is what the work of a run (`work/`) sees: it observes a procedure, hands out the drive, and
stops by raising KeyboardInterrupt where the run was cancelled, as Ctrl-C does at the command line.
"""

from __future__ import annotations

import logging
import queue
import threading
import time
from collections.abc import Callable, Iterable, Mapping
from contextlib import nullcontext
from dataclasses import asdict, dataclass, replace
from pathlib import Path
from typing import Any, Protocol

from schwung.api.drives import Connected
from schwung.errors import DriveError, InputError, InterruptedByUser, SchwungError
from schwung.service.audit import Trail
from schwung.service.lanes import Lane
from schwung.service.proposals import Proposals
from schwung.service.records import DriveRecord
from schwung.service.store import Store
from schwung.service.values import ENDED, Progress, RunState, RunView
from schwung.service.workshop import Compute, Workshop

_log = logging.getLogger("schwung.service")
_KEPT_NOTES = 50


class Work(Protocol):
    """What a run does; raises SchwungError where it cannot. Its result is JSON-ready."""

    def __call__(self, task: Task) -> Mapping[str, Any]: ...


@dataclass(frozen=True)
class Shared:
    """What all runs have in common."""

    store: Store
    workshop: Workshop
    proposals: Proposals
    trail: Trail


class Task:
    """One run while it is queued or running. `request` is its validated request (requests.py)."""

    def __init__(
        self,
        run: RunView,
        request: Any,
        work: Work,
        shared: Shared,
        lane: Lane | None,
        told: Callable[[Task], None],
    ) -> None:
        self.run, self.request, self.lane = run, request, lane
        self.store, self.proposals, self.trail = shared.store, shared.proposals, shared.trail
        self._work, self._workshop, self._told = work, shared.workshop, told
        self.folder: Path = self.store.run_folder(run.id)
        self._progress = Progress("waiting for its turn")
        self._began_s = 0.0
        self._cancelled = threading.Event()

    # ── what the work uses ───────────────────────────────────────────────────────────────────────────────────────

    def phase(self, text: str) -> None:
        """See commissioning.Observer. Raises KeyboardInterrupt where the run was cancelled."""
        self._begin(text)
        self._tell()

    def progress(self, done: int, total: int) -> None:
        """See commissioning.Observer."""
        share = done / total if total else None
        self._share(share)

    def note(self, text: str) -> None:
        """See commissioning.Observer."""
        notes = (*self._progress.notes, text)[-_KEPT_NOTES:]
        self._progress = replace(self._progress, notes=notes)
        self._tell()

    @property
    def drive_record(self) -> DriveRecord:
        """The drive of this run, as stored. Raises InputError where it is about none."""
        if self.run.drive_id is None:
            raise InputError("drive_id", "is missing", "Name a drive.")
        return self.store.drive(self.run.drive_id)

    def connect(self) -> Connected:
        """The drive of this run, connected. Raises InputError, BusError, DriveError."""
        assert self.lane is not None
        self.check()
        record = self.drive_record
        found = self.lane.connect(record)
        identity = asdict(found.drive.identity)
        if record.identity != identity:
            self.store.change_drive(record.id, identity=identity)
            if record.identity is not None:
                self.note("another drive answers here than before")
                told = {"was": dict(record.identity), "is": identity}
                self.trail.add(self.run.who, "another drive", record.id, self.run.id, **told)
        self.check()  # a STOP that came while it was being connected found no brake to pull
        return found

    def compute(self, function: Compute, *, alone: bool = False, **arguments: Any) -> Any:
        """Run `function(**arguments, tell=…)` in a process of its own; see Workshop.run."""
        self.check()

        def tell(text: str, share: float) -> None:
            if text != self._progress.phase:
                self._begin(text)
            self._share(share)

        return self._workshop.run(function, arguments, tell, self._cancelled_while_it_goes_on, alone=alone)

    def warm(self) -> None:
        """Something will be computed soon."""
        self._workshop.warm()

    def check(self) -> None:
        """Raise KeyboardInterrupt where the run was cancelled."""
        if self._cancelled_while_it_goes_on():
            raise KeyboardInterrupt

    def _cancelled_while_it_goes_on(self) -> bool:
        if self.lane is not None:
            self.lane.answered()
        return self._cancelled.is_set()

    # ── what the queue uses ──────────────────────────────────────────────────────────────────────────────────────

    @property
    def view(self) -> RunView:
        """The run, and how far it is."""
        return replace(self.run, progress=self._progress)

    @property
    def was_cancelled(self) -> bool:
        """Somebody has asked for its end."""
        return self._cancelled.is_set()

    def cancel(self) -> None:
        """Ask for its end; returns at once."""
        self._cancelled.set()

    def carry_out(self) -> RunView:
        """Do it, in the calling thread; returns it as it ended. Never raises."""
        state: RunState = "done"
        result: Mapping[str, Any] | None = None
        error: dict[str, Any] | None = None
        try:
            self.check()
            self.store.begin_run(self.run.id)
            self.run = self.store.run(self.run.id)
            self.phase("begun")
            with (
                self.lane.occupied(self.run.drive_id, self.run.id) if self.lane is not None else nullcontext()
            ):
                result = self._work(self)
        except (KeyboardInterrupt, InterruptedByUser) as interrupt:
            state, error = "cancelled", problem_of(interrupt)
        except SchwungError as trouble:
            stopped = self.was_cancelled and isinstance(trouble, DriveError)
            state, error = "cancelled" if stopped else "failed", problem_of(trouble)
        except Exception as defect:
            _log.exception("run %s", self.run.id)
            state, error = "failed", problem_of(defect)
        if result is None and error is not None:
            result = error.pop("document", None)
        return self.store.end_run(self.run.id, state, self._with_notes(result), error)

    def _with_notes(self, result: Mapping[str, Any] | None) -> Mapping[str, Any] | None:
        notes = self._progress.notes
        return result if result is None or not notes else {**result, "notes": list(notes)}

    def _begin(self, text: str) -> None:
        self._began_s = time.monotonic()
        self._progress = Progress(text, notes=self._progress.notes)
        self.check()

    def _share(self, share: float | None) -> None:
        self.check()
        took_s = time.monotonic() - self._began_s
        left_s = took_s * (1 - share) / share if share else None
        self._progress = replace(self._progress, share=share, left_s=left_s)
        self._tell()

    def _tell(self) -> None:
        self._told(self)


def problem_of(error: BaseException) -> dict[str, Any]:
    """An error for the store and for clients; `document` holds what is known in spite of it."""
    told: dict[str, Any] = {"notes": list(getattr(error, "__notes__", []))}
    if isinstance(error, SchwungError):
        told |= {
            "type": type(error).__name__, "place": error.place, "problem": error.problem, "remedy": error.remedy,
            "text": str(error), "exit_code": error.exit_code,
        }  # fmt: skip
        document = getattr(error, "document", None)
        return told | ({"document": dict(document)} if document else {})
    if isinstance(error, KeyboardInterrupt):
        return told | {"type": "Cancelled", "text": "cancelled", "exit_code": InterruptedByUser.exit_code}
    return told | {
        "type": "Defect",
        "text": f"a defect of Schwung's: {type(error).__name__}: {error}",
        "exit_code": 1,
    }


class Jobs:
    """All runs that are queued or running. `told` is called with every change, from whichever thread makes it, `after`
    with each run that has ended, before that is told.
    """

    def __init__(
        self,
        shared: Shared,
        told: Callable[[RunView], None],
        workers: int,
        after: Callable[[RunView], None] = lambda _run: None,
    ) -> None:
        self._shared, self._store, self._told, self._after = shared, shared.store, told, after
        self._tasks: dict[str, Task] = {}
        self._lock = threading.Lock()
        self._closed = False
        self._computing: queue.SimpleQueue[Callable[[], None] | None] = queue.SimpleQueue()
        self._threads = [
            threading.Thread(target=self._compute, name=f"schwung compute {n}", daemon=True)
            for n in range(workers)
        ]
        for thread in self._threads:
            thread.start()

    def submit(self, run: RunView, request: Any, work: Work, lane: Lane | None) -> RunView:
        """Take a run that the store has accepted: into a lane, or where it only computes to the processes."""
        task = Task(run, request, work, self._shared, lane, self._tell)
        with self._lock:
            if self._closed:
                raise InputError("service", "is ending", "Start it again.")
            self._tasks[run.id] = task
        self._told(task.view)
        put = self._computing.put if lane is None else lane.put
        put(lambda: self._carry_out(task))
        return task.view

    def view(self, run_id: str) -> RunView:
        """A run, with its progress while it goes on. Raises NotFoundError."""
        task = self._tasks.get(run_id)
        return self._store.run(run_id) if task is None else task.view

    def active(self) -> list[RunView]:
        """All that is queued or running, in the order in which it was asked for."""
        return [task.view for task in list(self._tasks.values())]

    def cancel(self, run_id: str) -> RunView:
        """End a run: one that waits at once, one that runs as soon as it listens. The drive is not stopped by this
        alone.

        Raises InputError where it has ended already.
        """
        task = self._tasks.get(run_id)
        if task is None:
            run = self._store.run(run_id)
            if run.state in ENDED:
                raise InputError(f"run {run_id}", f"is {run.state} already", "There is nothing to cancel.")
            return run
        task.cancel()
        return task.view

    def cancel_all(self, runs: Iterable[RunView]) -> None:
        """Cancel those of them that still go on."""
        for run in runs:
            task = self._tasks.get(run.id)
            if task is not None:
                task.cancel()

    def close(self, patience_s: float) -> bool:
        """Cancel all, and wait for what computes; the lanes are their owner's. False where that takes longer."""
        with self._lock:
            self._closed = True
        self.cancel_all(self.active())
        for _ in self._threads:
            self._computing.put(None)
        end = time.monotonic() + patience_s
        for thread in self._threads:
            thread.join(max(0.0, end - time.monotonic()))
        return not any(thread.is_alive() for thread in self._threads)

    def _carry_out(self, task: Task) -> None:
        try:
            ended = task.carry_out()
            self._after(ended)
        except SchwungError:  # of what comes after: the service is ending
            ended = self._store.run(task.run.id)
        except Exception:  # the store fails (disk full): the row stays, and is found at the next start
            _log.exception("run %s could not be kept", task.run.id)
            ended = replace(task.run, state="failed", error={"type": "Defect", "text": "could not be kept"})
        with self._lock:
            self._tasks.pop(task.run.id, None)
        self._told(ended)

    def _tell(self, task: Task) -> None:
        self._told(task.view)

    def _compute(self) -> None:
        while (job := self._computing.get()) is not None:
            job()
