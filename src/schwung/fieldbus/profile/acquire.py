"""What a drive does by itself, for buses that are too slow: make a sine, play a buffer of torque, record a trace."""

from __future__ import annotations

from typing import Literal

from pydantic import Field, model_validator

from schwung.fieldbus.profile.parts import Part, Positive, Quantity, Ref, ScaledObject


class GeneratorControl(Part):
    """The object that starts and stops the sine."""

    object: Ref
    """Where it is written."""
    off: int
    """Value for silence."""
    on: int
    """Value that starts it at once; its phase counts from then."""
    at_motion: int | None = None
    """Value that starts it with the next motion; its phase counts from the motion's start."""


class Generator(Part):
    """The drive's own sine, added to the torque demand."""

    amplitude: Quantity
    """Its amplitude."""
    frequency: ScaledObject
    """Its frequency, Hz per count."""
    phase: ScaledObject | None = None
    """Its phase, rad per count; absent: always 0."""
    control: GeneratorControl
    """Start and stop."""


class DisturbanceBuffer(Part):
    """Torque values that the drive plays from its own memory, one per control cycle."""

    values: Ref
    """Where the values are written, one after another."""
    unit: Quantity
    """What one of them is worth."""
    rate_hz: Positive
    """How many of them are played per second, undivided."""
    divider: Ref | None = None
    """Object that divides that rate."""
    max_values: int = Field(ge=2)
    """How many the drive holds."""
    control: GeneratorControl
    """Start and stop."""


class TraceControl(Part):
    """The object that arms and stops the trace."""

    object: Ref
    """Where it is written."""
    arm: int
    """Value that makes it wait for its trigger."""
    stop: int | None = None
    """Value that ends it; absent: it ends when it is full."""


class TraceStatus(Part):
    """The object that tells how far the trace is."""

    object: Ref
    """Where it is read."""
    full: int
    """Value when it can be read out."""
    armed: int | None = None
    """Value while it waits for its trigger."""
    running: int | None = None
    """Value while it records."""
    mask: int = 0xFFFFFFFF
    """Bits that count, where the object holds others too."""


TracedQuantity = Literal["position", "speed", "torque", "torque_added", "position_demand"]


class TraceColumn(Part):
    """One recorded quantity."""

    quantity: TracedQuantity
    """What it is."""
    type: str = Field(pattern=r"^((INTEGER|UNSIGNED)(8|16|32|64)|REAL(32|64))$")
    """CiA 301 name of its type in the buffer: INTEGER16, INTEGER32, REAL32, …"""
    scale: float | None = None
    """SI per count; absent: as in [quantities]."""
    selector: Ref | None = None
    """Object that chooses what this column records."""
    selection: int | None = None
    """Value of `selector` for this quantity."""
    data: Ref | None = None
    """With layout = "columns": where this column is read."""

    @model_validator(mode="after")
    def _chosen_by_both(self) -> TraceColumn:
        if (self.selector is None) != (self.selection is None):
            raise ValueError("selector and selection go together")
        return self


class Trace(Part):
    """The drive's own recorder: faster than any bus, and read out after the motion."""

    base_rate_hz: Positive
    """Samples per second, undivided."""
    divider: Ref | None = None
    """Object that divides the rate."""
    period: ScaledObject | None = None
    """Instead of a divider: object that holds the sampling period, s per count."""
    length: Ref | None = None
    """Object that takes the number of samples; absent: always `max_samples`."""
    max_samples: int = Field(ge=2)
    """Rows that the drive holds."""
    control: TraceControl
    """Arm and stop."""
    status: TraceStatus
    """How far it is."""
    trigger: Literal["motion_start", "immediate"]
    """Row 0: the first sample of the next motion, or the one after arming."""
    layout: Literal["rows", "columns"] = "rows"
    """One buffer with row after row (all columns of a sample side by side), or one buffer per column."""
    columns: tuple[TraceColumn, ...] = Field(min_length=1)
    """What is recorded, in the order of the row."""
    data: Ref | None = None
    """With layout = "rows": where the rows are read; for registers, the first of the window."""
    window: int | None = Field(default=None, ge=1, le=125)
    """Registers only: how many of them are readable at `data` at once."""
    cursor: Ref | None = None
    """Registers only: object that takes the number of the first row in the window."""

    @model_validator(mode="after")
    def _readable(self) -> Trace:
        if (self.layout == "rows") != (self.data is not None):
            raise ValueError('layout = "rows" goes with data, and only that layout does')
        if self.layout == "columns" and any(column.data is None for column in self.columns):
            raise ValueError('layout = "columns" needs data in every column')
        if self.divider is not None and self.period is not None:
            raise ValueError("divider and period exclude each other")
        return self
