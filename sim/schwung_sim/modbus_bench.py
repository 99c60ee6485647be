"""The bench on Modbus: one simulated drive with its machine, on loopback TCP or on a serial line made of two
pseudo-terminals, in a thread or as a process of its own."""

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
from schwung_sim.drives.modbus.server import ModbusServer, SerialLine
from schwung_sim.drives.modbus.servo import ModbusServo, read_profile
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
    serial line is made, `bitrate` then paces it as a real one. `faults`: see drives/modbus/faults.py. All chance comes
    from `seed`, and so does the serial number. The drive's time is the computer's.
    Raises BenchError on wrong use, before anything runs.
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
        self._bitrate = bitrate
        self._line = SerialLine(bitrate) if tcp is None else None
        self.server = ModbusServer(self.servo, unit, tcp=tcp, line=self._line, faults=wanted, seed=seed)
        self.failure: BaseException | None = None
        self._ready = threading.Event()
        self._thread: threading.Thread | None = None

    @property
    def tool_options(self) -> dict[str, Any]:
        """What the tool under test takes to meet this bench: interface, channel, bit rate."""
        if self._line is not None:
            rate = self._bitrate or 115200
            return {"interface": "modbus-rtu", "channel": self._line.tool, "bitrate": rate, "parity": "N"}
        host, port = self.server.address or ("127.0.0.1", 0)
        return {"interface": "modbus-tcp", "channel": f"{host}:{port}"}

    def start(self) -> ModbusBench:
        """Switch the drive on, in a thread of its own; it answers when this returns."""
        self.servo.advance(0.002)  # the compiled loops are ready before the first request
        self._thread = threading.Thread(target=self._run, name="modbus-bench", daemon=True)
        self._thread.start()
        if not self._ready.wait(START_S) or self.failure is not None:
            self.stop()
            raise BenchError("bench", f"the drive did not start within {START_S:g} s")
        return self

    def _run(self) -> None:
        try:
            self.server.run(self._ready.set)
        except BaseException as error:
            self.failure = error
        finally:
            self._ready.set()

    def stop(self) -> None:
        """Switch off. Raises what made the drive's thread fail, if anything did."""
        self.server.stop()
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
