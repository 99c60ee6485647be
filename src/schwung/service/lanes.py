"""One thread per bus: jobs in order, the drivers kept connected between them, idle drives looked at now and then.

So there is one SYNC per bus and never two who move. What is asked of a lane from elsewhere (`status`, `brakes`, `pull`)
is read or set without waiting for it.
"""

from __future__ import annotations

import contextlib
import logging
import queue
import threading
import time
from collections.abc import Callable, Iterator
from contextlib import ExitStack, contextmanager
from dataclasses import dataclass, replace

from schwung.api.drives import Connected, Drive, DriveState, connected
from schwung.api.watching import SteppedClock
from schwung.errors import DriveError, SchwungError
from schwung.service.latch import Brake
from schwung.service.records import DriveRecord
from schwung.service.values import BusEntry

_log = logging.getLogger("schwung.service")
_RETRY_S = 5.0  # a drive that did not answer is asked again after so long


@dataclass(frozen=True)
class DriveStatus:
    """What is known of a drive at this moment. `state` is as seen at `seen_s` (monotonic), None before it answered."""

    drive_id: str
    connected: bool = False
    busy_with: str | None = None  # id of the run
    state: DriveState | None = None
    seen_s: float | None = None
    trouble: str = ""  # why it is not connected


@dataclass
class _Held:
    stack: ExitStack
    found: Connected
    brake: Brake


class Lane:
    """The thread of one bus. `drives` tells which drives are on it; `changed` is called, from here, with a new
    status."""

    def __init__(
        self,
        entry: BusEntry,
        drives: Callable[[], list[DriveRecord]],
        changed: Callable[[DriveStatus], None],
        poll_s: float,
        halted: Callable[[float], None] = lambda _latency_s: None,
    ) -> None:
        self.entry, self._halted = entry, halted
        self._answered_s, self._asked = time.monotonic(), False
        self._drives, self._changed, self._poll_s = drives, changed, poll_s
        self._jobs: queue.SimpleQueue[Callable[[], None] | None] = queue.SimpleQueue()
        self._held: dict[str, _Held] = {}
        self._status: dict[str, DriveStatus] = {}
        self._retry_s: dict[str, float] = {}
        self._thread = threading.Thread(target=self._run, name=f"schwung bus {entry.name}", daemon=True)
        self._thread.start()

    # ── from any thread ──────────────────────────────────────────────────────────────────────────────────────────

    def put(self, job: Callable[[], None]) -> None:
        """Have a job done in its turn; it never raises."""
        self._jobs.put(job)

    def status(self, drive_id: str) -> DriveStatus:
        """What is known of a drive."""
        return self._status.get(drive_id) or DriveStatus(drive_id)

    def connected_drives(self) -> list[tuple[str, Drive]]:
        """Ids and drives that are connected at this moment, for those who watch."""
        return [(drive_id, held.found.drive) for drive_id, held in list(self._held.items())]

    def pull(self, drive_id: str | None = None) -> list[Brake]:
        """Quick stop of one drive, or all that are connected; returns at once the brakes that were pulled."""
        pulled = [held.brake for key, held in list(self._held.items()) if drive_id in (None, key)]
        for brake in pulled:
            brake.pull()
        self.put(self._let_time_pass)
        return pulled

    def ask(self) -> float:
        """How long ago it has answered (s): asked anew, it answers between two jobs, and by what goes on in one."""
        if not self._asked:
            self._asked = True
            self.put(self.answered)
        return time.monotonic() - self._answered_s

    def answered(self) -> None:
        """Whoever works in it says that it goes on."""
        self._answered_s, self._asked = time.monotonic(), False

    def close(self, patience_s: float) -> bool:
        """End the lane after the job that it is at; False where that takes longer."""
        self._jobs.put(None)
        self._thread.join(patience_s)
        return not self._thread.is_alive()

    # ── in its thread ────────────────────────────────────────────────────────────────────────────────────────────

    def connect(self, record: DriveRecord) -> Connected:
        """The drive, connected now where it is not. Raises InputError, BusError and other DriveErrors."""
        held = self._held.get(record.id)
        if held is None:
            held = self._connect(record)
        elif held.brake.answer():
            held.found.drive.disable()  # a driver that was halted begins nothing before it has been switched off
        return held.found

    @contextmanager
    def released(self) -> Iterator[None]:
        """Within: nobody is connected, the bus is free for who opens it anew."""
        self._release()
        yield

    @contextmanager
    def occupied(self, drive_id: str | None, run_id: str) -> Iterator[None]:
        """Within: the drive is shown as busy with this run."""
        if drive_id is None:
            yield
            return
        self._show(replace(self.status(drive_id), busy_with=run_id))
        try:
            yield
        finally:
            self._show(replace(self.status(drive_id), busy_with=None))
            self.look(drive_id)

    def look(self, drive_id: str) -> None:
        """Look at a connected drive; one that does not answer is let go."""
        held = self._held.get(drive_id)
        if held is None:
            return
        try:
            state = held.found.drive.state()
            if state.cia402 == "unknown":
                raise DriveError(f"node {held.found.drive.identity.node_id}", "does not answer any more")
        except SchwungError as error:
            self._let_go(drive_id, str(error))
        else:
            self._show(
                replace(
                    self.status(drive_id), connected=True, state=state, seen_s=time.monotonic(), trouble=""
                )
            )

    def _connect(self, record: DriveRecord) -> _Held:
        stack = ExitStack()
        try:
            found = stack.enter_context(connected(self.entry.options, record.node_id, record.profile))
        except SchwungError as error:
            self._retry_s[record.id] = time.monotonic() + _RETRY_S
            self._show(DriveStatus(record.id, busy_with=self.status(record.id).busy_with, trouble=str(error)))
            raise
        brake = Brake(found.drive, self._halted)
        stack.callback(brake.close)
        held = self._held[record.id] = _Held(stack, found, brake)
        self.look(record.id)
        return held

    def _let_go(self, drive_id: str, trouble: str = "") -> None:
        held = self._held.pop(drive_id, None)
        if held is not None:
            with contextlib.suppress(Exception):
                held.stack.close()
            self._retry_s[drive_id] = time.monotonic() + (_RETRY_S if trouble else 0.0)
            self._show(DriveStatus(drive_id, busy_with=self.status(drive_id).busy_with, trouble=trouble))

    def _release(self) -> None:
        for drive_id in list(self._held):
            self._let_go(drive_id)

    def _show(self, status: DriveStatus) -> None:
        self._status[status.drive_id] = status
        self._changed(status)

    def _let_time_pass(self) -> None:
        """A stepped clock's time goes on in its users' thread alone: whatever was put there is due now."""
        for held in list(self._held.values()):
            clock = held.found.drive.clock
            if isinstance(clock, SteppedClock):
                clock.sleep(1e-3)

    def _run(self) -> None:
        while True:
            try:
                job = self._jobs.get(timeout=self._poll_s if self._poll_s > 0 else None)
            except queue.Empty:
                job = self._poll
            if job is None:
                break
            try:
                job()
            except Exception:  # a defect in one may not end the lane for all that come
                _log.exception("bus %s", self.entry.name)
        self._release()

    def _poll(self) -> None:
        """Nobody wants anything: look at the drives, and for those that were not there."""
        for record in self._drives():
            if not self._jobs.empty():
                return
            if record.id in self._held:
                self.look(record.id)
            elif time.monotonic() >= self._retry_s.get(record.id, 0.0):
                with contextlib.suppress(SchwungError):
                    self._connect(record)
