"""One seed of the fault campaign: a commissioning from connecting to putting back, what befalls it, and the verdict."""

from __future__ import annotations

import contextlib
import math
import shutil
import tempfile
from collections import deque
from collections.abc import Iterator
from dataclasses import dataclass, field
from functools import cache
from itertools import count
from pathlib import Path
from typing import Any
from unittest.mock import patch

import can
import h5py
import numpy as np

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
from schwung.drivetrain import Coupling, InertiaTable, Load, Machine, Motor
from schwung.errors import SchwungError
from schwung.fieldbus.canopen import CanopenDrive, driver
from schwung.fieldbus.drive import Acquisition, Progress, Recording, Setpoints
from schwung.fieldbus.profile import DeviceProfile, load_profile
from schwung_sim.bench import Bench
from schwung_sim.campaign.draw import STAGES, Incident, Scenario, draw
from schwung_sim.campaign.incidents import Scene
from schwung_sim.campaign.monitor import BenchMachine, Expected, Monitor
from schwung_sim.campaign.side import Killed, Overdue, Side, SideBus
from schwung_sim.campaign.weather import Weather
from schwung_sim.drives.dictionary import key
from schwung_sim.plants.two_mass import TwoMassPlant
from schwung_sim.traits import Traits

NODE = 3
OVERDUE_S = 90.0  # of simulated time: all patience of a tool whose drive answers nothing, thrice
WAIT_S = 0.01  # an incident that comes with a wait does so within so long
MOVED_RAD = 0.02  # by so much the axis may have been moved before it starts
AFTERMATH_S = 1.0  # in which a drive that nobody looks after has to stop by itself
DISTANCE_RAD, DURATION_S = 0.5, 0.15
ROOM_RAD = 0.15  # between the stroke and the ends of the window
SPEED_RAD_S, TORQUE_NM, FOLLOWING_RAD = 12.05, 60.0, 0.1
# The bench's drive, as its data sheet would have it: counts a turn, rated torque, per cent of it that is injected.
COUNT_RAD = 2 * math.pi / 2**20
RATED_TORQUE_NM = 70.0
SILENCE_S, DECELERATION_RAD_S2 = 0.3, 10_000 * 2 * math.pi / 60


@dataclass(frozen=True)
class Way:
    """One way of commissioning, and how often it is taken."""

    name: str
    weight: float
    wishes: dict[str, Any]
    mode: int = 8
    writable: frozenset[int] = frozenset({0x6040})


_PP = frozenset({0x6040, 0x6081, 0x6083, 0x6084})
_OWN = frozenset({0x2100, 0x2200})
_TRACED = {"sampling": "trace", "trace_rate_hz": 500.0}
WAYS = (
    Way("setpoints, 500 Hz", 5.0, {"sample_rate_hz": 500.0}),
    Way("setpoints, 1 kHz", 2.0, {"sample_rate_hz": 1000.0, "frequency_hz": 100.0}),
    Way("one way", 1.0, {"sample_rate_hz": 500.0, "returns": False}),
    Way("profile position", 1.0, {"sample_rate_hz": 500.0, "mode": "pp"}, 1, _PP),
    Way("by itself", 0.7, {**_TRACED, "sample_rate_hz": 200.0, "mode": "pp", "injecting": "generator"}, 1, _PP | _OWN),
    Way("setpoints, trace", 0.5, {**_TRACED, "sample_rate_hz": 500.0}, 8, _PP | _OWN),
)  # fmt: skip
#: What was in the drive before, where that shall not be its default.
#: Its speed limit is the plan's: a target that comes after a gap is no faster than that.
_BEFORE = {
    key(0x6080): 115,
    key(0x605A): 5,
    key(0x6065): 40_000,
    key(0x6066): 3,
    key(0x1017): 500,
    key(0x60C2, 1): 4,
}
#: Objects that command or follow what the drive does: not parameters.
_LIVE = {0x6040, 0x607A, 0x60B2, 0x60B0, 0x60B1, 0x6071, 0x60FF, 0x1003, 0x1010, 0x1011}
_LIVE_PARTS = {key(0x2100, 4), key(0x2200, 3)}
_channels = count()


#: Frames, seconds and waits of a stage.
Counts = dict[str, float]


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


@cache
def _profile() -> DeviceProfile:
    return load_profile("schwung-bench")


#: The dictionary is read from its file once for all sessions; nobody changes it.
_read_eds = cache(driver.eds.read_eds)


@cache
def _machine() -> Machine:
    return Machine(
        name="campaign",
        motor=Motor(inertia_kgm2=0.012, viscous_friction_nms=0.2, peak_torque_nm=233.0),
        coupling=Coupling(stiffness_nm_rad=24963.0, damping_nms=8.62),
        load=Load(viscous_friction_nms=0.1, inertia_kgm2=0.11),
    )


def scenario_of(seed: int) -> Scenario:
    """What a seed draws."""
    return draw(seed, len(WAYS), tuple(way.weight for way in WAYS))


def expected(way: Way, start_rad: float) -> Expected:
    """The plan, computed from the wishes: peak speed of the trapezoid with equal thirds is 1.5 times the mean."""
    step = 1.5 * DISTANCE_RAD / DURATION_S / way.wishes["sample_rate_hz"]
    return Expected(
        node_id=NODE,
        low_rad=start_rad - ROOM_RAD,
        high_rad=start_rad + DISTANCE_RAD + ROOM_RAD,
        speed_rad_s=SPEED_RAD_S,
        torque_nm=TORQUE_NM,
        silence_s=SILENCE_S,
        deceleration_rad_s2=DECELERATION_RAD_S2,
        standing_rad_s=0.6 if way.writable & _OWN else 0.3,
        step_counts=math.ceil((DISTANCE_RAD + MOVED_RAD if way.mode == 1 else step) / COUNT_RAD),
        added_counts=math.ceil(0.2 * TORQUE_NM / RATED_TORQUE_NM * 1000),
        count_rad=COUNT_RAD,
        mode=way.mode,
        writable=way.writable,
    )


class _Observer:
    def phase(self, text: str) -> None: ...

    def progress(self, done: int, total: int) -> None: ...

    def note(self, text: str) -> None: ...


class _Watched(CanopenDrive):
    """The driver, which tells how far the procedure is."""

    def __init__(self, room: Room) -> None:
        self._room = room
        super().__init__(room.tool_bus, NODE, _profile(), bit_rate=1_000_000)

    def start(self, acquisition: Acquisition) -> None:
        self._room.enter("start")
        super().start(acquisition)

    def enable(self) -> None:
        self._room.enter("enable")
        super().enable()

    def play(self, setpoints: Setpoints, progress: Progress | None = None) -> Recording:
        self._room.enter("motion")
        return super().play(setpoints, progress)

    def disable(self) -> None:
        self._room.enter("off")
        super().disable()

    def stop(self) -> None:
        self._room.enter("put-back")
        super().stop()


class Room:
    """Bench, tool and everybody else on one wire, with the monitor listening."""

    def __init__(self, scenario: Scenario, folder: Path) -> None:
        self.scenario, self.folder = scenario, folder
        self.way = WAYS[scenario.way]
        self.stack = contextlib.ExitStack()
        channel = f"campaign-{next(_channels)}"
        plant = TwoMassPlant(seed=scenario.seed)
        plant.state["motor_rad"] = plant.state["load_rad"] = scenario.start_rad
        self.bench = self.stack.enter_context(Bench(plant, channel=channel, node_id=NODE, seed=scenario.seed))
        self.channel, self.clock = channel, self.bench.bus.clock
        dictionary = self.bench.servo.dictionary
        for k, value in _BEFORE.items():
            dictionary.writer(k)(value)
        dictionary.writer(key(0x1010, 1))(0x65766173)
        self.before = self.parameters()
        self.weather = Weather(NODE, self.clock.now)
        self.machine = BenchMachine(self.bench)
        self.monitor = Monitor(expected(self.way, scenario.start_rad), self.machine, self.clock.now)
        self.clock.every(0.001, self.monitor.look)
        other = self._end()
        self.weather.names[self.bench.bus.stepped] = "drive"
        self.weather.on_frame = self._on_frame
        self.bench.bus.stepped.wire.weather = self.weather
        self.side, self.tool_bus = self.connect()
        self.drive: CanopenDrive | None = None
        self.killed_with: Path | None = None
        traits = Traits(self.bench.servo)
        self.bench.servo.on_advance = traits.poll
        if scenario.trait[0]:
            traits.begin(*scenario.trait, 0)
        self.scene = Scene(
            self.clock, self.weather, self.bench, self.machine, self.side, self.tool_bus, other,
            self._halt, self._killed, traits,
        )  # fmt: skip
        self.stages: dict[str, Counts] = {}
        self._stage, self._counts, self._stage_s = "connect", {"frames": 0.0, "waits": 0.0}, 0.0
        self.side.on_wait = lambda: self._count("waits")
        self._pending = list(scenario.incidents)
        self._typical = typical(scenario.way) if scenario.incidents else {}

    def _end(self) -> Any:
        return self.stack.enter_context(can.Bus(interface="stepped", channel=self.channel))

    def connect(self) -> tuple[Side, SideBus]:
        """One more tool."""
        side = Side(self.clock, self.clock.now() + OVERDUE_S)
        bus = self.stack.enter_context(SideBus(self._end(), side))
        self.weather.names[bus.stepped] = "tool"
        return side, bus

    def __enter__(self) -> Room:
        return self

    def __exit__(self, *_: object) -> None:
        self.stack.close()

    # Points in time --------------------------------------------------------------------------------------

    def enter(self, stage: str) -> None:
        """The tool begins with this."""
        now = self.clock.now()
        if stage == self._stage:
            return
        self.stages[self._stage] = {**self._counts, "time": now - self._stage_s}
        self._stage, self._counts, self._stage_s = stage, {"frames": 0.0, "waits": 0.0}, now
        for incident in [
            i for i in self._pending if i.stage == stage and i.by == "time" and i.after_s is None
        ]:
            self._pending.remove(incident)
            self._later(incident, self._point(incident))

    def _on_frame(self, sender: str, message: can.Message) -> None:
        self.monitor.heard(sender, message)
        self._count("frames")

    def _count(self, what: str) -> None:
        self._counts[what] += 1
        if not self._pending:
            return
        for incident in [i for i in self._pending if self._is_due(i)]:
            self._pending.remove(incident)
            self._later(incident, 0.0 if what == "frames" else WAIT_S * incident.size)

    def _is_due(self, incident: Incident) -> bool:
        if incident.stage != self._stage or incident.by == "time" or incident.after_s is not None:
            return False
        return self._counts[incident.by] > self._point(incident)

    def _point(self, incident: Incident) -> float:
        """At how many frames, seconds or waits of its stage it comes."""
        return incident.share * self._typical.get(incident.stage, {}).get(incident.by, 0.0)

    def _later(self, incident: Incident, delay_s: float) -> None:
        """It befalls so much later; those that follow it come after it."""

        def now() -> None:
            self.scene.befall(incident, f"{self.scenario.seed}")
            following = [i for i in self._pending if i.after_s is not None]
            if following:
                self._pending.remove(following[0])
                self._later(following[0], following[0].after_s or 0.0)

        self.clock.later(delay_s, now)

    def _halt(self) -> None:
        if self.drive is not None:
            self.drive.halt()

    def _killed(self) -> None:
        self.monitor.died()
        self.killed_with = self.folder.with_name(self.folder.name + "-killed")
        shutil.copytree(self.folder, self.killed_with)

    # What is left ----------------------------------------------------------------------------------------

    def parameters(self) -> dict[int, Any]:
        """Everything in the drive that can be set."""
        dictionary = self.bench.servo.dictionary
        return {
            k: dictionary.values[k]
            for k, entry in dictionary.entries.items()
            if entry.writable and k >> 8 not in _LIVE and k not in _LIVE_PARTS
        }

    def changed(self, since: dict[int, Any]) -> list[int]:
        """Objects that are not as they were; what somebody else has changed is left out."""
        now = self.parameters()
        others = {key(0x6060)} if any(" mode " in told for told in self.scene.happened) else set()
        return [k for k, value in since.items() if now[k] != value and k not in others]


def run(scenario: Scenario, show: bool = False) -> Outcome:
    """Play a scenario through and judge it."""
    with _shortened(), tempfile.TemporaryDirectory(dir=_memory(), prefix="campaign-") as name:
        folder = Path(name) / "out"
        folder.mkdir()
        with Room(scenario, folder) as room:
            return _played(room, show)


@contextlib.contextmanager
def _shortened() -> Iterator[None]:
    """Without what takes long and is not the matter here: what an estimator would make of it, reading the EDS anew."""
    with (
        patch.object(preflight_room, "_predicted", lambda *_: None),
        patch.object(driver.eds, "read_eds", _read_eds),
    ):
        yield


def _played(room: Room, show: bool) -> Outcome:
    outcome, monitor = Outcome(room.scenario), room.monitor
    if show:
        monitor.frames = deque()
    error = _commission(room)
    room.enter("over")
    outcome.ended, outcome.told = _ending(error)
    by_itself = not isinstance(error, Killed)
    if by_itself:
        monitor.ended(outcome.told)
        outcome.problems += _unclear(error)
    room.clock.sleep(AFTERMATH_S)
    outcome.problems += [str(violation) for violation in monitor.violations]
    if show:
        outcome.log = [str(frame) for frame in monitor.frames]
    outcome.digest, outcome.frames, outcome.stages = monitor.digest, monitor.count, room.stages
    outcome.simulated_s = room.clock.now()
    room.scene.calm()
    kept = room.killed_with or room.folder
    outcome.problems += _unreadable(kept)
    outcome.problems += _parameters(room, kept, outcome.told if by_itself else None)
    outcome.happened = room.scene.happened
    return outcome


def _commission(room: Room) -> BaseException | None:
    """Everything that `schwung commission` does but estimating; the error that it ended with."""
    way, start, out = room.way, room.scenario.start_rad, room.folder
    limits = LimitWishes(
        start - ROOM_RAD, start + DISTANCE_RAD + ROOM_RAD, SPEED_RAD_S, TORQUE_NM, FOLLOWING_RAD
    )
    wishes = Wishes(distance_rad=DISTANCE_RAD, duration_s=DURATION_S, limits=limits, repeats=1, **way.wishes)
    try:
        drive = room.drive = _Watched(room)
        try:
            room.enter("prepare")
            prepared = prepare(drive, _profile(), _machine(), wishes)
            room.enter("set-up")
            room.monitor.asked()
            record(
                drive,
                prepared.plan,
                prepared.preflight,
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
                export_table(drive, _profile(), table, ExportChoice("table"), backup_path=path)
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


def _parameters(room: Room, kept: Path, told: str | None) -> list[str]:
    """Parameters that are neither back nor can be put back. `told` None: the tool could not say anything any more."""
    servo = room.bench.servo
    if room.machine.weak:
        servo.reset_node()
    if servo.store.was_cut:
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
    _, bus = room.connect()
    room.clock.sleep(0.1)
    try:
        if servo.nmt == 4:  # somebody has stopped the node
            servo.reset_node()
        drive = CanopenDrive(bus, NODE, _profile(), bit_rate=1_000_000)
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


def kind_of(scenario: Scenario) -> str:
    """The drive and the way, in words."""
    drive = f", drive with {scenario.trait[0]}" if scenario.trait[0] else ""
    return WAYS[scenario.way].name + drive + (", exported" if scenario.exports else "")


@cache
def typical(way: int) -> dict[str, Counts]:
    """Frames, seconds and waits of each stage where nothing goes wrong. Raises RuntimeError where something does."""
    outcome = run(Scenario(way, way, 0.0, (), True))
    if outcome.problems or outcome.ended != "well":
        raise RuntimeError(
            f"{WAYS[way].name}, without any incident: {outcome.ended} {outcome.told} {outcome.problems}"
        )
    return {stage: outcome.stages[stage] for stage in STAGES}


def _memory() -> str | None:
    """A file system in memory, where there is one: thousands of sessions are written."""
    return "/dev/shm" if Path("/dev/shm").is_dir() else None
