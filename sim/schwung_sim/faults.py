"""What can go wrong on the bench, on purpose and repeatably.

    drop=0.01                lose one frame in a hundred, both ways
    jitter=0.0002            the drive sees each SYNC up to so many seconds late
    turn-around=0.001        the drive takes so many seconds to answer whatever it is asked
    reset@0.5                the node restarts
    emcy=0x4310@0.5          the drive goes into fault with this error code
    heartbeat-stop@0.5       its heartbeat stops, all else goes on
    sdo-abort=0x6065         access to an object is aborted (=0x6065:0x08000020 gives the code)
    sdo-timeout=0x6065       access to an object is not answered
    bus-off@0.5              the drive's CAN controller goes bus-off and stays there
    second-master=0x06@0.5   someone else writes this controlword every 10 ms
    following-error@0.5      the motor gives no torque any more: the axis is left behind

How drives differ, and what keeps them from following (docs/bench.md tells them at length):

    late-controlword=0.002   the state machine takes a controlword so many seconds late: the frame's target acts first
    controlword-task=0.004   it looks at the controlword only so often, and sees the last one
    late-setpoint=0.002      targets and torques act so many seconds late: the frame's controlword acts first
    first-rpdo               of two RPDOs in one SYNC window the first acts, not the last
    lost-rpdo=1@0.5          so many RPDOs are lost, SYNC is not
    late-rpdo=1@0.5          so many RPDOs come only behind their SYNC
    rpdo-timeout=0.01        a fault (0x8250) so many seconds after the last cyclic target
    sto=0x5091@0.5..0.8      safe torque off is open: Switch on disabled, voltage enabled = 0, this EMCY
    sto-fault=0x5091@0.5     the same, but as a fault that is not reset before STO is closed
    enable-input@0.5..0.8    the drive's enable input is off: Switch on disabled, voltage enabled = 0, no EMCY, no fault
    brake=0.15               a holding brake that takes so many seconds to open, and to close
    not-following@0.5..0.8   bit 12 = 0: set-points are ignored, the axis is held (=1: bit 11 says that it is a limit)
    local@0.5..0.8           remote = 0: controlwords are ignored, the axis is held
    negative-limit@0.5..0.8  a limit switch, as 60FD has it; also positive-limit, home-switch
    set-up=0x607C00:-5000    an object (index and sub-index) holds this value from the start
    torque-polarity=5        the bit of 607E that turns torques, too: 5, or 7 with the position
    demand-polarity          607E turns demands, but not actual values
    limits-from-zero         607D is not corrected by the home offset 607C
    store-power-cut=0        the supply fails at the next 1010, which then holds what it held, =1 defaults, =2 all

Joined by commas. `@0.5` is the axis' own time, 0.5 s after the bench's start; `@on+0.5` counts from the
moment at which the power stage is first on. Where the plant is clocked by SYNC, both are exact to the cycle.
`..0.8` is when it ends, for what can end; without `@` it is so from the start.
"""

from __future__ import annotations

import random
import time
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import can

from schwung_sim.drives.servo import CanopenServo, encode_controlword
from schwung_sim.errors import BenchError
from schwung_sim.traits import FROM_THE_START, HIGHEST, PASSING, TAKES_TIME, TRAITS, Traits

SYNC_ID = 0x80
MASTER_PERIOD_S = 0.01
SDO_GENERAL_ERROR = 0x08000000


@dataclass(frozen=True)
class Fault:
    """One fault; `at_s` None: from the start. `value` and `extra` as its kind needs them."""

    kind: str
    value: float = 0.0
    extra: int = 0
    at_s: float | None = None
    after_power_on: bool = False
    until_s: float | None = None


#: kind -> default value; None: a value has to be given
KINDS: dict[str, float | None] = {
    "drop": None, "jitter": None, "turn-around": None, "reset": 0, "emcy": 0x4310, "heartbeat-stop": 0,
    "sdo-abort": None, "sdo-timeout": None, "bus-off": 0, "second-master": 0x06, "following-error": 0, **TRAITS,
}  # fmt: skip


def parse_faults(text: str) -> tuple[Fault, ...]:
    """Read the syntax above. Raises BenchError that names the part and what exists."""
    return tuple(_parse(part.strip()) for part in text.split(",") if part.strip())


def _parse(part: str) -> Fault:
    place = f'fault "{part}"'
    head, _, when = part.partition("@")
    kind, given, value_text = head.partition("=")
    if kind not in KINDS:
        raise BenchError(place, "there is no such fault", f"There are {', '.join(KINDS)}.")
    default = KINDS[kind]
    value_text, _, extra_text = value_text.partition(":")
    try:
        if not given and default is None:
            raise ValueError
        value = _number(value_text) if given else float(default or 0)
        extra = int(extra_text, 0) if extra_text else SDO_GENERAL_ERROR
        after_power_on = when.startswith("on+")
        begin, ends, end = when.removeprefix("on+").partition("..")
        at_s = float(begin) if begin else None
        until_s = float(end) if ends else None
    except ValueError:
        raise BenchError(place, "its numbers cannot be read", "Write it as name=value@seconds.") from None
    if kind == "drop" and not 0 <= value < 1:
        raise BenchError(place, "is no probability", "Give a share of the frames, 0 to 1.")
    if value < 0 or (at_s is not None and at_s < 0):
        raise BenchError(place, "is negative", "Values and times count upwards from 0.")
    if until_s is not None and (kind not in PASSING or until_s <= (at_s or 0.0)):
        raise BenchError(
            place, "does not end so", f"What ends, after it began, is {', '.join(sorted(PASSING))}."
        )
    if kind in FROM_THE_START and at_s is not None:
        raise BenchError(place, "is how a drive is made, not what befalls it", "Leave out the time.")
    if kind in TAKES_TIME and value == 0:
        raise BenchError(place, "takes no time", "Give seconds.")
    if value > HIGHEST.get(kind, value):
        raise BenchError(place, "is not one of its values", f"Give 0 to {HIGHEST[kind]}.")
    if kind == "set-up" and not extra_text:
        raise BenchError(place, "names no value", "Write it as set-up=0x607C00:-5000.")
    return Fault(kind, value, extra, at_s, after_power_on, until_s)


def _number(text: str) -> float:
    return float(int(text, 16)) if text.lower().startswith("0x") else float(text)


class FaultyBus(can.BusABC):
    """Any bus, with frames lost, SYNC late, or bus-off; works the same for a drive and for a tool under test.

    `drop` is the probability of losing a frame (each way), `jitter_s` the longest delay of a SYNC that is
    received; every frame is received `turn_around_s` after it was sent. `go_bus_off` makes every later call raise as
    an adapter in bus-off does; `bus_off_after` does so after that many frames sent. Repeatable by `seed`.
    """

    def __init__(
        self,
        bus: can.BusABC,
        *,
        drop: float = 0.0,
        jitter_s: float = 0.0,
        turn_around_s: float = 0.0,
        bus_off_after: int | None = None,
        seed: int = 0,
    ) -> None:
        self.inner, self.drop, self.jitter_s, self.bus_off_after = bus, drop, jitter_s, bus_off_after
        self.turn_around_s = turn_around_s
        self.sent = self.dropped = 0
        self._off = False
        self._send_luck, self._receive_luck = random.Random(f"{seed} send"), random.Random(f"{seed} receive")
        self.channel_info = f"{bus.channel_info}, with faults"
        clock = getattr(bus, "clock", None)  # a stepped bus has its own
        self._sleep = time.sleep if clock is None else clock.sleep
        self._date = time.time if clock is None else clock.date
        super().__init__(channel=getattr(bus, "channel", "faulty"))

    def go_bus_off(self) -> None:
        """From now on nothing gets through."""
        self._off = True

    def _check(self) -> None:
        if self._off or (self.bus_off_after is not None and self.sent >= self.bus_off_after):
            self._off = True
            raise can.CanOperationError("Failed to transmit: bus-off")

    def send(self, msg: can.Message, timeout: float | None = None) -> None:
        """Send, or lose it. Raises can.CanOperationError in bus-off."""
        self._check()
        self.sent += 1
        if self.drop and self._send_luck.random() < self.drop:
            self.dropped += 1
            return
        self.inner.send(msg, timeout)

    @property
    def clock(self) -> Any:
        """The clock of the bus inside, where it has one."""
        return getattr(self.inner, "clock", None)

    @property
    def stepped(self) -> Any:
        """The stepped bus inside, where it is one."""
        return getattr(self.inner, "stepped", None)

    def recv(self, timeout: float | None = None) -> can.Message | None:
        """Receive, or lose it. Raises can.CanOperationError in bus-off."""
        self._check()
        message = self.inner.recv(timeout)
        if message is None:
            return None
        if self.drop and self._receive_luck.random() < self.drop:
            self.dropped += 1
            return None
        if self.turn_around_s:
            waits = message.timestamp + self.turn_around_s - self._date()
            self._sleep(min(max(waits, 0.0), self.turn_around_s))
        if self.jitter_s and message.arbitration_id == SYNC_ID:
            self._sleep(self._receive_luck.uniform(0, self.jitter_s))
        return message

    def _recv_internal(self, timeout: float | None) -> tuple[can.Message | None, bool]:
        return self.recv(timeout), True

    def shutdown(self) -> None:
        """Shut the bus inside down as well."""
        super().shutdown()
        self.inner.shutdown()


class FaultSchedule:
    """Makes a drive's faults happen when they are due; `poll` is called whenever its axis has advanced."""

    def __init__(self, servo: CanopenServo, bus: FaultyBus, faults: tuple[Fault, ...]) -> None:
        self._servo, self._bus = servo, bus
        self._on_s: float | None = None
        self._next_master_s: float | None = None
        self._master_word = 0
        self._traits = Traits(servo)
        self._waiting = [fault for fault in faults if fault.at_s is not None]
        self._ending = [fault for fault in faults if fault.until_s is not None]
        for fault in faults:
            if fault.at_s is None:
                self._begin(fault)

    def poll(self) -> None:
        """Begin what is due."""
        now = self._servo.axis.time_s
        if self._on_s is None and self._servo.power.energised:
            self._on_s = now
        for fault in [fault for fault in self._waiting if self._is_due(fault, fault.at_s, now)]:
            self._waiting.remove(fault)
            self._begin(fault)
        for fault in [fault for fault in self._ending if self._is_due(fault, fault.until_s, now)]:
            self._ending.remove(fault)
            self._traits.end(fault.kind)
        self._traits.poll()
        if self._next_master_s is not None and now >= self._next_master_s:
            self._next_master_s = now + MASTER_PERIOD_S
            request = encode_controlword(self._servo.node_id, self._master_word)
            self._bus.send(request)  # everyone sees it, as if it came from another node
            self._servo.service(request)

    def _is_due(self, fault: Fault, due_s: float | None, now: float) -> bool:
        start = self._on_s if fault.after_power_on else 0.0
        return start is not None and due_s is not None and now >= start + due_s - 1e-9

    def _begin(self, fault: Fault) -> None:
        if fault.kind in TRAITS:
            self._traits.begin(fault.kind, fault.value, fault.extra)
            return
        servo, value = self._servo, int(fault.value)
        actions: dict[str, Callable[[], Any]] = {
            "drop": lambda: setattr(self._bus, "drop", fault.value),
            "jitter": lambda: setattr(self._bus, "jitter_s", fault.value),
            "turn-around": lambda: setattr(self._bus, "turn_around_s", fault.value),
            "reset": servo.reset_node,
            "emcy": lambda: servo.fault(value),
            "heartbeat-stop": lambda: setattr(servo.heartbeats, "muted", True),
            "sdo-abort": lambda: servo.sdo.aborts.update({value: fault.extra}),
            "sdo-timeout": lambda: servo.sdo.silent.add(value),
            "bus-off": self._bus.go_bus_off,
            "second-master": lambda: self._start_master(value),
            "following-error": servo.vendor.weaken,
        }
        actions[fault.kind]()

    def _start_master(self, word: int) -> None:
        self._master_word, self._next_master_s = word, self._servo.axis.time_s
