"""A bench drive on a virtual bus, connected through the real driver, as the command line would."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from itertools import count
from pathlib import Path

import numpy as np

from schwung.commissioning import Commissioned, Prepared, Wishes, carry_out, prepare
from schwung.commissioning.commission import settings_of
from schwung.commissioning.journal import ParameterJournal
from schwung.commissioning.plan import PlannedRun
from schwung.commissioning.procedure import record
from schwung.drivetrain import Coupling, Load, Machine, Motor
from schwung.fieldbus.canopen import BusOptions, CanopenDrive, open_bus
from schwung.fieldbus.profile import DeviceProfile, load_profile
from schwung.session import Session, read_session
from schwung_sim.bench import Bench
from schwung_sim.plants import Plant

_channels = count()


def guessed_machine(load_inertia: float = 0.11) -> Machine:
    """What an engineer knows beforehand: data sheets and a guess of the load. The gains are the drive's."""
    return Machine(
        name="bench machine",
        motor=Motor(inertia_kgm2=0.012, viscous_friction_nms=0.2, peak_torque_nm=233.0),
        coupling=Coupling(stiffness_nm_rad=24963.0, damping_nms=8.62),
        load=Load(viscous_friction_nms=0.1, inertia_kgm2=load_inertia),
    )


class Silence:
    """An observer that keeps the notes."""

    def __init__(self) -> None:
        self.notes: list[str] = []

    def phase(self, text: str) -> None: ...

    def progress(self, done: int, total: int) -> None: ...

    def note(self, text: str) -> None:
        self.notes.append(text)


@dataclass
class Desk:
    """Bench, drive and profile, connected."""

    bench: Bench
    drive: CanopenDrive
    profile: DeviceProfile

    def wishes(self, **changes: object) -> Wishes:
        arguments: dict[str, object] = {"distance_rad": np.pi, "duration_s": 0.25, "repeats": 1, **changes}
        return Wishes(**arguments)  # type: ignore[arg-type]  # by name

    def prepare(self, **changes: object) -> Prepared:
        return prepare(self.drive, self.profile, guessed_machine(), self.wishes(**changes))

    def commission(self, out: Path, **changes: object) -> Commissioned:
        out.mkdir(exist_ok=True)
        wishes = self.wishes(**changes)
        return carry_out(self.drive, self.prepare(**changes), out, Silence(), wishes.max_jitter_share)

    def record(self, out: Path, *, runs: tuple[PlannedRun, ...] | None = None, **changes: object) -> Session:
        """Commission, but for what is made of the recording. `runs`: after the creep, instead of the plan's."""
        out.mkdir(exist_ok=True)
        prepared = self.prepare(**changes)
        record(
            self.drive,
            prepared.plan,
            prepared.preflight,
            session_path=out / "session.h5",
            journal=ParameterJournal(self.drive, out / "setup.backup.json", self.drive.describe()),
            observer=Silence(),
            settings=settings_of(prepared.plan),
            runs=runs,
        )
        return read_session(out / "session.h5")


@contextmanager
def desk(
    plant: str | Plant = "two-mass",
    sync: str = "auto",
    bit_rate: int = 1_000_000,
    profile: DeviceProfile | None = None,
    bench_profile: Path | None = None,
    **bench_options: object,
) -> Iterator[Desk]:
    """A connected desk; both ends are closed at the end. `bench_profile`: what the drive is made of, where not of its
    own profile."""
    channel = f"desk-{next(_channels)}"
    profile = profile or load_profile("schwung-bench")
    with Bench(plant, channel=channel, node_id=1, profile=bench_profile, **bench_options) as bench:  # type: ignore[arg-type]  # by name
        bus = open_bus(BusOptions("stepped", channel, bit_rate))
        try:
            drive = CanopenDrive(bus, 1, profile, bit_rate=bit_rate, sync=sync)  # type: ignore[arg-type]  # a literal
            try:
                yield Desk(bench, drive, profile)
            finally:
                drive.close()
        finally:
            bus.shutdown()
