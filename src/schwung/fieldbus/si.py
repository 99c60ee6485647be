"""Raw values of a drive's parameters in SI, where the standard or the profile says what one count is worth.

Sources: CiA 402-2 for the objects of the drive profile area, CiA 301 for those of communication.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass

from schwung.errors import InputError
from schwung.fieldbus.drive import ParameterValue
from schwung.fieldbus.profile import CanopenProfile
from schwung.fieldbus.units import Scales, read_scales

_POSITION = (0x6062, 0x6064, 0x6065, 0x6067, 0x607A, 0x607B, 0x607C, 0x607D, 0x60F4, 0x60FC)
_SPEED = (0x606B, 0x606C, 0x606D, 0x606F, 0x607F, 0x6081, 0x6082, 0x6099, 0x60B1, 0x60FF)
_ACCELERATION = (0x6083, 0x6084, 0x6085, 0x609A, 0x60C5, 0x60C6)
_TORQUE = (0x6071, 0x6072, 0x6074, 0x6077, 0x60B2)  # per mille of the rated torque
_FIXED = {
    0x1006: (1e-6, "s"), 0x100C: (1e-3, "s"), 0x1017: (1e-3, "s"), 0x6066: (1e-3, "s"), 0x6068: (1e-3, "s"),
    0x606E: (1e-3, "s"), 0x6070: (1e-3, "s"), 0x6080: (2 * math.pi / 60, "rad/s"), 0x6079: (1e-3, "V"),
}  # fmt: skip
_GAINS = {
    "position_gain": "1/s", "speed_gain": "N·m·s/rad", "speed_integral_time": "s", "speed_feed_forward": "",
}  # fmt: skip
_SCALELESS = (0, (1 << 31) - 1, -(1 << 31), (1 << 32) - 1)  # values by which limits are switched off


@dataclass(frozen=True)
class Si:
    """A value with its unit; the unit is empty for plain numbers."""

    value: float
    unit: str

    def __str__(self) -> str:
        return f"{self.value:.6g} {self.unit}".rstrip()


@dataclass(frozen=True)
class SiScales:
    """What one count of an object is worth, by index and sub-index (None: every sub-index from 1 on)."""

    of: Mapping[tuple[int, int | None], tuple[float, str]]

    def si(self, value: ParameterValue) -> Si | None:
        """The value in SI; None where nobody says what a count is worth, or where it stands for "off"."""
        parameter, raw = value.parameter, value.raw
        if parameter.space != "object" or isinstance(raw, str | bytes) or raw in _SCALELESS[1:]:
            return None
        scale, unit = self.of.get((parameter.index, parameter.subindex), (math.nan, ""))
        if math.isnan(scale) and parameter.subindex:
            scale, unit = self.of.get((parameter.index, None), (math.nan, ""))
        return None if math.isnan(scale) else Si(raw * scale, unit)


def si_scales(profile: CanopenProfile | None, read: Callable[[int, int], int | None]) -> SiScales:
    """Scales of all objects that we know. `read` gives what 608F, 60A9, 6076, … hold; None where nobody knows."""
    known: dict[tuple[int, int | None], tuple[float, str]] = {(i, 0): scale for i, scale in _FIXED.items()}
    if profile is None:
        return SiScales(known)
    try:
        scales: Scales | None = read_scales(profile, read)
    except InputError:
        scales = None
    if scales is not None:
        rated = (scales.rated_torque_nm or math.nan) / 1000
        for indices, scale, unit in (
            (_POSITION, abs(scales.position_rad), "rad"),
            (_SPEED, abs(scales.speed_rad_s), "rad/s"),
            (_ACCELERATION, abs(scales.acceleration_rad_s2), "rad/s²"),
            (_TORQUE, rated, "N·m"),
        ):
            for index in indices:
                known[index, 0] = known[index, None] = (scale, unit)
        q = profile.quantities
        for quantity, scale, unit in (
            (q.position, scales.position_rad, "rad"), (q.speed, scales.speed_rad_s, "rad/s"),
            (q.torque, scales.torque_nm, "N·m"), (q.torque_added, scales.torque_added_nm, "N·m"),
        ):  # fmt: skip
            if quantity is not None:
                known[quantity.object.index, quantity.object.subindex] = (scale, unit)
        counts = read(0x6076, 0)
        if counts and scales.rated_torque_nm:
            known[0x6076, 0] = (scales.rated_torque_nm / counts, "N·m")
    _add_targets(profile, known)
    return SiScales(known)


def _add_targets(profile: CanopenProfile, known: dict[tuple[int, int | None], tuple[float, str]]) -> None:
    """Gains and inertia targets of the profile."""
    for name, unit in _GAINS.items():
        gain = getattr(profile.control, name)
        if gain is not None:
            known[gain.object.index, gain.object.subindex] = (gain.scale, unit)
    table, scalar = profile.export.table, profile.export.scalar
    if table is not None:
        known[table.values.index, None] = (table.scale_kgm2, "kg·m²")
        for ref in (table.start, table.step):
            known[ref.index, ref.subindex] = (table.angle_scale_rad, "rad")
    if scalar is not None and scalar.per is None:
        known[scalar.object.index, scalar.object.subindex] = (scalar.scale_kgm2, "kg·m²")
