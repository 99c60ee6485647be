"""Sessions imported from real recordings, and what is believed about the machines. Nothing of them is kept here.

A linear axis uses the words of a rotary one in a machine file: `inertia` is mass in kg, `viscous_friction` N·s/m,
`peak_torque` N. Without [coupling] the axis is one rigid mass.
"""

from __future__ import annotations

import os
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path

from schwung.drivetrain import Load, Machine, Motor
from schwung.session import Session
from schwung.session.imports import import_recordings, make_recipe

VARIABLE = "SCHWUNG_REAL_DATA"


class MissingRecordings(Exception):
    """The recordings are not on this computer."""


@dataclass(frozen=True)
class RealRecordings:
    """Where the recordings are; sessions are imported when they are asked for."""

    folder: Path

    @classmethod
    def found(cls, repository: Path) -> RealRecordings:
        """The folder named by the environment, else shared/data in a parent of the repository."""
        named = os.environ.get(VARIABLE)
        places = [Path(named)] if named else [parent / "shared" / "data" for parent in repository.parents]
        for place in places:
            if (place / "emps").is_dir():
                return cls(place)
        raise MissingRecordings(f"no real recordings: set {VARIABLE} to the folder that holds emps/")

    def _session(self, names: tuple[str, ...], **recipe: object) -> Session:
        return import_recordings([self.folder / name for name in names], make_recipe(recipe)).session

    def _emps(self, name: str) -> Session:
        return self._session(
            (f"emps/{name}",), axis="linear", time="t", position="qm", position_demand="qg", torque="vir",
            torque_scale="gtau",
        )  # fmt: skip

    @cached_property
    def emps(self) -> Session:
        """The estimation record: four cycles of 6.24 s, the last without its end."""
        return self._emps("DATA_EMPS.mat")

    @cached_property
    def emps_pulses(self) -> Session:
        """The validation record: the same cycles with pulses of force."""
        return self._emps("DATA_EMPS_PULSES.mat")

    def pendulum(self, name: str) -> Session:
        """ddp, dircol or sysid."""
        return self._session(
            (f"dfki-pendulum/{name}_measured.csv",), time="time", position="position", speed="velocity",
            torque="torque", resample=True,
        )  # fmt: skip

    def hsm150(self, *names: str) -> Session:
        """Torque steps such as neg_0.04_1."""
        return self._session(
            tuple(f"hsm150/idf_{name}.mat" for name in names), time="data[:,0]", position="data[:,2]",
            speed="data[:,3]", torque="data[:,5]",
        )  # fmt: skip


def emps_machine() -> Machine:
    """Mass alone, as published: no friction, no offset; the drive saturates at 10 V. Rigid, so how the mass is shared
    between [motor] and [load] makes no odds; together 95.1089 kg."""
    return Machine(
        name="EMPS, mass alone",
        motor=Motor(inertia_kgm2=15.1089, viscous_friction_nms=0.0, peak_torque_nm=351.5),
        load=Load(inertia_kgm2=80.0),
    )


def pendulum_machine() -> Machine:
    """Point mass and rod about the shaft, output side of the gear, from the test bench's data sheet; no gravity."""
    return Machine(
        name="Pendulum, without gravity",
        motor=Motor(inertia_kgm2=6.0719e-5 * 6**2, viscous_friction_nms=0.0, peak_torque_nm=12.0),
        load=Load(inertia_kgm2=0.15),
    )


def hsm150_machine() -> Machine:
    """Catalogue values of the motor."""
    return Machine(
        name="HSM150",
        motor=Motor(inertia_kgm2=1.2e-4, viscous_friction_nms=7.03e-5, peak_torque_nm=0.2925),
    )
