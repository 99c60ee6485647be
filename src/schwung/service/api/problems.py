"""Errors as problem+json (RFC 9457), in responses and in the OpenAPI document."""

from __future__ import annotations

import logging
from typing import Any

from fastapi import FastAPI, Request
from fastapi.exceptions import RequestValidationError
from fastapi.openapi.utils import get_openapi
from fastapi.responses import Response
from pydantic import BaseModel, Field
from starlette.exceptions import HTTPException

from schwung.errors import DriveError, InputError, InterruptedByUser, RefusedError, SchwungError
from schwung.service.guard import PROBLEM, problem_body
from schwung.service.store import NotFoundError

_log = logging.getLogger("schwung.service")
_STATUS: tuple[tuple[type[SchwungError], int, str], ...] = (
    (NotFoundError, 404, "Not found"),
    (InputError, 422, "Not as it should be"),
    (RefusedError, 409, "Refused"),
    (DriveError, 502, "The drive or the bus failed"),
    (InterruptedByUser, 409, "Interrupted"),
    (SchwungError, 500, "Failed"),
)
#: What may come instead of an answer, and why.
PROBLEMS = {
    400: "The request is no HTTP that we understand.",
    401: "The token is missing or wrong.",
    403: "A page of another origin asks.",
    404: "There is nothing with this id.",
    409: "Refused: stopped, not there any more, or preflight says no.",
    413: "The body is too long.",
    421: "This host name is not ours.",
    422: "Something in the request is not as it should be; `place` says what.",
}


class Problem(BaseModel):
    """A problem, RFC 9457, with what every error of ours has: place, problem, remedy."""

    type: str = "about:blank"
    title: str
    status: int
    detail: str = Field(description="One sentence: place, problem and remedy.")
    place: str | None = None
    problem: str | None = None
    remedy: str | None = None
    notes: list[str] = []


def problem(status: int, title: str, detail: str, **more: Any) -> Response:
    """A response that tells of a problem."""
    return Response(problem_body(status, title, detail, **more), status, media_type=PROBLEM)


def of_error(error: SchwungError) -> Response:
    """The response to one of our errors."""
    status, title = next((s, t) for kind, s, t in _STATUS if isinstance(error, kind))
    return problem(
        status, title, str(error), place=error.place, problem=error.problem, remedy=error.remedy,
        notes=list(getattr(error, "__notes__", [])),
    )  # fmt: skip


def install(app: FastAPI) -> None:
    """Have every error of an application told as a problem, and its OpenAPI document say so."""

    @app.exception_handler(SchwungError)
    async def _ours(_: Request, error: SchwungError) -> Response:
        return of_error(error)

    @app.exception_handler(RequestValidationError)
    async def _invalid(_: Request, error: RequestValidationError) -> Response:
        first = error.errors()[0]
        place = ".".join(str(part) for part in first["loc"]) or "request"
        said = str(first["msg"])[:300]
        return problem(422, "Not as it should be", f"{place}: {said}", place=place, problem=said)

    @app.exception_handler(HTTPException)
    async def _http(_: Request, error: HTTPException) -> Response:
        response = problem(error.status_code, str(error.detail), str(error.detail))
        response.headers.update(error.headers or {})
        return response

    @app.exception_handler(Exception)
    async def _defect(request: Request, error: Exception) -> Response:
        _log.exception("%s %s", request.method, request.url.path)
        return problem(500, "A defect of Schwung's", f"{type(error).__name__}: please report it.")

    app.openapi = lambda: _openapi(app)  # type: ignore[method-assign]


def _openapi(app: FastAPI) -> dict[str, Any]:
    if app.openapi_schema is None:
        document = get_openapi(
            title=app.title, version=app.version, description=app.description, routes=app.routes
        )
        schemas = document.setdefault("components", {}).setdefault("schemas", {})
        schemas["Problem"] = Problem.model_json_schema()
        for name in ("HTTPValidationError", "ValidationError"):
            schemas.pop(name, None)
        content = {PROBLEM: {"schema": {"$ref": "#/components/schemas/Problem"}}}
        for path in document["paths"].values():
            for operation in path.values():
                for status, why in PROBLEMS.items():
                    operation["responses"][str(status)] = {"description": why, "content": content}
        schemes = {"token": {"type": "http", "scheme": "bearer"}}
        document["components"]["securitySchemes"] = schemes
        document["security"] = [{"token": []}]
        app.openapi_schema = document
    return app.openapi_schema
