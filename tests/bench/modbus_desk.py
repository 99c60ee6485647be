"""The Modbus bench and the tool's driver at its other end, on a line in simulated time."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from typing import Any

import numpy as np

from schwung.clock import SteppedClock
from schwung.commissioning.plan import moves_of
from schwung.fieldbus.canopen import BusOptions
from schwung.fieldbus.connecting import Connected, connected
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


def modbus_bench(transport: str, clock: SteppedClock, *plant: Any, **options: Any) -> ModbusBench:
    """A bench in a clock's time, on TCP or a serial line."""
    tcp = ("bench", 502) if transport == "tcp" else None
    return ModbusBench(*plant, tcp=tcp, clock=clock, **{"seed": 7, **options})


@contextmanager
def connected_bench(
    transport: str, *plant: Any, family: str | None = None, profile: str = FAMILY, **options: Any
) -> Iterator[tuple[ModbusBench, Connected]]:
    """A bench, and the tool connected to it as the command line would be; `family`: what --profile says."""
    clock = SteppedClock()
    with (
        modbus_bench(transport, clock, *plant, profile=profile, **options) as bench,
        connected(bus_options(bench), 1, family, clock=clock, line=bench.line) as opened,
    ):
        yield bench, opened


@dataclass
class ModbusDesk:
    """Bench and drive, connected, and the time they live in. `sent`: every frame of the tool's."""

    bench: ModbusBench
    drive: ModbusDrive
    clock: SteppedClock
    sent: list[bytes]

    @property
    def controlwords(self) -> list[int]:
        """Every controlword that went over the line, in order, whatever became of it."""
        header, trailer = (7, None) if self.bench.server.transport == "tcp" else (1, -2)
        requests = (frame[header:trailer] for frame in self.sent)
        return [int.from_bytes(pdu[6:], "big") for pdu in requests if pdu[:3] == b"\x10\x00\x64"]

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

    def until(self, condition: Callable[[], bool], patience_s: float = 3.0) -> bool:
        """Let time pass for it; False where it does not come."""
        return self.clock.wait(condition, patience_s)


@contextmanager
def modbus_desk(
    transport: str = "tcp", family: str = FAMILY, timeout_s: float | None = None, **bench_options: Any
) -> Iterator[ModbusDesk]:
    """A connected desk; both ends are closed at the end."""
    clock = SteppedClock()
    with modbus_bench(transport, clock, profile=family, **bench_options) as bench:
        profile = profile_of(family)
        line = bench.line
        assert line is not None
        sent, send = [], line.send

        def noted(data: bytes) -> None:
            sent.append(data)
            send(data)

        line.send = noted  # type: ignore[method-assign]  # somebody listens
        link = ModbusLink(line_options(bench, timeout_s), 1, profile.modbus, clock=clock, line=line)
        with ModbusDrive(link, profile) as drive:
            yield ModbusDesk(bench, drive, clock, sent)
