"""A drive on a workbench without threads or wall clock: frames go in by hand, time passes by hand."""

from __future__ import annotations

import math
import struct
from pathlib import Path
from typing import Any

import can
import canopen

from schwung_sim.bench import default_eds
from schwung_sim.drives.axis import ServoAxis
from schwung_sim.drives.roles import find_profile, read_profile, read_roles
from schwung_sim.drives.servo import CanopenServo
from schwung_sim.faults import FaultSchedule, FaultyBus, parse_faults
from schwung_sim.plants import make_plant

NODE = 5
COUNTS_PER_RAD = 2**20 / (2 * math.pi)
FORMS = {1: "<B", 2: "<H", 4: "<I"}
STATE_MASK = 0x6F
SHUTDOWN, SWITCH_ON, ENABLE, QUICK, VOLTAGE_OFF, RESET, HALT = 0x06, 0x07, 0x0F, 0x02, 0x00, 0x80, 0x100
SWITCH_ON_DISABLED, READY, SWITCHED_ON, ENABLED = 0x40, 0x21, 0x23, 0x27
QUICK_STOP, FAULT_REACTION, FAULT = 0x07, 0x0F, 0x08


class Wire(can.BusABC):
    """Keeps what the drive sends; `fail` makes it behave as in bus-off."""

    def __init__(self) -> None:
        self.sent: list[can.Message] = []
        self.fail = False
        self.listener: Any = None
        super().__init__(channel="wire")
        self.shutdown()  # nothing to close: spares a warning for every wire that is dropped

    def send(self, msg: can.Message, timeout: float | None = None) -> None:
        if self.fail:
            raise can.CanOperationError("bus-off")
        self.sent.append(msg)
        if self.listener is not None:
            self.listener(msg.arbitration_id, bytearray(msg.data), 0.0)

    def _recv_internal(self, timeout: float | None) -> tuple[can.Message | None, bool]:
        return None, True


class Aborted(Exception):
    """The drive aborted an SDO."""

    def __init__(self, code: int) -> None:
        self.code = code
        super().__init__(f"0x{code:08X}")


class Rig:
    """One drive, one hand-driven bus. `wait` lets wall-clock time pass, `sync` plays SYNCs."""

    def __init__(
        self,
        clock: Any = "sync",
        memory: Path | None = None,
        seed: int = 0,
        profile: str | Path = "schwung-bench",
        faults: str = "",
    ) -> None:
        self.now = 100.0
        self.wire = Wire()
        self.axis = ServoAxis(make_plant("two-mass"), seed=seed)
        content, eds = read_profile(find_profile(profile))
        self.servo = CanopenServo(
            self.wire,
            NODE,
            self.axis,
            eds,
            read_roles(content),
            clock=clock,
            seed=seed,
            memory=memory,
            monotonic=lambda: self.now,
        )
        if faults:
            bus = FaultyBus(self.wire)
            bus.shutdown()  # as with the wire: nothing to close
            self.servo.on_advance = FaultSchedule(self.servo, bus, parse_faults(faults)).poll
        self.servo.start()

    # -- frames --

    def give(self, can_id: int, data: bytes = b"") -> None:
        self.servo.service(can.Message(arbitration_id=can_id, data=data, is_extended_id=False))

    def take(self, can_id: int) -> list[bytes]:
        """What the drive has sent under this identifier since the last look."""
        found = [bytes(m.data) for m in self.wire.sent if m.arbitration_id == can_id]
        self.wire.sent = [m for m in self.wire.sent if m.arbitration_id != can_id]
        return found

    def ask(self, request: bytes) -> list[bytes]:
        """An SDO frame and all that is answered."""
        self.take(0x580 + NODE)
        self.give(0x600 + NODE, request.ljust(8, b"\0"))
        return self.take(0x580 + NODE)

    def read_raw(self, index: int, subindex: int = 0) -> bytes:
        """An expedited upload."""
        (reply,) = self.ask(struct.pack("<BHB", 0x40, index, subindex))
        if reply[0] == 0x80:
            raise Aborted(struct.unpack_from("<I", reply, 4)[0])
        assert reply[0] & 0xE3 == 0x43
        assert struct.unpack_from("<HB", reply, 1) == (index, subindex)
        return reply[4 : 8 - (reply[0] >> 2 & 3)]

    def read(self, index: int, subindex: int = 0, signed: bool = False) -> int:
        raw = self.read_raw(index, subindex)
        return int.from_bytes(raw, "little", signed=signed)

    def write(self, index: int, subindex: int, value: int, size: int) -> None:
        """An expedited download."""
        raw = (value & (1 << 8 * size) - 1).to_bytes(size, "little")
        (reply,) = self.ask(struct.pack("<BHB", 0x23 | (4 - size) << 2, index, subindex) + raw)
        if reply[0] == 0x80:
            raise Aborted(struct.unpack_from("<I", reply, 4)[0])
        assert reply == struct.pack("<BHB4x", 0x60, index, subindex)

    def client(self) -> canopen.RemoteNode:
        """canopen's own node, wired to the drive without a bus in between."""
        network = canopen.Network()
        network.send_message = lambda can_id, data, remote=False: self.give(can_id, bytes(data))
        node = canopen.RemoteNode(NODE, str(default_eds()))
        network.add_node(node)
        self.wire.listener = network.notify
        return node

    # -- time --

    def wait(self, duration_s: float, step_s: float = 0.002) -> None:
        for _ in range(round(duration_s / step_s)):
            self.now += step_s
            self.servo.tick()

    def sync(self, count: int = 1, period_s: float = 0.001) -> None:
        for _ in range(count):
            self.now += period_s
            self.give(0x80)
            self.servo.tick()

    # -- CiA 402 --

    @property
    def status(self) -> int:
        return self.read(0x6041)

    @property
    def state(self) -> int:
        word = self.status
        return word & STATE_MASK if word & 0x4F not in (0x40, 0x08, 0x0F) else word & 0x4F

    def control(self, word: int) -> int:
        """Write a controlword by SDO; returns the state after it."""
        self.write(0x6040, 0, word, 2)
        return self.state

    def enable(self, mode: int = 8) -> None:
        self.write(0x6060, 0, mode, 1)
        for word in (0x06, 0x07, 0x0F):
            self.control(word)
        assert self.state == ENABLED

    def nmt(self, command: int, node: int = NODE) -> None:
        self.give(0, bytes((command, node)))

    def map_pdo(self, communication: int, cob_id: int, kind: int, entries: list[int]) -> None:
        """The order that CiA 301 prescribes: off, count 0, entries, count, on."""
        mapping = communication + 0x200
        self.write(communication, 1, cob_id | 1 << 31, 4)
        self.write(communication, 2, kind, 1)
        self.write(mapping, 0, 0, 1)
        for subindex, entry in enumerate(entries, start=1):
            self.write(mapping, subindex, entry, 4)
        self.write(mapping, 0, len(entries), 1)
        self.write(communication, 1, cob_id, 4)

    def cyclic(self) -> None:
        """The profile's PDOs, and operational."""
        self.map_pdo(0x1400, 0x205, 1, [0x60400010, 0x607A0020, 0x60B20010])
        self.map_pdo(0x1800, 0x40000185, 1, [0x60410010, 0x60640020, 0x60770010])
        self.map_pdo(0x1801, 0x40000285, 1, [0x606C0020])
        self.nmt(1)

    def cycle(self, word: int, target: int, offset: int = 0) -> tuple[int, int, int, int]:
        """One RPDO and one SYNC; (status, position, torque, speed) as the TPDOs have them."""
        self.take(0x185), self.take(0x285)
        self.give(0x205, struct.pack("<Hih", word, target, offset))
        self.sync()
        (first,), (second,) = self.take(0x185), self.take(0x285)
        status, position, torque = struct.unpack("<Hih", first)
        return status, position, torque, struct.unpack("<i", second)[0]

    def run(self, speed_rad_s: float = 6.0, cycles: int = 150) -> int:
        """CSP at constant speed from rest at 0; returns the last target (counts)."""
        self.cyclic()
        self.write(0x6060, 0, 8, 1)
        for word, state in ((SHUTDOWN, READY), (SWITCH_ON, SWITCHED_ON), (ENABLE, ENABLED)):
            for _ in range(500):  # a brake, or a slow state machine
                self.cycle(word, 0)
                if self.state == state:
                    break
        target = 0
        for _ in range(cycles):
            target += round(speed_rad_s * 1e-3 * COUNTS_PER_RAD)
            self.cycle(ENABLE, target)
        return target

    def emergencies(self) -> list[int]:
        """Error codes that the drive has sent since the last look."""
        return [struct.unpack_from("<H", data)[0] for data in self.take(0x80 + NODE)]
