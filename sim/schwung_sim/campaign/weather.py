"""Weather on a wire: which frames are lost, late, doubled or out of order, while it lasts."""

from __future__ import annotations

import random
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any

import can

CALM = (0.0,)
#: What is doubled or out of order is so by a frame or two: repeated on the wire, swapped in a controller's mailboxes.
_SWAPPED_WITHIN_S = 1e-3
_REPEATED_WITHIN_S = 1e-4  # before its sender has another one


@dataclass(eq=False)
class Squall:
    """One kind of weather for some of the frames."""

    kind: str  # "lose", "delay", "double", "reorder"
    target: str
    share: float  # of those frames
    delay_s: float
    chance: random.Random

    def delays(self) -> Sequence[float]:
        """After which times a frame arrives."""
        if self.chance.random() >= self.share:
            return CALM
        if self.kind == "lose":
            return ()
        if self.kind == "double":
            return (0.0, self.chance.uniform(0.0, _REPEATED_WITHIN_S))
        if self.kind == "reorder":
            return (self.chance.uniform(0.0, _SWAPPED_WITHIN_S),)
        return (self.delay_s,)


class Weather:
    """For `Wire.weather`. `names`: who is who on the wire; who is none of them only talks, and gets nothing."""

    def __init__(self, node_id: int, now: Callable[[], float]) -> None:
        self.names: dict[Any, str] = {}
        self.squalls: list[Squall] = []
        self.on_frame: Callable[[str, can.Message], None] | None = (
            None  # called with every frame and its sender
        )
        self.on_way: Callable[[str, can.Message, Sequence[float]], None] | None = (
            None  # and with who will get it, after which times
        )
        self._node_id, self._now = node_id, now
        self._last: can.Message | None = None
        self._arrived_s: dict[
            tuple[Any, int], float
        ] = {}  # the latest frame that was late, by end and identifier

    def __call__(self, sender: Any, end: Any, message: can.Message) -> Sequence[float]:
        """See clock.Weather."""
        name = self.names.get(sender, "other")
        if message is not self._last:
            self._last = message
            if self.on_frame is not None:
                self.on_frame(name, message)
        if end not in self.names:
            return ()
        delays = self._delays(name, end, message)
        if self.on_way is not None:
            self.on_way(self.names[end], message, delays)
        return delays

    def _delays(self, name: str, end: Any, message: can.Message) -> Sequence[float]:
        """After which times it arrives there."""
        if not self.squalls:
            return self._in_turn(end, message.arbitration_id, 0.0) if self._arrived_s else CALM
        kinds = {"all", f"to {self.names[end]}", f"from {name}", self.kind_of(message.arbitration_id, name)}
        for squall in self.squalls:
            if squall.target in kinds:
                delays = squall.delays()
                if squall.kind == "delay":
                    return self._in_turn(end, message.arbitration_id, delays[0])
                if delays is not CALM:
                    return delays
        return self._in_turn(end, message.arbitration_id, 0.0) if self._arrived_s else CALM

    def _in_turn(self, end: Any, can_id: int, delay_s: float) -> Sequence[float]:
        """A late frame does not let those behind it pass: it is a queue that is late."""
        now, place = self._now(), (end, can_id)
        arrives = max(now + delay_s, self._arrived_s.get(place, 0.0))
        self._arrived_s[place] = arrives
        return (arrives - now,)

    def kind_of(self, can_id: int, sender: str) -> str:
        """What a frame is, by its identifier (CiA 301, 7.3.5)."""
        node = self._node_id
        if can_id == 0x700 + node:
            return "its heartbeat"
        if can_id == 0x77F:
            return "our heartbeat" if sender == "tool" else "another's heartbeat"
        fixed = {
            0x000: "NMT",
            0x080: "SYNC",
            0x080 + node: "EMCY",
            0x580 + node: "SDO answer",
            0x600 + node: "SDO request",
        }
        if can_id in fixed:
            return fixed[can_id]
        return "RPDO" if can_id & 0x7F == node and can_id & 0x780 in (0x200, 0x300, 0x400, 0x500) else "TPDO"
