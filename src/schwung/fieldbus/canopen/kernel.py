"""SYNC and setpoints from the kernel: SocketCAN's broadcast manager keeps the time, Python only feeds it.

One task of the broadcast manager sends SYNC; another plays a ring of 256 RPDO frames, whose slots are rewritten ahead
of where it plays, so that a motion may be longer than the ring. The kernel's own frames come back on the raw socket,
in order with the answers, and tell where the ring is and which setpoint held at each SYNC. A task waits a period
after each frame, so that it runs slow by its latency: that is measured before the power stage is on, and taken off.

If this process dies, the kernel closes its sockets and both tasks end: the drive's heartbeat consumer stops it. If
it is merely held up, the last slots before the ring would repeat hold quick stop and then disable voltage, after
which no repeated slot can move the drive.
"""

from __future__ import annotations

import contextlib
import threading
import time
from collections.abc import Callable

import can
import numpy as np
from can.broadcastmanager import ModifiableCyclicTaskABC

from schwung.errors import BusError, InputError, StateError
from schwung.fieldbus import cia402
from schwung.fieldbus.canopen.exchange import SYNC_ID, Exchange
from schwung.fieldbus.canopen.link import Frame
from schwung.fieldbus.canopen.output import StopFrame
from schwung.fieldbus.canopen.recorder import Recorder
from schwung.fieldbus.canopen.sync import wait_while_playing
from schwung.fieldbus.drive import Progress

RING = 256  # frames that one task of the broadcast manager holds
GUARD = 64  # slots before the wrap that stop the drive if they are ever reached
REFILL = 64  # slots played between two refills
_LEAD = 48  # slots between the decision to play and the first setpoint
_ECHO_TIMEOUT_S = 1.0
_CALIBRATION_CYCLES = 200
_MOST_EXCESS = 0.4  # of the period; a system that is later than that on average cannot keep it


class KernelProducer:
    """RPDO ring and SYNC as two cyclic tasks; see the module."""

    name = "kernel"

    def __init__(self, exchange: Exchange, period_s: float, stop_frame: StopFrame) -> None:
        if abs(period_s * 1e6 - round(period_s * 1e6)) > 1e-6:
            raise InputError(
                "sample_rate_hz", f"{1 / period_s:g} Hz is no whole number of µs", "Take e.g. 1000."
            )
        self.period_s = period_s
        self._exchange, self._stop_frame = exchange, stop_frame
        self.last = b""
        self._rpdo_id = exchange.layouts.rpdo.can_id
        self._offset = exchange.layouts.rpdo.offset("6040:00")
        self._task: ModifiableCyclicTaskABC | None = None
        self._sync_task: can.CyclicSendTaskABC | None = None
        self._write_lock = threading.RLock()
        self._over = threading.Event()
        self._over.set()
        self._held = b""
        self._after = b""
        self._frames: list[bytes] = []
        self._first = 0  # count of the ring's first setpoint; counts go on growing, slot = count % RING
        self._written = 0  # count that was playing when the ring was last written
        self._played = -1  # count of the last echo
        self._setpoint = -1
        self._last_rpdo_s = self._last_sync_s = 0.0
        self._stamps: tuple[list[float], list[float]] | None = (
            None  # of RPDO and SYNC, while they are measured
        )

    def start(self, frame: bytes) -> None:
        exchange = self._exchange
        self._held, self._frames = frame, []
        exchange.expecting_echo = True
        exchange.link.subscribe(self._rpdo_id, self._on_rpdo)
        exchange.link.subscribe(SYNC_ID, self._on_sync)
        self._start_tasks(frame, self.period_s, self.period_s)
        excess = self._measure_excess()
        self._stop_tasks()
        time.sleep(4 * self.period_s)
        self._start_tasks(frame, self.period_s - excess[0], self.period_s - excess[1])

    def hold(self, frame: bytes) -> None:
        with self._write_lock:
            self._held, self._frames, self._setpoint = frame, [], -1
            self._write()
        self._over.set()

    def latch(self, controlword: int) -> None:
        self.hold(self._stop_frame.frame(self.last or self._held, controlword))

    def release(self) -> None: ...

    def pump(self, duration_s: float) -> bool:
        count = self._exchange.answer_count
        time.sleep(max(duration_s, 3 * self.period_s))
        return self._exchange.answer_count > count

    def play(self, frames: list[bytes], after: bytes, recorder: Recorder, progress: Progress | None) -> None:
        self._over.clear()
        with self._write_lock:
            self._frames, self._after = frames, after
            self._setpoint = -1
            self._first = self._played + _LEAD
            self._write()
        feeder = threading.Thread(target=self._feed, name="schwung setpoints", daemon=True)
        feeder.start()
        wait_while_playing(self._over.is_set, self._exchange, recorder, len(frames), progress)
        time.sleep(4 * self.period_s)  # answers that come late
        if self._setpoint == len(frames):
            self.hold(after)
        feeder.join(1.0)

    def stop(self) -> None:
        self._over.set()
        self._stop_tasks()
        self._exchange.link.unsubscribe(self._rpdo_id, self._on_rpdo)
        self._exchange.link.unsubscribe(SYNC_ID, self._on_sync)
        self._exchange.expecting_echo = False

    def _start_tasks(self, frame: bytes, rpdo_period_s: float, sync_period_s: float) -> None:
        """Ring of held frames, and SYNC half a period later."""
        self._played = -1
        task = self._start_task([Frame(self._rpdo_id, frame)] * RING, rpdo_period_s)
        if not isinstance(task, ModifiableCyclicTaskABC):
            raise BusError(self._exchange.link.name, "its cyclic tasks cannot be changed", "Use a thread.")
        self._task = task
        self._wait_echo(self._rpdo_stamp, "RPDO")
        time.sleep(self.period_s / 2)
        self._sync_task = self._start_task(self._exchange.sync_frames(), sync_period_s)
        self._wait_echo(self._sync_stamp, "SYNC")

    def _start_task(self, frames: list[Frame], period_s: float) -> can.CyclicSendTaskABC:
        whole = round(period_s * 1e6) / 1e6 + 1e-9  # python-can cuts to whole microseconds
        try:
            return self._exchange.link.bus.send_periodic(list(frames), whole, store_task=False)
        except (can.CanError, OSError) as error:
            raise BusError(
                self._exchange.link.name, f"no cyclic task ({error})", "Is can-bcm there?"
            ) from error

    def _stop_tasks(self) -> None:
        for task in (self._task, self._sync_task):
            if task is not None:
                with contextlib.suppress(can.CanError, OSError):
                    task.stop()
        self._task = self._sync_task = None

    def _measure_excess(self) -> tuple[float, float]:
        """By how much the intervals of both tasks exceed the period (s), single stalls left out."""
        rpdo: list[float] = []
        sync: list[float] = []
        self._stamps = (rpdo, sync)
        deadline = time.monotonic() + 3 * _CALIBRATION_CYCLES * self.period_s + _ECHO_TIMEOUT_S
        while len(sync) < _CALIBRATION_CYCLES:
            if time.monotonic() > deadline:
                raise BusError(
                    self._exchange.link.name, "the kernel's SYNC falters", "Lower the sample rate."
                )
            time.sleep(10 * self.period_s)
        self._stamps = None
        return self._excess(rpdo), self._excess(sync)

    def _excess(self, stamps: list[float]) -> float:
        intervals = np.sort(np.diff(stamps))
        usual = float(np.mean(intervals[: int(0.98 * intervals.size)]))
        return min(max(usual - self.period_s, 0.0), _MOST_EXCESS * self.period_s)

    def _rpdo_stamp(self) -> float:
        return self._last_rpdo_s

    def _sync_stamp(self) -> float:
        return self._last_sync_s

    def _wait_echo(self, stamp: Callable[[], float], what: str) -> None:
        before, deadline = stamp(), time.monotonic() + _ECHO_TIMEOUT_S
        while stamp() == before:
            if time.monotonic() > deadline:
                raise BusError(
                    self._exchange.link.name,
                    f"{what} frames of the kernel do not come back",
                    "Leave local_loopback on; is the interface up, does anybody acknowledge frames?",
                )
            time.sleep(self.period_s / 10)

    def _content(self, count: int) -> bytes:
        """The frame that belongs at a count of the ring, were Python never late."""
        if not self._frames or count < self._first:
            return self._held
        index = count - self._first
        return self._frames[index] if index < len(self._frames) else self._after

    def _write(self) -> None:
        """Write the next RING slots; the lock is held. Slots that are about to play are rewritten as they were."""
        task, begin = self._task, self._played + 1
        if task is None:
            return
        slots: list[Frame] = [Frame(self._rpdo_id, b"")] * RING
        moving_until = self._first + len(self._frames) if self._frames else begin
        for ahead in range(RING):
            count = begin + ahead
            data = self._content(count)
            if ahead >= RING - GUARD and self._first <= count < moving_until:
                data = self._stopping(data, last=ahead == RING - 1)
            slots[count % RING] = Frame(self._rpdo_id, data)
        self._written = begin
        try:
            task.modify_data(list(slots))
        except (can.CanError, OSError, ValueError) as error:
            self._exchange.report(BusError(self._exchange.link.name, f"no refill ({error})", "Is it up?"))

    def _stopping(self, data: bytes, *, last: bool) -> bytes:
        word = cia402.DISABLE_VOLTAGE if last else cia402.QUICK_STOP
        return data[: self._offset] + word.to_bytes(2, "little") + data[self._offset + 2 :]

    def _feed(self) -> None:
        while not self._over.wait(self.period_s * REFILL / 8):
            if self._exchange.trouble is not None:
                return
            with self._write_lock:
                if self._frames and self._played - self._written >= REFILL:
                    self._write()

    def _on_rpdo(self, message: can.Message) -> None:
        self._last_rpdo_s = message.timestamp
        if self._stamps is not None:
            self._stamps[0].append(message.timestamp)
        self._played += 1
        self.last = bytes(message.data)
        frames = self._frames
        if not frames:
            return
        if message.data != self._content(self._played):
            self._unexpected(message)
        index = self._played - self._first
        if index >= 0:
            self._setpoint = min(index, len(frames))

    def _unexpected(self, message: can.Message) -> None:
        """An echo was lost, the guard was reached, or somebody else speaks."""
        for skipped in range(1, 9):
            if message.data == self._content(self._played + skipped):
                self._played += skipped
                return
        exchange = self._exchange
        word = int.from_bytes(message.data[self._offset : self._offset + 2], "little")
        if self._played - self._written >= RING - GUARD - 8 and word in (
            cia402.QUICK_STOP,
            cia402.DISABLE_VOLTAGE,
        ):
            exchange.report(StateError(
                f"node {exchange.node_id}",
                f"was stopped: this program was held up for {(self._played - self._written) * self.period_s:.2f} s",
                "Free the processor of other work."))  # fmt: skip
        else:
            self._played -= 1  # not one of ours
            exchange.report_foreign(message)

    def _on_sync(self, message: can.Message) -> None:
        self._last_sync_s = message.timestamp
        if self._stamps is not None:
            self._stamps[1].append(message.timestamp)
        exchange = self._exchange
        exchange.sync_count += 1
        frames, setpoint = self._frames, self._setpoint
        recorder = exchange.recorder
        if recorder is not None:
            recorder.sync(message.timestamp, exchange.sync_count, setpoint if setpoint < len(frames) else -1)
        if frames and setpoint == len(frames):
            self._over.set()
