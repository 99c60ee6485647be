"""The page of a commissioning: its steps put together."""

from __future__ import annotations

from fastapi import Request

from schwung.errors import SchwungError
from schwung.service.pages.desk import Desk, frame, html
from schwung.service.pages.markup import problem
from schwung.service.pages.wizard import after, before, exporting, planning
from schwung.service.pages.wizard.guide import CONNECT, RESULT, RUN, Guide, wishes_of

#: What shows each of the guide's steps.
_BUILDERS = (
    before.connect,
    before.check,
    planning.plan,
    before.confirm,
    after.run,
    after.result,
    exporting.export,
)


def commissioning(desk: Desk, request: Request) -> None:
    """The page: a new commissioning, with ?run= the one that goes on or has ended, with ?next= one whose motion an
    explanation has chosen."""
    try:
        drive = desk.service.store.drive(request.path_params["drive_id"])
        run_id = request.query_params.get("run")
        run = desk.service.run(run_id) if run_id else None
        explained = request.query_params.get("next")
        chosen = desk.service.store.explanation(explained).document.get("next") if explained else None
    except SchwungError as error:
        with frame(desk, "Commission", "/"):
            html(problem(error))
        return
    with frame(desk, f"Commission {drive.name}", "/", f"{drive.bus}, node {drive.node_id}"):
        guide = Guide(desk, drive, _BUILDERS)
        if chosen is not None and chosen["plan"] is not None:
            guide.known.wishes = wishes_of(chosen["plan"])
        if run is not None and run.kind == "commission" and run.drive_id == drive.id:
            guide.known.run = run
            guide.go(RUN if run.state != "done" else RESULT)
        else:
            guide.go(CONNECT)
