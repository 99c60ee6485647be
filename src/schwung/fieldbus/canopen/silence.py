"""How long a drive does not answer: what it misses meanwhile is one step when it hears us again."""

from __future__ import annotations

from collections import Counter


class Silence:
    """SYNCs in a row without an answer; a CAN adapter that hands frames on in bursts makes some all the time."""

    def __init__(self) -> None:
        self._heard = 0  # SYNCs sent when an answer came last
        self._spent: Counter[int] = Counter()  # SYNCs, by the length of the silence that they were in

    def answered(self, sync_count: int) -> None:
        """A TPDO has come, so many SYNCs having been sent."""
        length = sync_count - self._heard
        if length > 0:
            self._spent[length] += length
            self._heard = sync_count

    def length(self, sync_count: int) -> int:
        """How many have gone out since an answer came."""
        return sync_count - self._heard

    @property
    def usual(self) -> int:
        """A silence that is not exceeded for half of the time; one that comes once does not become usual."""
        half, spent = sum(self._spent.values()) / 2, 0
        for length in sorted(self._spent):
            spent += self._spent[length]
            if spent >= half:
                return length
        return 0
