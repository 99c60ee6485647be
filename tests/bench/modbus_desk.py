"""The Modbus bench and the tool's driver at its other end."""

from __future__ import annotations

import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from typing import Any

import numpy as np

from schwung.commissioning.plan import moves_of
from schwung.fieldbus.canopen import BusOptions
from schwung.fieldbus.drive import Acquisition, Move, Setpoints, Sine
from schwung.fieldbus.modbus import ModbusDrive, ModbusLink, ModbusOptions, modbus_options
from schwung.fieldbus.profile import ModbusProfile, load_profile
from schwung.motion import Motion
from schwung_sim.modbus_bench import ModbusBench

FAMILY = "schwung-bench-modbus"
RATE_HZ = 1000.0


def bus_options(bench: ModbusBench) -> BusOptions:
    """What a command line would be given for this bench."""
    told = dict(bench.tool_options)
    named = (told.pop("interface"), told.pop("channel"), told.pop("bitrate", None))
    return BusOptions(*named, told)


def line_options(bench: ModbusBench, timeout_s: float | None = None) -> ModbusOptions:
    """The same, checked."""
    bus = bus_options(bench)
    extra = dict(bus.extra) | ({} if timeout_s is None else {"timeout": timeout_s})
    return modbus_options(bus.interface or "", bus.channel, bus.bitrate, extra)


def profile_of(family: str = FAMILY) -> ModbusProfile:
    profile = load_profile(family)
    assert isinstance(profile, ModbusProfile)
    return profile


@dataclass
class ModbusDesk:
    """Bench and drive, connected."""

    bench: ModbusBench
    drive: ModbusDrive

    def acquisition(self, trace_rate_hz: float = 1000.0, duration_s: float = 0.2) -> Acquisition:
        return Acquisition(
            "pp", RATE_HZ, sampling="trace", injecting="generator", trace_rate_hz=trace_rate_hz,
            trace_s=duration_s + 0.1,
        )  # fmt: skip

    def stroke(
        self, distance_rad: float = 1.0, duration_s: float = 0.2, sine: Sine | None = None
    ) -> Setpoints:
        """From where it stands, after 0.1 s."""
        begin = self.drive.state().position_rad
        motion = Motion(
            kind="third", distance_rad=distance_rad, duration_s=duration_s, start_time_s=0.1, returns=False,
            dwell_s=0.1,
        )  # fmt: skip
        time_s = motion.time(RATE_HZ)
        moves: tuple[Move, ...] = moves_of(motion, begin, RATE_HZ)
        path = begin + motion.demand(time_s).position_rad
        return Setpoints(RATE_HZ, path, np.zeros(time_s.size), moves, sine)

    @contextmanager
    def enabled(self, **acquisition: Any) -> Iterator[None]:
        """Set up, started, in Operation enabled; off and silent afterwards."""
        wanted = self.acquisition(**acquisition)
        self.drive.write(self.drive.setup(wanted))
        self.drive.start(wanted)
        self.drive.enable()
        try:
            yield
        finally:
            self.drive.stop()


@contextmanager
def modbus_desk(
    transport: str = "tcp", family: str = FAMILY, timeout_s: float | None = None, **bench_options: Any
) -> Iterator[ModbusDesk]:
    """A connected desk; both ends are closed at the end."""
    tcp = ("127.0.0.1", 0) if transport == "tcp" else None
    with ModbusBench(profile=family, tcp=tcp, **{"seed": 7, **bench_options}) as bench:
        profile = profile_of(family)
        link = ModbusLink(line_options(bench, timeout_s), 1, profile.modbus)
        with ModbusDrive(link, profile) as drive:
            yield ModbusDesk(bench, drive)


def until(condition: Callable[[], bool], patience_s: float = 3.0) -> bool:
    """Wait for it; False where it does not come."""
    end_s = time.monotonic() + patience_s
    while not condition() and time.monotonic() < end_s:
        time.sleep(0.005)
    return condition()
