"""A session of the campaign on Modbus: line, drive and tool, and when what befalls it."""

from __future__ import annotations

import math
import shutil
from functools import cache
from pathlib import Path
from typing import Any

from campaign_plan import (
    COARSE_COUNTS,
    COUNT_RAD,
    DISTANCE_RAD,
    OVERDUE_S,
    ROOM_RAD,
    SPEED_RAD_S,
    TORQUE_NM,
    Way,
)  # fmt: skip
from campaign_room import watched

from schwung.clock import SteppedClock
from schwung.fieldbus.modbus import ModbusDrive, ModbusLink, modbus_options
from schwung.fieldbus.profile import DeviceProfile, ModbusProfile, load_profile
from schwung_sim.campaign.draw import Scenario
from schwung_sim.campaign.line import LineMachine, LineMonitor, LineScene
from schwung_sim.campaign.machine import LOOK_S
from schwung_sim.campaign.monitor import Expected
from schwung_sim.campaign.points import Counts, Points
from schwung_sim.campaign.side import Side
from schwung_sim.modbus_bench import ModbusBench
from schwung_sim.plants.two_mass import TwoMassPlant

FAMILY, UNIT = "schwung-bench-modbus", 1
SILENCE_S = 1.5
BRAKES_RAD_S2 = 1000.0
#: Registers that a motion needs: how it is made, generator and trace.
_WRITABLE = frozenset({100, 210, 212, 214, 216, 400, 402, 404, 406, 500, 502, 504, 508})
#: Registers that command, or follow what the drive does.
_LIVE = {100, 102, 106, 108, 112, 200, 202, 204, 504, 506}
_TRACED = {"trace_rate_hz": 500.0}
WAYS = (
    Way("Modbus TCP", 3.0, _TRACED, 1, _WRITABLE),
    Way("Modbus RTU", 1.0, _TRACED, 1, _WRITABLE),
    Way("Modbus TCP, 1000 counts a turn", 2.0, _TRACED, 1, _WRITABLE),
)  # fmt: skip


def profile(way: int, folder: Path) -> tuple[DeviceProfile, Path]:
    """The bench's, and its file; its counts as the way has them."""
    file = Path(load_profile(FAMILY).folder) / "profile.toml"
    if "counts" in WAYS[way].name:
        text = file.read_text(encoding="utf-8").replace(repr(COUNT_RAD), repr(2 * math.pi / COARSE_COUNTS))
        file = folder.with_name("profile.toml")
        file.write_text(text, encoding="utf-8")
    return (load_profile(str(file)) if "counts" in WAYS[way].name else _usual()), file


@cache
def _usual() -> DeviceProfile:
    return load_profile(FAMILY)


class SideLine:
    """The tool's end of a line: who sends may be held up, or be gone. The rest is the line's."""

    def __init__(self, line: Any, side: Side, monitor: LineMonitor, points: Points) -> None:
        self._line, self._side, self._monitor, self._points = line, side, monitor, points

    def send(self, data: bytes) -> None:
        self._side.here()
        self._monitor.requested(data)
        self._points.count("frames")
        self._line.send(data)

    def __getattr__(self, name: str) -> Any:
        return getattr(self._line, name)


class LineRoom:
    """As campaign_room.Room, on Modbus."""

    store_was_cut = False

    def __init__(self, scenario: Scenario, folder: Path, typical: dict[str, Counts]) -> None:
        self.scenario, self.folder = scenario, folder
        self.way = WAYS[scenario.way]
        self.clock = SteppedClock()
        plant = TwoMassPlant(seed=scenario.seed)
        plant.state["motor_rad"] = plant.state["load_rad"] = scenario.start_rad
        self.profile, file = profile(scenario.way, folder)
        tcp = None if "RTU" in self.way.name else ("bench", 502)
        self.bench = ModbusBench(plant, profile=file, tcp=tcp, seed=scenario.seed, clock=self.clock)
        kind, value = scenario.trait
        brakes = value if kind == "brakes" else BRAKES_RAD_S2
        self.bench.servo.power.stop_rate_rad_s2 = brakes
        self.before = self.parameters()
        self.machine = LineMachine(self.bench, self.clock.now)
        self.monitor = LineMonitor(
            expected(self.way, scenario.start_rad, brakes), self.machine, self.clock.now
        )
        self.monitor.serial = tcp is None
        self.clock.every(LOOK_S, self.monitor.look)
        self.side = Side(self.clock, self.clock.now() + OVERDUE_S)
        self.drive: Any = None
        self.killed_with: Path | None = None
        self.scene = LineScene(self.clock, self.bench, self.machine, self.side, self._halt, self._killed)
        self.points = Points(
            self.clock, scenario.incidents, typical, lambda i: self.scene.befall(i, f"{scenario.seed}")
        )
        self.side.on_wait = lambda: self.points.count("waits")

    def __enter__(self) -> LineRoom:
        self.bench.start()
        return self

    def __exit__(self, *_: object) -> None:
        self.bench.stop()

    def enter(self, stage: str) -> None:
        """The tool begins with this."""
        self.points.enter(stage)

    # The tool --------------------------------------------------------------------------------------------

    def open(self) -> Any:
        """The tool connects."""
        self.drive = watched(self._driver(self.side), self.points)
        return self.drive

    def open_again(self) -> Any:
        """Another tool does, when all is over."""
        return self._driver(Side(self.clock, self.clock.now() + OVERDUE_S))

    def _driver(self, side: Side) -> ModbusDrive:
        assert isinstance(self.profile, ModbusProfile)
        told = dict(self.bench.tool_options)
        options = modbus_options(told.pop("interface"), told.pop("channel"), told.pop("bitrate", None), told)
        line: Any = SideLine(self.bench.line, side, self.monitor, self.points)
        link = ModbusLink(options, UNIT, self.profile.modbus, clock=side, line=line)
        return ModbusDrive(link, self.profile)

    def _halt(self) -> None:
        if self.drive is not None:
            self.monitor.halted()
            self.drive.halt()

    def _killed(self) -> None:
        self.monitor.died()
        if self.killed_with is None:
            self.killed_with = self.folder.with_name(self.folder.name + "-killed")
            shutil.copytree(self.folder, self.killed_with)

    # What is left ----------------------------------------------------------------------------------------

    def misjudged(self, told: str) -> list[str]:
        """Exceptions 5 and 6 are none, for as long as a drive may be busy (Modbus Application Protocol, chapter 7)."""
        once = sum(" busy " in told or " acknowledge " in told for told in self.scene.happened) == 1
        taken = "(exception 5)" in told or "(exception 6)" in told
        return [f"busy: a drive that was for a moment has refused ({told})"] if once and taken else []

    def calm(self) -> None:
        """All that befell is over."""
        self.points.calm()
        self.scene.calm()
        self.clock.sleep(1.0)

    def parameters(self) -> dict[int, Any]:
        """Everything in the drive that can be set."""
        cells = self.bench.servo.registers.cells
        return {
            address: cell.value if cell.read is None else cell.read()
            for address, cell in cells.items()
            if not cell.read_only and address not in _LIVE
        }

    def changed(self, since: dict[int, Any]) -> list[int]:
        """Registers that are not as they were, as keys like those of objects."""
        now = self.parameters()
        return [address << 8 for address, value in since.items() if now[address] != value]


def expected(way: Way, start_rad: float, brakes_rad_s2: float) -> Expected:
    """The plan, computed from the wishes."""
    return Expected(
        node_id=UNIT,
        low_rad=start_rad - ROOM_RAD,
        high_rad=start_rad + DISTANCE_RAD + ROOM_RAD,
        speed_rad_s=SPEED_RAD_S,
        torque_nm=TORQUE_NM,
        silence_s=SILENCE_S,
        deceleration_rad_s2=brakes_rad_s2,
        step_rad=DISTANCE_RAD,
        bend_rad=None,
        added_counts=0,
        mode=way.mode,
        writable=way.writable,
    )
