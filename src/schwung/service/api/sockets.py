"""Web sockets: live samples of a drive, and everything that changes.

/api/drives/ID/live?points=200&rate=30
    {"motion": …, "lost": …, "time_s": [...], "position_rad": [...], …}, null for what has not come; at most `points`
    rows a message, smallest and largest of each piece; at most `rate` messages a second, none while nothing comes
/api/events
    {"run": {…}} | {"drive": {…}} | {"stopped": {…} | null}; first all runs that go on
"""

from __future__ import annotations

import asyncio
import contextlib
from typing import Annotated, Any

import numpy as np
from fastapi import APIRouter, Query, WebSocket, WebSocketDisconnect

from schwung.api.watching import Array
from schwung.service.api.models import DriveModel, RunModel, StoppedModel
from schwung.service.lanes import DriveStatus
from schwung.service.latch import Stopped
from schwung.service.live import Scope
from schwung.service.service import Change, Service
from schwung.service.store import NotFoundError
from schwung.service.values import RunView

_DIGITS = 6
#: A listener that is further behind is let go: it comes again and gets all that goes on anew.
_BEHIND = 1000


def router(service: Service, _who: Any) -> APIRouter:
    """The routes."""
    routes = APIRouter(prefix="/api")

    @routes.websocket("/drives/{drive_id}/live")
    async def live(
        socket: WebSocket,
        drive_id: str,
        points: Annotated[int, Query(ge=2, le=5000)] = 200,
        rate: Annotated[float, Query(gt=0, le=60)] = 30.0,
    ) -> None:
        try:
            service.store.drive(drive_id)
        except NotFoundError:
            await socket.close(1008, "there is no such drive")
            return
        await socket.accept()
        await _until_left(socket, _send_samples(socket, service.live.scope(drive_id), points, rate))

    @routes.websocket("/events")
    async def events(socket: WebSocket) -> None:
        await socket.accept()
        await _until_left(socket, _send_events(socket, service))

    return routes


async def _until_left(socket: WebSocket, sending: Any) -> None:
    """Send until the other side leaves: it is only heard when somebody listens."""
    task = asyncio.ensure_future(sending)
    try:
        while not task.done():
            hearing = asyncio.ensure_future(socket.receive())
            await asyncio.wait({task, hearing}, return_when=asyncio.FIRST_COMPLETED)
            if not hearing.done():
                hearing.cancel()
            elif hearing.result()["type"] == "websocket.disconnect":
                return
        if task.exception() is None:
            await socket.close(1013, "too slow")
    finally:
        task.cancel()
        with contextlib.suppress(asyncio.CancelledError, WebSocketDisconnect, RuntimeError):
            await task


async def _send_samples(socket: WebSocket, scope: Scope, points: int, rate: float) -> None:
    cursor = scope.cursor
    while True:
        await asyncio.sleep(1 / rate)
        view = scope.since(cursor, points)
        if view.cursor != cursor:
            cursor = view.cursor
            columns = {name: _plain(values) for name, values in view.columns.items()}
            await socket.send_json({"motion": view.motion, "lost": view.lost, **columns})


def _plain(values: Array) -> list[float | None]:
    finite = np.isfinite(values)
    return [round(v, _DIGITS) if ok else None for v, ok in zip(values.tolist(), finite.tolist(), strict=True)]


async def _send_events(socket: WebSocket, service: Service) -> None:
    loop, changes = asyncio.get_running_loop(), asyncio.Queue[Change](_BEHIND)

    def put(change: Change) -> None:
        with contextlib.suppress(asyncio.QueueFull):
            changes.put_nowait(change)

    def tell(
        change: Change,
    ) -> None:  # from whichever thread; one that comes when the loop has ended is for nobody
        with contextlib.suppress(RuntimeError):
            loop.call_soon_threadsafe(put, change)

    unsubscribe = service.subscribe(tell)
    try:
        for run in await asyncio.to_thread(service.active):
            await socket.send_json({"run": _run(run)})
        while changes.qsize() < _BEHIND:
            await socket.send_json(await asyncio.to_thread(_event, service, await changes.get()))
    finally:
        unsubscribe()


def _run(run: RunView) -> dict[str, Any]:
    return RunModel.of(run).model_dump(mode="json")


def _event(service: Service, change: Change) -> dict[str, Any]:
    if isinstance(change, RunView):
        return {"run": _run(change)}
    if isinstance(change, DriveStatus):
        drive = service.store.drive(change.drive_id)
        return {
            "drive": DriveModel.of(drive, change, service.store.unsettled(drive.id)).model_dump(mode="json")
        }
    if isinstance(change, Stopped):
        return {"stopped": StoppedModel(stopped=True, who=change.who, at=change.at).model_dump()}
    return {"stopped": None}
