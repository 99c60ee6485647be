"""STOP and release. STOP is also served on a listener of its own: see stop_listener.py."""

from __future__ import annotations

from typing import Any

from fastapi import APIRouter, Request

from schwung import __version__
from schwung.service.api.models import StoppedModel
from schwung.service.service import Service


def router(service: Service, who: Any) -> APIRouter:
    """The routes; `who(request)` tells who asks."""
    routes = APIRouter(prefix="/api", tags=["stop"])

    @routes.post(
        "/stop", summary="STOP: quick stop of all drives, now; nothing is begun until it is released"
    )
    async def stop(request: Request) -> StoppedModel:
        stopped = service.stop(who(request))
        return StoppedModel(stopped=True, who=stopped.who, at=stopped.at)

    @routes.get("/stop", summary="Whether the service is stopped")
    async def stopped() -> StoppedModel:
        held = service.latch.stopped
        return (
            StoppedModel(stopped=False)
            if held is None
            else StoppedModel(stopped=True, who=held.who, at=held.at)
        )

    @routes.post("/release", summary="Release a STOP")
    def release(request: Request) -> StoppedModel:
        service.release(who(request))
        return StoppedModel(stopped=False)

    @routes.get("/health", summary="Whether the service answers")
    async def health() -> dict[str, str]:
        return {"status": "ok", "version": __version__}

    return routes
