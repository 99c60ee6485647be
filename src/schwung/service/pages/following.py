"""What may follow on a run: explain its session, estimate it again, find the best motion, put a file back."""

from __future__ import annotations

from functools import partial
from typing import Any

from nicegui import ui

from schwung.service.machines import TABLES
from schwung.service.pages.desk import Desk, button, go, html, panel
from schwung.service.pages.fields import QuantityField, choice
from schwung.service.records import MachineRecord
from schwung.service.values import ENDED, RunView
from schwung.service.work import KINDS

_CONFIGURATIONS = (
    "drive.dcf",
    "drive.eds",
    "drive.bin",
    "drive.backup.json",
    "export.backup.json",
    "restore.backup.json",
)
_MEASURED = "measured"
_FINDS = ("commission", "estimate")


def show_next(desk: Desk, run: RunView) -> None:
    """Everything that can be asked for with what this run has led to; nothing where it has led to nothing."""
    result = run.result or {}
    kept = [file for file in desk.service.store.files(run.id) if file.name in _CONFIGURATIONS]
    explains = (
        bool(result.get("session_id")) and run.kind in (*_FINDS, "import", "import_as") and "explain" in KINDS
    )
    optimises = bool(result.get("estimate_id")) and run.kind in _FINDS and "optimise" in KINDS
    if run.state not in ENDED or not (explains or optimises or (kept and run.drive_id)):
        return
    with panel("What may follow"), ui.element("div").classes("sw-next"):
        if explains:
            _explaining(desk, run)
        if optimises:
            _optimising(desk, run)
        if run.drive_id is not None and kept and "propose_restore" in KINDS:
            with ui.element("section").classes("sw-column"):
                html("Put back", "h3")
                html(
                    "Compares a file with the drive and shows what would change. Writes nothing.",
                    "p",
                    "muted",
                )
                for file in kept:
                    request = {"kind": "propose_restore", "drive_id": run.drive_id, "file_id": file.id}
                    if file.name != "drive.eds":
                        _button(desk, f"Put back {file.name} …", partial(_ask, desk, request))
                    _button(
                        desk,
                        f"Show what differs from {file.name}",
                        partial(_ask, desk, request | {"kind": "diff"}),
                    )


def _button(desk: Desk, word: str, handler: Any) -> None:
    with ui.element("div"):
        button(word, handler, enabled=desk.may_act, why="Log in with the token first.")


def _explaining(desk: Desk, run: RunView) -> None:
    """Against which belief: the machine with the table that was measured here, or another."""
    result = run.result or {}
    machines = {machine.id: machine.name for machine in desk.service.store.machines()}
    measured = {_MEASURED: "the machine as measured here"} if result.get("estimate_id") else {}

    def explain() -> None:
        machine_id = _keep_measured(desk, run).id if belief.value == _MEASURED else belief.value
        asked = {"kind": "explain", "session_id": result["session_id"], "machine_id": machine_id}
        _ask(desk, asked | {"next_motion": bool(further.value)})

    with ui.element("section").classes("sw-column"):
        html("Explain", "h3")
        html("What a belief leaves out of this recording: where, which physics, how sure.", "p", "muted")
        beliefs = measured | machines
        belief = choice("Against", beliefs, next(iter(beliefs), None))
        further = ui.checkbox("Say what to measure next").props("dense")
        _button(desk, "Explain the difference", explain)

        def again() -> None:
            machine_id = belief.value if belief.value in machines else None
            _ask(desk, {"kind": "estimate", "session_id": result["session_id"], "machine_id": machine_id})

        _button(desk, "Estimate once more", again)
        form = choice("For other tools", {"mf4": "MDF 4", "parquet": "Parquet"}, "mf4")
        _button(
            desk,
            "Write the session so",
            lambda: _ask(desk, {"kind": "convert", "session_id": result["session_id"], "form": form.value}),
        )


def _keep_measured(desk: Desk, run: RunView) -> MachineRecord:
    """The machine with the table that this run has measured, as a machine of its own; made once."""
    store = desk.service.store
    name = f"{_name_of(desk, run)}, measured {run.created[:16].replace('T', ' ')}"
    for machine in store.machines():
        if machine.name == name:
            return machine
    folder = store.run_folder(run.id)
    toml = (folder / "measured.toml").read_text(encoding="utf-8")
    table = next(path for path in (folder / "measured_inertia.csv", folder / "inertia.csv") if path.exists())
    tables = {next(iter(TABLES)): table.read_text(encoding="utf-8")}
    made: MachineRecord = desk.service.add_machine(name, toml, tables, desk.who)
    return made


def _name_of(desk: Desk, run: RunView) -> str:
    return desk.service.store.machine(run.machine_id).name if run.machine_id else "Machine"


def _optimising(desk: Desk, run: RunView) -> None:
    def asked() -> dict[str, Any]:
        return {
            "estimate_id": (run.result or {})["estimate_id"],
            "distance_rad": distance.value,
            "duration_s": duration.value,
        }

    def find() -> None:
        _ask(desk, {"kind": "optimise", "start_rad": start.value or 0.0, **asked()})

    def plan() -> None:
        _ask(desk, {"kind": "propose_play", "drive_id": run.drive_id, **asked()})

    with ui.element("section").classes("sw-column"):
        html("Find the best motion", "h3")
        html("With the measured table, within every limit. Moves nothing.", "p", "muted")
        with ui.element("div").classes("sw-form"):
            start = QuantityField("From", "angle", "0", signed=True)
            distance = QuantityField("Stroke", "angle", "180deg", signed=True)
            duration = QuantityField("Time", "time", "250ms", "Empty: as fast as can be.", optional=True)
        _button(desk, "Optimise", find)
        if "propose_play" in KINDS and run.drive_id is not None:
            _button(desk, "Plan to play it beside a usual one, from where the axis stands", plan)


def _ask(desk: Desk, request: dict[str, Any]) -> None:
    go(f"/run/{desk.service.submit(request, desk.who).id}")
