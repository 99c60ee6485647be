"""Where positions are counted from, and the range that they are folded into: objects 607C and 607B.

    motor, in position units of the user's direction (607E) ─ minus 607C ─► from zero ─ into 607B ─► on the bus

The encoder is an absolute one whose own zero is the home position: the zero position is that plus the home offset
(CiA 402-2, home offset, figure "Home offset definition").
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import TypeVar

Counts = TypeVar("Counts", int, float)
_WHOLE_RANGE = 2**32 - 1  # as wide as the type: nothing is ever folded


@dataclass(frozen=True)
class Frame:
    """In position counts. `modulus` 0: there is no range."""

    zero: int = 0
    low: int = 0
    modulus: int = 0

    def reported(self, counts: float) -> float:
        """A position of the motor as the bus has it."""
        return self.fold(counts - self.zero)

    def fold(self, position: Counts) -> Counts:
        """A position within the range; at its upper end it begins anew."""
        return (position - self.low) % self.modulus + self.low if self.modulus else position

    def nearest(self, target: int, near: int) -> int:
        """The motor's position for a target on the bus: no more than half a range away from `near`."""
        way = target + self.zero - near
        if self.modulus:
            way = (way + self.modulus // 2) % self.modulus - self.modulus // 2
        return near + way

    def within(self, target: int, near: int) -> int:
        """The same, but never across an end of the range: as on a linear axis (CiA 402-2, 60F2 bits 7 and 6 = 0)."""
        if not self.modulus:
            return target + self.zero
        return near + self.fold(target) - self.fold(near - self.zero)


def read_frame(number: Callable[[int, int], int]) -> Frame | None:
    """The frame that 607B and 607C ask for; None where the bus has the motor's own positions.

    On reaching or exceeding an end of 607B the value wraps to the other end: both ends are one position, and the
    range is max − min long (CiA 402-2, position range limit).
    """
    zero, low, high = number(0x607C, 0), number(0x607B, 1), number(0x607B, 2)
    modulus = high - low if 0 < high - low < _WHOLE_RANGE else 0
    return Frame(zero, low, modulus) if zero or modulus else None
