"""The pieces that every part of a profile is made of: references, scales, quantities."""

from __future__ import annotations

from typing import Annotated, Any, Literal

from pydantic import BaseModel, BeforeValidator, ConfigDict, Field, model_validator


class Part(BaseModel):
    """Frozen, and strict about keys: a misspelt key is an error, not a silent default.

    The docstring below a field is its description; docs/profiles.md is made of them (document.py).
    """

    model_config = ConfigDict(frozen=True, extra="forbid")


#: Integer and float types that a Modbus parameter can have.
REGISTER_TYPES = (
    "INTEGER16", "UNSIGNED16", "INTEGER32", "UNSIGNED32", "INTEGER64", "UNSIGNED64", "REAL32", "REAL64"
)  # fmt: skip


class ObjectRef(Part):
    """One object of a CANopen dictionary, "6064:00" (hexadecimal), or one Modbus parameter, "@7706:INTEGER32"."""

    index: int = Field(ge=0, le=0xFFFF)
    """Index of the object, or address of the parameter's first register."""
    subindex: int = Field(default=0, ge=0, le=0xFF)
    """Sub-index; 0 for registers."""
    space: Literal["object", "register"] = "object"
    """Which of the two it is."""
    type: str = ""
    """CiA 301 name of a register's type; an object's is in the EDS."""

    @model_validator(mode="after")
    def _within_its_space(self) -> ObjectRef:
        if self.space == "object" and self.index < 0x1000:
            raise ValueError(f"{self.index:04X} is no object of a dictionary: they begin at 1000")
        if self.space == "register" and (self.type not in REGISTER_TYPES or self.subindex):
            raise ValueError(
                f"register {self.index} needs a type: {', '.join(f'@{self.index}:{t}' for t in REGISTER_TYPES[:4])}, …"
            )
        return self

    def __str__(self) -> str:
        return f"@{self.index}" if self.space == "register" else f"{self.index:04X}:{self.subindex:02X}"


def _parse_ref(value: Any) -> Any:
    if not isinstance(value, str):
        return value
    try:
        if value.startswith("@"):
            address, _, type_name = value[1:].partition(":")
            return {"index": int(address), "space": "register", "type": type_name}
        index, _, subindex = value.partition(":")
        return {"index": int(index, 16), "subindex": int(subindex or "0", 16)}
    except ValueError:
        raise ValueError(
            f'"{value}" is no object; write index and sub-index like "6064:00", or a register like "@7706:INTEGER32"'
        ) from None


Ref = Annotated[ObjectRef, BeforeValidator(_parse_ref)]
Positive = Annotated[float, Field(gt=0, allow_inf_nan=False)]


class Setting(Part):
    """An object and the value that it shall have."""

    object: Ref
    """Where it is written."""
    value: int
    """What is written."""


class ScaledObject(Part):
    """An object and the SI value of one count."""

    object: Ref
    """Where it is."""
    scale: Positive
    """SI per count."""


QuantityUnit = Literal[
    "encoder", "increments", "si_unit_velocity", "position_per_second", "rated_torque", "literal", "user"
]


class Quantity(Part):
    """One quantity, and how its counts become SI on the motor side."""

    object: Ref
    """Where its actual value is read (or, for what is commanded, written)."""
    unit: QuantityUnit
    """"encoder": 2π · gear (6091) over feed (6092), or over resolution (608F) where there is no feed, per count.
    "increments": 2π over the number in `resolution` (times `resolution_factor`) per count.
    "si_unit_velocity": as 60A9 says. "position_per_second": position counts per second.
    "rated_torque": per mille of the rated torque. "literal": `scale`. "user": neither drive nor file can tell; `hint`
    says what is needed, and a profile that `extends` this one gives it as "literal"."""
    scale: float | None = None
    """SI (rad, rad/s, N·m, rad/s²) per count, for "literal" only; a negative one turns the direction."""
    resolution: Ref | None = None
    """For "increments": where the drive holds its increments per motor revolution."""
    resolution_factor: Positive = 1.0
    """For "increments": counts per number in `resolution`; 4 where it holds pulses of a quadrature encoder."""
    rated: Ref | None = None
    """For "rated_torque": where the drive holds it; 6076 where absent."""
    rated_torque_scale: Positive = 1e-3
    """For "rated_torque": N·m per count of the rated torque: mN·m by CiA 402-2, µN·m on some."""
    hint: str = ""
    """For "user": what the scale is made of, in words."""

    @model_validator(mode="after")
    def _unit_has_what_it_needs(self) -> Quantity:
        if (self.unit == "literal") != (self.scale is not None) or self.scale == 0:
            raise ValueError('unit = "literal" goes with a scale other than 0, and only that unit does')
        if (self.unit == "increments") != (self.resolution is not None):
            raise ValueError('unit = "increments" goes with a resolution, and only that unit does')
        if self.unit == "user" and not self.hint:
            raise ValueError('unit = "user" needs a hint that says what the scale is made of')
        return self


class PositionQuantity(Quantity):
    """Position also has an object that takes the demand."""

    demand: Ref | None = None
    """Where the demanded position is written; a profile without modes needs none."""


class InjectedQuantity(Quantity):
    """The torque that is injected on top of the controller's."""

    between_syncs: Literal["held", "interpolated"] = "held"
    """What the drive does with it between two SYNCs."""


class Quantities(Part):
    """What is sampled and commanded. All but position may be missing; [cannot] then says why."""

    position: PositionQuantity
    """Angle of the motor shaft."""
    torque: Quantity | None = None
    """Motor torque, controller and injection together."""
    speed: Quantity | None = None
    """Speed of the motor shaft."""
    torque_added: InjectedQuantity | None = None
    """Torque offset that can be written at every SYNC."""
    acceleration: Quantity | None = None
    """Of 6083 and 6084, where 60AA does not say it; absent: 60AA, else speed units per second."""
