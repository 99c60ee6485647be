"""What comes before the machine moves: is the drive there, is anything missing, and who says that it may move."""

from __future__ import annotations

from collections.abc import Mapping
from html import escape

from nicegui import ui

from schwung.service.pages.asking import Asked
from schwung.service.pages.confirming import CLEAR, NOT_LOGGED_IN, Confirmation
from schwung.service.pages.desk import LOOK_S, actions, button, enable, grid, html, panel, state_tag
from schwung.service.pages.fields import choice
from schwung.service.pages.markup import Safe, checks, facts, muted, problem, si, verdict
from schwung.service.pages.wizard.guide import CHECK, CONNECT, PLAN, RUN, Guide
from schwung.service.pages.words import cia402_meaning
from schwung.service.values import RunView
from schwung.service.work import KINDS


def connect(guide: Guide) -> None:
    """Step 1: the drive answers, and it is known what hangs on it."""
    desk, drive = guide.desk, guide.drive
    machines = {machine.id: machine.name for machine in desk.service.store.machines()}
    with grid("sw-stretch"):
        with panel("The drive", "w7"):
            live = html("", "div", "sw-body")
        with panel("The machine behind it", "w5"), ui.element("div").classes("sw-body sw-column"):
            if machines:
                if guide.known.machine_id not in machines:
                    guide.known.machine_id = next(iter(machines))
                choice(
                    "What is believed of it", machines, guide.known.machine_id,
                    lambda machine_id: setattr(guide.known, "machine_id", machine_id),
                    "Motor and coupling from the data sheets, and a guess of the load. It decides what is predicted.",
                )  # fmt: skip
            else:
                html(
                    problem(
                        {"place": "machine", "problem": "none is known yet", "remedy": "Add one at Machines."}
                    )
                )
            html('<a href="/machines">Machines</a>')
    with actions("Looking does not change anything: nothing is switched on, nothing is written."):
        onward = button("Check the drive", lambda: guide.go(CHECK), "primary")

    shown = [""]

    def look() -> None:
        status = desk.service.status(drive.id)
        state = status.state
        rows = [
            ("State", Safe(f"{state_tag(status)} {muted(cia402_meaning(state.cia402) if state else '')}")),
            ("Bus", f"{drive.bus}, node {drive.node_id}"),
            ("Profile", drive.profile or "by identity"),
        ]
        if state is not None:
            rows.append(("Position", f"{si(state.position_rad)} rad"))
            rows += [("Communication", f"NMT {state.nmt.lower()}")] if state.nmt.lower() != "unknown" else []
        text = facts(rows)
        if status.trouble:
            text = Safe(text + problem({"text": status.trouble}))
        if state is not None and state.error:
            text = Safe(text + problem({"text": state.error}))
        if text != shown[0]:
            shown[0] = text
            live.set_content(text)
        enable(onward, state is not None and bool(machines) and desk.may_act,
               "The drive does not answer yet." if desk.may_act else NOT_LOGGED_IN)  # fmt: skip

    look()
    ui.timer(LOOK_S, look)


def check(guide: Guide) -> None:
    """Step 2: what is missing, gravest first, and how to mend it."""
    desk = guide.desk
    if "doctor" not in KINDS:
        guide.go(PLAN)
        return
    with panel("What is missing before it can be commissioned") as head:
        place = ui.element("div").classes("sw-body")
        found = html("")
    with actions():
        button("Back", lambda: guide.go(CONNECT))
        onward = button(
            "Plan the motion", lambda: guide.go(PLAN), "primary", enabled=False, why="The check goes on."
        )

    def ended(run: RunView) -> None:
        guide.known.checked = run
        document = run.result or {}
        stops = [c for c in document.get("checks", ()) if c["severity"] == "stop"]
        found.set_content(checks(document.get("checks", ())))
        fine = run.state == "done" and not stops
        if run.state == "done":
            place.clear()
            with place:
                html(
                    verdict(
                        "unusable",
                        "cannot start",
                        [f"{len(stops)} finding(s) stand in the way; the remedy is beside each."],
                    )
                    if stops
                    else verdict("good", "can start", ["Nothing stands in the way of commissioning."])
                )
        if not fine:
            guide.fail()
        enable(onward, fine, "Mend what stops first, and check again.")

    asked = Asked(desk)
    with place:
        asked.place()

    def again() -> None:
        found.set_content("")
        place.clear()
        with place:
            asked.place()
            asked.ask({"kind": "doctor", "drive_id": guide.drive.id}, ended)

    with head:
        button("Check again", again, "small")
    if guide.known.checked is not None and guide.known.checked.state == "done":
        ended(guide.known.checked)
    else:
        again()


def confirm(guide: Guide) -> None:
    """Step 4: what will move, within which limits, and who says that it may."""
    desk, document = guide.desk, guide.known.plan
    limits, predicted = document["limits"], document["predicted"]["excited"]
    low, high = predicted["travel_rad"]
    with grid("sw-stretch"):
        with panel("What will happen", "w7"), ui.element("div").classes("sw-body sw-column"):
            html(
                f'<div class="sw-moves"><b>The machine will move</b> from {si(low, 3)} to {si(high, 3)} rad and back, '
                f"{document['motions']} times in about {document['duration_s']:.0f} s, with up to "
                f"{si(predicted['peak_speed_rad_s'], 3)} rad/s and {si(predicted['peak_torque_nm'], 3)} N·m.</div>"
            )
            creep = document.get("creep")
            html(
                facts(
                    (
                        ("First", creep or "the motions themselves"),
                        ("Then", f"motions without and with {si(document['excitation']['amplitude_nm'], 3)} N·m at "
                                 f"{si(document['excitation']['frequency_hz'], 4)} Hz"),
                        ("Kept by the drive", _kept(limits)),
                        ("Afterwards", "power stage off, every changed parameter as before"),
                        ("Plan", Safe(f'<span class="mono">{escape(document["digest"][:16])}</span> '
                                      + muted("goes into the audit trail with your name"))),
                    )
                )
            )  # fmt: skip
        with panel("Who confirms it", "w5"), ui.element("div").classes("sw-body sw-column"):
            given = Confirmation(desk, document, CLEAR, guide.drive.id)
            html(
                "STOP here, Escape and S send a quick stop over the bus. They are no safety function and do not "
                "replace the emergency stop.", "div", "muted",
            )  # fmt: skip

    def started(run: RunView) -> None:
        guide.known.run, guide.known.written = run, None
        guide.go(RUN)

    with actions():
        button("Back to the plan", lambda: guide.go(PLAN))
        given.button("Move the machine", started)


def _kept(limits: Mapping[str, float]) -> str:
    window = f"{si(limits['position_min_rad'])} … {si(limits['position_max_rad'])} rad"
    return f"{window}, {si(limits['torque_max_nm'])} N·m, following error {si(limits['following_error_rad'], 3)} rad"
