"""Bench, tool and everybody else on one wire: where a session of the campaign takes place, and when what befalls it."""

from __future__ import annotations

import contextlib
import shutil
from itertools import count
from pathlib import Path
from typing import Any

import can
from campaign_plan import COARSE_COUNTS, NODE, OVERDUE_S, WAYS, expected, profile

from schwung.fieldbus.canopen import CanopenDrive
from schwung_sim.bench import Bench
from schwung_sim.campaign.draw import Scenario
from schwung_sim.campaign.incidents import Scene
from schwung_sim.campaign.machine import LOOK_S, BenchMachine
from schwung_sim.campaign.monitor import Monitor
from schwung_sim.campaign.points import Counts, Points
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
#: What the procedure calls, and what begins with it.
_STAGES = {"start": "start", "enable": "enable", "play": "motion", "disable": "off", "stop": "put-back"}
_channels = count()


def watched(drive: Any, points: Points) -> Any:
    """A driver that tells how far the procedure is."""

    def telling(name: str, stage: str) -> None:
        verb = getattr(drive, name)

        def told(*given: Any) -> Any:
            points.enter(stage)
            return verb(*given)

        setattr(drive, name, told)

    for name, stage in _STAGES.items():
        telling(name, stage)
    return drive


class Room:
    """Bench, tool and everybody else on one wire, with the monitor listening."""

    def __init__(self, scenario: Scenario, folder: Path, typical: dict[str, Counts]) -> None:
        self.scenario, self.folder = scenario, folder
        self.way, self.profile = WAYS[scenario.way], profile(scenario.stays)
        self.stack = contextlib.ExitStack()
        channel = f"campaign-{next(_channels)}"
        plant = TwoMassPlant(seed=scenario.seed)
        plant.state["motor_rad"] = plant.state["load_rad"] = scenario.start_rad
        self.bench = self.stack.enter_context(Bench(plant, channel=channel, node_id=NODE, seed=scenario.seed))
        self.channel, self.clock = channel, self.bench.bus.clock
        dictionary = self.bench.servo.dictionary
        for k, value in _BEFORE.items():
            dictionary.writer(k)(value)
        if scenario.stays:
            dictionary.writer(key(0x605A))(6)
        if scenario.coarse:
            dictionary.writer(key(0x608F, 1))(COARSE_COUNTS)
        dictionary.writer(key(0x1010, 1))(0x65766173)
        self.before = self.parameters()
        self.weather = Weather(NODE, self.clock.now)
        self.machine = BenchMachine(self.bench)
        self.monitor = Monitor(expected(self.way, scenario.start_rad), self.machine, self.clock.now)
        self.clock.every(LOOK_S, self.monitor.look)
        other = self._end()
        other.stepped.wire.ends.remove(other.stepped)  # it only talks
        self.weather.names[self.bench.bus.stepped] = "drive"
        self.weather.on_frame, self.weather.on_way = self._on_frame, self.monitor.under_way
        self.bench.bus.stepped.wire.weather = self.weather
        self.side, self.tool_bus = self.connect()
        # a tool that stalls hears it when it goes on, whichever of its threads then runs first
        self.tool_bus.on_received = lambda message: self.side.run(lambda: self.monitor.reached(message))
        self.drive: Any = None
        self.killed_with: Path | None = None
        traits = Traits(self.bench.servo)
        self.bench.servo.on_advance = traits.poll
        if scenario.trait[0]:
            traits.begin(*scenario.trait, 0)
        self.scene = Scene(
            self.clock, self.weather, self.bench, self.machine, self.side, self.tool_bus, other,
            self._halt, self._killed, traits,
        )  # fmt: skip
        self.points = Points(
            self.clock, scenario.incidents, typical, lambda i: self.scene.befall(i, f"{scenario.seed}")
        )
        self.side.on_wait = lambda: self.points.count("waits")

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
        self.points.enter(stage)

    def _on_frame(self, sender: str, message: can.Message) -> None:
        self.monitor.heard(sender, message)
        self.points.count("frames")

    # The tool --------------------------------------------------------------------------------------------

    def open(self) -> Any:
        """The tool connects."""
        self.drive = watched(self._driver(self.tool_bus), self.points)
        return self.drive

    def open_again(self) -> Any:
        """Another tool does, when all is over; a drive that is lost to the bus is switched off and on."""
        _, bus = self.connect()
        self.clock.sleep(0.1)
        if self.bench.servo.nmt == 4:  # somebody has stopped the node
            self.bench.servo.reset_node()
        return self._driver(bus)

    def _driver(self, bus: SideBus) -> CanopenDrive:
        return CanopenDrive(bus, NODE, self.profile, bit_rate=1_000_000)

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

    def misjudged(self, told: str) -> list[str]:
        """What the tool said of the drive, and is not so."""
        return []

    def calm(self) -> None:
        """All that befell is over; a drive without torque is switched off and on."""
        self.points.calm()
        self.scene.calm()
        if self.machine.weak:
            self.bench.servo.reset_node()

    @property
    def store_was_cut(self) -> bool:
        """It lost its supply while it stored: nobody can know what it holds."""
        return bool(self.bench.servo.store.was_cut)

    def changed(self, since: dict[int, Any]) -> list[int]:
        """Objects that are not as they were; what somebody else has changed is left out."""
        now = self.parameters()
        others = {key(0x6060)} if any(" mode " in told for told in self.scene.happened) else set()
        return [k for k, value in since.items() if now[k] != value and k not in others]
