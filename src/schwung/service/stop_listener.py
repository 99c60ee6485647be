"""STOP on a listener of its own: one port, one thread, one event loop, and nothing else on it.

A page posts to both, `/api/stop` of the application and `/stop` here; whichever answers first has stopped. The same
guard looks at Host and Origin. It answers to a page of ours with the one header that lets it read the answer (CORS).
"""

from __future__ import annotations

import asyncio
import contextlib
import gc
import json
import socket
import sys
import threading
import time

import uvicorn
from starlette.requests import HTTPConnection
from starlette.types import Receive, Scope, Send

from schwung.errors import BusError, InputError
from schwung.service.guard import Guard
from schwung.service.service import Service

_STARTED_WITHIN_S = 10.0
#: A thread that computes in Python gives way after so long, so that STOP is not behind a queue of them.
_SWITCH_S = 5e-4


def give_way() -> None:
    """Have nothing in this process hold the interpreter for long, once its libraries are loaded.

    A full collection of garbage looks through all objects of all libraries, 200 000 of them, and STOP waits for a tenth
    of a second, longer where the processor is shared. What is loaded is no garbage: it is not looked through again.
    """
    sys.setswitchinterval(_SWITCH_S)
    gc.collect()
    gc.freeze()


def listen(host: str, port: int, what: str) -> socket.socket:
    """A listening socket. Raises InputError where the port is taken or not ours to take."""
    try:
        family = socket.getaddrinfo(host, port, type=socket.SOCK_STREAM)[0][0]
        found = socket.socket(family, socket.SOCK_STREAM)
        found.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
        found.bind((host, port))
        found.listen(128)
    except OSError as error:
        reason = (error.strerror or str(error)).lower()
        raise InputError(
            f"{what} {host}:{port}", f"cannot be listened on: {reason}", "Choose another port."
        ) from error
    return found


class StopListener:
    """Serves STOP until it is closed."""

    def __init__(self, service: Service, guard: Guard, host: str, port: int) -> None:
        self._service, self._guard = service, guard
        self._socket = listen(host, port, "STOP's port")
        self.port: int = self._socket.getsockname()[1]
        guard.ports.add(self.port)
        config = uvicorn.Config(
            self._answer, interface="asgi3", log_config=None, lifespan="off", timeout_keep_alive=30, ws="none"
        )
        self._server = uvicorn.Server(config)
        self._thread = threading.Thread(target=self._run, name="schwung STOP", daemon=True)
        self._thread.start()
        end = time.monotonic() + _STARTED_WITHIN_S
        while not self._server.started:
            if time.monotonic() > end or not self._thread.is_alive():
                raise BusError(f"STOP's port {self.port}", "does not answer")
            time.sleep(0.005)

    def close(self) -> None:
        """End it."""
        self._server.should_exit = True
        self._thread.join(5.0)
        with contextlib.suppress(OSError):
            self._socket.close()

    def _run(self) -> None:
        asyncio.run(self._server.serve(sockets=[self._socket]))

    async def _answer(self, scope: Scope, receive: Receive, send: Send) -> None:
        if scope["type"] != "http":
            return
        asked = HTTPConnection(scope)
        origin = asked.headers.get("origin")
        if not self._guard.knows_host(asked.headers.get("host")) or not self._guard.knows_origin(origin):
            status, body = 403, {"stopped": False, "detail": "asked from elsewhere"}
        elif scope["method"] == "POST" and scope["path"] == "/stop":
            stopped = self._service.stop(self._guard.who(asked))
            status, body = 200, {"stopped": True, "who": stopped.who, "at": stopped.at}
        else:
            status, body = 404, {"stopped": False, "detail": "POST /stop"}
        headers = [(b"content-type", b"application/json")]
        if origin is not None and status != 403:
            headers.append((b"access-control-allow-origin", origin.encode("latin-1")))
            headers.append((b"access-control-allow-credentials", b"true"))  # the cookie says who it is
        await send({"type": "http.response.start", "status": status, "headers": headers})
        await send({"type": "http.response.body", "body": json.dumps(body).encode()})
