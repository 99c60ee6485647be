"""A CiA 402 servo drive on CANopen: everything that a bus sees of the simulated drive.

frames ─► CanopenServo ─► SdoServer, PdoEngine, Heartbeats, Emergency   (CiA 301)
                └───────► PowerStage, Operation, vendor objects         (CiA 402) ─► axis (SI)
"""

from __future__ import annotations

import struct
import threading
import time
from collections.abc import Callable
from pathlib import Path
from typing import Literal

import can

from schwung_sim.drives import vendor
from schwung_sim.drives.dictionary import AbortError, Code, key
from schwung_sim.drives.network import EMCY_HEARTBEAT, Emergency, Heartbeats, Nmt
from schwung_sim.drives.operation import Operation
from schwung_sim.drives.parameters import ParameterStore
from schwung_sim.drives.pdo import PdoEngine
from schwung_sim.drives.power import Power, PowerStage
from schwung_sim.drives.roles import Roles
from schwung_sim.drives.sdo_server import SdoServer
from schwung_sim.drives.setup import open_dictionary
from schwung_sim.drives.vendor import BenchAxis
from schwung_sim.errors import BenchError

Clock = Literal["sync", "wall"]

TICK_S = 0.002  # how often timers are looked at when no frame comes
STALL_S = 0.02  # a drive's own processor never stops for so long; a bench on a busy computer may
SYNC_LOST_S = 0.05  # without SYNC for so long, a stop reaction goes on by the wall clock
BACKLOG_S = 0.25  # a wall-clocked plant that fell further behind than this drops the rest
_WHOLE = 1e-6  # of a control tick: rounding errors of the time shall not make one more or less of them
EMCY_BUS_OFF, EMCY_SYNC_LENGTH = 0x8140, 0x8240
_COMMUNICATION = range(0x1000, 0x2000)


class Frame(can.Message):
    """A data frame that is made and copied cheaply: python-can's virtual bus copies every frame it delivers, deeply."""

    __slots__ = ()

    def __init__(self, can_id: int, data: bytes) -> None:
        self.timestamp, self.arbitration_id, self.channel = 0.0, can_id, None
        self.data, self.dlc = bytearray(data), len(data)
        self.is_extended_id = self.is_remote_frame = self.is_error_frame = False
        self.is_fd = self.bitrate_switch = self.error_state_indicator = False
        self.is_rx = True

    def __deepcopy__(self, memo: object) -> Frame:
        return Frame(self.arbitration_id, bytes(self.data))


class CanopenServo:
    """One drive on one bus. Feed it frames (`service`) and time (`tick`), or let `run` do both in a thread.

    `clock` "sync": the axis advances one communication period (1006, else 60C2 in cyclic position, else 1 ms) per
    SYNC and stands still otherwise; only a stop that SYNC has deserted goes on by the wall clock. "wall": the axis
    follows `monotonic`, which need not be the wall's. `eds` says which objects there are, `roles` what they do.
    `memory` keeps stored parameters, `seed` is the serial number.
    Raises BenchError where node id, EDS or memory are wrong.
    """

    def __init__(
        self,
        bus: can.BusABC,
        node_id: int,
        axis: BenchAxis,
        eds: Path,
        roles: Roles,
        *,
        clock: Clock = "sync",
        seed: int = 0,
        memory: Path | None = None,
        monotonic: Callable[[], float] = time.monotonic,
        sleep: Callable[[float], None] = time.sleep,
    ) -> None:
        if not 1 <= node_id <= 127:
            raise BenchError("node id", f"{node_id} is not within 1…127")
        self.bus, self.node_id, self.axis, self.clock = bus, node_id, axis, clock
        self.syncs = 0
        self.on_advance: Callable[[], None] | None = None  # the bench's own: called whenever time has passed
        self._monotonic, self._sleep = monotonic, sleep
        self._seed = seed
        self._wall = clock == "wall"
        self.booted = threading.Event()
        self._stop = threading.Event()
        self._bus_off = False
        self.stalled = False  # the bench's own: see `stall`
        self._mailboxes: dict[int, can.Message] = {}
        self._debt_s = 0.0  # time owed to the axis: less than a communication period
        self._last_tick_s = self._last_sync_s = monotonic()
        self._due_s = monotonic()
        self._behind_until = (
            0.0  # until when (time.time) frames may wait unread after a stall of the computer
        )

        self.nmt = Nmt.BOOT_UP
        self.dictionary = dictionary = open_dictionary(eds, node_id, roles)
        self.emergency = Emergency(dictionary, self._send, self._may_send_emcy)
        self.heartbeats = Heartbeats(dictionary, self._send_heartbeat, self._node_lost, self._node_back)
        self.sdo = SdoServer(dictionary, lambda data: self._send(0x580 + node_id, data))
        self.pdo = PdoEngine(dictionary, self._send, self.emergency.report, self.emergency.clear)
        self.power = PowerStage(dictionary, axis, self._deceleration, self._clear_faults)
        self.operation = Operation(dictionary, axis, self.power, self.fault, roles)
        self.vendor = vendor.VendorObjects(dictionary, axis, roles, lambda: self.operation.units)
        self.store = ParameterStore(
            dictionary, memory, lambda: not self.power.energised, self.vendor.volatile
        )
        self._bind(roles.clock)
        self._power_up()

    def _bind(self, clock: int | None) -> None:
        read, write = self.dictionary.readers, self.dictionary.writers
        read[key(0x6041)] = lambda: self.operation.status
        if clock is not None:
            read[clock] = lambda: 0 if self._wall else 1
        write[key(0x6040)] = self.operation.control
        write[key(0x1005)] = self._write_sync_id
        write[key(0x1006)] = self._write_period
        write[key(0x1019)] = self._write_overflow

    # Power-on and reset
    # ------------------------------------------------------------------------------------------

    def start(self) -> None:
        """Announce itself: boot-up, then pre-operational."""
        self.nmt = Nmt.BOOT_UP
        self._send(0x700 + self.node_id, b"\x00")
        self._enter(Nmt.PRE_OPERATIONAL)

    def _power_up(self) -> None:
        self.store.power_up()
        self.dictionary.values[key(0x1018, 4)] = self._seed & 0xFFFFFFFF
        self._load_communication()
        self.operation.load()
        self.vendor.load()

    def _load_communication(self) -> None:
        self.pdo.load()
        self.heartbeats.reset()
        self.sdo.reset()
        self._sync_id = self.dictionary.number(0x1005) & 0x7FF
        self._overflow = self.dictionary.number(0x1019)
        self._set_period(self.dictionary.number(0x1006))

    def reset_node(self) -> None:
        """NMT reset node: power off, stored parameters, boot-up."""
        self.power.power_off()
        self.emergency.forget()
        self.dictionary.values[key(0x603F)] = 0
        self._power_up()
        self.start()

    def _reset_communication(self) -> None:
        self._connection_lost()
        self.store.power_up(_COMMUNICATION)
        self.dictionary.values[key(0x1018, 4)] = self._seed & 0xFFFFFFFF
        self._load_communication()
        self.start()

    # -- Frames -----------------------------------------------------------------------------------

    def service(self, message: can.Message) -> None:
        """Handle one frame of the bus."""
        if message.is_error_frame or message.is_extended_id or message.is_remote_frame:
            return
        can_id = message.arbitration_id
        if can_id == self._sync_id:
            if self.nmt is not Nmt.STOPPED:
                self._sync(message.data)
        elif can_id == 0x600 + self.node_id:
            if self.nmt in (Nmt.PRE_OPERATIONAL, Nmt.OPERATIONAL):
                self.sdo.service(bytes(message.data), self._monotonic())
        elif can_id == 0:
            self._nmt_command(bytes(message.data))
        elif 0x700 < can_id < 0x780:
            self.heartbeats.heard(can_id - 0x700, self._monotonic())
        elif self.nmt is Nmt.OPERATIONAL:
            self.pdo.receive(can_id, bytes(message.data))

    def _sync(self, data: bytes | bytearray) -> None:
        now = self._monotonic()
        self._last_sync_s = now
        self.syncs += 1
        expected = 1 if self._overflow else 0
        if len(data) != expected:
            self.emergency.report(EMCY_SYNC_LENGTH)
            return
        if self._wall:
            self._follow_wall(now)
        else:
            self._advance(self._period_s or self.operation.sync_period_s)
        if self.nmt is Nmt.OPERATIONAL:
            self.pdo.sync(data[0] if expected else 0)

    def _advance(self, duration_s: float) -> None:
        self.axis.advance(duration_s)
        if self.stalled:
            return
        self.operation.poll()
        if self.on_advance is not None:
            self.on_advance()

    def _nmt_command(self, data: bytes) -> None:
        if len(data) != 2 or data[1] not in (0, self.node_id):
            return
        command = data[0]
        if command == 1:
            self._enter(Nmt.OPERATIONAL)
        elif command == 2:
            self._connection_lost()
            self._enter(Nmt.STOPPED)
        elif command == 0x80:
            self._enter(Nmt.PRE_OPERATIONAL)
        elif command == 0x81:
            self.reset_node()
        elif command == 0x82:
            self._reset_communication()

    def _enter(self, state: Nmt) -> None:
        if state is not self.nmt:
            self.pdo.restart()  # what came before does not act afterwards
        self.nmt = state

    def _send(self, can_id: int, data: bytes) -> None:
        try:
            self.bus.send(Frame(can_id, data))
        except can.CanError:
            self.bus_failed()

    def _send_heartbeat(self) -> None:
        self._send(0x700 + self.node_id, bytes((self.nmt,)))

    def _may_send_emcy(self) -> bool:
        return self.nmt in (Nmt.PRE_OPERATIONAL, Nmt.OPERATIONAL)

    # -- Time -------------------------------------------------------------------------------------

    def tick(self, up_to_date: bool = True) -> None:
        """Look at the timers; cheap when nothing is due. `up_to_date`: all that came has been read."""
        now = self._monotonic()
        if now < self._due_s:
            return
        if now - self._due_s > STALL_S:
            self._behind_until = time.time()  # what came meanwhile is still to be read, heartbeats among it
        self._due_s = now + TICK_S
        if self.stalled:
            if self._wall:
                self._follow_wall(now)
            return
        self.heartbeats.tick(now, judge=not self._behind_until)
        self._behind_until = 0.0 if up_to_date else self._behind_until
        self.sdo.tick(now)
        deserted = now - self._last_sync_s > SYNC_LOST_S
        if self._wall or (deserted and self.power.coming_to_rest):
            self._follow_wall(now)
        else:
            self._last_tick_s = now
        if self.nmt is Nmt.OPERATIONAL:
            self.pdo.poll(now)

    def _follow_wall(self, now: float) -> None:
        self._debt_s += min(now - self._last_tick_s, BACKLOG_S)
        self._last_tick_s = now
        ticks = int(self._debt_s * vendor.CONTROL_RATE_HZ + _WHOLE)
        if ticks:
            self._debt_s -= ticks / vendor.CONTROL_RATE_HZ
            self._advance(ticks / vendor.CONTROL_RATE_HZ)

    def run(self) -> None:
        """Serve the bus until `stop` is called."""
        self.start()
        self.booted.set()
        while not self._stop.is_set():
            try:
                message = self.bus.recv(TICK_S)
            except can.CanError:
                self.bus_failed()
                self._stop.wait(0.01)
                message = None
            if message is not None:
                self.receive(message)
            self.tick(message is None or message.timestamp >= self._behind_until)

    def receive(self, message: can.Message) -> None:
        """Take one frame from the bus, which works where it brings one."""
        if self.stalled:
            self._mailboxes[message.arbitration_id] = message
            return
        if self._bus_off:
            self._bus_back()
        self.service(message)

    def stall(self, on: bool) -> None:
        """The bench's own: its processor does nothing while its motor goes on. Of what comes meanwhile it finds the
        last frame of each identifier, as in the mailboxes of a CAN controller."""
        self.stalled = on
        if not on:
            waiting, self._mailboxes = self._mailboxes, {}
            for message in waiting.values():
                self.receive(message)

    def stop(self) -> None:
        """End `run`; from any thread."""
        self._stop.set()

    def settle(self, timeout_s: float) -> bool:
        """Wait, where others serve it, until the drive is out of operation and at rest; False if not in time."""
        end = self._monotonic() + timeout_s
        while self.power.state is Power.OPERATION_ENABLED or self.power.coming_to_rest:
            if self._monotonic() > end:
                return False
            self._sleep(0.005)
        return True

    # -- Faults -----------------------------------------------------------------------------------

    def fault(self, code: int) -> None:
        """Go into fault with this error code: 603F, EMCY, reaction by 605E."""
        if self.power.state in (Power.FAULT, Power.FAULT_REACTION_ACTIVE):
            return
        self.dictionary.values[key(0x603F)] = code
        self.power.fault()
        self.emergency.report(code)

    def _clear_faults(self) -> bool:
        if self.heartbeats.silent and self.dictionary.number(0x603F) == EMCY_HEARTBEAT:
            return False  # the cause is still there
        self.dictionary.values[key(0x603F)] = 0
        self.emergency.clear()
        return True

    def _connection_lost(self, code: int = EMCY_HEARTBEAT) -> None:
        """The reaction of 6007."""
        if self.power.connection_lost():
            self.fault(code)

    def _communication_error(self, code: int) -> None:
        """Heartbeat lost or bus-off: the reaction of 6007, and the NMT state that 1029 asks for."""
        self._connection_lost(code)
        behaviour = self.dictionary.number(0x1029, 1)
        if self.nmt is Nmt.OPERATIONAL and behaviour != 1:
            self._enter(Nmt.STOPPED if behaviour == 2 else Nmt.PRE_OPERATIONAL)

    def _node_lost(self, node: int) -> None:
        self.emergency.report(EMCY_HEARTBEAT)
        self._communication_error(EMCY_HEARTBEAT)

    def _node_back(self) -> None:
        if self.dictionary.number(0x603F) != EMCY_HEARTBEAT:
            self.emergency.clear(EMCY_HEARTBEAT)

    def bus_failed(self) -> None:
        """Nothing can be sent or received: bus-off."""
        if not self._bus_off:
            self._bus_off = True
            self._communication_error(EMCY_BUS_OFF)

    def _bus_back(self) -> None:
        self._bus_off = False
        self.emergency.report(EMCY_BUS_OFF)
        self.emergency.clear(EMCY_BUS_OFF)

    # -- Communication objects --------------------------------------------------------------------

    def _deceleration(self, index: int) -> float:
        return self.operation.deceleration(index)

    def _write_sync_id(self, value: int) -> None:
        if value & ~0x7FF:  # bit 30: we do not produce SYNC; bit 29: no long identifiers
            raise AbortError(Code.INVALID_VALUE)
        self._sync_id = value

    def _write_period(self, value: int) -> None:
        if value % vendor.CONTROL_PERIOD_US:
            raise AbortError(Code.INVALID_VALUE)  # whole control ticks
        self._set_period(value)

    def _set_period(self, period_us: int) -> None:
        self._period_s = period_us * 1e-6

    def _write_overflow(self, value: int) -> None:
        if self.dictionary.number(0x1006):
            raise AbortError(Code.DEVICE_STATE)  # 7.5.2.22: not while a period is set
        if value == 1:
            raise AbortError(Code.INVALID_VALUE)
        self._overflow = value


def encode_controlword(node_id: int, word: int) -> can.Message:
    """An expedited SDO download of 6040, as any master would send it."""
    data = struct.pack("<BHBHxx", 0x2B, 0x6040, 0, word)
    return can.Message(arbitration_id=0x600 + node_id, data=data, is_extended_id=False)
