"""The wall's time, for real buses: `every` and `read` are threads; what waits, waits in the kernel."""

from __future__ import annotations

import contextlib
import math
import threading
import time
from collections.abc import Callable
from typing import Any

import can

from schwung.clock.interruption import INTERRUPTION
from schwung.clock.protocol import Event, Failed, Reader, Receive, Task

_POLL_S = 0.001  # how often `wait` looks
_READ_TIMEOUT_S = 0.02  # on a silent bus, `close` waits for the reader so long
_FAILURE_PAUSE_S = 0.1
_WAITED_FOR_S = 1.0
_DEAF_S = 0.02  # who waits hears of an interrupt within that: not every system breaks off a wait for it


class WallClock:
    """The computer's own time. It has no state: two of them are as good as one."""

    simulated = False

    now = staticmethod(time.monotonic)
    date = staticmethod(time.time)

    def sleep(self, duration_s: float) -> None:
        """See Clock."""
        end = time.monotonic() + duration_s
        while True:
            INTERRUPTION.let_through()
            left = end - time.monotonic()
            if left <= 0:
                return
            time.sleep(min(left, _DEAF_S))

    def wait(self, ready: Callable[[], bool], timeout_s: float) -> bool:
        """See Clock."""
        end = time.monotonic() + timeout_s
        while not ready():
            INTERRUPTION.let_through()
            if time.monotonic() >= end:
                return ready()
            time.sleep(_POLL_S)
        return True

    def event(self) -> Event:
        """See Clock."""
        return _Event()

    def lock(self) -> contextlib.AbstractContextManager[Any]:
        """See Clock."""
        return threading.RLock()

    def every(self, period_s: float, call: Callable[[], None], name: str = "") -> Task:
        """See Clock."""

        def run(ending: threading.Event) -> None:
            due = time.monotonic()
            while not ending.is_set():
                began = time.monotonic()
                call()
                due = max(due + period_s, began + period_s / 2)
                left = due - time.monotonic()
                if left > 0:
                    ending.wait(left)

        return _Thread(run, name or "schwung timer")

    def later(self, delay_s: float, call: Callable[[], None]) -> Task:
        """See Clock."""

        def run(ending: threading.Event) -> None:
            if not ending.wait(delay_s):
                call()

        return _Thread(run, "schwung timer")

    def read(self, bus: can.BusABC, receive: Receive, failed: Failed) -> Reader:
        """See Clock."""
        return _ReaderThread(bus, receive, failed)


class _Event(threading.Event):
    def wait(self, timeout: float | None = None) -> bool:
        """Within so much time."""
        end = math.inf if timeout is None else time.monotonic() + timeout
        while True:
            INTERRUPTION.let_through()
            left = end - time.monotonic()
            if super().wait(max(0.0, min(left, _DEAF_S))) or left <= _DEAF_S:
                return self.is_set()


class _Thread:
    def __init__(self, run: Callable[[threading.Event], None], name: str) -> None:
        self._ending = threading.Event()
        self._thread = threading.Thread(target=run, args=(self._ending,), name=name, daemon=True)
        self._thread.start()

    def close(self) -> None:
        self._ending.set()
        if threading.current_thread() is not self._thread:
            self._thread.join(_WAITED_FOR_S)


class _ReaderThread(_Thread):
    def __init__(self, bus: can.BusABC, receive: Receive, failed: Failed) -> None:
        self._bus, self._receive, self._failed = bus, receive, failed
        self._asked, self._caught_up = threading.Event(), threading.Event()
        self._asked_s = math.inf
        super().__init__(self._read, "schwung bus reader")

    def catch_up(self) -> None:
        if threading.current_thread() is not self._thread:
            self._caught_up.clear()
            self._asked_s = time.time()
            self._asked.set()
            self._caught_up.wait(_WAITED_FOR_S)

    def _read(self, ending: threading.Event) -> None:
        while not ending.is_set():
            asked = self._asked.is_set()
            try:
                message = self._bus.recv(0.0 if asked else _READ_TIMEOUT_S)
            except (
                Exception
            ) as error:  # adapters raise what they like, ValueError where one is closed under us
                if not ending.is_set():
                    self._failed(error)
                    self._caught_up.set()
                    ending.wait(_FAILURE_PAUSE_S)
                continue
            if message is not None:
                try:
                    self._receive(message)
                except (
                    Exception
                ) as error:  # a mistake of ours: who moves an axis hears of it, and of the frames to come
                    self._failed(error)
            # One that came later ends it: on a full bus there may be no instant without a frame. A stamp that is still
            # to come is by another clock than the kernel's, and says nothing.
            if asked and (message is None or self._asked_s < message.timestamp <= time.time()):
                self._asked.clear()
                self._caught_up.set()
