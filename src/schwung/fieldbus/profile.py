"""Device profiles: what a drive family offers and in which units. Data in device_profiles/, no code.

A profile is a folder with `profile.toml` and, beside it, the EDS that it names.
"""

from __future__ import annotations

import tomllib
from pathlib import Path
from typing import Annotated, Any, Literal

from pydantic import BaseModel, BeforeValidator, ConfigDict, Field, ValidationError, model_validator

import schwung
from schwung.errors import InputError
from schwung.fieldbus.drive import OperatingMode


class _Part(BaseModel):
    """Frozen, and strict about keys: a misspelt key is an error, not a silent default."""

    model_config = ConfigDict(frozen=True, extra="forbid")


class ObjectRef(_Part):
    """One object of the dictionary, written "6064:00" in the file (hexadecimal)."""

    index: int = Field(ge=0x1000, le=0xFFFF)
    subindex: int = Field(ge=0, le=0xFF)

    def __str__(self) -> str:
        return f"{self.index:04X}:{self.subindex:02X}"


def _parse_ref(value: Any) -> Any:
    if not isinstance(value, str):
        return value
    index, _, subindex = value.partition(":")
    try:
        return {"index": int(index, 16), "subindex": int(subindex or "0", 16)}
    except ValueError:
        raise ValueError(f'"{value}" is no object; write index and sub-index like "6064:00"') from None


Ref = Annotated[ObjectRef, BeforeValidator(_parse_ref)]
Positive = Annotated[float, Field(gt=0, allow_inf_nan=False)]
QuantityUnit = Literal["encoder", "si_unit_velocity", "rated_torque", "literal"]


class Identity(_Part):
    """Object 1018; a drive that answers otherwise is refused. A revision is compared only where given."""

    vendor_id: int = Field(ge=0, le=0xFFFFFFFF)
    product_code: int | None = Field(default=None, ge=0, le=0xFFFFFFFF)
    revision: int | None = Field(default=None, ge=0, le=0xFFFFFFFF)


class Quantity(_Part):
    """One quantity exchanged cyclically, and how its counts become SI.

    unit: "encoder" (2π/608F per count, with gear 6091 and feed 6092), "si_unit_velocity" (60A9),
    "rated_torque" (per mille of 6076, times `rated_torque_scale` N·m per count of 6076), "literal" (`scale`).
    """

    object: Ref
    unit: QuantityUnit
    scale: float | None = None  # SI per count, for "literal"; a negative one turns the direction
    rated_torque_scale: Positive = 1e-3  # N·m per count of 6076: mN·m by CiA 402, µN·m on some

    @model_validator(mode="after")
    def _literal_has_scale(self) -> Quantity:
        if (self.unit == "literal") != (self.scale is not None) or self.scale == 0:
            raise ValueError('unit = "literal" goes with a scale other than 0, and only that unit does')
        return self


class PositionQuantity(Quantity):
    """Position also has an object that takes the demand."""

    demand: Ref


class InjectedQuantity(Quantity):
    """The injected torque, and what the drive does with it between two SYNCs."""

    between_syncs: Literal["held", "interpolated"] = "held"


class Quantities(_Part):
    """What is sampled and commanded; speed and injection may be missing."""

    position: PositionQuantity
    torque: Quantity
    speed: Quantity | None = None
    torque_added: InjectedQuantity | None = None
    acceleration: Quantity | None = (
        None  # of 6083 and 6084 where 60AA does not say it: "literal", rad/s² per count
    )


class Pdo(_Part):
    """One PDO with its mapped objects in order; numbers count from 1."""

    direction: Literal["rpdo", "tpdo"]
    number: int = Field(ge=1, le=512)
    entries: tuple[Ref, ...] = Field(min_length=1, max_length=8)

    @model_validator(mode="after")
    def _no_object_twice(self) -> Pdo:
        if len(set(map(str, self.entries))) != len(self.entries):
            raise ValueError("an object is mapped twice")
        return self


class Sync(_Part):
    """Abilities around SYNC."""

    counter: bool = False  # 1019 is there
    clocked_by_sync: Ref | None = None  # reads 1 where the plant's time is SYNC itself


class Setting(_Part):
    """An object and the value that it shall have."""

    object: Ref
    value: int


class Stop(_Part):
    """What the drive shall do by itself; absent: the drive's own setting stays."""

    quick_stop_option: Setting | None = None  # 605A
    connection_lost: Setting | None = None  # 6007
    fault_reaction: Setting | None = None  # 605E


class TableExport(_Part):
    """Load inertia over load angle, for the drive's feed-forward."""

    values: Ref  # array; sub-indices 1…points
    points: int = Field(ge=2, le=254)
    scale_kgm2: Positive  # kg·m² per count
    start: Ref  # angle of the first point
    step: Ref  # angle between points
    angle_scale_rad: Positive  # rad per count
    count: Ref | None = None  # points in use
    enable: Setting | None = None


class ScalarExport(_Part):
    """One number for the load inertia."""

    object: Ref
    scale_kgm2: Positive
    enable: Setting | None = None


class Export(_Part):
    """Where an estimated inertia can be written."""

    table: TableExport | None = None
    scalar: ScalarExport | None = None


class ScaledObject(_Part):
    """An object and the SI value of one count."""

    object: Ref
    scale: Positive


class Control(_Part):
    """The cascade as the drive holds it, for the believed machine: 1/s, N·m·s/rad, s, 1."""

    position_gain: ScaledObject | None = None
    speed_gain: ScaledObject | None = None
    speed_integral_time: ScaledObject | None = None
    speed_feed_forward: ScaledObject | None = None


class DeviceProfile(_Part):
    """A drive family, as device_profiles/<family>/profile.toml describes it."""

    version: Literal[1]
    family: str
    name: str
    verified: Literal["bench", "hardware"]
    eds: str
    source: str = ""
    identity: Identity | None = None  # absent: any drive is accepted
    modes: dict[OperatingMode, int]
    quantities: Quantities
    pdo: tuple[Pdo, ...]
    sync: Sync = Sync()
    stop: Stop = Stop()
    export: Export = Export()
    control: Control = Control()
    folder: Path = Field(default=Path(), exclude=True)  # where the file lies; set by load_profile

    @property
    def eds_path(self) -> Path:
        """The EDS file beside the profile."""
        return self.folder / self.eds

    @property
    def rpdos(self) -> tuple[Pdo, ...]:
        """PDOs that the drive receives, by number."""
        return tuple(sorted((p for p in self.pdo if p.direction == "rpdo"), key=lambda p: p.number))

    @property
    def tpdos(self) -> tuple[Pdo, ...]:
        """PDOs that the drive sends, by number."""
        return tuple(sorted((p for p in self.pdo if p.direction == "tpdo"), key=lambda p: p.number))

    @model_validator(mode="after")
    def _pdos_carry_the_exchange(self) -> DeviceProfile:
        numbers = [(p.direction, p.number) for p in self.pdo]
        if len(set(numbers)) != len(numbers):
            raise ValueError("[[pdo]]: a direction and number occurs twice")
        if len(self.rpdos) != 1:
            raise ValueError("[[pdo]]: one rpdo is needed, so that one identifier carries a whole motion")
        q = self.quantities
        sent = {str(entry) for entry in self.rpdos[0].entries}
        answered = {str(entry) for pdo in self.tpdos for entry in pdo.entries}
        demanded = ["6040:00", str(q.position.demand)] + (
            [str(q.torque_added.object)] if q.torque_added else []
        )
        sampled = ["6041:00", *(str(x.object) for x in (q.position, q.torque, q.speed) if x is not None)]
        for names, mapped, kind in ((demanded, sent, "rpdo"), (sampled, answered, "tpdo")):
            missing = [name for name in names if name not in mapped]
            if missing:
                raise ValueError(f"[[pdo]]: no {kind} carries {', '.join(missing)}")
        return self


def profile_folders() -> tuple[Path, ...]:
    """Where profiles are looked for: inside the installed package, then the repository's own folder."""
    package = Path(schwung.__file__).parent
    candidates = (package / "device_profiles", package.parent.parent / "device_profiles")
    return tuple(folder for folder in candidates if folder.is_dir())


def load_profile(name_or_path: str | Path) -> DeviceProfile:
    """Load a profile by family name ("schwung-bench") or by path of its folder or file.

    Raises InputError naming file, key and remedy.
    """
    path = Path(name_or_path)
    candidates = [path / "profile.toml" if path.is_dir() else path]
    if len(path.parts) == 1:
        candidates = [folder / path / "profile.toml" for folder in profile_folders()] + candidates
    for file in candidates:
        if file.is_file():
            return _read(file)
    known = ", ".join(_families())
    raise InputError(f'profile "{name_or_path}"', "is neither a known family nor a file", f"Known: {known}.")


def list_profiles() -> tuple[DeviceProfile, ...]:
    """Every profile that comes with Schwung, by family name."""
    return tuple(load_profile(family) for family in _families())


def _families() -> list[str]:
    return sorted(
        {file.parent.name for folder in profile_folders() for file in folder.glob("*/profile.toml")}
    )


def _read(file: Path) -> DeviceProfile:
    try:
        content = tomllib.loads(file.read_text(encoding="utf-8"))
    except (OSError, UnicodeDecodeError) as error:
        raise InputError(str(file), f"cannot be read ({error})", "Give a readable UTF-8 file.") from error
    except tomllib.TOMLDecodeError as error:
        raise InputError(str(file), f"is no TOML: {error}", "Mend the line that it names.") from error
    try:
        profile = DeviceProfile.model_validate({**content, "folder": file.parent})
    except ValidationError as error:
        first = error.errors()[0]
        key = ".".join(str(part) for part in first["loc"]) or "file"
        problem = first["msg"].removeprefix("Value error, ")
        raise InputError(
            f"{file}, {key}", problem, "Compare with device_profiles/schwung-bench/profile.toml."
        ) from error
    if not profile.eds_path.is_file():
        raise InputError(f"{file}, eds", f'"{profile.eds}" does not lie beside it', "Put the EDS there.")
    return profile
