"""SYNC producers in Python: lockstep, as fast as the drive answers, and a thread that keeps to absolute deadlines.

Lockstep is for drives whose time is SYNC itself. A thread's jitter is what the system makes of it (2.6 ms at the
99th percentile was measured under load): on SocketCAN the kernel's producer is taken instead (kernel.py).
"""

from __future__ import annotations

import threading
import time

from schwung.errors import BusError, NodeLostError
from schwung.fieldbus.canopen.exchange import Exchange
from schwung.fieldbus.canopen.link import Frame
from schwung.fieldbus.canopen.recorder import Recorder
from schwung.fieldbus.drive import Progress

_PROGRESS_S = 0.05
LOST_AFTER_S = 0.1  # lockstep: an answer that takes longer is lost, unless it turns up after all
STRAGGLERS_S = 0.25  # lockstep: so long the last answers are waited for where some were missed
SILENT_S = 0.5  # otherwise: no answer for so long, and the node is lost
SILENT_CYCLES = 20  # lockstep: so many in a row without any answer, and the node is lost


class LockstepProducer:
    """The next RPDO and SYNC go out, from the thread that receives, as soon as the last SYNC is answered."""

    name = "lockstep"

    def __init__(self, exchange: Exchange, period_s: float) -> None:
        self.period_s = period_s
        self._exchange = exchange
        self._syncs = exchange.sync_frames()
        self._template = Frame(exchange.layouts.rpdo.can_id, bytes(exchange.layouts.rpdo.size))
        self._all = (1 << len(exchange.layouts.tpdos)) - 1
        self._lock = threading.Lock()
        self._over = threading.Event()
        self._over.set()
        self._held = b""
        self._frames: list[bytes] = []
        self._recorder: Recorder | None = None
        self._position = 0
        self._pending = 0
        self._silent = 0
        self._gave_up = False

    def start(self, frame: bytes) -> None:
        self._held = frame
        self._exchange.after_tpdo = self._answered
        self.pump(self.period_s)

    def hold(self, frame: bytes) -> None:
        with self._lock:
            self._held = frame
            self._frames = []
        self._over.set()

    def pump(self, duration_s: float) -> bool:
        cycles = max(1, round(duration_s / self.period_s))
        self._run([self._held] * cycles, None, None)
        return self._silent == 0

    def play(self, frames: list[bytes], after: bytes, recorder: Recorder, progress: Progress | None) -> None:
        self._run(frames, recorder, progress)
        self._held = after

    def stop(self) -> None:
        self.hold(self._held)
        self._exchange.after_tpdo = None

    def _run(self, frames: list[bytes], recorder: Recorder | None, progress: Progress | None) -> None:
        exchange = self._exchange
        with self._lock:
            self._frames, self._recorder, self._silent, self._gave_up = frames, recorder, 0, False
            self._over.clear()
            self._position = -1
            self._send_next()
        seen, since = -1, time.monotonic()
        shown = 0.0
        while not self._over.wait(LOST_AFTER_S / 4 if recorder is not None else 0.01):
            now = time.monotonic()
            if self._position != seen:
                seen, since = self._position, now
            elif now - since > LOST_AFTER_S:
                self._give_up_cycle(seen)
            if exchange.troubled.is_set() and recorder is not None:
                break
            if progress is not None and now - shown > _PROGRESS_S:
                shown = now
                progress(max(self._position, 0), len(frames))
        if self._gave_up and recorder is not None:
            # What was only late shifts all that follow by one: the last answers are still to come.
            time.sleep(STRAGGLERS_S)
        with self._lock:
            self._frames = []
            self._over.set()
        if progress is not None:
            progress(max(self._position, 0), len(frames))

    def _give_up_cycle(self, position: int) -> None:
        with self._lock:
            if self._position != position or self._over.is_set():
                return
            self._gave_up = True
            if self._pending == self._all:
                self._silent += 1
            recorded = self._recorder is not None
            if self._silent >= (SILENT_CYCLES if recorded else 2):
                if recorded:
                    self._exchange.report(NodeLostError(
                        f"node {self._exchange.node_id}", f"did not answer {self._silent} SYNCs in a row",
                        "Check its power and the cable."))  # fmt: skip
                self._over.set()
                return
            self._send_next()

    def _answered(self, number: int) -> None:
        with self._lock:
            if not self._pending:
                return
            self._pending &= ~(1 << number)
            if not self._pending:
                self._silent = 0
                self._send_next()

    def _send_next(self) -> None:
        """Send RPDO and SYNC of the next cycle; the lock is held."""
        exchange = self._exchange
        self._position += 1
        position = self._position
        if position >= len(self._frames) or (exchange.trouble is not None and self._recorder is not None):
            self._pending = 0
            self._over.set()
            return
        rpdo = self._template.__deepcopy__(None)
        rpdo.data = bytearray(self._frames[position])
        self._pending = self._all
        try:
            exchange.link.send_frame(rpdo)
            exchange.sync_count += 1
            if self._recorder is not None:
                self._recorder.sync(time.time(), exchange.sync_count, position)
            exchange.link.send_frame(self._syncs[(exchange.sync_count - 1) % len(self._syncs)])
        except BusError as error:
            exchange.report(error)
            self._over.set()


class ThreadProducer:
    """A thread with absolute deadlines: RPDO half a period before the SYNC that it is for.

    A late SYNC is caught up with by at most half a period per cycle; the motion is never compressed further.
    """

    name = "thread"

    def __init__(self, exchange: Exchange, period_s: float) -> None:
        self.period_s = period_s
        self._exchange = exchange
        self._syncs = exchange.sync_frames()
        self._held = b""
        self._frames: list[bytes] = []
        self._after = b""
        self._position = 0
        self._change = threading.Lock()
        self._over = threading.Event()
        self._over.set()
        self._ending = threading.Event()
        self._thread: threading.Thread | None = None

    def start(self, frame: bytes) -> None:
        self._held = frame
        self._ending.clear()
        self._thread = threading.Thread(target=self._run, name="schwung SYNC", daemon=True)
        self._thread.start()

    def hold(self, frame: bytes) -> None:
        with self._change:
            self._held = frame
            self._frames = []
            self._over.set()

    def pump(self, duration_s: float) -> bool:
        count = self._exchange.answer_count
        time.sleep(max(duration_s, 2 * self.period_s))
        return self._exchange.answer_count > count

    def play(self, frames: list[bytes], after: bytes, recorder: Recorder, progress: Progress | None) -> None:
        with self._change:
            self._after, self._position, self._frames = after, 0, frames
            self._over.clear()
        wait_while_playing(self._over, self._exchange, recorder, len(frames), progress)
        time.sleep(4 * self.period_s)  # answers that come late

    def stop(self) -> None:
        self._ending.set()
        self._over.set()
        if self._thread is not None and self._thread is not threading.current_thread():
            self._thread.join(1.0)

    def _next_frame(self) -> tuple[bytes, int]:
        with self._change:
            if not self._frames:
                return self._held, -1
            position = self._position
            if position >= len(self._frames):
                self._held, self._frames = self._after, []
                self._over.set()
                return self._held, -1
            self._position += 1
            return self._frames[position], position

    def _run(self) -> None:
        exchange, half = self._exchange, self.period_s / 2
        due = time.perf_counter() + half
        while not self._ending.is_set():
            try:
                _sleep_until(due - half)
                frame, position = self._next_frame()
                exchange.send_rpdo(frame)
                _sleep_until(due)
                exchange.sync_count += 1
                recorder = exchange.recorder
                if recorder is not None:
                    recorder.sync(time.time(), exchange.sync_count, position)
                exchange.link.send_frame(self._syncs[(exchange.sync_count - 1) % len(self._syncs)])
            except BusError as error:
                exchange.report(error)
                self._ending.wait(0.05)
            due = max(due + self.period_s, time.perf_counter() + half)


def wait_while_playing(
    over: threading.Event, exchange: Exchange, recorder: Recorder, total: int, progress: Progress | None
) -> None:
    """Wait until a playback is over or in trouble, telling progress. A drive that falls silent is trouble."""
    answered, since = exchange.answer_count, time.monotonic()
    while not over.wait(_PROGRESS_S):
        if exchange.troubled.is_set():
            break
        now = time.monotonic()
        if exchange.answer_count != answered:
            answered, since = exchange.answer_count, now
        elif now - since > SILENT_S:
            silence = f"did not answer SYNC for {now - since:.1f} s"
            exchange.report(NodeLostError(f"node {exchange.node_id}", silence, "Check its power and cable."))
        if progress is not None:
            progress(min(len(recorder.sync_times), total), total)
    if progress is not None:
        progress(min(len(recorder.sync_times), total), total)


def _sleep_until(due: float) -> None:
    left = due - time.perf_counter()
    if left > 0:
        time.sleep(left)
