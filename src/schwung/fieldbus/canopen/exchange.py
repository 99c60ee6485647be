"""The cyclic exchange with one drive as all SYNC producers share it: frames out, latest answers, trouble."""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import Protocol

import can

from schwung.errors import DriveError, DriveFaultError, NodeLostError, StateError
from schwung.fieldbus import cia402
from schwung.fieldbus.canopen.link import Frame, FrameCallback, Link
from schwung.fieldbus.canopen.pdo import Layouts
from schwung.fieldbus.canopen.recorder import Recorder
from schwung.fieldbus.canopen.silence import Silence
from schwung.fieldbus.drive import Progress

SYNC_ID = 0x080
_STATE_BITS, _OPERATION_ENABLED = 0x6F, 0x27
SILENT_S = 0.05  # who has not heard the other for so long does not go on as if nothing had been
#: So many SYNCs in a row without an answer, and the node is lost, by the clock not before SILENT_S: else what it has
#: missed would be one step when it hears us again.
SILENT_CYCLES = 20
COUNTER_OVERFLOW = 128  # of 1019: a ring of the kernel's holds as many cycles (CiA 301 allows up to 240)


class Producer(Protocol):
    """Sends RPDO and SYNC, in whatever way keeps the time."""

    name: str

    def start(self, frame: bytes) -> None:
        """Begin the exchange, holding this RPDO frame."""
        ...

    @property
    def last(self) -> bytes:
        """The RPDO frame that went out last."""
        ...

    def hold(self, frame: bytes) -> None:
        """Hold this frame from now on; a playback under way is given up. From any thread.

        Raises StateError for a frame that enables operation after a `latch`.
        """
        ...

    def latch(self, controlword: int) -> None:
        """From now on: the last frame that went out, with this controlword and no injected torque. From any thread."""
        ...

    def send_awaited_sync(self) -> bool:
        """Send the SYNC that did not go out after an RPDO that enables, where that is so: a drive that holds such a
        frame would undo with the next SYNC what comes by SDO before it. False where it cannot be sent."""
        ...

    def release(self) -> None:
        """End a latch: what is asked for goes out again."""
        ...

    def pump(self, duration_s: float) -> bool:
        """Let so much of the drive's time pass; False when it does not answer."""
        ...

    def await_answers(self) -> bool:
        """Until the drive answers anew: a frame that is held right then goes out with the very next SYNC. False where
        it does not answer."""
        ...

    def play(self, frames: list[bytes], after: bytes, recorder: Recorder, progress: Progress | None) -> None:
        """Play one frame per SYNC, then hold `after`; returns when all is answered, given up, or in trouble."""
        ...

    def stop(self) -> None:
        """End the exchange: no SYNC any more, and `pump` lets time pass without an answer. May be called twice."""
        ...


class Exchange:
    """Receives the TPDOs, keeps the latest, logs them while a recorder is set, and watches for trouble.

    `trouble` holds the first error that came up. Whoever has to see to it may be waiting for something else just then:
    what goes out is a quick stop from that instant on.
    """

    def __init__(self, link: Link, layouts: Layouts, node_id: int, counter: bool) -> None:
        self.link, self.layouts, self.node_id, self.counter = link, layouts, node_id, counter
        self.latest: list[bytes | bytearray | None] = [None] * len(layouts.tpdos)
        self.recorder: Recorder | None = None
        self.guarded = False  # leaving Operation enabled is trouble; see `guard`
        self._guarded_bits = self._guarded_value = 0
        self.expecting_echo = (
            False  # the kernel's own frames come back: the kernel producer looks at them itself
        )
        self.after_tpdo: Callable[[int], None] | None = None
        self.watchers: dict[int, Callable[[bytes | bytearray], None]] = {}  # of TPDOs, while guarded
        self.leaps: Callable[[int, int], bool] | None = None  # a setpoint, behind so many unanswered SYNCs
        self.silence = Silence()
        self.latch: Callable[[int], object] | None = None  # a controlword, for all that goes out
        self.trouble: DriveError | None = None
        self._turn_s = math.inf  # when something went out last
        self.sync_count = 0  # SYNCs sent
        self.answer_counts = [0] * len(layouts.tpdos)  # TPDOs that came, of each
        self._status_tpdo = next(i for i, t in enumerate(layouts.tpdos) if t.carries("6041:00"))
        self._status_offset = layouts.tpdos[self._status_tpdo].offset("6041:00")
        self._subscriptions: list[tuple[int, FrameCallback]] = []
        for number, layout in enumerate(layouts.tpdos):
            self._subscribe(layout.can_id, self._tpdo_callback(number))
        rpdos = range(0x200 + node_id, 0x600, 0x100)  # the drive may have the controlword in any of the four
        for can_id in (*rpdos, SYNC_ID, 0x000, 0x600 + node_id):
            self._subscribe(can_id, self._on_foreign)

    def close(self) -> None:
        """Stop listening."""
        for can_id, callback in self._subscriptions:
            self.link.unsubscribe(can_id, callback)
        self._subscriptions = []

    def guard(self, *, follows: bool) -> None:
        """From now on it is trouble when the drive leaves Operation enabled, or no longer takes controlwords (remote,
        bit 9), or, where it `follows` setpoints (cyclic position, bit 12), no longer does. A bit that is not set now is
        not watched: not every drive has them."""
        present = self.statusword or 0
        may_be_lost = cia402.REMOTE | (cia402.FOLLOWS_COMMAND if follows else 0)
        self._guarded_bits = _STATE_BITS | (present & may_be_lost)
        self._guarded_value = _OPERATION_ENABLED | (present & may_be_lost)
        self.guarded = True

    def report(self, error: DriveError) -> None:
        """Note trouble, and stop; the first counts. From any thread, and from callbacks."""
        if self.trouble is None:
            self.trouble = error
            if self.latch is not None:
                self.latch(cia402.QUICK_STOP)

    def clear(self) -> None:
        """Forget trouble, before a new playback."""
        self.trouble = None

    @property
    def statusword(self) -> int | None:
        """The latest statusword that came by PDO."""
        frame = self.latest[self._status_tpdo]
        return None if frame is None else self._status_of(frame)

    def sync_frames(self) -> list[Frame]:
        """SYNC frames to be sent in turn: one without counter, else one per counter value from 1."""
        if not self.counter:
            return [Frame(SYNC_ID, b"")]
        return [Frame(SYNC_ID, bytes([count])) for count in range(1, COUNTER_OVERFLOW + 1)]

    def take_turn(self, period_s: float, setpoint: int | None = None) -> None:
        """Before something goes out, each time; `period_s`: how often that is, `setpoint`: which one, if any. One that
        was held up hears first what came meanwhile: it may forbid to go on. Not from callbacks."""
        now = self.link.clock.now()
        leaps = setpoint is not None and self._would_leap(setpoint)
        if leaps or now - self._turn_s > period_s + SILENT_S:
            self.link.catch_up()
            now = self.link.clock.now()  # it listened: that was no hold-up
        self._turn_s = now
        if leaps and setpoint is not None:
            self.refuse_leap(setpoint)

    def refuse_leap(self, setpoint: int) -> None:
        """Before a setpoint acts: it is trouble where it would be a step, since a drive that does not answer may have
        missed those before it. From callbacks, too."""
        if self._would_leap(setpoint):
            self.report(NodeLostError(
                f"node {self.node_id}",
                f"did not answer {self.silence.length(self.sync_count)} SYNCs in a row, in which its setpoint went on "
                "by more than the following error that it tolerates: what it has missed would be one step",
                "Check its power, the cable, and what else is on the bus."))  # fmt: skip

    def _would_leap(self, setpoint: int) -> bool:
        unanswered = self.silence.length(self.sync_count)
        if self.leaps is None or not unanswered:
            return False
        return self.leaps(setpoint, unanswered + 1 - self.silence.usual)

    def send_rpdo(self, frame: bytes, wanted: Callable[[], bool] | None = None) -> bool:
        """Send one RPDO frame; False where it was no longer `wanted` when the send buffer had room. Raises BusError."""
        return self.link.send_frame(Frame(self.layouts.rpdo.can_id, frame), wanted)

    def _subscribe(self, can_id: int, callback: FrameCallback) -> None:
        self.link.subscribe(can_id, callback)
        self._subscriptions.append((can_id, callback))

    def _status_of(self, frame: bytes | bytearray) -> int:
        return int.from_bytes(frame[self._status_offset : self._status_offset + 2], "little")

    def _tpdo_callback(self, number: int) -> FrameCallback:
        latest, watched, offset = self.latest, number == self._status_tpdo, self._status_offset
        size = self.layouts.tpdos[number].size

        def on_tpdo(message: can.Message) -> None:
            data = message.data
            if len(data) < size:
                self._too_short(message, size)
                return
            latest[number] = data
            self.answer_counts[number] += 1
            self.silence.answered(self.sync_count)
            recorder = self.recorder
            if recorder is not None:
                recorder.frames[number].append((len(recorder.sync_times) - 1, message.timestamp, data))
            if watched and self.guarded:
                status = data[offset] | data[offset + 1] << 8
                if status & self._guarded_bits != self._guarded_value:
                    self._left_operation(status)
            watch = self.watchers.get(number)
            if watch is not None and self.guarded:
                watch(data)
            if self.after_tpdo is not None:
                self.after_tpdo(number)

        return on_tpdo

    def _too_short(self, message: can.Message, size: int) -> None:
        """What a frame lacks is unknown. It is no answer: without a statusword a drive would seem to be off."""
        self.report(StateError(
            f"node {self.node_id}",
            f"TPDO 0x{message.arbitration_id:03X} came with {len(message.data)} bytes, not with the {size} mapped",
            "Was it mapped anew, did the drive restart, or does another node send as it?"))  # fmt: skip

    def _left_operation(self, statusword: int) -> None:
        self.guarded = False
        state = cia402.decode(statusword)
        place, shown = f"node {self.node_id}", f"statusword 0x{statusword:04X}"
        if state in (cia402.State.FAULT, cia402.State.FAULT_REACTION):
            self.report(
                DriveFaultError(place, f"reported a fault ({shown})", "Remove its cause, then reset it.")
            )
        elif state is cia402.State.OPERATION_ENABLED and not statusword & cia402.REMOTE:
            self.report(StateError(
                place, f"no longer takes commands from the bus (remote, bit 9: {shown}) during the motion",
                "Who has switched it to local control?"))  # fmt: skip
        elif state is cia402.State.OPERATION_ENABLED:
            self.report(StateError(
                place, f"no longer follows its setpoints (bit 12: {shown}) during the motion",
                "Look at its limit switches, its limits and its homing."))  # fmt: skip
        else:
            self.report(StateError(
                place, f'left "Operation enabled" for "{state.value}" ({shown}) during the motion',
                "Look for an enable input, STO, or another master."))  # fmt: skip

    def _on_foreign(self, message: can.Message) -> None:
        """From start to stop, moving or not: whoever enables or stops our drive while it stands would do so unseen."""
        can_id = message.arbitration_id
        if self.expecting_echo and can_id in (SYNC_ID, self.layouts.rpdo.can_id):
            return
        if can_id == 0 and (len(message.data) < 2 or message.data[1] not in (0, self.node_id)):
            return
        self.report_foreign(message)

    def report_foreign(self, message: can.Message) -> None:
        """Another master speaks to our drive."""
        kinds = {0x000: "NMT commands", SYNC_ID: "SYNC", 0x600 + self.node_id: "SDO requests"}
        kind = kinds.get(message.arbitration_id, "setpoints and controlwords")
        self.report(StateError(
            f"node {self.node_id}",
            f"another master sends {kind} (identifier 0x{message.arbitration_id:03X}, data {message.data.hex(' ')})",
            "Disconnect it, or stop its program, while commissioning."))  # fmt: skip
