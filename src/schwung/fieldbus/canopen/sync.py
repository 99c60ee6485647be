"""SYNC producers in Python: lockstep, as fast as the drive answers, and one that keeps to the clock.

Lockstep is for drives whose time is SYNC itself. By the wall's clock a thread's jitter is what the system makes of it
(2.6 ms at the 99th percentile was measured under load): on SocketCAN the kernel's producer is taken (kernel.py).
"""

from __future__ import annotations

import contextlib
from collections.abc import Callable

import numpy as np

from schwung.clock import Task
from schwung.errors import BusError, NodeLostError
from schwung.fieldbus.canopen.exchange import SILENT_CYCLES, SILENT_S, Exchange
from schwung.fieldbus.canopen.link import Link
from schwung.fieldbus.canopen.output import Outgoing, Output
from schwung.fieldbus.canopen.recorder import Recorder, measure_timing
from schwung.fieldbus.drive import Progress, SyncTiming

_PROGRESS_S = 0.05
LOST_AFTER_S = 0.1  # lockstep: an answer that takes longer is lost, unless it turns up after all
STRAGGLERS_S = 0.25  # lockstep: so long the last answers are waited for where some were missed
_SILENT_AT_MOST_S = 0.5  # where SYNC does not go out either
_LOOK_S = 0.01
_FEW = 4  # periods: an answer may be lost, and one begun when it was asked for
_PROBE_ID = 0x6FF  # restricted (CiA 301, table of CAN-IDs): no communication object uses it
_PROBE_S = 0.5


class _PythonProducer:
    """What both have in common: frames from an `Output`."""

    def __init__(self, exchange: Exchange, period_s: float, output: Output) -> None:
        self.period_s = period_s
        self._exchange, self._output, self._clock = exchange, output, exchange.link.clock
        self._syncs = exchange.sync_frames()
        self._sending = self._clock.lock()  # what was taken from the output is sent before a stop is
        self._awaits_sync = False  # an RPDO that enables has gone out, and no SYNC since

    @property
    def last(self) -> bytes:
        return self._output.last

    def hold(self, frame: bytes) -> None:
        self._output.hold(frame)

    def latch(self, controlword: int) -> None:
        """As Producer. Sent at once, too: an RPDO that waits for its SYNC in the drive would act after the stop."""
        frame = self._output.latch(controlword)  # first: what waits for the send buffer is no longer wanted
        with self._sending, contextlib.suppress(BusError):
            if frame and self._exchange.send_rpdo(frame):
                self._output.sent(Outgoing(frame, -1))

    def send_awaited_sync(self) -> bool:
        """As Producer."""
        try:
            if self._awaits_sync:
                self._send_sync(-1)
        except BusError:
            return False
        return True

    def release(self) -> None:
        self._output.release()

    def _send_rpdo(self) -> int:
        """Send the frame whose turn it is; the setpoint in it. A stop that came in between is not overwritten."""
        self._exchange.take_turn(self.period_s, self._output.coming)
        with self._sending:
            outgoing = self._send_next()
            while self._output.overtakes(outgoing.frame):
                outgoing = self._send_next()
            return outgoing.setpoint

    def _send_next(self) -> Outgoing:
        """The frame whose turn it is, sent unless a stop comes while it waits for the send buffer."""
        outgoing = self._output.next()
        if self._exchange.send_rpdo(outgoing.frame, lambda: not self._output.overtakes(outgoing.frame)):
            self._output.sent(outgoing)
            self._awaits_sync |= self._output.enables(outgoing.frame)
        return outgoing

    def _send_sync(self, setpoint: int) -> None:
        """Send SYNC, at which the drive acts upon the RPDO that it has: a stop that came since then goes first."""
        exchange = self._exchange
        exchange.sync_count += 1
        if exchange.recorder is not None:
            exchange.recorder.sync(self._clock.date(), exchange.sync_count, setpoint)
        frame = self._syncs[(exchange.sync_count - 1) % len(self._syncs)]
        while not (self._is_last_wanted() and exchange.link.send_frame(frame, self._is_last_wanted)):
            self._send_rpdo()
        self._awaits_sync = False

    def _is_last_wanted(self) -> bool:
        return not self._output.overtakes(self._output.last)


class LockstepProducer(_PythonProducer):
    """The next RPDO and SYNC go out, from the thread that plays, as soon as the last SYNC is answered."""

    name = "lockstep"

    def __init__(self, exchange: Exchange, period_s: float, output: Output) -> None:
        super().__init__(exchange, period_s, output)
        self._turn = self._clock.lock()  # `halt` in another thread may send cycles of its own
        self._all = (1 << len(exchange.layouts.tpdos)) - 1
        self._pending = 0
        self._answered = self._clock.event()
        self._stopped = False

    def start(self, frame: bytes) -> None:
        self._stopped = False
        self._output.hold(frame)
        self._exchange.after_tpdo = self._on_tpdo
        self.pump(self.period_s)

    def pump(self, duration_s: float) -> bool:
        if self._stopped:
            self._clock.sleep(duration_s)
            return False
        missed = 0
        for _ in range(max(1, round(duration_s / self.period_s))):
            missed = 0 if self._cycle() else missed + 1
            if missed == 2:
                return False
        return missed == 0

    def await_answers(self) -> bool:
        return self.pump(self.period_s)

    def play(self, frames: list[bytes], after: bytes, recorder: Recorder, progress: Progress | None) -> None:
        exchange, clock = self._exchange, self._clock
        self._output.play(frames, after)
        silent, any_missed, shown = 0, False, clock.now()
        for _ in range(len(frames)):
            if exchange.trouble is not None or not self._output.playing:
                break
            answered = self._cycle()
            any_missed = any_missed or not answered
            silent = silent + 1 if self._pending == self._all else 0
            if silent >= SILENT_CYCLES:
                lost = f"did not answer {silent} SYNCs in a row"
                exchange.report(
                    NodeLostError(f"node {exchange.node_id}", lost, "Check its power and the cable.")
                )
            if progress is not None and clock.now() - shown > _PROGRESS_S:
                shown = clock.now()
                progress(recorder.played, len(frames))
        if any_missed:
            # What was only late shifts all that follow by one: the last answers are still to come.
            clock.sleep(STRAGGLERS_S)
        if progress is not None:
            progress(recorder.played, len(frames))

    def stop(self) -> None:
        self._stopped = True
        self._exchange.after_tpdo = None

    def _cycle(self) -> bool:
        """RPDO and SYNC, and the answers; False where not all came in time."""
        with self._turn:
            self._answered.clear()
            self._pending = self._all
            try:
                self._send_sync(self._send_rpdo())
            except BusError as error:  # the frame after it would be a step
                self._exchange.report(error)
                return False
            return self._answered.wait(LOST_AFTER_S)

    def _on_tpdo(self, number: int) -> None:
        self._pending &= ~(1 << number)
        if not self._pending:
            self._answered.set()


class PeriodicProducer(_PythonProducer):
    """Keeps to absolute deadlines of the clock: RPDO half a period before the SYNC that it is for.

    A late SYNC is caught up with by at most half a period per cycle; the motion is never compressed further.
    """

    name = "thread"

    def __init__(self, exchange: Exchange, period_s: float, output: Output) -> None:
        super().__init__(exchange, period_s, output)
        self._task: Task | None = None
        self._setpoint: int | None = None  # of the RPDO that waits for its SYNC

    def start(self, frame: bytes) -> None:
        self._output.hold(frame)
        self._task = self._clock.every(self.period_s / 2, self._half_cycle, "schwung SYNC")

    def pump(self, duration_s: float) -> bool:
        return answered_within(self._exchange, max(duration_s, 2 * self.period_s))

    def await_answers(self) -> bool:
        return await_answers(self._exchange, self.period_s)

    def play(self, frames: list[bytes], after: bytes, recorder: Recorder, progress: Progress | None) -> None:
        self._output.play(frames, after)
        wait_while_playing(self._output.over, self._exchange, recorder, len(frames), progress)
        self._clock.sleep(4 * self.period_s)  # answers that come late

    def stop(self) -> None:
        if self._task is not None:
            self._task.close()

    def _half_cycle(self) -> None:
        setpoint, self._setpoint = self._setpoint, None
        try:
            if setpoint is None:
                self._setpoint = self._send_rpdo()
            else:
                self._send_sync(setpoint)
        except BusError as error:  # the frame after it would be a step
            self._exchange.report(error)


def measure_evenness(link: Link, period_s: float) -> SyncTiming:
    """How evenly a thread of ours gets frames onto this bus: what SYNC would be by `PeriodicProducer`.

    Measured with empty frames of an identifier that no object may use, so that nobody acts on them. Raises BusError.
    """
    stamps: list[float] = []
    failures: list[BusError] = []

    def probe() -> None:
        try:
            link.send(_PROBE_ID, b"")
        except BusError as error:
            failures.append(error)
        stamps.append(link.clock.date())

    task = link.clock.every(period_s, probe, "schwung probe")
    link.clock.wait(lambda: bool(failures), _PROBE_S)
    task.close()
    if failures:
        raise failures[0]
    return measure_timing(PeriodicProducer.name, period_s, np.array(stamps))


def answered_within(exchange: Exchange, duration_s: float) -> bool:
    """Let so much time pass; False where one of the TPDOs did not come meanwhile: another one does not stand for it."""
    heard = _hearing(exchange)
    exchange.link.clock.sleep(duration_s)
    return heard()


def await_answers(exchange: Exchange, period_s: float) -> bool:
    """Until every TPDO has come anew; False where one does not in a few periods."""
    return exchange.link.clock.wait(_hearing(exchange), _FEW * period_s)


def _hearing(exchange: Exchange) -> Callable[[], bool]:
    before = list(exchange.answer_counts)
    return lambda: all(now > count for count, now in zip(before, exchange.answer_counts, strict=True))


def wait_while_playing(
    over: Callable[[], bool], exchange: Exchange, recorder: Recorder, total: int, progress: Progress | None
) -> None:
    """Wait until a playback is over or in trouble, telling progress. A drive that falls silent is trouble, also where
    but one TPDO does not come: it may be the one that shows a fault.

    Counted are SYNCs that went out: a program that is held up misses neither them nor the answers.
    """
    clock = exchange.link.clock
    counts = list(exchange.answer_counts)
    since = [(clock.now(), exchange.sync_count)] * len(counts)
    shown = clock.now()
    while not clock.wait(lambda: over() or exchange.trouble is not None, _LOOK_S):
        now = clock.now()
        for number, count in enumerate(exchange.answer_counts):
            if count != counts[number]:
                counts[number], since[number] = count, (now, exchange.sync_count)
        heard_s, heard = min(since)
        silent_s, cycles = now - heard_s, exchange.sync_count - heard
        if silent_s > _SILENT_AT_MOST_S or (silent_s > SILENT_S and cycles > SILENT_CYCLES):
            silence = f"did not answer SYNC for {silent_s:.2f} s"
            exchange.report(NodeLostError(f"node {exchange.node_id}", silence, "Check its power and cable."))
        if progress is not None and now - shown > _PROGRESS_S:
            shown = now
            progress(min(len(recorder.sync_times), total), total)
    if progress is not None:
        progress(min(len(recorder.sync_times), total), total)
