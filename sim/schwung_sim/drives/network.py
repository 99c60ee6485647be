"""NMT, heartbeats and emergencies of the drive (CiA 301 clauses 7.2.7, 7.2.8)."""

from __future__ import annotations

import struct
from collections.abc import Callable
from enum import IntEnum
from functools import partial

from schwung_sim.drives.dictionary import AbortError, Code, ObjectDictionary, key

EMCY_HEARTBEAT = 0x8130
NOT_VALID = 1 << 31

SendFrame = Callable[[int, bytes], None]


class Nmt(IntEnum):
    """NMT states, by their number in the heartbeat."""

    BOOT_UP = 0
    STOPPED = 4
    OPERATIONAL = 5
    PRE_OPERATIONAL = 127


class Emergency:
    """Error register, history and EMCY messages. Errors are held by code until they are cleared."""

    def __init__(self, dictionary: ObjectDictionary, send: SendFrame, may_send: Callable[[], bool]) -> None:
        self._dictionary, self._send, self._may_send = dictionary, send, may_send
        self.active: dict[int, int] = {}  # code -> bit of the error register
        self._history: list[int] = []
        dictionary.readers[key(0x1001)] = lambda: self.register
        dictionary.readers[key(0x1003)] = lambda: len(self._history)
        dictionary.writers[key(0x1003)] = self._clear_history
        self._room = max((k & 0xFF for k in dictionary.entries if k >> 8 == 0x1003), default=0)
        for n in range(1, self._room + 1):
            dictionary.readers[key(0x1003, n)] = partial(self._past, n)

    @property
    def register(self) -> int:
        """Object 1001: bit 0 is set with any error."""
        register = 1 if self.active else 0
        for bit in self.active.values():
            register |= bit
        return register

    def _past(self, n: int) -> int:
        if n > len(self._history):
            raise AbortError(Code.NO_DATA)
        return self._history[n - 1]

    def _clear_history(self, value: int) -> None:
        if value:
            raise AbortError(Code.INVALID_VALUE)
        self._history.clear()

    def forget(self) -> None:
        """A reset: no error is left, and nothing is sent about it."""
        self.active.clear()

    def report(self, code: int) -> None:
        """Send an EMCY and remember it; an error that is already there is not reported again."""
        if code in self.active:
            return
        self.active[code] = _register_bit(code)
        self._history = [code, *self._history][: self._room]
        self._emit(code)

    def clear(self, code: int | None = None) -> None:
        """An error has gone (None: all); EMCY 0000 tells when none is left."""
        before = bool(self.active)
        if code is None:
            self.active.clear()
        else:
            self.active.pop(code, None)
        if before and not self.active:
            self._emit(0)

    def _emit(self, code: int) -> None:
        cob_id = self._dictionary.number(0x1014)
        if not cob_id & NOT_VALID and self._may_send():
            self._send(cob_id & 0x7FF, struct.pack("<HB5x", code, self.register))


def _register_bit(code: int) -> int:
    """Bit of object 1001 for an error code: its class in the high nibble (CiA 301 table 26)."""
    classes = {0x2: 1 << 1, 0x3: 1 << 2, 0x4: 1 << 3, 0x8: 1 << 4}
    device_profile = 1 << 5
    return device_profile if code >> 8 in (0x84, 0x85, 0x86) else classes.get(code >> 12, 1 << 7)


class Heartbeats:
    """Producer (1017) and consumers (1016). `now` is wall-clock time in seconds."""

    def __init__(
        self,
        dictionary: ObjectDictionary,
        send: Callable[[], None],
        lost: Callable[[int], None],
        back: Callable[[], None],
    ) -> None:
        self._dictionary = dictionary
        self._send, self._lost, self._back = send, lost, back
        self.muted = False  # the bench's own: a heartbeat that has stopped
        self._next_s = 0.0
        self.silent: set[int] = set()  # nodes that are watched and have fallen silent
        self._heard: dict[int, float] = {}  # node -> when; only once it has been heard (7.2.8.3.2.2)
        self._consumers = [k for k in dictionary.entries if k >> 8 == 0x1016 and k & 0xFF]
        for k in self._consumers:
            dictionary.writers[k] = partial(self._write_consumer, k)
        dictionary.writers[key(0x1017)] = self._write_producer

    def reset(self) -> None:
        """Forget whom we have heard."""
        self._heard.clear()
        self.silent.clear()
        self._next_s = 0.0

    def _write_consumer(self, written: int, value: int) -> None:
        node, time_ms = value >> 16 & 0xFF, value & 0xFFFF
        if value >> 24 or (time_ms and not 1 <= node <= 127):
            raise AbortError(Code.INVALID_VALUE)
        others = [int(self._dictionary.real(k)) for k in self._consumers if k != written]
        if time_ms and any(v & 0xFFFF and v >> 16 & 0xFF == node for v in others):
            raise AbortError(Code.INCOMPATIBLE)  # one time for one node (7.5.2.19)
        self._heard.clear()
        self.silent.clear()

    def _write_producer(self, value: int) -> None:
        self._next_s = 0.0

    @property
    def watched(self) -> set[int]:
        """Nodes whose silence would be noticed now."""
        return set(self._heard) - self.silent

    def heard(self, node: int, now: float) -> None:
        """A heartbeat of another node came."""
        for k in self._consumers:
            value = int(self._dictionary.real(k))
            if value >> 16 & 0xFF == node and value & 0xFFFF:
                self._heard[node] = now
                if node in self.silent:
                    self.silent.discard(node)
                    self._back()

    def tick(self, now: float, judge: bool = True) -> None:
        """Send our own where it is due; find those that have fallen silent, where it is time to `judge`."""
        period = self._dictionary.number(0x1017) * 1e-3
        if period and now >= self._next_s and not self.muted:
            self._next_s = now + period if now - self._next_s > period else self._next_s + period
            self._send()
        for k in self._consumers if judge else ():
            value = int(self._dictionary.real(k))
            node, limit = value >> 16 & 0xFF, (value & 0xFFFF) * 1e-3
            if limit and node in self._heard and node not in self.silent and now - self._heard[node] > limit:
                self.silent.add(node)
                self._lost(node)
