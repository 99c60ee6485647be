"""What begins with a file: imports, the archive worked through anew, device profiles, the paper."""

from __future__ import annotations

from fastapi import Request
from nicegui import ui

from schwung.api.profiles import list_profiles
from schwung.service.pages.confirming import NOT_LOGGED_IN
from schwung.service.pages.desk import Desk, button, frame, go, grid, html, panel
from schwung.service.pages.fields import choice
from schwung.service.pages.markup import moment
from schwung.service.pages.uploading import upload_form

#: What a choice asks of every session.
_PAPER = {
    "all": "all of it (minutes)",
    **{f"figure-{number}": f"figure {number}" for number in (4, 5, 6, 9, 10, 12, 13, 14)},
    "table-2": "table 2",
    "gdft": "the sliding DFT's filters",
}


def overview(desk: Desk, _request: Request) -> None:
    """Everything that begins with a file."""
    store = desk.service.store
    machines = {machine.id: machine.name for machine in store.machines()}
    drives = {drive.id: drive.name for drive in store.drives()}
    with (
        frame(
            desk, "Files", "/files", "Recordings and configurations from elsewhere, and the whole archive."
        ),
        grid(),
    ):
        with panel("Bring a file", "w6"), ui.element("div").classes("sw-body sw-column"):
            html(
                "Columns of a recording are guessed and shown with their evidence; you confirm them before anything is "
                "taken in.", "p", "muted",
            )  # fmt: skip
            upload_form(desk, "Send", drives=drives, machines=machines)
        with ui.element("div").classes("w6 sw-column"):
            _archive(desk, machines, drives)
            _profiles(desk)
            _paper(desk)


def _archive(desk: Desk, machines: dict[str, str], drives: dict[str, str]) -> None:
    sessions = desk.service.store.results("session", limit=10_000)
    with panel("Work through the archive", aside=f"{len(sessions)} sessions"), _body():
        html("Every stored session anew, on all cores; one that cannot be read ends nothing.", "p", "muted")
        works = {"estimate": "estimate the inertia", "explain": "explain the difference"}
        work = choice("What", works, "estimate")
        which = choice("Of", {"": "all drives", **drives}, "")
        machine = choice("Against", {"": "the machine that each was recorded with", **machines}, "")

        def begin() -> None:
            chosen = [one.id for one in sessions if which.value in ("", one.drive_id)]
            request = {
                "kind": "batch", "work": work.value,
                "session_ids": chosen if which.value else [],
                "machine_id": machine.value or None,
            }  # fmt: skip
            go(f"/run/{desk.service.submit(request, desk.who).id}")

        with ui.element("div"):
            button("Work through it", begin, enabled=desk.may_act and bool(sessions),
                   why=NOT_LOGGED_IN if sessions else "There is no session yet.")  # fmt: skip


def _profiles(desk: Desk) -> None:
    families = {profile.family: profile.name for profile in list_profiles()}
    kept = {
        file.id: f"{file.name}, brought {moment(run.created)[:16]}"
        for run in desk.service.runs(kind="import", state="done", limit=50)
        if run.request.get("what") in ("eds", "configuration")
        for file in desk.service.store.files(run.id)
        if file.name in ("drive.eds", "drive.dcf")
    }
    with panel("Device profiles"), _body():
        html(
            "What a family of drives offers, in which units. Bring a vendor's EDS to draft one.",
            "p",
            "muted",
        )

        def draft() -> None:
            _ask(desk, {"kind": "draft_profile", "eds_file_id": eds.value})

        def check() -> None:
            _ask(desk, {"kind": "check_profile", "family": family.value})

        def check_with_eds() -> None:
            _ask(desk, {"kind": "check_profile", "family": family.value, "eds_file_id": eds.value})

        upload_form(desk, "Bring an EDS", what="eds")
        if kept:
            eds = choice("EDS", kept, next(iter(kept)))
            with ui.element("div"):
                button("Draft a profile from it", draft, enabled=desk.may_act, why=NOT_LOGGED_IN)
        family = choice("Family", families, next(iter(families)))

        with ui.element("div").classes("sw-row"):
            button("Check it against its own EDS", check, enabled=desk.may_act, why=NOT_LOGGED_IN)
            if kept:
                button("Against the EDS above", check_with_eds, enabled=desk.may_act, why=NOT_LOGGED_IN)


def _paper(desk: Desk) -> None:
    with panel("The paper's figures"), _body():
        html("From its simulated machine, beside what it reports.", "p", "muted")
        what = choice("Which", _PAPER, "figure-9")
        with ui.element("div"):
            button("Reproduce", lambda: _ask(desk, {"kind": "reproduce", "what": [what.value]}),
                   enabled=desk.may_act, why=NOT_LOGGED_IN)  # fmt: skip


def _body() -> ui.element:
    return ui.element("div").classes("sw-body sw-column")


def _ask(desk: Desk, request: dict[str, object]) -> None:
    go(f"/run/{desk.service.submit(request, desk.who).id}")
