"""The bench on Modbus: one simulated drive with its machine.

With a stepped clock everything happens in the thread that lets its time pass, on a line of that time. Without, it is on
loopback TCP or on a pseudo-terminal, in a thread or as a process of its own, and the drive's time is the wall's.
"""

from __future__ import annotations

import signal
import threading
import time
from collections.abc import Callable
from pathlib import Path
from types import TracebackType
from typing import Any

from schwung_sim.drives.axis import ServoAxis
from schwung_sim.drives.modbus.faults import parse_faults
from schwung_sim.drives.modbus.server import Clock, ModbusServer
from schwung_sim.drives.modbus.serving import SerialServing, TcpServing
from schwung_sim.drives.modbus.servo import ModbusServo, read_profile
from schwung_sim.drives.modbus.stepped import USUAL_BITRATE, SteppedLine
from schwung_sim.errors import BenchError
from schwung_sim.plants import Plant, make_plant

START_S = 10.0
DEFAULT_FAMILY = "schwung-bench-modbus"


def profile_path(family_or_path: str | Path) -> Path:
    """The profile.toml of a family that comes with Schwung, in a checkout or installed; or the file or folder itself.
    Raises BenchError where there is none."""
    given = Path(family_or_path)
    room = Path(__file__).resolve().parents[1]  # sim/ in a checkout, site-packages/ when installed
    places = [given, given / "profile.toml"]
    places += [base / "device_profiles" / given / "profile.toml" for base in (room.parent, room / "schwung")]
    found = next((place for place in places if place.is_file()), None)
    if found is None:
        raise BenchError(
            f'profile "{family_or_path}"', "is neither a family nor a file", f"Try {DEFAULT_FAMILY}."
        )
    return found


class ModbusBench:
    """A drive, its axis and its plant on Modbus.

    `plant` and `conceal` as in Bench; `profile` is a family or a path. `tcp` = (host, port), port 0: any; without it a
    serial line is made, `bitrate` then paces it as a real one. `clock`: a stepped clock, in whose time all happens;
    `line` is then the tool's end, and the address means nothing. `faults`: see drives/modbus/faults.py. All chance
    comes from `seed`, and so does the serial number. Raises BenchError on wrong use, before anything runs.
    """

    def __init__(
        self,
        plant: str | Plant = "two-mass",
        *,
        profile: str | Path = DEFAULT_FAMILY,
        tcp: tuple[str, int] | None = None,
        bitrate: int | None = None,
        unit: int = 1,
        conceal: str = "",
        seed: int = 0,
        faults: str = "",
        clock: Clock | None = None,
    ) -> None:
        if seed < 0:
            raise BenchError("--seed", f"{seed} is negative", "Take 0 or more.")
        if not 1 <= unit <= 247:
            raise BenchError("unit", f"{unit} is not within 1…247")
        content, wanted = read_profile(profile_path(profile)), parse_faults(faults)
        self.plant = make_plant(plant, conceal=conceal, seed=seed) if isinstance(plant, str) else plant
        self.axis = ServoAxis(self.plant, seed=seed)
        self.servo = ModbusServo(content, self.axis, seed=seed)
        self.family = str(content.get("family", ""))
        self.server = ModbusServer(
            self.servo, unit, "rtu" if tcp is None else "tcp", faults=wanted, seed=seed
        )
        self.line: SteppedLine | None = None
        self._bitrate, self._clock = bitrate, clock
        self._serving: TcpServing | SerialServing | None = None
        if clock is not None:
            self.line = SteppedLine(clock, self.server, bitrate)
        elif tcp is not None:
            self._serving = TcpServing(self.server, tcp)
        else:
            self._serving = SerialServing(self.server, bitrate)
        self.failure: BaseException | None = None
        self._ready = threading.Event()
        self._thread: threading.Thread | None = None

    @property
    def tool_options(self) -> dict[str, Any]:
        """What the tool under test takes to meet this bench: interface, channel, bit rate."""
        serving = self._serving
        if self.server.transport == "tcp":
            host, port = serving.address if isinstance(serving, TcpServing) else ("bench", 502)
            return {"interface": "modbus-tcp", "channel": f"{host}:{port}"}
        channel = serving.tool if isinstance(serving, SerialServing) else "bench"
        rate = self._bitrate or USUAL_BITRATE
        return {"interface": "modbus-rtu", "channel": channel, "bitrate": rate, "parity": "N"}

    def start(self) -> ModbusBench:
        """Switch the drive on; it answers when this returns."""
        self.servo.advance(0.002)  # the compiled loops are ready before the first request
        if self._clock is not None:
            self.server.begin(self._clock)
            return self
        self._thread = threading.Thread(target=self._run, name="modbus-bench", daemon=True)
        self._thread.start()
        if not self._ready.wait(START_S) or self.failure is not None:
            self.stop()
            raise BenchError("bench", f"the drive did not start within {START_S:g} s")
        return self

    def happen(self, faults: str) -> None:
        """Let faults happen now; in the thread in which the drive lives."""
        for fault in parse_faults(faults):
            self.server.faults.begin(fault)

    def _run(self) -> None:
        try:
            if self._serving is not None:
                self._serving.run(self._ready.set)
        except BaseException as error:
            self.failure = error
        finally:
            self._ready.set()

    def stop(self) -> None:
        """Switch off. Raises what made the drive's thread fail, if anything did."""
        if self._serving is None:
            self.server.end()
            return
        self._serving.stop()
        if self._thread is not None:
            self._thread.join(START_S)
            self._thread = None
        if self.failure is not None:
            failure, self.failure = self.failure, None
            raise failure

    def __enter__(self) -> ModbusBench:
        return self.start()

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self.stop()

    def run_forever(
        self, max_time_s: float | None = None, announce: Callable[[str], object] | None = None
    ) -> None:
        """Be a process of its own: tell the address, serve until SIGINT or SIGTERM, or for `max_time_s`."""
        announce = announce or (lambda line: print(line, flush=True))
        stopped = threading.Event()
        handlers = {s: signal.signal(s, lambda *_: stopped.set()) for s in (signal.SIGINT, signal.SIGTERM)}
        try:
            with self:
                announce(self.describe())
                end_s = None if max_time_s is None else time.monotonic() + max_time_s
                while not stopped.wait(0.05) and self._thread is not None and self._thread.is_alive():
                    if end_s is not None and time.monotonic() > end_s:
                        break
        finally:
            for number, handler in handlers.items():
                signal.signal(number, handler)

    def told(self) -> dict[str, Any]:
        """What runs, and how to reach it, for machines."""
        return {
            "bus": self.tool_options,
            "node": self.server.unit,
            "plant": self.plant.name,
            "profile": self.family,
        }

    def describe(self) -> str:
        """One line: what runs, and how to reach it."""
        where = " ".join(f"{name}={value}" for name, value in self.tool_options.items())
        return f"bench ready: {where} unit={self.server.unit} plant={self.plant.name} profile={self.family}"
