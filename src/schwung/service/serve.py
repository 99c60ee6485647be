"""Run the service: lock the folder, start, listen, tell where, and leave the machine safe at the end."""

from __future__ import annotations

import asyncio
import contextlib
import os
import signal
import socket
import threading
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import uvicorn

from schwung.errors import InputError
from schwung.service.app import make_app
from schwung.service.guard import Guard, own_token
from schwung.service.logs import EventLog
from schwung.service.pages import mount_pages
from schwung.service.service import Service
from schwung.service.stop_listener import StopListener, give_way, listen
from schwung.service.systemd import Notifier, Watchdog
from schwung.service.values import Settings


@dataclass(frozen=True)
class Started:
    """Where it is, and the token."""

    url: str
    login_url: str
    stop_url: str
    token: str


def run(settings: Settings, announce: Callable[[Started], None]) -> None:
    """Serve until SIGINT or SIGTERM. Raises InputError where folder or port are somebody else's."""
    with only_one(settings.folder), undisturbed_ending() as ends:
        token = own_token(settings.folder)
        listening = listen(settings.host, settings.port, "port")
        port: int = listening.getsockname()[1]
        guard = Guard(settings, token, port)
        with contextlib.closing(listening), Service(settings) as service:
            stop_port = _stop_port(settings)
            stopper = StopListener(service, guard, settings.host, stop_port)
            service.subscribe(EventLog(lambda drive_id: service.store.drive(drive_id).name))
            try:
                app = make_app(service, guard)
                app.state.stop_port = stopper.port
                mount_pages(app, service, guard, stopper.port)
                give_way()
                config = uvicorn.Config(
                    app, log_config=None, timeout_graceful_shutdown=2, server_header=False
                )
                server = _Told(config, service)
                shown = f"[{settings.host}]" if ":" in settings.host else settings.host
                url = f"http://{shown}:{port}"
                announce(
                    Started(url, f"{url}/login?token={token}", f"http://{shown}:{stopper.port}/stop", token)
                )
                with contextlib.suppress(
                    KeyboardInterrupt
                ):  # how the server hands on the signal that ended it
                    server.run(sockets=[listening])
            finally:
                ends()
                stopper.close()


def _stop_port(settings: Settings) -> int:
    """As wanted, else the one after the port; any where that is any: the next one may be somebody's."""
    if settings.stop_port is not None:
        return settings.stop_port
    return settings.port + 1 if settings.port else 0


class _Told(uvicorn.Server):
    """A server of which systemd hears: when it is ready, that it is alive, and when it ends."""

    def __init__(self, config: uvicorn.Config, service: Service) -> None:
        super().__init__(config)
        self._service, self._notifier = service, Notifier()
        self._watchdog: Watchdog | None = None

    async def startup(self, sockets: list[socket.socket] | None = None) -> None:
        """See uvicorn.Server; ready when it listens."""
        await super().startup(sockets)
        self._watchdog = Watchdog(self._notifier, self._service.silent_s, asyncio.get_running_loop())
        self._notifier.tell(READY=1, STATUS="serving", MAINPID=os.getpid())

    async def shutdown(self, sockets: list[socket.socket] | None = None) -> None:
        """See uvicorn.Server."""
        self._notifier.tell(STOPPING=1)
        if self._watchdog is not None:
            self._watchdog.close()
        await super().shutdown(sockets)


@contextmanager
def undisturbed_ending() -> Iterator[Callable[[], None]]:
    """Within: from the call of what is yielded on, signals do nothing: stopping and putting back is not cut short by a
    second Ctrl-C. It takes seconds, and ends by itself.
    """
    before: dict[int, Any] = {}

    def ends() -> None:
        if threading.current_thread() is threading.main_thread():
            for name in ("SIGINT", "SIGTERM", "SIGHUP"):
                if hasattr(signal, name):
                    number = getattr(signal, name)
                    before[number] = signal.signal(number, signal.SIG_IGN)

    try:
        yield ends
    finally:
        for number, handler in before.items():
            signal.signal(number, signal.SIG_DFL if handler is None else handler)


@contextmanager
def only_one(folder: Path) -> Iterator[None]:
    """Within: the folder is ours; the system ends the lock with the process. Raises InputError where another has it."""
    try:
        folder.mkdir(parents=True, exist_ok=True)
        handle = os.open(folder / "lock", os.O_RDWR | os.O_CREAT, 0o600)
    except OSError as error:
        reason = (error.strerror or str(error)).lower()
        raise InputError(str(folder), f"cannot be used: {reason}", "Choose another --data folder.") from error
    try:
        _lock(handle, folder)
        yield
    finally:
        os.close(handle)


def _lock(handle: int, folder: Path) -> None:
    try:
        import fcntl  # noqa: PLC0415  # not on Windows
    except ImportError:
        return
    try:
        fcntl.flock(handle, fcntl.LOCK_EX | fcntl.LOCK_NB)
    except OSError as error:
        raise InputError(
            str(folder), "is in use by another schwung serve", "Use that one, or another --data."
        ) from error
