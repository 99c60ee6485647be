"""Every page, with its address, on the service's application."""

from __future__ import annotations

from collections.abc import Callable

from fastapi import FastAPI, Request
from nicegui import app as pages_app
from nicegui import ui

from schwung import __version__
from schwung.service.guard import Guard
from schwung.service.pages import adding, comparing, drives, files, machines, runs, trail
from schwung.service.pages.desk import Desk
from schwung.service.pages.scope import scope_routes
from schwung.service.pages.style import STATIC, STATIC_URL, head_html, stop_html
from schwung.service.pages.wizard import commissioning
from schwung.service.service import Service

_FAVICON = (
    '<svg xmlns="http://www.w3.org/2000/svg" viewBox="0 0 26 26"><rect width="26" height="26" rx="4" fill="#1c2733"/>'
    '<path d="M2 13c2.5-9 6-9 8.5 0s5.5 9 8 0S23 5 24.5 6" stroke="#5db8f5" stroke-width="2.4" fill="none"/></svg>'
)


def mount_pages(app: FastAPI, service: Service, guard: Guard, stop_port: int | None) -> None:
    """Add the pages to an application, after its own routes; once in a process, since NiceGUI has one for all.

    No page asks anything of another host. `stop_port`: of STOP's own listener.
    """
    app.include_router(scope_routes(service))
    pages_app.add_static_files(STATIC_URL, str(STATIC))

    def page(path: str, build: Callable[..., None]) -> None:
        @ui.page(path, response_timeout=30)
        def show(request: Request) -> None:
            ui.add_head_html(head_html(__version__))
            ui.add_body_html(stop_html(stop_port, __version__))
            build(Desk.of(service, guard, request), request)

    page("/", drives.overview)
    page("/drive/{drive_id}", drives.one)
    page("/commission/{drive_id}", commissioning)
    page("/runs", runs.overview)
    page("/run/{run_id}", runs.one)
    page("/compare", comparing.compare)
    page("/machines", machines.overview)
    page("/add", adding.add_drive)
    page("/files", files.overview)
    page("/trail", trail.overview)
    ui.run_with(
        app, title="Schwung", favicon=_FAVICON, dark=None, tailwind=False, show_welcome_message=False,
        reconnect_timeout=30.0, language="en-US",
    )  # fmt: skip
