"""Who may: token, Host, Origin, and how much may be sent. Pure ASGI, in front of everything, page and web sockets
included.

    Host      is one of ours, else 421: nobody is led here by a name of his own (DNS rebinding)
    Origin    where one is sent with anything but a plain look, it is ours, else 403
    token     `Authorization: Bearer TOKEN`, or the cookie that `/login?token=TOKEN` sets. Whatever is not a GET or
    HEAD needs it, but
              POST /api/stop; where we are reached from elsewhere than this computer everything needs it, but that
              and /api/health
    body      at most MAX_BODY_BYTES, an upload (multipart) MAX_UPLOAD_BYTES, counted as it comes, else 413

The token is made at the first start and lies in `token` beside the store, for its owner only.
"""

from __future__ import annotations

import hmac
import json
import os
import re
import secrets
from http.cookies import CookieError, SimpleCookie
from pathlib import Path
from typing import Any
from urllib.parse import unquote

from starlette.exceptions import HTTPException
from starlette.types import ASGIApp, Message, Receive, Scope, Send

from schwung.errors import InputError
from schwung.service.values import MAX_BODY_BYTES, MAX_UPLOAD_BYTES, Settings

COOKIE = "schwung_token"
#: Who somebody says to be, for the trail: header or cookie, percent-encoded (RFC 3986) beyond ASCII.
WHO_HEADER, WHO_COOKIE = "schwung-who", "schwung_who"
PROBLEM = "application/problem+json"

#: With every answer: nobody else's page shows ours in a frame, and nobody guesses what a file is.
_ALWAYS = (
    (b"x-frame-options", b"SAMEORIGIN"),
    (b"x-content-type-options", b"nosniff"),
    (b"referrer-policy", b"no-referrer"),
)
_SAFE = ("GET", "HEAD", "OPTIONS")
_OPEN = ("/api/stop", "/api/health", "/login")
_TOKEN = re.compile(r"[A-Za-z0-9_-]{32,128}")


def own_token(folder: Path) -> str:
    """The token of a data folder, made where there is none. Raises InputError where the file holds none."""
    path, made = folder / "token", folder / ".token.new"
    if path.exists():
        token = path.read_text(encoding="ascii", errors="replace").strip()
        if not _TOKEN.fullmatch(token):
            raise InputError(str(path), "holds no token", "Remove the file: a new one is made.")
        return token
    token = secrets.token_urlsafe(32)
    made.unlink(missing_ok=True)
    handle = os.open(made, os.O_WRONLY | os.O_CREAT | os.O_EXCL, 0o600)
    with os.fdopen(handle, "w", encoding="ascii") as file:
        file.write(token + "\n")
        file.flush()
        os.fsync(file.fileno())
    os.replace(made, path)  # there whole or not at all, whatever happens meanwhile
    return token


class Guard:
    """What is allowed, for one set of settings. `port` is the one that is listened on, once that is known."""

    def __init__(self, settings: Settings, token: str, port: int | None = None) -> None:
        self.token = token
        self._loopback = settings.is_loopback
        self._names = {"localhost", "127.0.0.1", "::1", settings.host, *settings.names} - {"0.0.0.0", "::"}
        self.ports = {settings.port if port is None else port}

    def knows_host(self, host: str | None) -> bool:
        """Whether a Host header names us."""
        name, port = _split(host or "")
        return name in self._names and (port is None or port in self.ports)

    def knows_origin(self, origin: str | None) -> bool:
        """Whether an Origin is a page of ours. None (not sent: no browser) is."""
        if origin is None:
            return True
        scheme, separator, place = origin.partition("://")
        return bool(separator) and scheme in ("http", "https") and self.knows_host(place)

    def knows_token(self, token: str | None) -> bool:
        """Whether it is the token; takes the same time for any."""
        return hmac.compare_digest((token or "").encode(), self.token.encode())

    def may_act(self, connection: Any) -> bool:
        """Whether a request (starlette's HTTPConnection, as pages get it) comes with the token."""
        return self.knows_token(_token_of(dict(_headers(connection.scope))))

    def who(self, connection: Any) -> str:
        """Who somebody says to be; "somebody" where nothing is said. At most 60 printable characters."""
        return _who(dict(_headers(connection.scope)))

    def refusal(self, scope: Scope) -> tuple[int, str, str] | None:
        """Status, problem and remedy where a connection is refused; None where it may pass."""
        headers = dict(_headers(scope))
        method = scope.get("method", "GET")
        looks = scope["type"] == "http" and method in _SAFE
        if not self.knows_host(headers.get("host")):
            return (
                421,
                "this host name is not ours",
                "Use the address in the start line, or start with --allow-host NAME.",
            )
        if not looks and not self.knows_origin(headers.get("origin")):
            return 403, "a page of another origin asks for this", "Use the page of this service."
        path = scope["path"]
        needs = not looks if scope["type"] == "http" else False
        needs = (needs or not self._loopback) and path not in _OPEN
        if needs and not self.knows_token(_token_of(headers)):
            return (
                401,
                "the token is missing or wrong",
                "Send Authorization: Bearer TOKEN; it is in the start line.",
            )
        return None


class GuardMiddleware:
    """Refuses what the guard refuses, and bodies that are too long."""

    def __init__(self, app: ASGIApp, guard: Guard) -> None:
        self._app, self._guard = app, guard

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        if scope["type"] not in ("http", "websocket"):
            await self._app(scope, receive, send)
            return
        refused = self._guard.refusal(scope)
        if refused is not None:
            await _refuse(scope, receive, send, *refused)
            return
        if scope["type"] == "websocket":
            await self._app(scope, receive, send)
            return
        headers = dict(_headers(scope))
        limit = (
            MAX_UPLOAD_BYTES if headers.get("content-type", "").startswith("multipart/") else MAX_BODY_BYTES
        )
        told = headers.get("content-length", "0")
        if not told.isdigit() or int(told) > limit:
            await _refuse(scope, receive, send, 413, f"the body is longer than {limit} bytes", "Send less.")
            return
        await self._bounded(scope, receive, send, limit)

    async def _bounded(self, scope: Scope, receive: Receive, send: Send, limit: int) -> None:
        came, begun = 0, False

        async def counted() -> Message:
            nonlocal came
            message = await receive()
            came += len(message.get("body", b""))
            if came > limit:
                raise _TooLongError
            return message

        async def watched(message: Message) -> None:
            nonlocal begun
            if message["type"] == "http.response.start":
                begun = True
                message.setdefault("headers", [])
                message["headers"] = [*message["headers"], *_ALWAYS]
            await send(message)

        try:
            await self._app(scope, counted, watched)
        except _TooLongError:
            if not begun:
                await _refuse(
                    scope, receive, send, 413, f"the body is longer than {limit} bytes", "Send less."
                )


class _TooLongError(HTTPException):
    """More came than was announced, or than is allowed; FastAPI lets through what is one of these."""

    def __init__(self) -> None:
        super().__init__(413, "the body is too long")


def problem_body(status: int, title: str, detail: str, **more: Any) -> bytes:
    """A problem as RFC 9457 has it."""
    return json.dumps(
        {"type": "about:blank", "title": title, "status": status, "detail": detail, **more}
    ).encode()


async def _refuse(scope: Scope, receive: Receive, send: Send, status: int, problem: str, remedy: str) -> None:
    if scope["type"] == "websocket":
        await receive()
        await send({"type": "websocket.close", "code": 1008, "reason": problem[:120]})
        return
    body = problem_body(status, problem, f"{problem}. {remedy}", remedy=remedy)
    headers = [(b"content-type", PROBLEM.encode()), (b"content-length", str(len(body)).encode())]
    if status == 401:
        headers.append((b"www-authenticate", b"Bearer"))
    if status == 413:
        headers.append((b"connection", b"close"))
    await send({"type": "http.response.start", "status": status, "headers": headers})
    await send({"type": "http.response.body", "body": body})


def _headers(scope: Scope) -> list[tuple[str, str]]:
    return [(name.decode("latin-1").lower(), value.decode("latin-1")) for name, value in scope["headers"]]


def _cookie(headers: dict[str, str], name: str) -> str | None:
    try:
        found = SimpleCookie(headers.get("cookie", "")).get(name)
    except CookieError:
        return None
    return None if found is None else found.value


def _token_of(headers: dict[str, str]) -> str | None:
    kind, _, token = headers.get("authorization", "").partition(" ")
    return token.strip() if kind.lower() == "bearer" else _cookie(headers, COOKIE)


def _who(headers: dict[str, str]) -> str:
    told = unquote(headers.get(WHO_HEADER) or _cookie(headers, WHO_COOKIE) or "")
    return "".join(c for c in told if c.isprintable())[:60].strip() or "somebody"


def _split(host: str) -> tuple[str, int | None]:
    """Name and port of a Host header; brackets of IPv6 off."""
    found = re.fullmatch(r"(\[[0-9a-fA-F:.]+\]|[A-Za-z0-9.-]+)(?::(\d{1,5}))?", host)
    if found is None:
        return "", None
    return found[1].strip("[]").lower(), int(found[2]) if found[2] else None
