"""What runs have led to: sessions, estimates, explanations, exports; archives and the trail; what was left in
drives."""

from __future__ import annotations

from dataclasses import asdict
from typing import Annotated, Any, Literal

from fastapi import APIRouter, Query, Request
from fastapi.responses import FileResponse
from pydantic import BaseModel
from starlette.background import BackgroundTask

from schwung.service.api.models import ResultModel
from schwung.service.archive import temporary_archive
from schwung.service.comparison import compare
from schwung.service.requests import Id
from schwung.service.service import Service


class EntryModel(BaseModel):
    """One entry of the trail."""

    number: int
    at: str
    who: str
    action: str
    drive_id: str | None
    run_id: str | None
    detail: dict[str, Any]
    before: str
    hash: str


class TrailCheck(BaseModel):
    """Whether the chain of hashes holds; `broken_at` is the number of the first entry where it does not."""

    whole: bool
    broken_at: int | None
    entries: int


class ComparedModel(BaseModel):
    """One estimate against the first; `beyond`: share of the angles where both differ by more than their bands
    allow."""

    estimate_id: str
    run_id: str
    created: str
    verdict: str | None
    mean_kgm2: float
    change: float | None
    largest_kgm2: float | None
    at_rad: float | None
    beyond: float | None


def router(service: Service, who: Any) -> APIRouter:
    """The routes; `who(request)` tells who asks."""
    routes = APIRouter(prefix="/api", tags=["results"])
    store = service.store

    @routes.get("/results/{table}", summary="What runs have led to, the newest first")
    def results(
        table: Literal["session", "estimate", "explanation", "export"],
        drive_id: Id | None = None,
        limit: Annotated[int, Query(ge=1, le=1000)] = 100,
    ) -> list[ResultModel]:
        return [ResultModel.of(one) for one in store.results(table, drive_id, limit)]

    @routes.get("/sessions/{session_id}", summary="One session: what was recorded")
    def session(session_id: Id) -> ResultModel:
        return ResultModel.of(store.session(session_id))

    @routes.get("/estimates/{estimate_id}", summary="One estimate: table, band, verdict")
    def estimate(estimate_id: Id) -> ResultModel:
        return ResultModel.of(store.estimate(estimate_id))

    @routes.get("/explanations/{explanation_id}", summary="One explanation")
    def explanation(explanation_id: Id) -> ResultModel:
        return ResultModel.of(store.explanation(explanation_id))

    @routes.get("/compare", summary="Estimates against the first of them")
    def compared(estimate_id: Annotated[list[Id], Query(min_length=2, max_length=50)]) -> list[ComparedModel]:
        found = compare([store.estimate(one) for one in estimate_id])
        return [ComparedModel(**asdict(one)) for one in found]

    @routes.get("/runs/{run_id}/archive", summary="A run as one zip", response_class=FileResponse)
    def archive(run_id: Id) -> FileResponse:
        path = temporary_archive(store, service.trail, run_id)
        gone = BackgroundTask(path.unlink, missing_ok=True)
        return FileResponse(
            path, media_type="application/zip", filename=f"schwung-{run_id}.zip", background=gone
        )

    @routes.delete("/runs/{run_id}", status_code=204, summary="Remove an ended run with all that rests on it")
    def remove(request: Request, run_id: Id) -> None:
        run = store.run(run_id)
        store.remove_run(run_id)
        service.trail.add(
            who(request), "remove run", run.drive_id, run_id, kind=run.kind, created=run.created
        )

    @routes.get("/trail", summary="Who did what, in order")
    def trail(
        after: Annotated[int, Query(ge=0, le=2**53)] = 0, limit: Annotated[int, Query(ge=1, le=10_000)] = 1000
    ) -> list[EntryModel]:
        return [EntryModel(**asdict(entry)) for entry in service.trail.entries(after, limit)]

    @routes.get("/trail/check", summary="Whether the trail is whole")
    def check() -> TrailCheck:
        broken = service.trail.verify()
        return TrailCheck(whole=broken is None, broken_at=broken, entries=len(service.trail.entries()))

    @routes.post(
        "/unsafe/{unsafe_id}/decline", status_code=204, summary="Leave in a drive what a run has changed"
    )
    def decline(request: Request, unsafe_id: Id) -> None:
        service.decline(unsafe_id, who(request))

    return routes
