"""A drive on its bench with the tool connected to it, whatever the bus: what the tests of the suite work with."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Callable, Iterator
from contextlib import ExitStack, contextmanager
from itertools import count
from pathlib import Path
from typing import Any

import numpy as np
from conformance_drives import Case, completed_profile

from schwung.clock import Clock, SteppedClock
from schwung.errors import DriveError
from schwung.fieldbus.canopen import BusOptions, CanopenDrive, open_bus
from schwung.fieldbus.connecting import connected
from schwung.fieldbus.drive import Acquisition, Drive, Move, OperatingMode, Sampling, Setpoints
from schwung.fieldbus.modbus import ModbusDrive
from schwung.fieldbus.profile import CanopenProfile, DeviceProfile, ModbusProfile, load_canopen_profile
from schwung_sim.bench import Bench
from schwung_sim.drives.axis import ServoAxis
from schwung_sim.modbus_bench import ModbusBench

NODE = 5
SEED = 11
RATE_HZ = 1000.0
SHORT_HEARTBEAT_S = 0.01

_channels = count()


class Room(ABC):
    """One drive. `axis` and `plant` are the truth, everything else goes through the bus."""

    profile: DeviceProfile
    drive: Drive

    def __init__(self, case: Case, bench: Bench | ModbusBench, clock: Clock) -> None:
        self.case, self.bench, self.clock = case, bench, clock
        self.axis: ServoAxis = bench.axis
        self.plant = bench.plant

    @abstractmethod
    def held(self) -> dict[int, object]:
        """All parameters as the drive holds them, but for what only commands."""

    @property
    @abstractmethod
    def identity(self) -> tuple[int, int]:
        """Vendor and product that the drive has, 0 where it has none."""

    @abstractmethod
    def fail(self, code: int) -> None:
        """The drive's own trouble."""

    @abstractmethod
    def fall_silent(self) -> Callable[[], None]:
        """What kill -9 does to us: nothing more is said. Returns how to speak again."""

    def wait_until(self, happened: Callable[[], bool]) -> bool:
        """Whether it happened within ten seconds."""
        return self.clock.wait(happened, 10.0)

    def offers(self, capability: str) -> bool:
        return next(c.available for c in self.drive.capabilities() if c.name == capability)

    @property
    def mode(self) -> OperatingMode | None:
        """The best mode that profile and drive offer."""
        if self.offers("cyclic position"):
            return "csp"
        return "pp" if self.offers("profile position") else None

    @property
    def sampling(self) -> Sampling:
        return "sync" if self.offers("sampling by SYNC") else "trace"

    def acquisition(self, mode: OperatingMode, heartbeat_s: float = 0.1) -> Acquisition:
        stroke = self.stroke(mode)
        return Acquisition(
            mode, RATE_HZ, heartbeat_s=heartbeat_s, moves=stroke.moves, sampling=self.sampling,
            trace_rate_hz=RATE_HZ, trace_s=stroke.position_rad.size / RATE_HZ,
        )  # fmt: skip

    def stroke(self, mode: OperatingMode, distance_rad: float = 0.3, cycles: int = 400) -> Setpoints:
        """From where it stands, there within half of the time, and stay."""
        begin = self.drive.state().position_rad
        share = np.clip((np.arange(cycles) - 20) / (0.5 * cycles), 0, 1)
        path = begin + distance_rad * (1 - np.cos(np.pi * share)) / 2
        moves = (Move(20, begin + distance_rad, 6.0, 100.0),) if mode == "pp" else ()
        return Setpoints(RATE_HZ, path, np.zeros(cycles), moves)

    @contextmanager
    def enabled(self, mode: OperatingMode, heartbeat_s: float = 0.1) -> Iterator[None]:
        """Set up, started, in Operation enabled; as before afterwards, whatever happened."""
        acquisition = self.acquisition(mode, heartbeat_s)
        wanted = self.drive.setup(acquisition)
        before = [self.drive.read(value.parameter) for value in wanted]
        with ExitStack() as ways_out:
            ways_out.callback(self.drive.write, before)
            self.drive.write(wanted)
            ways_out.callback(self.drive.stop)
            self.drive.start(acquisition)
            ways_out.callback(self._off)
            self.drive.enable()
            yield

    def _off(self) -> None:
        if self.drive.state().cia402.lower() == "fault":
            self.drive.reset_fault()
        self.drive.disable()

    def comes_to_rest(self) -> bool:
        """Out of operation, and standing."""
        return self.wait_until(
            lambda: abs(self.axis.speed_rad_s) < 0.5 and self.state() not in ("operation enabled", "between")
        )

    @contextmanager
    def once_it_moves(self, act: Callable[[], object]) -> Iterator[None]:
        """Do something while a motion is being played."""

        done = self.clock.event()

        def look() -> None:
            if (
                not done.is_set() and abs(self.axis.demand_speed_rad_s) > 0.2
            ):  # it may still swing from before
                done.set()
                act()

        watch = self.clock.every(0.002, look)
        yield
        self.wait_until(done.is_set)
        watch.close()

    def state(self) -> str:
        """The drive's state by its own statusword."""
        return {
            0x27: "operation enabled",
            0x07: "quick stop active",
            0x08: "fault",
            0x40: "switch on disabled",
        }.get(self.bench.servo.power.state.value, "between")


class CanopenRoom(Room):
    """A drive on CANopen, on a stepped bus."""

    bench: Bench
    drive: CanopenDrive
    profile: CanopenProfile

    def __init__(self, case: Case, bench: Bench, drive: CanopenDrive, profile: CanopenProfile) -> None:
        super().__init__(case, bench, drive.clock)
        self.drive, self.profile = drive, profile

    def held(self) -> dict[int, object]:
        servo = self.bench.servo
        commands = servo.vendor.volatile | {0x604000}
        return {k: value for k, value in servo.dictionary.values.items() if k not in commands}

    @property
    def identity(self) -> tuple[int, int]:
        number = self.bench.servo.dictionary.number
        return number(0x1018, 1), number(0x1018, 2)

    def fail(self, code: int) -> None:
        self.bench.servo.fault(code)

    def fall_silent(self) -> Callable[[], None]:
        heartbeats = self.bench.servo.heartbeats
        self.wait_until(
            lambda: bool(heartbeats.watched)
        )  # who has never been heard is not missed (CiA 301 7.2.8.3.2.2)
        heartbeat = self.drive._parameters._heartbeat
        assert heartbeat is not None
        heartbeat.close()
        self.drive._parameters._heartbeat = None

        def speak() -> None:
            self.drive._parameters.beat(SHORT_HEARTBEAT_S)
            self.wait_until(
                lambda: not heartbeats.silent
            )  # a fault by silence cannot be reset before we have been heard

        return speak


class ModbusRoom(Room):
    """A drive on Modbus, on a stepped line."""

    bench: ModbusBench
    drive: ModbusDrive
    profile: ModbusProfile

    def __init__(self, case: Case, bench: ModbusBench, drive: ModbusDrive, profile: ModbusProfile) -> None:
        super().__init__(case, bench, drive.clock)
        self.drive, self.profile = drive, profile

    def held(self) -> dict[int, object]:
        commands = {self.profile.quantities.position.demand} | (
            {s.controlword} if (s := self.profile.state) else set()
        )
        trace = self.profile.trace
        if trace is not None:
            commands |= {trace.cursor, trace.data, trace.status.object}
        skipped = {ref.index for ref in commands if ref is not None}
        names = [parameter for parameter in self.drive.parameters() if parameter.index not in skipped]
        live = {q.object.index for q in vars(self.profile.quantities).values() if q is not None}
        return {p.index: self._value(p) for p in names if p.index not in live}

    def _value(self, parameter: Any) -> object:
        try:
            return self.drive.read(parameter).raw
        except DriveError as error:
            return str(error)

    @property
    def identity(self) -> tuple[int, int]:
        vendor, product = (*(entry.value for entry in self.profile.identity), 0, 0)[:2]
        return vendor, product

    def fail(self, code: int) -> None:
        self.bench.servo.power.fail(code)

    def fall_silent(self) -> Callable[[], None]:
        self.drive._close_keeper()
        return lambda: None


@contextmanager
def room_of(case: Case, folder: Path) -> Iterator[Room]:
    """Bench and tool, connected."""
    file = completed_profile(case, folder)
    yield from _canopen_room(case, file) if case.bus == "canopen" else _modbus_room(case, file)


def _canopen_room(case: Case, file: Path) -> Iterator[Room]:
    channel = f"conformance-{next(_channels)}"
    profile = load_canopen_profile(file)
    if case.eds is not None:
        profile = profile.model_copy(update={"eds": str(case.eds)})
    with Bench(profile=file, eds=case.eds, channel=channel, node_id=NODE, seed=SEED) as bench:
        bus = open_bus(BusOptions("stepped", channel, 1_000_000))
        try:
            with CanopenDrive(bus, NODE, profile, bit_rate=1_000_000) as drive:
                yield CanopenRoom(case, bench, drive, profile)
        finally:
            bus.shutdown()


def _modbus_room(case: Case, file: Path) -> Iterator[Room]:
    tcp = ("bench", 502) if case.bus == "modbus-tcp" else None
    clock = SteppedClock()
    with ModbusBench(profile=case.family, tcp=tcp, unit=NODE, seed=SEED, clock=clock) as bench:
        told = bench.tool_options
        options = BusOptions(
            told.pop("interface"), told.pop("channel"), told.pop("bitrate", None), extra=told
        )
        with connected(options, NODE, str(file), clock=clock, line=bench.line) as found:
            assert isinstance(found.drive, ModbusDrive)
            assert isinstance(found.profile, ModbusProfile)
            yield ModbusRoom(case, bench, found.drive, found.profile)
