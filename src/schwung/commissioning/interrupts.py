"""Ctrl-C, a kill or a closed terminal: one interrupt gets through, and none into the way out."""

from __future__ import annotations

import signal
import threading
from types import FrameType, TracebackType
from typing import Any, Self

from schwung.clock import INTERRUPTION

_WATCHED = tuple(getattr(signal, name) for name in ("SIGINT", "SIGTERM", "SIGHUP") if hasattr(signal, name))


class OneInterrupt:
    """Within: after the first signal whoever waits next gets KeyboardInterrupt, later ones do nothing; after `hold_off`
    none does.

    A drive that is being stopped, switched off and put back takes a second or two, in which people press Ctrl-C
    again. A signal that came while it was held off raises KeyboardInterrupt at the end of a block that ends well, so
    that nothing is begun afterwards. So does one that nobody has heard of: what goes on without waiting calls
    `let_through` now and then. Signals that are ignored (nohup) stay so; off the main thread nothing happens.
    """

    def __init__(self) -> None:
        self._before: dict[int, Any] = {}
        self._armed = True
        self._pending = False

    def hold_off(self) -> None:
        """From now on signals wait."""
        self._armed = False
        INTERRUPTION.forget()

    def let_through(self) -> None:
        """Raise KeyboardInterrupt where a signal has waited, or was heard of and we are still here."""
        if self._pending:
            self._pending = False
            INTERRUPTION.forget()
            raise KeyboardInterrupt

    def __enter__(self) -> Self:
        try:
            if threading.current_thread() is threading.main_thread():
                for number in _WATCHED:
                    before = signal.getsignal(number)
                    if before is not signal.SIG_IGN:
                        self._before[number] = before
                        signal.signal(number, self._on_signal)
        except BaseException:
            self._put_back()
            raise
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self.hold_off()
        self._put_back()
        if kind is None:
            self.let_through()

    def _put_back(self) -> None:
        """All handlers, whichever of them interrupts meanwhile: one that stayed would be deaf for ever."""
        try:
            for number, handler in list(self._before.items()):
                signal.signal(number, signal.SIG_DFL if handler is None else handler)
                del self._before[number]
        finally:
            if self._before:
                self._put_back()

    def _on_signal(self, number: int, frame: FrameType | None) -> None:
        self._pending = True
        if self._armed:
            self._armed = False
            INTERRUPTION.note()
