"""Runs: ask for one, look, cancel."""

from __future__ import annotations

from typing import Annotated, Any, Literal

from fastapi import APIRouter, Query, Request, Response
from fastapi.responses import FileResponse

from schwung.service.api.models import FileModel, RunModel
from schwung.service.requests import AnyRequest, Id
from schwung.service.service import Service


def router(service: Service, who: Any) -> APIRouter:
    """The routes; `who(request)` tells who asks."""
    routes = APIRouter(prefix="/api", tags=["runs"])

    @routes.post("/runs", status_code=202, summary="Ask for a run")
    def ask(request: Request, response: Response, asked: AnyRequest) -> RunModel:
        """Accepted: it is done in its turn. Its address is in `Location`; what moves or writes needs a confirmed
        proposal."""
        run = service.submit(asked.model_dump(mode="json"), who(request))
        response.headers["Location"] = f"/api/runs/{run.id}"
        return RunModel.of(run)

    @routes.get("/runs", summary="List runs, the newest first")
    def listing(
        state: Literal["queued", "running", "done", "failed", "cancelled", "interrupted"] | None = None,
        kind: Annotated[str | None, Query(max_length=40)] = None,
        drive_id: Id | None = None,
        before: Annotated[
            str | None, Query(max_length=40, description="Only runs made before this time.")
        ] = None,
        limit: Annotated[int, Query(ge=1, le=1000)] = 100,
    ) -> list[RunModel]:
        found = service.runs(state=state, kind=kind, drive_id=drive_id, before=before, limit=limit)
        return [RunModel.of(run) for run in found]

    @routes.get("/runs/{run_id}", summary="One run, with its progress")
    def one(run_id: Id) -> RunModel:
        return RunModel.of(service.run(run_id))

    @routes.post("/runs/{run_id}/cancel", status_code=202, summary="End a run; a drive that moves is stopped")
    def cancel(request: Request, run_id: Id) -> RunModel:
        return RunModel.of(service.cancel(run_id, who(request)))

    @routes.get("/runs/{run_id}/files", summary="The files of a run")
    def files(run_id: Id) -> list[FileModel]:
        return [FileModel.of(file) for file in service.store.files(run_id)]

    @routes.get("/files/{file_id}", summary="A file, as it was kept", response_class=FileResponse)
    def content(file_id: Id) -> FileResponse:
        file = service.store.file(file_id)
        path = service.store.file_path(file_id)
        headers = {"Content-Security-Policy": "sandbox allow-scripts"}
        return FileResponse(path, media_type=file.media_type, filename=file.name, headers=headers,
                            content_disposition_type="inline")  # fmt: skip

    return routes
