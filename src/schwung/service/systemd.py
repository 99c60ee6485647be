"""A service under systemd: ready, ending, and alive, told by sd_notify(3)'s datagrams; and the unit that asks for it.

The watchdog is only told that we are alive while both answer: the event loop, and every bus's lane. A service that
hangs is then ended and started again by systemd, and a drive that it moved has stopped by itself when our heartbeats
ended.
"""

from __future__ import annotations

import asyncio
import contextlib
import getpass
import os
import socket
import sys
import threading
import time
from collections.abc import Callable, Mapping
from pathlib import Path

#: Shares of the watchdog's time: how often it is told, and how old an answer may be that counts.
_EVERY, _FRESH = 1 / 4, 1 / 2


class Notifier:
    """Tells systemd; does nothing where nobody listens (NOTIFY_SOCKET is not set)."""

    def __init__(self, environment: Mapping[str, str] | None = None) -> None:
        environment = os.environ if environment is None else environment
        self._address = environment.get("NOTIFY_SOCKET", "")
        own = environment.get("WATCHDOG_PID") in (None, "", str(os.getpid()))
        told = environment.get("WATCHDOG_USEC", "")
        self.watchdog_s = int(told) * 1e-6 if own and self._address and told.isdigit() and int(told) else None

    def tell(self, **words: object) -> None:
        """Send assignments, as READY=1; what cannot be sent is nobody's harm."""
        if not self._address.startswith(("/", "@")):
            return
        address = "\0" + self._address[1:] if self._address[0] == "@" else self._address
        with contextlib.suppress(OSError), socket.socket(socket.AF_UNIX, socket.SOCK_DGRAM) as sender:
            sender.sendto("\n".join(f"{key}={value}" for key, value in words.items()).encode(), address)


class Watchdog:
    """Tells systemd that we are alive, as long as the event loop and everything in `alive` answers.

    `alive` returns how long ago (s) the slowest of the others has answered. `loop` is asked for a turn each time.
    """

    def __init__(
        self, notifier: Notifier, alive: Callable[[], float], loop: asyncio.AbstractEventLoop
    ) -> None:
        self._notifier, self._alive, self._loop = notifier, alive, loop
        self._ending = threading.Event()
        self._turned_s = time.monotonic()
        self._thread: threading.Thread | None = None
        if notifier.watchdog_s is not None:
            self._thread = threading.Thread(target=self._run, name="schwung watchdog", daemon=True)
            self._thread.start()

    def close(self) -> None:
        """End it."""
        self._ending.set()
        if self._thread is not None:
            self._thread.join(1.0)

    def _run(self) -> None:
        assert self._notifier.watchdog_s is not None
        period_s, fresh_s = (share * self._notifier.watchdog_s for share in (_EVERY, _FRESH))
        while True:
            with contextlib.suppress(RuntimeError):  # it is closed: then it does not answer
                self._loop.call_soon_threadsafe(self._turned)
            if self._ending.wait(period_s):
                return
            if time.monotonic() - self._turned_s < fresh_s and self._alive() < fresh_s:
                self._notifier.tell(WATCHDOG=1)

    def _turned(self) -> None:
        self._turned_s = time.monotonic()


#: Where systemd keeps the records of this unit.
STATE = Path("/var/lib/schwung")


def unit(arguments: list[str], data: Path | None) -> str:
    """A unit that starts this very Schwung with these arguments of `schwung serve`, for a folder of records of its own,
    or for `data`, which belongs to whoever asks."""
    folder = STATE / "data" if data is None else data.absolute()
    arguments = ["--data", str(folder), *arguments]
    owner = (
        "StateDirectory=schwung\nStateDirectoryMode=0700\nDynamicUser=yes"
        if data is None
        else f"User={getpass.getuser()}\nReadWritePaths={_quoted(str(folder.parent))}"
    )
    words = " ".join(_quoted(word) for word in (sys.executable, "-m", "schwung", "serve", *arguments))
    return f"""\
# Save as /etc/systemd/system/schwung.service; then: systemctl daemon-reload && systemctl enable --now schwung
# A drive stops by itself, whatever ends this service: it watches our heartbeat.
[Unit]
Description=Schwung, commissioning of servo drives
After=network.target

[Service]
Type=notify
NotifyAccess=main
WatchdogSec=60
ExecStart={words}
Restart=on-failure
RestartSec=2
# Quick stop, power off, parameters put back: that takes a moment.
TimeoutStopSec=45
KillMode=mixed
{owner}
WorkingDirectory={_quoted(str(folder.parent))}
# What libraries compile or remember, where their own places are read-only.
CacheDirectory=schwung
Environment=NUMBA_CACHE_DIR=%C/schwung/numba MPLCONFIGDIR=%C/schwung/matplotlib
# Serial adapters; real-time priority for SYNC from a thread, where the kernel does not send it.
SupplementaryGroups=dialout
LimitRTPRIO=50
NoNewPrivileges=yes
ProtectSystem=strict
ProtectHome=read-only
PrivateTmp=yes
RestrictAddressFamilies=AF_UNIX AF_INET AF_INET6 AF_CAN AF_NETLINK

[Install]
WantedBy=multi-user.target
"""


def _quoted(word: str) -> str:
    """As systemd.service(5) reads it: % and $ doubled, in quotes where that is needed."""
    text = word.replace("\\", "\\\\").replace("%", "%%").replace("$", "$$").replace('"', '\\"')
    return f'"{text}"' if not text or any(c.isspace() for c in text) or "'" in text else text
