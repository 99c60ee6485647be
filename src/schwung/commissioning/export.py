"""The inertia table into drive parameters: written, read back, compared, stored; the old values stay in a backup."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Literal

import numpy as np

from schwung.commissioning.interrupts import OneInterrupt
from schwung.commissioning.journal import Change, ParameterJournal
from schwung.drivetrain import InertiaTable
from schwung.errors import DriveError, InputError, NodeLostError, RefusedError, SchwungError
from schwung.fieldbus.drive import ENERGISED, Drive, Parameter, ParameterValue
from schwung.fieldbus.profile import (
    CapabilityName,
    DeviceProfile,
    HarmonicExport,
    ObjectRef,
    ScalarExport,
    Setting,
    TableExport,
)

Form = Literal["table", "harmonics", "mean", "max", "at", "host"]

#: Finds a parameter by index and sub-index: `Drive.parameter`, or a dictionary's without a drive.
Lookup = Callable[[int, int], Parameter]
#: Reads a parameter: `Drive.read`; there is none where only a dictionary is at hand.
Read = Callable[[Parameter], ParameterValue]

_TURN_RAD = 2 * math.pi
_TURN_SLACK = 0.02  # share of a turn by which a table may fall short of one


@dataclass(frozen=True)
class ExportChoice:
    """How the table goes into the drive: as a table, as harmonics of a turn, or as one number (mean, maximum, or at
    an angle); or not at all: the host plays it."""

    form: Form = "table"
    position_rad: float | None = None


@dataclass(frozen=True)
class Exported:
    """What was written, and where the old values are."""

    changes: tuple[Change, ...]
    backup_path: Path
    stored: bool


def parse_choice(text: str) -> ExportChoice:
    """ "table", "harmonics", "mean", "max", "host" or "at=1.57". Raises InputError for anything else."""
    plain: dict[str, Form] = {
        "table": "table", "harmonics": "harmonics", "mean": "mean", "max": "max", "host": "host",
    }  # fmt: skip
    if text in plain:
        return ExportChoice(plain[text])
    form, _, angle = text.partition("=")
    if form != "at":
        raise InputError(
            f'export form "{text}"', "is unknown", "Use table, harmonics, mean, max, host or at=ANGLE."
        )
    try:
        return ExportChoice("at", float(angle))
    except ValueError:
        raise InputError(f'export form "{text}"', "names no angle", "Write for instance at=1.57.") from None


def scalar_of(table: InertiaTable, choice: ExportChoice) -> float:
    """The one number (kg·m²) that stands for a table; the mean is over angle.

    Raises InputError where the chosen angle lies outside the table.
    """
    if choice.form == "max":
        return float(table.inertia_kgm2.max())
    if choice.form == "at":
        angle = choice.position_rad if choice.position_rad is not None else math.nan
        if not table.position_rad[0] <= angle <= table.position_rad[-1]:
            raise InputError(
                "--as at",
                f"{angle:g} rad lies outside the table, {table.position_rad[0]:.4g} … {table.position_rad[-1]:.4g} rad",
                "Choose an angle that was measured.",
            )
        return float(table.at(np.array([angle]))[0])
    span = table.position_rad[-1] - table.position_rad[0]
    return float(np.trapezoid(table.inertia_kgm2, table.position_rad) / span)


def export_values(
    lookup: Lookup,
    profile: DeviceProfile,
    table: InertiaTable,
    choice: ExportChoice,
    *,
    read: Read | None = None,
    motor_inertia_kgm2: float | None = None,
) -> list[ParameterValue]:
    """What has to be written, as raw values, in the order of writing.

    `read` is needed where the drive itself holds the unit (its torque constant), `motor_inertia_kgm2` where it wants
    motor and load in one number. Raises InputError where the profile has no such target ("this profile can't do
    that, because …"), where one of the two is missing, or where a value does not fit its object.
    """
    if table.effort == "current":
        raise InputError("inertia table", "is in A·s²/rad: how many N·m an ampere makes is unknown",
                         "Multiply it by the motor's N·m per ampere, and name its column inertia_kgm2.")  # fmt: skip
    export = profile.export
    if choice.form == "table":
        if export.table is None:
            raise _denied(
                profile, "table feed-forward", "Use --as mean, --as max or --as at=ANGLE, or take the CSV."
            )
        return _table_values(lookup, export.table, table)
    if choice.form == "harmonics":
        if export.harmonics is None:
            raise _denied(profile, "harmonic feed-forward", "Use --as table, --as mean or --as max.")
        return _harmonic_values(lookup, export.harmonics, table)
    if choice.form == "host":
        raise InputError(
            "--as host",
            "writes nothing: the torque is played beside the setpoints",
            "Use it as `schwung commission --export host`, or take the CSV.",
        )
    if export.scalar is None:
        raise _denied(profile, "scalar feed-forward", "Take the CSV or DCF instead.")
    inertia = scalar_of(table, choice)
    if export.scalar.of == "total":
        if motor_inertia_kgm2 is None:
            raise InputError(
                f"profile {profile.family}",
                f"takes the inertia of motor and load together ({export.scalar.object})",
                "Say the motor's: give --machine.",
            )
        inertia += motor_inertia_kgm2
    return _scalar_values(lookup, export.scalar, inertia, read)


@dataclass(frozen=True)
class Worth:
    """What one count of a parameter is worth."""

    scale: float
    unit: str


def worth_of(profile: DeviceProfile, parameter: Parameter) -> Worth | None:
    """The worth of a parameter that an export writes; None where the profile does not say it, or the drive holds it."""
    export, here = profile.export, (parameter.index, parameter.subindex)

    def is_at(ref: ObjectRef | None) -> bool:
        return ref is not None and here == (ref.index, ref.subindex)

    found: Worth | None = None
    if export.table is not None:
        if parameter.index == export.table.values.index and parameter.subindex > 0:
            found = Worth(export.table.scale_kgm2, "kg·m²")
        elif is_at(export.table.start) or is_at(export.table.step):
            found = Worth(export.table.angle_scale_rad, "rad")
        elif is_at(export.table.count):
            found = Worth(1.0, "points")
    if (
        found is None
        and export.scalar is not None
        and is_at(export.scalar.object)
        and export.scalar.per is None
    ):
        found = Worth(export.scalar.scale_kgm2, "kg·m²")
    if found is None and export.harmonics is not None:
        harmonics = export.harmonics
        if parameter.index == harmonics.amplitudes.index and parameter.subindex > 0:
            found = Worth(harmonics.amplitude_scale_kgm2, "kg·m²")
        elif parameter.index == harmonics.phases.index and parameter.subindex > 0:
            found = Worth(harmonics.phase_scale_rad, "rad")
        elif is_at(harmonics.offset.object):
            found = Worth(harmonics.offset.scale, "kg·m²")
    return found


def _denied(profile: DeviceProfile, capability: CapabilityName, remedy: str) -> InputError:
    return InputError(f"profile {profile.family}", profile.reason(capability), remedy)


def _table_values(lookup: Lookup, target: TableExport, table: InertiaTable) -> list[ParameterValue]:
    """The table resampled to the drive's points; one point per sub-index from 1."""
    angles = np.linspace(table.position_rad[0], table.position_rad[-1], target.points)
    step = (angles[-1] - angles[0]) / (target.points - 1)
    values = [
        _counts(lookup, target.values.model_copy(update={"subindex": number}), inertia, target.scale_kgm2)
        for number, inertia in enumerate(table.at(angles), start=1)
    ]
    values += [
        _counts(lookup, target.start, float(angles[0]), target.angle_scale_rad),
        _counts(lookup, target.step, float(step), target.angle_scale_rad),
    ]
    if target.count is not None:
        values.append(_counts(lookup, target.count, target.points, 1.0))
    return values + _enabling(lookup, target.enable)


def _scalar_values(
    lookup: Lookup, target: ScalarExport, inertia_kgm2: float, read: Read | None
) -> list[ParameterValue]:
    scale = target.scale_kgm2
    if target.per is not None:
        scale *= _held(lookup, target.per, read)
    return [_counts(lookup, target.object, inertia_kgm2, scale), *_enabling(lookup, target.enable)]


def _held(lookup: Lookup, ref: ObjectRef, read: Read | None) -> float:
    """A number that the drive holds and that an inertia's scale depends on. Raises InputError without one."""
    parameter = lookup(ref.index, ref.subindex)
    if read is None:
        raise InputError(
            parameter.label,
            "is part of the inertia's unit, and only the drive knows it",
            "Connect to the drive.",
        )
    raw = read(parameter).raw
    if not isinstance(raw, int | float) or raw <= 0:
        raise InputError(
            parameter.label, f"is {raw!r}: the inertia has no unit without it", "Set it in the drive first."
        )
    return float(raw)


def _harmonic_values(lookup: Lookup, target: HarmonicExport, table: InertiaTable) -> list[ParameterValue]:
    """Fourier coefficients of the table over one turn: offset + Σ amplitude·cos(order·angle − phase).

    Raises InputError for a table that does not cover a turn: the rest of it is unknown.
    """
    span = float(table.position_rad[-1] - table.position_rad[0])
    if abs(span / _TURN_RAD - 1) > _TURN_SLACK:
        raise InputError(
            "--as harmonics",
            f"wants a table over one turn, this one covers {span:.4g} rad",
            "Use --as mean or max.",
        )
    samples = 4 * target.orders + 4  # more than twice the highest order: nothing folds back
    angles = table.position_rad[0] + np.arange(samples) * _TURN_RAD / samples
    inertia = table.at(np.minimum(angles, table.position_rad[-1]))
    values = [_counts(lookup, target.offset.object, float(inertia.mean()), target.offset.scale)]
    for order in range(1, target.orders + 1):
        coefficient = 2.0 * np.mean(inertia * np.exp(1j * order * angles))
        for ref, number, scale in (
            (target.amplitudes, abs(coefficient), target.amplitude_scale_kgm2),
            (target.phases, np.angle(coefficient), target.phase_scale_rad),
        ):
            element = ref.model_copy(update={"subindex": order})
            values.append(_counts(lookup, element, float(number), scale))
    return values + _enabling(lookup, target.enable)


def _enabling(lookup: Lookup, setting: Setting | None) -> list[ParameterValue]:
    """Last: the feed-forward is switched on when everything that it uses is there."""
    return [] if setting is None else [_counts(lookup, setting.object, setting.value, 1.0)]


def _counts(lookup: Lookup, ref: ObjectRef, value: float, scale: float) -> ParameterValue:
    parameter = lookup(ref.index, ref.subindex)
    raw = round(value / scale)
    low, high = _range(parameter)
    if not low <= raw <= high:
        raise InputError(
            parameter.label,
            f"takes {low} … {high} counts, {value:g} would be {raw}",
            "Check the profile's scale.",
        )
    return ParameterValue(parameter, raw)


def _range(parameter: Parameter) -> tuple[int, int]:
    """What an integer type can hold. Raises InputError for another type."""
    for kind, signed in (("UNSIGNED", 0), ("INTEGER", 1)):
        if parameter.type.startswith(kind):
            bits = int(parameter.type.removeprefix(kind))
            return (-(1 << (bits - 1)), (1 << (bits - 1)) - 1) if signed else (0, (1 << bits) - 1)
    raise InputError(parameter.label, f"is {parameter.type}, not an integer", "Correct the profile.")


def export_table(
    drive: Drive,
    profile: DeviceProfile,
    table: InertiaTable,
    choice: ExportChoice,
    *,
    backup_path: Path,
    store: bool = True,
    motor_inertia_kgm2: float | None = None,
) -> Exported:
    """Write the table, read every value back, compare, and store it in the drive's memory (1010).

    Refuses a drive whose power stage is on: its control may not change under a moving machine. A write or comparison
    that fails, or an interrupt, puts the old values back before it raises.
    """
    state = drive.state().cia402
    if state.lower() in ENERGISED:
        raise RefusedError("export", f'the drive is in "{state}"', "Switch it off first.")
    values = export_values(
        drive.parameter, profile, table, choice, read=drive.read, motor_inertia_kgm2=motor_inertia_kgm2
    )
    journal = ParameterJournal(drive, backup_path, drive.describe())
    with OneInterrupt() as interrupt:
        try:
            journal.change(values)
            _compare(drive, values)
            interrupt.let_through()
        except BaseException as error:
            interrupt.hold_off()
            _undo(journal, error)
            raise
        interrupt.hold_off()
        journal.keep(stored=store)
        if store:
            _store(drive, backup_path)
    return Exported(journal.changes, backup_path, store)


def _undo(journal: ParameterJournal, error: BaseException) -> None:
    """Put the old values back; what hinders it becomes a note of the error that made it necessary."""
    try:
        journal.restore()
    except SchwungError as trouble:
        error.add_note(f"the old values are not put back: run `schwung restore {journal.path}` ({trouble})")


def _store(drive: Drive, backup_path: Path) -> None:
    try:
        drive.store()
    except DriveError as error:
        lost = isinstance(error, NodeLostError)
        last = "nobody knows whether they last" if lost else "they last until power-off only"
        error.add_note(f"the values are written, but {last}; `schwung restore {backup_path}` undoes them")
        raise


def _compare(drive: Drive, values: Sequence[ParameterValue]) -> None:
    for value in values:
        found = drive.read(value.parameter).raw
        if found != value.raw:
            raise DriveError(
                value.parameter.label,
                f"was written as {value.raw!r} but reads {found!r}",
                "Check the object's range and access in the drive's manual.",
            )
