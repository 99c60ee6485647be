"""What can be done with a drive besides commissioning: look, keep and put back, measure at standstill, change."""

from __future__ import annotations

from functools import partial
from html import escape
from typing import Any

from nicegui import ui

from schwung.api.profiles import list_profiles
from schwung.errors import InputError
from schwung.quantities import parse_quantity
from schwung.service.pages.confirming import NOT_LOGGED_IN
from schwung.service.pages.desk import Desk, button, go, html, panel
from schwung.service.pages.fields import QuantityField, choice, line_of_text
from schwung.service.pages.markup import link, moment
from schwung.service.pages.uploading import upload_form
from schwung.service.records import DriveRecord, UnsafeRecord

_FORMS = {"dcf": "DCF (CiA 306)", "concise": "concise DCF", "backup": "backup.json"}
_AGAINST = {"third": "1/3 trapezoid", "poly5": "5th-order polynomial", "scurve": "S-curve", "cosine": "cosine",
            "cycloid": "cycloid"}  # fmt: skip


def show_look(desk: Desk, drive: DriveRecord) -> None:
    """What only looks, or switches off."""
    with panel("At rest", "w4"), _body():
        _look(desk, drive)


def show_more(desk: Desk, drive: DriveRecord) -> None:
    """Configuration, frequency response, best motion: panels beside each other."""
    for title, build in (
        ("Configuration", _configuration),
        ("Frequency response", _frequency_response),
        ("Best motion", _best_motion),
    ):
        with panel(title, "w4"), _body():
            build(desk, drive)


def show_changes(desk: Desk, drive: DriveRecord) -> None:
    """What is known of the drive, to be changed."""
    with panel("This drive", "w4"), _body():
        _changes(desk, drive)


def show_unsettled(desk: Desk, drive: DriveRecord) -> None:
    """An interrupted run has left changed parameters behind: put back, or declined by name."""
    for left in desk.service.store.unsettled(drive.id):
        found = f" It was found in: {escape(left.found)}." if left.found else ""
        with ui.element("div").classes("sw-problem sw-row").props('role="alert"'):
            html(
                f"<b>This drive holds parameters of an interrupted run ({moment(left.created)} UTC).</b>"
                f"It takes nothing but restoring them.{found}"
            )
            request = {"kind": "propose_restore", "drive_id": drive.id, "unsafe_id": left.id}
            button(
                "Show what would be put back",
                partial(_ask, desk, request),
                enabled=desk.may_act,
                why=NOT_LOGGED_IN,
            )
            button(
                "Leave it as it is …",
                partial(_decline, desk, drive, left),
                enabled=desk.may_act,
                why=NOT_LOGGED_IN,
            )
            html(link(f"/run/{left.run_id}", "That run"), "span")


def _decline(desk: Desk, drive: DriveRecord, left: UnsafeRecord) -> None:
    """Somebody answers for it by name."""
    with ui.dialog() as dialog, ui.element("div").classes("sw-panel").style("max-width:560px"):
        with _body():
            html(
                "<b>The drive keeps what the interrupted run has changed</b>, and may be moved with it. Limits and "
                "gains are then not those from before. Your name goes into the audit trail."
            )
            name = line_of_text("Your name", "" if desk.who == "somebody" else desk.who)
            sure = ui.checkbox("I answer for it.").props("dense")

            def leave() -> None:
                who = (name.value or "").strip()[:60]
                if not (who and sure.value):
                    raise InputError("confirmation", "is missing", "Your name and the mark are needed.")
                desk.service.decline(left.id, who)
                go(f"/drive/{drive.id}")

        with ui.element("div").classes("sw-foot"):
            button("Back", dialog.close)
            html("", "span", "spring")
            button("Leave it as it is", leave, "moves")
    dialog.props("no-esc-dismiss")  # Escape is STOP, and nothing else
    dialog.open()


def _look(desk: Desk, drive: DriveRecord) -> None:
    for kind, word, told in (
        (
            "doctor",
            "Check the drive",
            "What is missing before it can be commissioned, and how to mend it. Reads only.",
        ),
        ("secure", "Switch it off", "Looks at it, and takes the power stage off where it is on."),
        ("reset_fault", "Acknowledge a fault", "The power stage stays off."),
    ):
        _action(desk, word, told, {"kind": kind, "drive_id": drive.id})


def _configuration(desk: Desk, drive: DriveRecord) -> None:
    form = choice("Backup as", _FORMS, "dcf")

    def keep() -> None:
        _ask(desk, {"kind": "backup", "drive_id": drive.id, "form": form.value})

    with ui.element("div"):
        button("Back up its parameters", keep, enabled=desk.may_act, why=NOT_LOGGED_IN)
        html("Every object that can be read and written, into a file. Reads only.", "div", "muted")
    upload_form(desk, "Bring a configuration to compare or put back", what="configuration", drive_id=drive.id)


def _frequency_response(desk: Desk, drive: DriveRecord) -> None:
    where = line_of_text("At", "0, 90deg, 180deg", "Angles at which it stands.")
    with ui.element("details").classes("sw"):
        html("More", "summary")
        with ui.element("div").classes("sw-form"):
            amplitude = QuantityField("Amplitude", "torque", "", "Empty: proposed.", optional=True)
            lowest = QuantityField("From", "frequency", "", "Empty: proposed.", optional=True)
            highest = QuantityField("To", "frequency", "", optional=True)
            waveform = choice("Waveform", {"multisine": "multisine", "sine": "stepped sine"}, "multisine")

    def propose() -> None:
        parts = [part for part in (where.value or "").split(",") if part.strip()]
        angles = [parse_quantity(part, "angle", "Frequency response at", signed=True) for part in parts]
        _ask(desk, {
            "kind": "propose_bode", "drive_id": drive.id, "angles_rad": angles, "amplitude_nm": amplitude.value,
            "lowest_hz": lowest.value, "highest_hz": highest.value, "waveform": waveform.value,
        })  # fmt: skip

    with ui.element("div"):
        button("Plan the frequency response", propose, enabled=desk.may_act, why=NOT_LOGGED_IN)
        html("Plans only: it moves when you have confirmed it.", "div", "muted")


def _best_motion(desk: Desk, drive: DriveRecord) -> None:
    """With what was measured on it last, or with its machine as believed."""
    found = [
        one for one in desk.service.store.results("estimate", drive.id, limit=20) if one.verdict != "unusable"
    ]
    known = {f"estimate {one.id}": f"measured {moment(one.created)[:16]}" for one in found}
    if drive.machine_id is not None:
        known[f"machine {drive.machine_id}"] = (
            f"believed: {desk.service.store.machine(drive.machine_id).name}"
        )
    if not known:
        html("Commission it first, or give it a machine.", "div", "muted")
        return
    source = choice("With the inertia", known, next(iter(known)))
    with ui.element("div").classes("sw-form"):
        distance = QuantityField("Stroke", "angle", "180deg", signed=True)
        duration = QuantityField("Time", "time", "250ms", "Empty: as fast as can be.", optional=True)
    against = choice("Beside", _AGAINST, "third")

    def plan() -> None:
        table, _, key = str(source.value).partition(" ")
        _ask(desk, {
            "kind": "propose_play", "drive_id": drive.id, f"{table}_id": key, "distance_rad": distance.value,
            "duration_s": duration.value, "against": against.value,
        })  # fmt: skip

    with ui.element("div"):
        button("Plan to play it from where the axis stands", plan, enabled=desk.may_act, why=NOT_LOGGED_IN)
        html("Plans only: it moves when you have confirmed it.", "div", "muted")


def _changes(desk: Desk, drive: DriveRecord) -> None:
    store = desk.service.store
    machines = {"": "none", **{machine.id: machine.name for machine in store.machines()}}
    families = {"": "by identity", **{profile.family: profile.name for profile in list_profiles()}}
    name = line_of_text("Name", drive.name)
    profile = choice("Profile", families, drive.profile if drive.profile in families else "")
    machine = choice("Machine behind it", machines, drive.machine_id or "")

    def keep() -> None:
        if not (name.value or "").strip():
            raise InputError("Name", "is missing", "Give it one.")
        wanted = {
            "name": name.value.strip(),
            "profile": profile.value or None,
            "machine_id": machine.value or None,
        }
        desk.service.change_drive(drive.id, desk.who, **wanted)
        go(f"/drive/{drive.id}")

    def remove() -> None:
        desk.service.archive_drive(drive.id, desk.who)
        go("/")

    with ui.element("div").classes("sw-row"):
        button("Keep the changes", keep, enabled=desk.may_act, why=NOT_LOGGED_IN)
        button("Take it from the list", remove, enabled=desk.may_act, why=NOT_LOGGED_IN)
    html("Its runs stay, and it can be added again.", "div", "muted")


def _action(desk: Desk, word: str, told: str, request: dict[str, Any]) -> None:
    with ui.element("div"):
        button(word, partial(_ask, desk, request), enabled=desk.may_act, why=NOT_LOGGED_IN)
        html(told, "div", "muted")


def _body() -> ui.element:
    return ui.element("div").classes("sw-body sw-column")


def _ask(desk: Desk, request: dict[str, Any]) -> None:
    go(f"/run/{desk.service.submit(request, desk.who).id}")
