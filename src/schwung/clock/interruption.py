"""Where an interrupt gets through while a machine may move: where somebody waits, and nowhere else.

A signal's handler runs between any two instructions of the main thread. What it raises there can leave a lock held or
a stop half begun for ever: threading.Event is written in Python, and an interrupt amid its waits may leave its lock
held. The program then waited for itself, for good, while its heartbeat went on. So a handler notes the interrupt, and
whoever sleeps or waits next by a clock, in the main thread, hears of it.
"""

from __future__ import annotations

import threading


class Interruption:
    """What a signal asks of the main thread."""

    def __init__(self) -> None:
        self.noted = False

    def note(self) -> None:
        """Whoever waits next shall hear of it."""
        self.noted = True

    def forget(self) -> None:
        """Nobody shall."""
        self.noted = False

    def let_through(self) -> None:
        """Raise KeyboardInterrupt, once, where one was noted; in the main thread alone."""
        if self.noted and threading.current_thread() is threading.main_thread():
            self.noted = False
            raise KeyboardInterrupt


#: The process's one, as its signals are.
INTERRUPTION = Interruption()
