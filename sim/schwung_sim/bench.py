"""The bench: one simulated drive with its machine on any CAN bus.

On a stepped bus, which brings its own clock, it does what is due when that clock says so; on any other it has a thread,
or is a process of its own.
"""

from __future__ import annotations

import signal
import threading
import time
from collections.abc import Callable, Mapping
from pathlib import Path
from types import TracebackType
from typing import Any

import can

from schwung_sim.drives.axis import ServoAxis
from schwung_sim.drives.roles import find_profile, read_profile, read_roles
from schwung_sim.drives.servo import TICK_S, CanopenServo, Clock
from schwung_sim.drives.vendor import CONTROL_PERIOD_US, OWN_FAMILY
from schwung_sim.errors import BenchError
from schwung_sim.faults import FaultSchedule, FaultyBus, parse_faults
from schwung_sim.plants import Plant, make_plant
from schwung_sim.socketcand import SocketcandHub

START_S = 5.0


def default_eds() -> Path:
    """The EDS of the bench's own drive, in a checkout or in an installed package."""
    return read_profile(find_profile(OWN_FAMILY))[1]


class Bench:
    """A drive, its axis and its plant on a bus.

    `plant` is a name ("two-mass", "slider-crank") or a Plant; `conceal` switches on physics that the tool
    under test does not know (plants/concealed.py has the syntax), `faults` what goes wrong (faults.py has
    the syntax). `interface`, `channel` and `bus_options` are python-can's; `tcp` = (host, port) serves a bus
    of its own instead, see socketcand.py. `clock`: what the axis follows, see CanopenServo; by default the clock
    of a stepped bus, else SYNC. `profile` (a family of device_profiles, or a path) says which objects play
    which part, `eds` which objects there are: nothing else is shown on the bus; default: the bench's own drive.
    `memory` keeps stored parameters (1010) in a file. All chance comes from `seed`, and so does the serial number of
    the drive.
    Raises BenchError on wrong use, before anything runs.
    """

    def __init__(
        self,
        plant: str | Plant = "two-mass",
        *,
        conceal: str = "",
        seed: int = 0,
        interface: str = "stepped",
        channel: str = "bench",
        bus_options: Mapping[str, Any] | None = None,
        tcp: tuple[str, int] | None = None,
        clock: Clock | None = None,
        node_id: int = 5,
        eds: Path | None = None,
        profile: str | Path | None = None,
        faults: str = "",
        memory: Path | None = None,
    ) -> None:
        if clock not in ("sync", "wall", None):
            raise BenchError("--clock", f'there is no clock "{clock}"', "There are sync and wall.")
        if seed < 0:
            raise BenchError("--seed", f"{seed} is negative", "Take 0 or more.")
        if conceal and not isinstance(plant, str):
            raise BenchError(
                "--conceal", "a plant that is given has its own physics", "Name the plant instead."
            )
        wanted_faults = parse_faults(faults)
        content, own_eds = read_profile(find_profile(profile or OWN_FAMILY))
        roles = read_roles(content)
        if isinstance(plant, str):
            _compile(plant, conceal)
            plant = make_plant(plant, conceal=conceal, seed=seed)
        self.plant = plant
        self._hub = SocketcandHub(*tcp, channel=channel) if tcp is not None else None
        try:
            bus = self._hub.bus() if self._hub else _open_bus(interface, channel, bus_options or {})
        except BenchError:
            self._close_hub()
            raise
        self.interface, self.channel = ("socketcand" if tcp is not None else interface), channel
        self.bus = FaultyBus(bus, seed=seed) if wanted_faults else bus
        try:
            self.axis = ServoAxis(self.plant, seed=seed)
            self._time = getattr(self.bus, "clock", None)
            timed = {} if self._time is None else {"monotonic": self._time.now, "sleep": self._time.sleep}
            self.servo = CanopenServo(
                self.bus, node_id, self.axis, eds or own_eds, roles, seed=seed, memory=memory,
                clock=clock or ("sync" if self._time is None else "wall"), **timed,
            )  # fmt: skip
        except BaseException:
            self.close()
            raise
        if isinstance(self.bus, FaultyBus):
            self.servo.on_advance = FaultSchedule(self.servo, self.bus, wanted_faults).poll
        self.failure: BaseException | None = None
        self._tasks: list[Any] = []  # what a stepped bus's clock does for us
        self._thread: threading.Thread | None = None
        self._ended = threading.Event()

    @property
    def tool_options(self) -> dict[str, Any]:
        """What the tool under test gives to can.Bus to meet this bench."""
        options: dict[str, Any] = {"interface": self.interface, "channel": self.channel}
        if self._hub is not None:
            options |= {"host": self._hub.host, "port": self._hub.port}
        return options

    def start(self) -> Bench:
        """Switch the drive on; it has booted when this returns."""
        if self._time is not None:
            self.servo.start()
            self._tasks = [
                self._time.read(self.bus, self.servo.receive, lambda _: self.servo.bus_failed()),
                self._time.every(TICK_S, self.servo.tick, "bench drive"),
            ]
            return self
        self._thread = threading.Thread(target=self._run, name="bench-drive", daemon=True)
        self._thread.start()
        if not self.servo.booted.wait(START_S) or self.failure is not None:
            self.stop()
            raise BenchError("bench", f"the drive did not start within {START_S:g} s")
        return self

    def _run(self) -> None:
        try:
            self.servo.run()
        except BaseException as error:
            self.failure = error
        finally:
            self.servo.booted.set()
            self._ended.set()

    def stop(self) -> None:
        """Switch off and leave the bus. Raises what made the drive's thread fail, if anything did."""
        self.servo.stop()
        while self._tasks:
            self._tasks.pop().close()
        if self._thread is not None:
            self._thread.join(START_S)
            self._thread = None
        self.close()
        if self.failure is not None:
            failure, self.failure = self.failure, None
            raise failure

    def close(self) -> None:
        """Leave the bus; after it has been stopped."""
        self.bus.shutdown()
        self._close_hub()

    def _close_hub(self) -> None:
        if self._hub is not None:
            self._hub.close()

    def __enter__(self) -> Bench:
        return self.start()

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self.stop()

    def run_forever(
        self, max_time_s: float | None = None, announce: Callable[[str], None] | None = None
    ) -> None:
        """Be a process of its own: tell the address, serve until SIGINT or SIGTERM, or for `max_time_s`."""
        announce = announce or (lambda line: print(line, flush=True))
        stopped = threading.Event()
        handlers = {s: signal.signal(s, lambda *_: stopped.set()) for s in (signal.SIGINT, signal.SIGTERM)}
        try:
            with self:
                announce(self.describe())
                end_s = None if max_time_s is None else time.monotonic() + max_time_s
                while not stopped.wait(0.05) and not self._ended.is_set():
                    if end_s is not None and time.monotonic() > end_s:
                        break
        finally:
            for number, handler in handlers.items():
                signal.signal(number, handler)

    def describe(self) -> str:
        """One line: what runs, and how to reach it."""
        where = " ".join(f"{name}={value}" for name, value in self.tool_options.items())
        return (
            f"bench ready: {where} node={self.servo.node_id} plant={self.plant.name} clock={self.servo.clock}"
        )


def _compile(plant: str, conceal: str) -> None:
    """Have the compiled loops ready before the drive appears on a bus: the first SYNC must not wait for them."""
    axis = ServoAxis(make_plant(plant, conceal=conceal))
    axis.energise(True)
    axis.set_target(0.0, 1e-3)
    axis.set_torque_offset(0.0)
    axis.advance(CONTROL_PERIOD_US * 1e-6)


def _open_bus(interface: str, channel: str, options: Mapping[str, Any]) -> can.BusABC:
    try:
        return can.Bus(interface=interface, channel=channel, **options)
    except (can.CanError, OSError, ValueError, TypeError, ImportError) as error:
        raise BenchError(
            f"interface {interface}, channel {channel}",
            f"cannot be opened ({error})",
            "See python-can's interfaces.",
        ) from error
