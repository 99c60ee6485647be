"""The two files of a sealed session, written straight from their contract: session.h5, and machine.toml."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Literal

import h5py
import numpy as np
from numpy.typing import NDArray

from schwung_sim.plants.two_mass import TwoMassMachine

Array = NDArray[np.float64]

#: The same for every session: when it was made would tell in which order.
_CREATED = "2026-01-01T00:00:00+00:00"


@dataclass(frozen=True, eq=False)
class RecordedRun:
    """One run as reported, arrays (n,); `motion` and `excitation` as JSON."""

    role: Literal["reference", "excited"]
    repeat: int
    motion: str
    excitation: str | None
    position_rad: Array
    speed_rad_s: Array
    torque_nm: Array
    position_demand_rad: Array
    torque_added_nm: Array


@dataclass(frozen=True, eq=False)
class Belief:
    """What machine.toml says: drive train, controller (None: not known), load inertia (n,) over the angle (n,)."""

    name: str
    drive: TwoMassMachine
    control: Mapping[str, float] | None
    position_rad: Array
    inertia_kgm2: Array
    constant: bool


def write_session(path: Path, runs: Sequence[RecordedRun], rate_hz: float) -> None:
    """Write a session file, version 1."""
    with h5py.File(path, "w") as file:
        file.attrs.update(
            format="schwung-session",
            version=1,
            created=_CREATED,
            source="virtual machine room",
            axis="rotary",
        )
        for number, run in enumerate(runs):
            group = file.create_group(f"run/{number:04d}")
            group.attrs.update(role=run.role, repeat=run.repeat, sample_rate_hz=rate_hz, motion=run.motion)
            if run.excitation is not None:
                group.attrs["excitation"] = run.excitation
            datasets = {
                "time": (np.arange(run.torque_nm.size) / rate_hz, "s"),
                "position": (run.position_rad, "rad"),
                "speed": (run.speed_rad_s, "rad/s"),
                "torque": (run.torque_nm, "N·m"),
                "position_demand": (run.position_demand_rad, "rad"),
                "torque_added": (run.torque_added_nm, "N·m"),
            }
            for name, (values, unit) in datasets.items():
                group.create_dataset(name, data=values).attrs["unit"] = unit


def write_belief(folder: Path, belief: Belief) -> None:
    """Write machine.toml, and inertia.csv beside it unless the inertia is one number."""
    drive = belief.drive
    tables: dict[str, Mapping[str, float | str]] = {
        "motor": {
            "inertia": drive.rotor_inertia_kgm2,
            "viscous_friction": drive.rotor_viscous_nms,
            "peak_torque": drive.peak_torque_nm,
        },
        "coupling": {"stiffness": drive.stiffness_nm_rad, "damping": drive.damping_nms},
        "load": {"viscous_friction": drive.load_viscous_nms}
        | (
            {"inertia": float(belief.inertia_kgm2[0])}
            if belief.constant
            else {"inertia_table": "inertia.csv"}
        ),
    }
    if belief.control is not None:
        tables["control"] = belief.control
    lines = [f'name = "{belief.name}"']
    for table, entries in tables.items():
        lines += ["", f"[{table}]"]
        lines += [
            f'{key} = "{value}"' if isinstance(value, str) else f"{key} = {float(value)!r}"
            for key, value in entries.items()
        ]
    (folder / "machine.toml").write_text("\n".join(lines) + "\n", encoding="utf-8")
    if not belief.constant:
        rows = zip(belief.position_rad.tolist(), belief.inertia_kgm2.tolist(), strict=True)
        table_text = "".join(f"{angle!r},{inertia!r}\n" for angle, inertia in rows)
        (folder / "inertia.csv").write_text("position_rad,inertia_kgm2\n" + table_text, encoding="utf-8")
