"""Who else acts as master of the bus, heard while we do not: a drive obeys whoever sends."""

from __future__ import annotations

from collections.abc import Callable

import can

from schwung.fieldbus.canopen.exchange import SYNC_ID
from schwung.fieldbus.canopen.link import Link


class ForeignMasters:
    """Listens for SYNC and NMT commands that are not ours: all that come while `exchanging` says that we send none."""

    LISTEN_S = 0.5  # since we are here, before nobody counts as nobody

    def __init__(self, link: Link, exchanging: Callable[[], bool]) -> None:
        self._link, self._exchanging = link, exchanging
        self._since = link.clock.now()
        self._heard: dict[int, str] = {}
        for can_id in (SYNC_ID, 0x000):
            link.subscribe(can_id, self._on_frame)

    @property
    def words(self) -> str:
        """What somebody else sends; empty where nothing was heard. Listens first, where that was not long enough."""
        clock = self._link.clock
        if not self._exchanging():
            clock.wait(lambda: bool(self._heard), self._since + self.LISTEN_S - clock.now())
        return " and ".join(self._heard[can_id] for can_id in sorted(self._heard, reverse=True))

    def close(self) -> None:
        """Stop listening."""
        for can_id in (SYNC_ID, 0x000):
            self._link.unsubscribe(can_id, self._on_frame)

    def _on_frame(self, message: can.Message) -> None:
        if message.is_rx and not self._exchanging():
            name = "SYNC" if message.arbitration_id == SYNC_ID else "NMT commands"
            self._heard[message.arbitration_id] = name
