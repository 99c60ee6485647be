"""After a death: which runs were cut off, what they have left in drives, and what they recorded.

A run that is queued or running by its row when the service starts was cut off: it becomes `interrupted`. Its drive
has stopped by its own means when our heartbeat ended. A `*.backup.json` of it that does not say `restored` makes
the drive unsafe: it is looked at and switched off (`secure`), and nothing moves or writes there before `restore`,
or before somebody declines. The same is noted of a run that ended badly while we live, where putting back has failed.
"""

from __future__ import annotations

from schwung.api.configurations import read_backup
from schwung.errors import SchwungError
from schwung.service.audit import Trail
from schwung.service.requests import Request, SalvageRequest, SecureRequest
from schwung.service.store import Store
from schwung.service.values import RunView


def recover(store: Store, trail: Trail) -> list[Request]:
    """Bring the rows in order; returns what shall be done now: drives secured, recordings entered."""
    for run in store.unfinished():
        began = run.state == "running"
        error = {
            "type": "Interrupted",
            "text": "the service ended while this run went on",
            "remedy": "A drive stops by itself then. Its page says whether it holds changed parameters.",
            "exit_code": 130,
            "notes": [],
        }
        ended = store.end_run(run.id, "interrupted" if began else "cancelled", None, error)
        if began:
            note_left(store, ended)
            trail.add("schwung serve", "found interrupted", run.drive_id, run.id, kind=run.kind)
    wanted: list[Request] = [
        SalvageRequest(kind="salvage", run_id=run.id)
        for run in store.runs(state="interrupted")
        if has_recording(store, run)
    ]
    drives = dict.fromkeys(unsafe.drive_id for unsafe in store.unsettled())
    return [*(SecureRequest(kind="secure", drive_id=drive_id) for drive_id in drives), *wanted]


def note_left(store: Store, run: RunView) -> None:
    """Enter what a run has changed in its drive and not put back."""
    if run.drive_id is None:
        return
    for path in sorted(store.run_folder(run.id).glob("*.backup.json")):
        try:
            backup = read_backup(path)
        except SchwungError:
            continue
        if backup.restored is None and any(change.old != change.new for change in backup.changes):
            store.add_unsafe(run.drive_id, run.id, path.name)


def has_recording(store: Store, run: RunView) -> bool:
    """Whether a run has left a session that is not entered yet."""
    return (store.run_folder(run.id) / "session.h5").is_file() and not store.of_run("session", run.id)
