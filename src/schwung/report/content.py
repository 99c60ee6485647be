"""What a report is made of: plain, immutable values. Whatever is absent is left out without a hole."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import Protocol

import numpy as np

from schwung.drivetrain.inertia import InertiaTable
from schwung.drivetrain.machine import Machine
from schwung.errors import InputError
from schwung.estimation.reach import Reach
from schwung.estimation.values import Estimate
from schwung.motion import Array
from schwung.quantities import Effort
from schwung.session import Axis, Run, Session


class CheckRow(Protocol):
    """One preflight check in words; commissioning's `Check` is one."""

    @property
    def name(self) -> str: ...

    @property
    def severity(self) -> str:
        """ok, note, warning or stop."""

    @property
    def text(self) -> str: ...

    @property
    def remedy(self) -> str: ...


@dataclass(frozen=True)
class ChangeRow:
    """One drive parameter that was changed, with its raw values as people write them."""

    parameter: str
    old: str
    new: str
    remark: str = ""  # "restored", "exported, read back equal", …


@dataclass(frozen=True)
class SyncRow:
    """How evenly SYNC came during one recording (s); a recording that lost a sample is not in a session."""

    run: str
    producer: str
    period_s: float
    rms_s: float
    p99_s: float
    max_s: float


@dataclass(frozen=True, eq=False)
class FollowingError:
    """The same motion before and after the export: following error (rad) over time (s), each pair (n,).

    Raises InputError where a pair is empty or of two lengths.
    """

    before_time_s: Array
    before_rad: Array
    after_time_s: Array
    after_rad: Array

    def __post_init__(self) -> None:
        for time, error in ((self.before_time_s, self.before_rad), (self.after_time_s, self.after_rad)):
            if time.shape != error.shape or time.size == 0:
                raise InputError(
                    "following error",
                    f"{time.size} instants for {error.size} values",
                    "Give one error per instant.",
                )

    @property
    def before_rms_rad(self) -> float:
        """RMS before the export (rad)."""
        return _rms(self.before_rad)

    @property
    def after_rms_rad(self) -> float:
        """RMS after the export (rad)."""
        return _rms(self.after_rad)

    @property
    def improvement(self) -> float:
        """How many times smaller the RMS has become; infinite where nothing is left."""
        return self.before_rms_rad / self.after_rms_rad if self.after_rms_rad else float("inf")


@dataclass(frozen=True)
class Units:
    """What quantities are measured in, and called, on one kind of axis."""

    position: str
    speed: str
    torque: str
    inertia: str
    position_word: str
    torque_word: str
    inertia_word: str


ROTARY = Units("rad", "rad/s", "N·m", "kg·m²", "angle", "torque", "inertia")
LINEAR = Units("m", "m/s", "N", "kg", "position", "force", "mass")
#: The same of sessions of which nobody knows how many N·m an ampere makes.
ROTARY_CURRENT = Units("rad", "rad/s", "A", "A·s²/rad", "angle", "current", "inertia")
LINEAR_CURRENT = Units("m", "m/s", "A", "A·s²/m", "position", "current", "mass")


def units_of(axis: Axis, effort: Effort) -> Units:
    """Units and words of an axis whose torques are that, or currents."""
    if effort == "current":
        return LINEAR_CURRENT if axis == "linear" else ROTARY_CURRENT
    return LINEAR if axis == "linear" else ROTARY


@dataclass(frozen=True, eq=False)
class ReportContent:
    """Everything that a report can show. Title and session are enough; the rest appears where it is given.

    `reach` sets the recording's bound beside the table's band. `contrast` is a second estimate of the same session, as
    a rule by the former method. `reference` is what the curve is held against; `reference_label` says what it is:
    "CAD", "believed", "true inertia".
    """

    title: str
    session: Session
    machine: Machine | None = None
    estimate: Estimate | None = None
    reach: Reach | None = None
    contrast: Estimate | None = None
    reference: InertiaTable | None = None
    reference_label: str = "reference"
    preflight: Sequence[CheckRow] = ()
    changes: Sequence[ChangeRow] = ()
    following_error: FollowingError | None = None
    sync: Sequence[SyncRow] = ()
    settings: Mapping[str, str] = field(default_factory=dict)
    notes: Sequence[str] = ()

    @property
    def units(self) -> Units:
        """Units and words of this axis."""
        return units_of(self.session.axis, self.session.effort)

    @property
    def shown_run(self) -> Run | None:
        """The run that stands for the session: the first excited one, else the first."""
        return next(iter((*self.session.excited, *self.session.runs)), None)


def _rms(values: Array) -> float:
    return float(np.sqrt(np.mean(values**2)))
