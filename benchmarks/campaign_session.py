"""One seed of the fault campaign: a commissioning from connecting to putting back, what befalls it, and the verdict."""

from __future__ import annotations

import contextlib
import tempfile
from collections.abc import Iterator
from dataclasses import dataclass, field, replace
from functools import cache
from pathlib import Path
from unittest.mock import patch

import h5py
import numpy as np
from campaign_line import WAYS as LINE_WAYS
from campaign_line import LineRoom
from campaign_plan import (
    AFTERMATH_S,
    COARSE_COUNTS,
    DISTANCE_RAD,
    DURATION_S,
    FOLLOWING_RAD,
    OVERDUE_S,
    ROOM_RAD,
    SPEED_RAD_S,
    TORQUE_NM,
    WAYS,
    machine,
    read_eds,
)  # fmt: skip
from campaign_room import Room

from schwung.commissioning import (
    ExportChoice,
    LimitWishes,
    Wishes,
    export_table,
    prepare,
    read_backup,
    restore_backup,
)
from schwung.commissioning import preflight as preflight_room
from schwung.commissioning.commission import settings_of
from schwung.commissioning.journal import ParameterJournal
from schwung.commissioning.procedure import record
from schwung.drivetrain import InertiaTable
from schwung.errors import SchwungError
from schwung.fieldbus.canopen import driver
from schwung_sim.campaign.draw import STAGES, Scenario, draw
from schwung_sim.campaign.points import Counts
from schwung_sim.campaign.side import Killed, Overdue


@dataclass
class Outcome:
    """What became of a seed."""

    scenario: Scenario
    problems: list[str] = field(default_factory=list)  # empty: all is well
    happened: list[str] = field(default_factory=list)
    ended: str = "well"  # how the tool ended: "well", "killed", or its error's type
    told: str = ""
    digest: int = 0
    frames: int = 0
    simulated_s: float = 0.0
    stages: dict[str, Counts] = field(default_factory=dict)
    log: list[str] = field(default_factory=list)


class _Observer:
    def phase(self, text: str) -> None: ...

    def progress(self, done: int, total: int) -> None: ...

    def note(self, text: str) -> None: ...


def scenario_of(seed: int, bus: str = "canopen") -> Scenario:
    """What a seed draws."""
    ways = WAYS if bus == "canopen" else LINE_WAYS
    return draw(seed, tuple(way.weight for way in ways), bus)


def kind_of(scenario: Scenario) -> str:
    """The drive and the way, in words."""
    way = (WAYS if scenario.bus == "canopen" else LINE_WAYS)[scenario.way]
    trait, value = scenario.trait
    drive = f", drive with {trait} {value:g}" if trait else ""
    stays = ", stays in quick stop" if scenario.stays and scenario.bus == "canopen" else ""
    coarse = f", {COARSE_COUNTS} counts a turn" if scenario.coarse else ""
    return way.name + drive + stays + coarse + (", exported" if scenario.exports else "")


def run(scenario: Scenario, show: bool = False) -> Outcome:
    """Play a scenario through and judge it."""
    with _shortened(), tempfile.TemporaryDirectory(dir=_memory(), prefix="campaign-") as name:
        folder = Path(name) / "out"
        folder.mkdir()
        usual = typical(scenario.bus, scenario.way, scenario.creeps) if scenario.incidents else {}
        kind = Room if scenario.bus == "canopen" else LineRoom
        with kind(scenario, folder, usual) as room:
            return _played(room, show)


@contextlib.contextmanager
def _shortened() -> Iterator[None]:
    """Without what takes long and is not the matter here: what an estimator would make of it, reading the EDS anew."""
    with (
        patch.object(preflight_room, "_predicted", lambda *_: None),
        patch.object(driver.eds, "read_eds", read_eds),
    ):
        yield


def _played(room: Room | LineRoom, show: bool) -> Outcome:
    outcome, monitor = Outcome(room.scenario), room.monitor
    if show:
        monitor.frames = []
    error = _commission(room)
    room.enter("over")
    outcome.ended, outcome.told = _ending(error)
    by_itself = not isinstance(error, Killed)
    if by_itself:
        monitor.ended(outcome.told)
        outcome.problems += _unclear(error) + room.misjudged(outcome.told)
    room.clock.sleep(monitor.expected.at_rest_s + AFTERMATH_S)
    outcome.problems += [str(violation) for violation in monitor.violations]
    outcome.log = [str(frame) for frame in monitor.frames or ()]
    outcome.digest, outcome.frames, outcome.stages = monitor.digest, monitor.count, room.points.stages
    outcome.simulated_s = room.clock.now()
    room.calm()
    kept = room.killed_with or room.folder
    outcome.problems += _unreadable(kept)
    outcome.problems += _parameters(room, kept, outcome.told if by_itself else None)
    outcome.happened = room.scene.happened
    return outcome


def _commission(room: Room | LineRoom) -> BaseException | None:
    """Everything that `schwung commission` does but estimating; the error that it ended with."""
    way, start, out = room.way, room.scenario.start_rad, room.folder
    limits = LimitWishes(
        start - ROOM_RAD, start + DISTANCE_RAD + ROOM_RAD, SPEED_RAD_S, TORQUE_NM, FOLLOWING_RAD
    )
    wishes = Wishes(distance_rad=DISTANCE_RAD, duration_s=DURATION_S, limits=limits, repeats=1, **way.wishes)
    try:
        drive = room.open()
        try:
            room.enter("prepare")
            prepared = prepare(drive, room.profile, machine(), wishes)
            room.enter("set-up")
            room.monitor.asked()
            ready = prepared.preflight
            record(
                drive,
                prepared.plan,
                ready if room.scenario.creeps else replace(ready, creep=None),
                session_path=out / "session.h5",
                journal=ParameterJournal(drive, out / "setup.backup.json", drive.describe()),
                observer=_Observer(),
                settings=settings_of(prepared.plan),
            )
            if room.scenario.exports:
                room.enter("export")
                angles = np.linspace(start, start + DISTANCE_RAD, 20)
                table = InertiaTable(angles, np.full(20, 0.11) + 0.01 * np.cos(angles))
                path = out / "export.backup.json"
                export_table(drive, room.profile, table, ExportChoice("table"), backup_path=path)
        finally:
            drive.close()
    except BaseException as error:
        return error
    return None


# The verdict ---------------------------------------------------------------------------------------------


def _ending(error: BaseException | None) -> tuple[str, str]:
    if error is None:
        return "well", ""
    notes = "; ".join(getattr(error, "__notes__", []))
    return type(error).__name__, f"{error}{f' ({notes})' if notes else ''}"


def _unclear(error: BaseException | None) -> list[str]:
    """Errors that a user cannot be shown; before and after the procedure the command line sees to Ctrl-C."""
    if isinstance(error, Overdue):
        return [f"no end: still busy after {OVERDUE_S:g} s"]
    if isinstance(error, SchwungError):
        sentence = str(error)
        clear = error.place and error.problem and "\n" not in sentence and len(sentence) < 400
        return [] if clear else [f"no clear sentence: {sentence!r}"]
    if error is None or isinstance(error, KeyboardInterrupt):
        return []
    return [f"not an error of ours: {type(error).__name__}: {error}"]


def _unreadable(folder: Path) -> list[str]:
    """Recordings that cannot be read."""
    problems = []
    for path in folder.glob("*.h5"):
        try:
            with h5py.File(path, "r") as file:
                for part in ("run", "partial"):
                    for group in file.get(part, {}).values():
                        if not all(
                            np.isfinite(group[name][()]).all() for name in ("time", "position", "torque")
                        ):
                            problems.append(f"recording: {path.name} holds what is no number")
        except (OSError, KeyError, ValueError, TypeError) as error:
            problems.append(f"recording: {path.name} cannot be read ({error})")
    return problems


def _parameters(room: Room | LineRoom, kept: Path, told: str | None) -> list[str]:
    """Parameters that are neither back nor can be put back. `told` None: the tool could not say anything any more."""
    if room.store_was_cut:
        return ["store: the supply failed while it stored, and nobody was told"] if told == "" else []
    exported = (kept / "export.backup.json").exists()
    changed = room.changed(room.before)
    if told is not None and changed and not exported and "schwung restore" not in told:
        names = ", ".join(f"0x{k >> 8:04X}:{k & 0xFF:02X}" for k in changed[:4])
        return [f"parameters: {names} are not as before, and nobody was told ({told or 'no error'})"]
    backups = [kept / name for name in ("export.backup.json", "setup.backup.json")]
    open_ones = [path for path in backups if path.exists() and read_backup(path).restored is None]
    if not changed:
        return []
    try:
        drive = room.open_again()
        try:
            for path in open_ones:
                restore_backup(drive, path)
        finally:
            drive.close()
    except (SchwungError, Killed, Overdue) as error:
        return [f"restore: {error}"]
    left = room.changed(room.before)
    names = ", ".join(f"0x{k >> 8:04X}:{k & 0xFF:02X}" for k in left[:4])
    if left:
        which = ", ".join(path.name for path in open_ones) or "no backup"
        return [f"parameters: {names} are not as before, and {which} does not bring them back"]
    return []


@cache
def typical(bus: str, way: int, creeps: bool) -> dict[str, Counts]:
    """Frames, seconds and waits of each stage where nothing goes wrong. Raises RuntimeError where something does."""
    outcome = run(Scenario(way, way, 0.0, (), True, creeps, bus=bus))
    if outcome.problems or outcome.ended != "well":
        kind = kind_of(outcome.scenario)
        raise RuntimeError(f"{kind}, without any incident: {outcome.ended} {outcome.told} {outcome.problems}")
    return {stage: outcome.stages[stage] for stage in STAGES}


def _memory() -> str | None:
    """A file system in memory, where there is one: thousands of sessions are written."""
    return "/dev/shm" if Path("/dev/shm").is_dir() else None
