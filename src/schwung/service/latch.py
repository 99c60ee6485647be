"""STOP: latched, on threads of its own, and not undone by anybody but who releases it.

`Latch` says whether anything may be begun; `Brake` is the thread that halts one connected drive. Neither waits for
the event loop, for a lane, or for a lock that one of them holds while it works.
"""

from __future__ import annotations

import contextlib
import threading
import time
from collections.abc import Callable
from dataclasses import dataclass

from schwung.api.drives import Drive
from schwung.api.watching import SteppedClock
from schwung.errors import RefusedError

_HALTED_WITHIN_S = 5.0


@dataclass(frozen=True)
class Stopped:
    """A STOP: who, and when (ISO 8601)."""

    who: str
    at: str


class Latch:
    """Whether the service is stopped. From any thread; the first STOP counts until it is released."""

    def __init__(self) -> None:
        self._stopped: Stopped | None = None

    @property
    def stopped(self) -> Stopped | None:
        """The STOP that holds; None: none does."""
        return self._stopped

    def set(self, stopped: Stopped) -> None:
        """Stop."""
        self._stopped = self._stopped or stopped

    def release(self) -> None:
        """What is asked for may be begun again."""
        self._stopped = None

    def require_free(self) -> None:
        """Raise RefusedError while stopped."""
        stopped = self._stopped
        if stopped is not None:
            raise RefusedError(
                "service",
                f"was stopped by {stopped.who} at {stopped.at}",
                "Release it when the machine is clear.",
            )


class Brake:
    """Halts one drive on a thread that does nothing else. `pull` returns at once and never raises."""

    def __init__(self, drive: Drive, halted: Callable[[float], None] = lambda _latency_s: None) -> None:
        self.drive, self._halted = drive, halted  # told how long it took from `pull` (s)
        self.pulled_s: float | None = None  # monotonic, when it was pulled last
        self.halted_s: float | None = None  # when the driver's `halt` returned
        self._pulls = self._done = self._answered = 0  # asked for, carried out, followed by `answer`
        self._wanted = threading.Event()
        self._ended = False
        self._thread = threading.Thread(target=self._run, name="schwung brake", daemon=True)
        self._thread.start()

    def pull(self) -> None:
        """Quick stop, now; see Drive.halt."""
        self.pulled_s, self.halted_s = time.monotonic(), None
        self._pulls += 1
        self._wanted.set()

    def answer(self) -> bool:
        """Whether it was pulled since this was asked last: who asks switches the drive off.

        In the thread of the drive's lane. What was pulled is over when this returns: no halt comes late into what
        begins afterwards.
        """
        if self._pulls == self._answered:
            return False
        end = time.monotonic() + _HALTED_WITHIN_S
        while self._done < self._pulls and time.monotonic() < end:
            time.sleep(1e-3)
        clock = self.drive.clock
        if isinstance(clock, SteppedClock):
            clock.sleep(1e-3)  # what was put into its time is carried out now
        self._answered = self._done
        return True

    def close(self) -> None:
        """End the thread; a halt under way is waited for, but for a second at most."""
        self._ended = True
        self._wanted.set()
        if threading.current_thread() is not self._thread:
            self._thread.join(1.0)

    def _run(self) -> None:
        while True:
            self._wanted.wait()
            self._wanted.clear()
            pulls = self._pulls
            if self._ended:
                return
            with contextlib.suppress(
                Exception
            ):  # `halt` never raises; a defect in it may not end the next one
                clock = self.drive.clock
                if isinstance(
                    clock, SteppedClock
                ):  # its time has one thread: whoever waits there carries it out
                    clock.later(0.0, self.drive.halt)
                else:
                    self.drive.halt()
            self.halted_s, self._done = time.monotonic(), pulls
            if self.pulled_s is not None:
                self._halted(self.halted_s - self.pulled_s)
