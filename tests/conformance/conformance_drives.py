"""Every drive that the suite runs over: each family in device_profiles, with its own EDS and with its vendor's.

A new family is in it as soon as it has a folder. What its profile leaves to the user (`unit = "user"`) is filled in
here as a user would: by a profile that extends it.
"""

from __future__ import annotations

import os
from collections.abc import Iterator
from contextlib import ExitStack, contextmanager
from dataclasses import dataclass, field
from itertools import count, takewhile
from pathlib import Path
from typing import Any

import numpy as np

from schwung.fieldbus.canopen import BusOptions, CanopenDrive, open_bus
from schwung.fieldbus.canopen.operation import Operation
from schwung.fieldbus.canopen.sync import LockstepProducer
from schwung.fieldbus.drive import Acquisition, Move, OperatingMode, Setpoints
from schwung.fieldbus.profile import CanopenProfile, list_profiles, load_canopen_profile
from schwung_sim.bench import Bench

VARIABLE = "SCHWUNG_REAL_EDS"
NODE = 5
RATE_HZ = 1000.0
HEARTBEAT_S = 0.05
#: what a user of the bench's machine would give where neither drive nor profile tell a unit
USER_SCALES = {"position": 2 * np.pi / 2**20, "speed": 2 * np.pi / 60, "torque": 0.07, "torque_added": 0.07}

_channels = count()


@dataclass(frozen=True)
class Case:
    """One drive: a family, and whose EDS it shows."""

    family: str
    eds: Path | None = None  # None: the profile's own

    @property
    def id(self) -> str:
        return self.family + ("" if self.eds is None else f"+{self.eds.suffix[1:].lower()}")


def real_eds_files() -> list[Path]:
    """Vendors' own files; none where they are not on this computer."""
    named = os.environ.get(VARIABLE)
    places = [Path(named)] if named else [parent / "shared" / "eds" for parent in Path(__file__).parents]
    found = next((place for place in places if (place / "elmo-gold").is_dir()), None)
    return (
        [] if found is None else sorted(p for p in found.glob("*/*") if p.suffix.lower() in (".eds", ".dcf"))
    )


def _family_of(eds: Path, families: list[str]) -> str | None:
    """The family whose name has the most in common with the file's folder, and at least its vendor."""

    def shared(family: str) -> int:
        return sum(
            1 for _ in takewhile(lambda pair: pair[0] == pair[1], zip(family, eds.parent.name, strict=False))
        )

    best = max(families, key=shared)
    return best if shared(best) > len(best.split("-", maxsplit=1)[0]) else None


def canopen_cases() -> list[Case]:
    """Every CANopen family with its own EDS, then those with a vendor's."""
    families = [profile.family for profile in list_profiles() if isinstance(profile, CanopenProfile)]
    real = [(eds, _family_of(eds, families)) for eds in real_eds_files()]
    return [*map(Case, families), *(Case(family, eds) for eds, family in real if family is not None)]


def completed_profile(case: Case, folder: Path) -> Path:
    """A profile that extends the family's by what a user has to give, and shows the case's EDS."""
    profile = load_canopen_profile(case.family)
    lines = [f'extends = "{case.family}"']
    for name in type(profile.quantities).model_fields:
        quantity = getattr(profile.quantities, name)
        if quantity is not None and quantity.unit == "user":
            lines += [f"[quantities.{name}]", 'unit = "literal"', f"scale = {USER_SCALES[name]!r}"]
    file = folder / case.id / "profile.toml"
    file.parent.mkdir()
    file.write_text("\n".join(lines) + "\n")
    return file


@dataclass
class Room:
    """A drive on its bench, and the tool connected to it."""

    case: Case
    bench: Bench
    drive: CanopenDrive
    profile: CanopenProfile
    setup: list[Any] = field(default_factory=list)  # what was there before, while it is set up

    @property
    def mode(self) -> OperatingMode | None:
        """The best mode that profile and drive offer."""
        offered = {c.name: c.available for c in self.drive.capabilities()}
        if offered["cyclic position"]:
            return "csp"
        return "pp" if offered["profile position"] else None

    def offers(self, capability: str) -> bool:
        return next(c.available for c in self.drive.capabilities() if c.name == capability)

    def acquisition(self, mode: OperatingMode, distance_rad: float = 0.3) -> Acquisition:
        moves = self.stroke(mode, distance_rad).moves
        return Acquisition(mode, RATE_HZ, heartbeat_s=HEARTBEAT_S, moves=moves)

    def stroke(self, mode: OperatingMode, distance_rad: float = 0.3, cycles: int = 400) -> Setpoints:
        """From where it stands, there and stay."""
        begin = self.drive.state().position_rad
        share = np.clip(np.arange(cycles) / (0.5 * cycles), 0, 1)
        path = begin + distance_rad * (1 - np.cos(np.pi * share)) / 2
        moves: tuple[Move, ...] = ()
        if mode == "pp":
            moves = (Move(20, begin + distance_rad, 6.0, 100.0),)
        return Setpoints(RATE_HZ, path, np.zeros(cycles), moves)

    @contextmanager
    def enabled(self, mode: OperatingMode) -> Iterator[None]:
        """Set up, started, in Operation enabled; as before afterwards, whatever happened."""
        acquisition = self.acquisition(mode)
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
        if self.bench.servo.dictionary.values[0x603F00]:
            self.drive.reset_fault()
        self.drive.disable()


@contextmanager
def room_of(case: Case, folder: Path, **bench_options: Any) -> Iterator[Room]:
    """Bench and tool, connected by a bus within the process; time is SYNC, as fast as it is answered."""
    file = completed_profile(case, folder)
    channel = f"conformance-{next(_channels)}"
    profile = load_canopen_profile(file)
    if case.eds is not None:
        profile = profile.model_copy(update={"eds": str(case.eds)})
    with Bench(profile=file, eds=case.eds, channel=channel, node_id=NODE, **bench_options) as bench:
        bus = open_bus(BusOptions("virtual", channel, 1_000_000))
        try:
            with CanopenDrive(bus, NODE, profile, bit_rate=1_000_000) as drive:
                yield Room(case, bench, drive, profile)
        finally:
            bus.shutdown()


def in_lockstep(operation: Operation, exchange: Any, period_s: float) -> LockstepProducer:
    """Real drives have their own clock and no object to say that SYNC is it: the suite knows it of the bench."""
    return LockstepProducer(exchange, period_s)
