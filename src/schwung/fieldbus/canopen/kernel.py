"""SYNC and setpoints from the kernel: SocketCAN's broadcast manager keeps the time, Python only feeds it.

One operation of the broadcast manager sends RPDO and SYNC in turn, so that neither can slide against the other, from a
ring whose slots are rewritten ahead of where it plays: a motion may be longer than the ring. ring.py says what is
written and why nothing is repeated; here are the time, the threads and the bus. The kernel's own frames come back on
the raw socket, in order with the answers, and tell where the ring is and which setpoint held at each SYNC. The
operation waits half a period after each frame, so that it runs slow by its latency: that is measured before the power
stage is on, and taken off.

If this process dies, the kernel closes its sockets and sending ends: the drive's heartbeat consumer stops it. If it is
merely held up, the frames that were written ahead end in quick stop, then in silence; what is held at standstill ends
in silence.

A stop also goes out at once, behind the ring's own frames and before any request by SDO: the RPDO that already waits
for its SYNC in the drive would act after that request, and undo it.
"""

from __future__ import annotations

import contextlib
import math

import can
import numpy as np

from schwung.clock import Task
from schwung.errors import BusError, InputError, StateError
from schwung.fieldbus.canopen.bcm import Broadcast, KernelBroadcast, OpenBroadcast, pack
from schwung.fieldbus.canopen.exchange import SYNC_ID, Exchange
from schwung.fieldbus.canopen.output import StopFrame
from schwung.fieldbus.canopen.recorder import Recorder
from schwung.fieldbus.canopen.ring import CYCLES, REFILL, Ring, Write
from schwung.fieldbus.canopen.sync import answered_within, await_answers, wait_while_playing
from schwung.fieldbus.drive import Progress

GUARD_S = 0.008  # quick stop goes out for so long before silence: one lost frame does not matter
LEAD_S = 0.4  # what is held before a motion: Python may be as late when it begins as within it, CYCLES long
HOLD_S = 2.0  # at standstill: longer than a drive waits for our heartbeat, or somebody for his disk
_ECHO_TIMEOUT_S = 1.0
_RESTART_S = 0.02  # a stop that is not sent for so long is started anew
_CALIBRATION_CYCLES, _STALL = 200, 1.25
_MOST_EXCESS = 0.4  # of the period; a system that is later than that on average cannot keep it


class KernelProducer:
    """RPDO and SYNC from the kernel; see the module. `hold` and `latch` may be called from any thread."""

    name = "kernel"

    def __init__(
        self,
        exchange: Exchange,
        period_s: float,
        stop_frame: StopFrame,
        open_broadcast: OpenBroadcast = KernelBroadcast,
    ) -> None:
        if abs(period_s * 1e6 - round(period_s * 1e6)) > 1e-6:
            raise InputError(
                "sample_rate_hz", f"{1 / period_s:g} Hz is no whole number of µs", "Take e.g. 1000."
            )
        self.period_s = period_s
        self._exchange, self._clock, self._open = exchange, exchange.link.clock, open_broadcast
        self._stop_frame = stop_frame
        self._rpdo_id = exchange.layouts.rpdo.can_id
        syncs = exchange.sync_frames()
        self._syncs = [pack(SYNC_ID, bytes(syncs[slot % len(syncs)].data)) for slot in range(CYCLES)]
        self._interval_us = round(period_s * 1e6 / 2)
        self._lock = self._clock.lock()  # of all that follows: caller, feeder and reader share it
        self._ring = self._new_ring(b"")
        self._broadcast: Broadcast | None = None
        self._feeder: Task | None = None
        self._over = self._clock.event()
        self._over.set()
        self._rpdo_s = math.inf  # date of the last echo
        self._sync_s = -math.inf  # date of the last SYNC, where no RPDO has come since
        self._stamps: list[float] | None = None  # of SYNC, while it is measured

    @property
    def last(self) -> bytes:
        """The RPDO that went out last, as far as it was seen; empty before the first."""
        return self._ring.last

    def start(self, frame: bytes) -> None:
        """Begin the exchange, holding this frame. Raises BusError where the kernel does not play or falters."""
        exchange = self._exchange
        exchange.expecting_echo = True
        with self._lock:
            self._ring, self._rpdo_s, self._sync_s = self._new_ring(frame), math.inf, -math.inf
            self._interval_us = round(self.period_s * 1e6 / 2)
            self._broadcast = self._open(str(getattr(exchange.link.bus, "channel", exchange.link.name)))
        exchange.link.subscribe(self._rpdo_id, self._on_rpdo)
        exchange.link.subscribe(SYNC_ID, self._on_sync)
        self._send(self._ring.again())
        excess_s = self._measure_excess()
        with self._lock:
            self._interval_us = round((self.period_s - excess_s) * 1e6 / 2)
            if not self._ring.latched:  # by another thread meanwhile
                self._send(self._ring.hold(frame, self._ring.played))
        self._feeder = self._clock.every(REFILL / 2 * self.period_s, self._feed, "schwung setpoints")

    def hold(self, frame: bytes) -> None:
        """Hold this frame from now on; a playback under way is given up. From any thread.

        Raises StateError for one that would energise while a stop is latched.
        """
        with self._lock:
            if not self._ring.admits(frame):
                raise self._is_latched()
            self._write(self._ring.hold(frame, self._position()))
            self._over.set()

    def latch(self, controlword: int) -> None:
        """Send the last frame that went out again and again, with this controlword and without injected torque.

        From any thread, and until `release`: nothing that is held or played meanwhile energises. Sent at once, too, see
        the module; the ring first, so that nothing but stops can follow.
        """
        frame = self.latch_ring(controlword)
        if self._broadcast is not None:
            with contextlib.suppress(BusError):  # what fails is told by who sends the next request
                self._exchange.send_rpdo(frame)

    def latch_ring(self, controlword: int) -> bytes:
        """As `latch`, from callbacks, too: nothing that waits for the send buffer. Returns the frame that goes out."""
        with self._lock:
            write = self._ring.latch(controlword, self._position())
            self._write(write)
            self._over.set()
            return write.slots[0]

    def send_awaited_sync(self) -> bool:
        """True: the kernel sends no RPDO without the SYNC after it."""
        return True

    def release(self) -> None:
        """End `latch`: what is held stays until something else is."""
        with self._lock:
            self._ring.latched = False

    def pump(self, duration_s: float) -> bool:
        """Let so much time pass; False when the drive does not answer."""
        return answered_within(self._exchange, max(duration_s, 3 * self.period_s))

    def await_answers(self) -> bool:
        """See Producer."""
        return await_answers(self._exchange, self.period_s)

    def play(self, frames: list[bytes], after: bytes, recorder: Recorder, progress: Progress | None) -> None:
        """Play one frame per SYNC, then hold `after`; returns when all is answered, given up, or in trouble.

        Raises StateError where a stop is latched, or another motion has not been given up.
        """
        with self._lock:
            if self._ring.latched:
                raise self._is_latched()
            if self._ring.playing:
                raise StateError(self._place, "still plays another motion", "Stop it first.")
            self._over.clear()
            self._write(self._ring.play(frames, after))
        wait_while_playing(self._over.is_set, self._exchange, recorder, len(frames), progress)
        if self._exchange.trouble is None:
            self._clock.sleep(4 * self.period_s)  # answers that come late
            self._feed()  # `after`

    def stop(self) -> None:
        """End the exchange."""
        with self._lock:
            self._over.set()
            broadcast, self._broadcast = self._broadcast, None
            feeder, self._feeder = self._feeder, None
            if broadcast is not None:
                broadcast.close()
        if feeder is not None:
            feeder.close()
        self._exchange.link.unsubscribe(self._rpdo_id, self._on_rpdo)
        self._exchange.link.unsubscribe(SYNC_ID, self._on_sync)
        self._exchange.expecting_echo = False

    # ── feeding ──────────────────────────────────────────────────────────────────────────────────────────────────

    def _feed(self) -> None:
        """Append setpoints, or hold on; see that a stop is sent."""
        self._exchange.take_turn(REFILL / 2 * self.period_s)
        with self._lock:
            ring, position = self._ring, self._position()
            if ring.latched:
                if position - ring.played > max(2, _RESTART_S / self.period_s):
                    self._write(ring.again())
            elif self._exchange.trouble is None:
                self._write(ring.refill(position))

    def _write(self, write: Write | None) -> None:
        """Hand it to the kernel, unless it has become too late for that, and report what fails; the lock is held."""
        if write is None:
            return
        try:
            self._send(write)
            undone = self._ring.overdue(self._position())
            if undone is not None:
                self._send(undone)
        except BusError as error:
            self._exchange.report(error)
        if self._ring.held_up:
            self._held_up()

    def _held_up(self) -> None:
        self._ring.held_up = False
        late_s = self._ring.unfed * self.period_s
        problem = f"was stopped: this program was held up for {late_s:.2f} s"
        self._exchange.report(StateError(self._place, problem, "Free the processor of other work."))
        self._over.set()

    def _send(self, write: Write) -> None:
        frames = self._packed(write)
        late = self._ring.overdue(
            self._position()
        )  # packing takes its time, and other threads may have theirs
        if late is not None:
            write, frames = late, self._packed(late)
        if self._broadcast is not None:
            self._broadcast.write(frames, self._interval_us, write.frames, start=write.start)

    def _packed(self, write: Write) -> bytes:
        pairs = zip(write.slots, self._syncs, strict=True)
        return b"".join(part for rpdo, sync in pairs for part in (pack(self._rpdo_id, rpdo), sync))

    def _position(self) -> int:
        """Cycle of the last RPDO that the kernel has sent, by when the last echo was stamped."""
        late_s = self._clock.date() - self._rpdo_s
        return self._ring.played + (int(late_s / self.period_s) if late_s > 0 else 0)

    # ── what comes back ──────────────────────────────────────────────────────────────────────────────────────────

    def _on_rpdo(self, message: can.Message) -> None:
        with self._lock:
            ring, data = self._ring, bytes(message.data)
            if not ring.sent(data):
                self._exchange.report_foreign(message)
                return
            self._rpdo_s, self._sync_s = message.timestamp, -math.inf
            self._exchange.refuse_leap(ring.setpoint)
            if ring.met_guard:
                self._write(ring.give_up(self._position()))

    def _on_sync(self, message: can.Message) -> None:
        with self._lock:
            exchange, ring = self._exchange, self._ring
            if message.timestamp - self._sync_s < self.period_s / 2:  # of ours, two are twice as far apart
                exchange.report_foreign(message)
            self._sync_s = message.timestamp
            exchange.sync_count += 1
            if self._stamps is not None:
                self._stamps.append(message.timestamp)
            if exchange.recorder is not None:
                exchange.recorder.sync(message.timestamp, exchange.sync_count, ring.setpoint)
            if ring.over:
                self._over.set()

    def _measure_excess(self) -> float:
        """By how much SYNC's intervals exceed the period (s), stalls of a busy computer left out. Raises BusError."""
        stamps: list[float] = []
        self._stamps = stamps
        name = self._exchange.link.name
        if not self._clock.wait(lambda: bool(stamps), _ECHO_TIMEOUT_S):
            remedy = "Leave local_loopback on; is the interface up, does anybody acknowledge frames?"
            raise BusError(name, "the kernel's frames do not come back", remedy)
        patience_s = 3 * _CALIBRATION_CYCLES * self.period_s
        if not self._clock.wait(lambda: len(stamps) > _CALIBRATION_CYCLES, patience_s):
            raise BusError(name, "the kernel's SYNC falters", "Lower the sample rate.")
        self._stamps = None
        intervals = np.diff(stamps)
        usual = intervals[intervals < _STALL * np.median(intervals)]
        return min(max(float(np.mean(usual)) - self.period_s, 0.0), _MOST_EXCESS * self.period_s)

    # ── within ───────────────────────────────────────────────────────────────────────────────────────────────────

    @property
    def _place(self) -> str:
        return f"node {self._exchange.node_id}"

    def _is_latched(self) -> StateError:
        return StateError(self._place, "was stopped on request (halt)", "Start it anew.")

    def _new_ring(self, held: bytes) -> Ring:
        durations_s = (GUARD_S, LEAD_S, HOLD_S)
        guard, lead, hold = (max(4, math.ceil(duration_s / self.period_s)) for duration_s in durations_s)
        return Ring(self._stop_frame, held, min(guard, CYCLES // 4), lead, max(hold, CYCLES))
