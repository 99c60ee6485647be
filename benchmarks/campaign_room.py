"""Bench, tool and everybody else on one wire: where a session of the campaign takes place, and when what befalls it."""

from __future__ import annotations

import contextlib
import shutil
from itertools import count
from pathlib import Path
from typing import Any

import can
from campaign_plan import NODE, OVERDUE_S, WAIT_S, WAYS, expected, profile

from schwung.fieldbus.canopen import CanopenDrive
from schwung.fieldbus.drive import Acquisition, Progress, Recording, Setpoints
from schwung_sim.bench import Bench
from schwung_sim.campaign.draw import Incident, Scenario
from schwung_sim.campaign.incidents import Scene
from schwung_sim.campaign.monitor import BenchMachine, Monitor
from schwung_sim.campaign.side import Side, SideBus
from schwung_sim.campaign.weather import Weather
from schwung_sim.drives.dictionary import key
from schwung_sim.plants.two_mass import TwoMassPlant
from schwung_sim.traits import Traits

#: What was in the drive before, where that shall not be its default.
_BEFORE = {
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


class WatchedDrive(CanopenDrive):
    """The driver, which tells how far the procedure is."""

    def __init__(self, room: Room) -> None:
        self._room = room
        super().__init__(room.tool_bus, NODE, profile(), bit_rate=1_000_000)

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

    def __init__(self, scenario: Scenario, folder: Path, typical: dict[str, Counts]) -> None:
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
        self.tool_bus.on_received = self.monitor.reached
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
        self._typical = typical

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
        if self.killed_with is not None:
            return
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
