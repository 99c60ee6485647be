"""Who else acts as master of the bus, heard while we do not: a drive obeys whoever sends."""

from __future__ import annotations

from collections.abc import Callable

import can

from schwung.fieldbus.canopen.exchange import SYNC_ID
from schwung.fieldbus.canopen.link import Link

_COMMANDS = "setpoints and controlwords"


class ForeignMasters:
    """Listens for what only a master sends, and we did not: SYNC, NMT commands, and PDOs and SDO requests to our node.

    All that comes while `exchanging` says that we exchange no PDOs; else `Exchange` listens.
    """

    LISTEN_S = 0.5  # since we are here, before nobody counts as nobody

    def __init__(self, link: Link, node_id: int, exchanging: Callable[[], bool]) -> None:
        self._link, self._exchanging = link, exchanging
        self._since = link.clock.now()
        self._heard: set[str] = set()
        self._names = {SYNC_ID: "SYNC", 0x000: "NMT commands", 0x600 + node_id: "SDO requests"}
        self._names |= dict.fromkeys(range(0x200 + node_id, 0x600, 0x100), _COMMANDS)
        for can_id in self._names:
            link.subscribe(can_id, self._on_frame)

    @property
    def words(self) -> str:
        """What somebody else sends; empty where nothing was heard. Listens first, where that was not long enough."""
        clock = self._link.clock
        if not self._exchanging():
            clock.wait(lambda: bool(self._heard), self._since + self.LISTEN_S - clock.now())
        return " and ".join(name for name in dict.fromkeys(self._names.values()) if name in self._heard)

    def close(self) -> None:
        """Stop listening."""
        for can_id in self._names:
            self._link.unsubscribe(can_id, self._on_frame)

    def _on_frame(self, message: can.Message) -> None:
        if message.is_rx and not self._exchanging():
            self._heard.add(self._names[message.arbitration_id])
