"""The web application: guard, API, and the page where it is there."""

from __future__ import annotations

from typing import Annotated
from urllib.parse import quote

from fastapi import FastAPI, Query
from fastapi.responses import RedirectResponse, Response

from schwung import __version__
from schwung.service.api import drives, problems, results, runs, sockets, stopping, uploads
from schwung.service.guard import COOKIE, WHO_COOKIE, Guard, GuardMiddleware
from schwung.service.service import Service


def make_app(service: Service, guard: Guard) -> FastAPI:
    """The application. `app.state.service` and `app.state.guard` are for the page (service/page), which is mounted
    on it."""
    app = FastAPI(
        title="Schwung",
        version=__version__,
        description="Commission servo drives: measure the load inertia over angle, and write it into the drive.",
        docs_url=None,
        redoc_url=None,
        openapi_url="/api/openapi.json",
    )
    app.state.service, app.state.guard = service, guard
    problems.install(app)
    for part in (runs, uploads, results, drives, stopping, sockets):
        app.include_router(part.router(service, guard.who))

    @app.get("/login", include_in_schema=False)
    async def login(
        token: Annotated[str, Query(max_length=200)] = "", who: Annotated[str, Query(max_length=60)] = ""
    ) -> Response:
        if not guard.knows_token(token):
            return problems.problem(
                401, "The token is wrong", "The token is in the start line of the service."
            )
        response = RedirectResponse("/", status_code=303)
        response.set_cookie(COOKIE, token, httponly=True, samesite="strict", max_age=90 * 86400)
        if who:
            response.set_cookie(WHO_COOKIE, quote(who), samesite="strict", max_age=90 * 86400)
        return response

    @app.get("/metrics", include_in_schema=False)
    def metrics() -> Response:
        return Response(service.meters.text(), media_type="text/plain; version=0.0.4; charset=utf-8")

    app.add_middleware(GuardMiddleware, guard=guard)
    return app
