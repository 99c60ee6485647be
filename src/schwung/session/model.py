"""What was recorded: one Run per motion, a Session of them. Plain values, checked when they are made."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any, Literal

import numpy as np

from schwung.errors import InputError
from schwung.motion import Array, Excitation, Motion
from schwung.quantities import Effort

Role = Literal["reference", "excited"]
Axis = Literal["rotary", "linear"]

#: The tolerated deviation of a sample instant from the uniform grid, in samples (files.md).
UNIFORMITY_SAMPLES = 0.01
#: Tolerated difference between the time a torque is held and the sampling period, as a share of the latter.
SAME_PERIOD = 0.01


@dataclass(frozen=True, eq=False)
class Run:
    """One recorded motion; every array is (n,), float64, finite, on a uniform time base, 0 at the trigger.

    On a linear axis the same fields hold m, m/s and N; where a session's effort is a current, torques are in A. Raises
    InputError, naming the dataset and the sample, where that does not hold.
    """

    role: Role
    repeat: int
    sample_rate_hz: float
    time_s: Array
    position_rad: Array
    speed_rad_s: Array
    torque_nm: Array
    position_demand_rad: Array | None = None
    torque_added_nm: Array | None = None
    motion: Motion | None = None
    excitation: Excitation | None = None
    name: str = ""
    extra: Mapping[str, Any] = field(
        default_factory=dict
    )  # further attributes and datasets, kept as they are

    def __post_init__(self) -> None:
        place = self.name or "run"
        if self.role not in ("reference", "excited"):
            raise InputError(place, f'role is "{self.role}"', 'Use "reference" or "excited".')
        if self.repeat < 0:
            raise InputError(place, f"repeat is {self.repeat}", "Count repetitions from 0.")
        if not (np.isfinite(self.sample_rate_hz) and self.sample_rate_hz > 0):
            raise InputError(place, f"sample_rate_hz is {self.sample_rate_hz}", "Give a positive rate in Hz.")
        if self.role == "excited" and self.excitation is None:
            raise InputError(place, "an excited run without excitation", "Add its excitation attribute.")
        for name, values in self.datasets().items():
            if values.ndim != 1 or values.dtype != np.float64:
                raise InputError(f"{place}/{name}", f"is {values.dtype} with {values.ndim} dimensions",
                                 "Store float64 with one dimension.")  # fmt: skip
            if values.size != self.time_s.size:
                raise InputError(f"{place}/{name}", f"has {values.size} samples, time has {self.time_s.size}",
                                 "All datasets of a run have one length.")  # fmt: skip
            bad = np.flatnonzero(~np.isfinite(values))
            if bad.size:
                raise InputError(f"{place}/{name}", f"sample {bad[0]} is {values[bad[0]]}",
                                 "Record again, or cut the run before it.")  # fmt: skip
        self._check_time(place)

    def _check_time(self, place: str) -> None:
        time = self.time_s
        if time.size < 2:
            raise InputError(f"{place}/time", f"has {time.size} samples", "A run needs two at the least.")
        step = np.diff(time)
        if np.any(step <= 0):
            worst = int(np.flatnonzero(step <= 0)[0])
            raise InputError(f"{place}/time", f"does not increase at sample {worst + 1}",
                             "Sort or cut the recording.")  # fmt: skip
        grid = time[0] + np.arange(time.size) / self.sample_rate_hz
        off = np.abs(time - grid) * self.sample_rate_hz
        if np.any(off > UNIFORMITY_SAMPLES):
            worst = int(np.flatnonzero(off > UNIFORMITY_SAMPLES)[0])
            raise InputError(
                f"{place}/time",
                f"is {off[worst]:.3g} samples off the {self.sample_rate_hz:g} Hz grid at sample {worst}",
                "Resample it, or split the run where samples are missing.",
            )

    def datasets(self) -> dict[str, Array]:
        """The arrays that are present, by the names that the file uses."""
        return _present(self)

    @property
    def is_held(self) -> bool:
        """Whether the injection was held for one sampling period, as by a bus, and is recorded."""
        hold = self.excitation.hold_s if self.excitation else None
        if hold is None or self.torque_added_nm is None:
            return False
        return abs(hold * self.sample_rate_hz - 1) < SAME_PERIOD

    def __len__(self) -> int:
        return int(self.time_s.size)


@dataclass(frozen=True, eq=False)
class PartialRun:
    """A recording that was cut short; arrays (n,), NaN where samples were lost. Evidence, not a run."""

    role: Role
    repeat: int
    sample_rate_hz: float
    time_s: Array
    position_rad: Array
    speed_rad_s: Array
    torque_nm: Array
    position_demand_rad: Array | None = None
    torque_added_nm: Array | None = None
    motion: Motion | None = None
    excitation: Excitation | None = None
    extra: Mapping[str, Any] = field(default_factory=dict)

    def datasets(self) -> dict[str, Array]:
        """The arrays that are present, by the names that the file uses."""
        return _present(self)


def _present(run: Run | PartialRun) -> dict[str, Array]:
    named = {
        "time": run.time_s,
        "position": run.position_rad,
        "speed": run.speed_rad_s,
        "torque": run.torque_nm,
        "position_demand": run.position_demand_rad,
        "torque_added": run.torque_added_nm,
    }
    return {name: values for name, values in named.items() if values is not None}


@dataclass(frozen=True, eq=False)
class Session:
    """Every run of one commissioning session, in the order in which they were recorded."""

    runs: tuple[Run, ...]
    created: str
    source: str
    axis: Axis = "rotary"
    drive: Mapping[str, Any] | None = None
    partial_reasons: tuple[str, ...] = ()  # why each recording that was cut short was
    extra: Mapping[str, Any] = field(default_factory=dict)  # further attributes of the file
    effort: Effort = "torque"  # "current": torques are in A, and N·m per A is unknown

    @property
    def references(self) -> tuple[Run, ...]:
        """Runs without injection."""
        return tuple(run for run in self.runs if run.role == "reference")

    @property
    def excited(self) -> tuple[Run, ...]:
        """Runs with the injected sine."""
        return tuple(run for run in self.runs if run.role == "excited")
