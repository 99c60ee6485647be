"""What is on a bus, heard without saying a word."""

from __future__ import annotations

from collections import Counter
from collections.abc import Mapping
from dataclasses import dataclass

import can

from schwung.clock import clock_of
from schwung.fieldbus.canopen.emcy import Emergency
from schwung.fieldbus.canopen.nmt import NMT_STATES

_SYNC = 0x080


@dataclass(frozen=True)
class Heard:
    """What came within a while: frames by identifier, and what some of them say."""

    frames: Mapping[int, int]
    error_frames: int
    duration_s: float
    heartbeats: Mapping[int, str]  # NMT state by node
    emergencies: tuple[tuple[int, Emergency], ...]  # node and message
    failure: str = ""  # why nothing more could be heard

    @property
    def count(self) -> int:
        """All data frames."""
        return sum(self.frames.values())

    @property
    def syncs(self) -> int:
        """SYNC messages: another master is there."""
        return self.frames.get(_SYNC, 0)

    @property
    def commands(self) -> int:
        """NMT commands: likewise."""
        return self.frames.get(0x000, 0)


def listen(bus: can.BusABC, duration_s: float) -> Heard:
    """Listen for so long; sends nothing. Nobody else may read the bus meanwhile."""
    frames: Counter[int] = Counter()
    heartbeats: dict[int, str] = {}
    emergencies: list[tuple[int, Emergency]] = []
    errors, failure = 0, ""
    clock = clock_of(bus)
    end = clock.now() + duration_s
    while (left := end - clock.now()) > 0:
        try:
            message = bus.recv(left)
        except (can.CanError, OSError, ValueError) as error:
            failure = str(error)
            break
        if message is None:
            continue
        if message.is_error_frame:
            errors += 1
            continue
        if message.is_remote_frame or message.is_extended_id:
            continue
        can_id, node = message.arbitration_id, message.arbitration_id & 0x7F
        frames[can_id] += 1
        if can_id & 0x780 == 0x700 and message.data:
            state = message.data[0] & 0x7F
            heartbeats[node] = NMT_STATES.get(state, f"state 0x{state:02X}")
        elif can_id & 0x780 == 0x080 and node:
            emergencies.append((node, Emergency.decode(bytes(message.data), clock.date())))
    return Heard(frames, errors, duration_s, heartbeats, tuple(emergencies), failure)
