"""Requests at a steady pace, so that the drive's watchdog hears us for as long as we live."""

from __future__ import annotations

import threading
from collections.abc import Callable

from schwung.errors import DriveError


class Keeper:
    """Calls `ask` every `period_s` in a thread of its own until it is closed; failures are left to who asks next."""

    def __init__(self, ask: Callable[[], object], period_s: float) -> None:
        self._ask, self._period_s = ask, period_s
        self._ended = threading.Event()
        self._thread = threading.Thread(target=self._run, name="modbus-keeper", daemon=True)
        self._thread.start()

    def _run(self) -> None:
        while not self._ended.wait(self._period_s):
            try:
                self._ask()
            except DriveError:
                continue  # the next request finds out, too, and somebody waits for its answer

    def close(self) -> None:
        """End the thread; a request under way is waited for."""
        self._ended.set()
        self._thread.join(5.0)
