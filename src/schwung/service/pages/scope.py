"""The live scope's web socket: samples of a drive as columns of smallest and largest values, as they come.

A client that is slow gets fewer, later frames, never a growing queue: every frame is made of what came since the last
one was sent, and what no column of its window would show is left out.
"""

from __future__ import annotations

import asyncio
import contextlib
import json
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any, Protocol

import numpy as np
from fastapi import APIRouter, WebSocket, WebSocketDisconnect

from schwung.api.watching import Array
from schwung.service.live import KEPT_ROWS, PERIOD_S
from schwung.service.pages.decimation import BEGUN, CONTINUED, Columns, Decimator, frame
from schwung.service.service import Service
from schwung.service.values import is_id

#: Twice as often as it is drawn (scope.js), so that no picture waits for what has come.
LOOKS_PER_S = 1 / PERIOD_S
#: What is drawn, in this order: name, unit, colour, and the least range of its axis.
TRACES: list[dict[str, Any]] = [
    {"name": "Position", "unit": "rad", "colour": "trace-1", "least": 1e-3},
    {"name": "Speed", "unit": "rad/s", "colour": "trace-3", "least": 0.05},
    {"name": "Torque", "unit": "N·m", "colour": "trace-2", "least": 0.1},
    {"name": "Following error", "unit": "rad", "colour": "trace-4", "least": 1e-5},
]
_WINDOW_S = (0.1, 120.0)
_COLUMNS = (50, 4000)
#: Samples per column of a window so short that a pixel has none: no column stays empty between two that came.
_NARROWEST = 1.5


def scope_url(drive_id: str) -> str:
    """The web socket of a drive's scope."""
    return f"/page-scope/{drive_id}"


@dataclass(frozen=True, eq=False)
class Fresh:
    """Samples that came: time on the drive's clock (n,), values (4, n) in the order of TRACES; NaN: lost.

    `next`: ask with this for what comes after them.
    """

    next: int
    time_s: Array
    values: Array


class Source(Protocol):
    """Samples of one drive as they come."""

    def __call__(self, after: int, window_s: float) -> Fresh:
        """What came after a number; of a long time only the last `window_s`."""
        ...


class Feed:
    """One client's view: which window, how many columns, and what was sent already."""

    def __init__(self, source: Source) -> None:
        self._source = source
        self._window_s, self._width_s, self._most = 5.0, 5e-3, 1000
        self._after, self._begun = 0, False
        self._decimator = Decimator(len(TRACES), self._width_s, self._most)

    def want(self, window_s: float, columns: int) -> None:
        """Another window (s), drawn with so many columns: everything is sent anew."""
        self._window_s = float(np.clip(window_s, *_WINDOW_S))
        self._most = int(np.clip(columns, *_COLUMNS))
        self._begin(max(self._window_s / self._most, 1e-4))
        self._after = 0

    def _begin(self, width_s: float) -> None:
        self._width_s, self._begun = width_s, False
        self._decimator = Decimator(len(TRACES), width_s, self._most)

    def frames(self) -> list[bytes]:
        """What is to be sent now."""
        came = self._source(self._after, self._window_s)
        self._after = came.next
        if came.time_s.size > 1:
            apart_s = float(np.median(np.diff(came.time_s)))
            if self._width_s < apart_s:
                self._begin(_NARROWEST * apart_s)
        found = self._decimator.feed(came.time_s, came.values)
        sent = [frame(columns, CONTINUED if self._begun or n else BEGUN) for n, columns in enumerate(found)]
        if not self._begun and not sent:
            empty = np.empty((len(TRACES), 0))
            sent = [frame(Columns(0.0, self._width_s, empty, empty), BEGUN)]
        self._begun = True
        return sent


def scope_routes(service: Service) -> APIRouter:
    """The web socket; the guard stands before it, as before everything."""
    routes = APIRouter()

    @routes.websocket("/page-scope/{drive_id}")
    async def scope(socket: WebSocket, drive_id: str) -> None:
        if not is_id(drive_id):
            await socket.close(1008)
            return
        await socket.accept()
        feed = Feed(source_of(service, drive_id))
        asking = asyncio.create_task(_listen(socket, feed.want))
        try:
            while not asking.done():
                for sent in feed.frames():
                    await socket.send_bytes(sent)
                await asyncio.sleep(1 / LOOKS_PER_S)
        except (WebSocketDisconnect, RuntimeError):
            pass  # the client went away
        finally:
            asking.cancel()
            with contextlib.suppress(asyncio.CancelledError, WebSocketDisconnect, RuntimeError):
                await asking

    return routes


async def _listen(socket: WebSocket, want: Callable[[float, int], None]) -> None:
    """What the client asks for, until it goes away; nonsense is passed over."""
    while True:
        try:
            asked = json.loads(await socket.receive_text())
            want(float(asked["window_s"]), int(asked["columns"]))
        except (ValueError, TypeError, KeyError, OverflowError):
            continue


def source_of(service: Service, drive_id: str) -> Source:
    """The samples of a drive; the following error is what is demanded less what is there."""
    scope = service.live.scope(drive_id)

    def fresh(after: int, window_s: float) -> Fresh:
        view = scope.since(
            after, 2 * KEPT_ROWS
        )  # all of them: columns that stand still are made by the Decimator
        c = view.columns
        error = c["position_demand_rad"] - c["position_rad"]
        values = np.vstack([c["position_rad"], c["speed_rad_s"], c["torque_nm"], error])
        time_s = c["time_s"]
        seen = time_s >= time_s[-1] - window_s if time_s.size else np.ones(0, bool)
        return Fresh(view.cursor, time_s[seen], values[:, seen])

    return fresh
