"""Where an estimated inertia can be written: a table, one number, harmonics, or torque that the host plays."""

from __future__ import annotations

from typing import Literal

from pydantic import Field

from schwung.fieldbus.profile.parts import Part, Positive, Quantity, Ref, ScaledObject, Setting


class TableExport(Part):
    """Load inertia over load angle, for the drive's feed-forward."""

    values: Ref
    """Array; sub-indices 1 to `points`, or that many registers' parameters one after another."""
    points: int = Field(ge=2, le=254)
    """How many points it holds."""
    scale_kgm2: Positive
    """kg·m² per count."""
    start: Ref
    """Angle of the first point."""
    step: Ref
    """Angle between points."""
    angle_scale_rad: Positive
    """rad per count of `start` and `step`."""
    count: Ref | None = None
    """Object that takes the number of points in use."""
    enable: Setting | None = None
    """What switches the feed-forward on, written last."""


class ScalarExport(Part):
    """One number for the inertia."""

    object: Ref
    """Where it is written."""
    scale_kgm2: Positive
    """kg·m² per count; with `per`, kg·m² per count and per count of that object."""
    per: Ref | None = None
    """Object whose value multiplies the scale: the torque constant, where the number is a current per acceleration."""
    of: Literal["load", "total"] = "load"
    """Whose inertia: the load's alone, or motor and load together."""
    enable: Setting | None = None
    """What switches the feed-forward on, written last."""


class HarmonicExport(Part):
    """Load inertia as a Fourier series over one turn: offset + Σ amplitude·cos(order·angle − phase)."""

    offset: ScaledObject
    """The mean, kg·m² per count."""
    amplitudes: Ref
    """Array; sub-index k holds the amplitude of order k."""
    amplitude_scale_kgm2: Positive
    """kg·m² per count."""
    phases: Ref
    """Array; sub-index k holds the phase of order k."""
    phase_scale_rad: Positive
    """rad per count."""
    orders: int = Field(ge=1, le=254)
    """How many orders it holds."""
    enable: Setting | None = None
    """What switches the feed-forward on, written last."""


class Export(Part):
    """Where an estimated inertia can be written."""

    table: TableExport | None = None
    """A table over angle."""
    scalar: ScalarExport | None = None
    """One number."""
    harmonics: HarmonicExport | None = None
    """A Fourier series over one turn."""
    host_played: Quantity | None = None
    """A feed-forward torque object that a PDO carries, so that the host plays the table at SYNC rate."""


class Control(Part):
    """The cascade as the drive holds it, for the believed machine."""

    position_gain: ScaledObject | None = None
    """Proportional gain of the position loop, 1/s per count."""
    speed_gain: ScaledObject | None = None
    """Proportional gain of the speed loop, N·m·s/rad per count."""
    speed_integral_time: ScaledObject | None = None
    """Integral time of the speed loop, s per count."""
    speed_feed_forward: ScaledObject | None = None
    """Share of the demanded speed that is added; 1 is full."""


class Stop(Part):
    """What the drive shall do by itself; absent: the drive's own setting stays."""

    quick_stop_option: Setting | None = None
    """Reaction to a quick stop (605A)."""
    connection_lost: Setting | None = None
    """Reaction to our silence (6007)."""
    fault_reaction: Setting | None = None
    """Reaction to a fault (605E)."""
