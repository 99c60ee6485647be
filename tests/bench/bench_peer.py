"""A small master on python-can alone: what a test needs to move the bench's drive over a real bus object."""

from __future__ import annotations

import struct
from typing import Any

import can

from schwung.clock import clock_of

NODE = 5


class Master:
    """Speaks expedited SDO and lock-step SYNC to one drive."""

    def __init__(self, node_id: int = NODE, **options: Any) -> None:
        self.bus = can.Bus(**options)
        self.node_id = node_id
        self.seen: list[can.Message] = []

    def send(self, can_id: int, data: bytes = b"") -> None:
        self.bus.send(can.Message(arbitration_id=can_id, data=data, is_extended_id=False))

    def wait_for(self, *can_ids: int, timeout_s: float = 1.0) -> dict[int, bytes]:
        """The next frame of each identifier; those that do not come in time are missing."""
        found: dict[int, bytes] = {}
        clock = clock_of(self.bus)
        end = clock.now() + timeout_s
        while len(found) < len(can_ids) and (left := end - clock.now()) > 0:
            message = self.bus.recv(left)
            if message is None:
                continue
            self.seen.append(message)
            if message.arbitration_id in can_ids:
                found[message.arbitration_id] = bytes(message.data)
        return found

    def _sdo(self, request: bytes, timeout_s: float) -> bytes:
        self.send(0x600 + self.node_id, request)
        reply = self.wait_for(0x580 + self.node_id, timeout_s=timeout_s)
        if not reply:
            raise TimeoutError("no SDO answer")
        (answer,) = reply.values()
        if answer[0] == 0x80:
            raise PermissionError(f"0x{struct.unpack_from('<I', answer, 4)[0]:08X}")
        return answer

    def write(self, index: int, subindex: int, value: int, size: int, timeout_s: float = 1.0) -> None:
        raw = (value & (1 << 8 * size) - 1).to_bytes(4, "little")
        self._sdo(struct.pack("<BHB", 0x23 | (4 - size) << 2, index, subindex) + raw, timeout_s)

    def read(self, index: int, subindex: int = 0, timeout_s: float = 1.0) -> int:
        answer = self._sdo(struct.pack("<BHB4x", 0x40, index, subindex), timeout_s)
        return int.from_bytes(answer[4 : 8 - (answer[0] >> 2 & 3)], "little")

    def map_pdo(self, communication: int, cob_id: int, entries: list[int]) -> None:
        mapping = communication + 0x200
        self.write(communication, 1, cob_id | 1 << 31, 4)
        self.write(communication, 2, 1, 1)
        self.write(mapping, 0, 0, 1)
        for subindex, entry in enumerate(entries, start=1):
            self.write(mapping, subindex, entry, 4)
        self.write(mapping, 0, len(entries), 1)
        self.write(communication, 1, cob_id, 4)

    def prepare(self) -> None:
        """The profile's PDOs, CSP, operational."""
        self.map_pdo(0x1400, 0x205, [0x60400010, 0x607A0020, 0x60B20010])
        self.map_pdo(0x1800, 0x40000185, [0x60410010, 0x60640020, 0x60770010])
        self.map_pdo(0x1801, 0x40000285, [0x606C0020])
        self.write(0x1006, 0, 1000, 4)
        self.write(0x6060, 0, 8, 1)
        self.send(0, bytes((1, self.node_id)))

    def cycle(
        self, word: int, target: int, offset: int = 0, timeout_s: float = 1.0
    ) -> tuple[int, int, int, int] | None:
        """(status, position, torque, speed), or None where not both answers came."""
        self.send(0x205, struct.pack("<Hih", word, target, offset))
        self.send(0x80)
        answers = self.wait_for(0x185, 0x285, timeout_s=timeout_s)
        if len(answers) < 2:
            return None
        return (*struct.unpack("<Hih", answers[0x185]), struct.unpack("<i", answers[0x285])[0])

    def enable(self) -> None:
        for word in (0x06, 0x07, 0x0F):
            assert self.cycle(word, 0) is not None

    def close(self) -> None:
        self.bus.shutdown()

    def __enter__(self) -> Master:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()
