"""Which object plays which part in a drive family: what the bench takes from a device profile (profile.toml).

The profile is data that tool and bench share; how it is read is not. The bench looks only at what it acts out, and
leaves the checking of the file to the tool.
"""

from __future__ import annotations

import tomllib
from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from schwung_sim.drives.eds import key
from schwung_sim.errors import BenchError

Table = Mapping[str, Any]
_DEPTH = 4  # of profiles that extend each other


@dataclass(frozen=True)
class Quantity:
    """An object and how its counts become SI; `unit` as docs/profiles.md has it."""

    object: int
    unit: str
    scale: float | None = None
    resolution: int | None = None
    resolution_factor: float = 1.0
    rated: int = key(0x6076)
    rated_torque_scale: float = 1e-3


@dataclass(frozen=True)
class Setting:
    """An object, and the value that means "on" or "so"."""

    object: int
    value: int


@dataclass(frozen=True)
class Scaled:
    """An object and the SI value of one count."""

    object: int
    scale: float


@dataclass(frozen=True)
class Control:
    """A commanding object and its values: of a generator off, on, at_motion; of a trace arm, stop."""

    object: int
    values: Mapping[str, int]


@dataclass(frozen=True)
class Generator:
    """The drive's own sine."""

    amplitude: Quantity
    frequency: Scaled
    phase: Scaled | None
    control: Control


@dataclass(frozen=True)
class Column:
    """One recorded quantity; `scale` None: that of the quantity."""

    quantity: str
    type: str
    scale: float | None
    data: int | None
    selector: int | None
    selection: int | None


@dataclass(frozen=True)
class TraceRole:
    """The drive's own recorder."""

    base_rate_hz: float
    divider: int | None
    period: Scaled | None
    length: int | None
    max_samples: int
    control: Control
    status: int
    status_mask: int
    states: Mapping[str, int]  # "full", "armed", "running"
    trigger: str
    columns: tuple[Column, ...]
    data: int | None


@dataclass(frozen=True)
class TableRole:
    """Load inertia over load angle."""

    values: int
    points: int
    scale_kgm2: float
    start: int
    step: int
    angle_scale_rad: float
    count: int | None
    enable: Setting | None


@dataclass(frozen=True)
class ScalarRole:
    """One number for the inertia, of the load or of all."""

    object: int
    scale_kgm2: float
    per: int | None
    total: bool
    enable: Setting | None


@dataclass(frozen=True)
class HarmonicRole:
    """Load inertia as offset + Σ amplitude·cos(order·angle − phase)."""

    offset: Scaled
    amplitudes: int
    amplitude_scale_kgm2: float
    phases: int
    phase_scale_rad: float
    orders: int
    enable: Setting | None


@dataclass(frozen=True)
class Roles:
    """All parts of one family; the defaults are CiA 402's own."""

    family: str = "cia402"
    modes: Mapping[str, int] = field(default_factory=lambda: {"pp": 1, "csp": 8})
    position: Quantity = Quantity(key(0x6064), "encoder")
    demand: int = key(0x607A)
    speed: Quantity | None = Quantity(key(0x606C), "si_unit_velocity")
    torque: Quantity | None = Quantity(key(0x6077), "rated_torque")
    torque_added: Quantity | None = Quantity(key(0x60B2), "rated_torque")
    acceleration: Quantity | None = None
    clock: int | None = None
    generator: Generator | None = None
    trace: TraceRole | None = None
    table: TableRole | None = None
    scalar: ScalarRole | None = None
    harmonics: HarmonicRole | None = None
    host_played: Quantity | None = None
    gains: Mapping[str, Scaled] = field(default_factory=dict)


def find_profile(name_or_path: str | Path) -> Path:
    """The file of a family by its name, or by the path of its folder or file. Raises BenchError."""
    path = Path(name_or_path)
    room = Path(__file__).resolve().parents[2]  # sim/ in a checkout, site-packages/ when installed
    families = (room.parent / "device_profiles", room / "schwung" / "device_profiles")
    by_name = [folder / path / "profile.toml" for folder in families] if len(path.parts) == 1 else []
    for file in (*by_name, path / "profile.toml", path):
        if file.is_file():
            return file
    raise BenchError(
        f'profile "{name_or_path}"', "is neither a family nor a file", "Name a folder of device_profiles."
    )


def read_profile(file: Path) -> tuple[Table, Path]:
    """What a profile says, with what it extends below it, and where its EDS lies. Raises BenchError."""
    content, folder = _content(file, _DEPTH)
    return content, folder / str(content.get("eds", ""))


def _content(file: Path, depth: int) -> tuple[Table, Path]:
    try:
        content = tomllib.loads(file.read_text(encoding="utf-8"))
    except (OSError, ValueError) as error:
        raise BenchError(str(file), f"cannot be read as a profile ({error})") from error
    base = content.pop("extends", None)
    if base is None or not depth:
        return content, file.parent
    beside = (file.parent / str(base)).resolve()
    below, folder = _content(find_profile(beside if beside.exists() else str(base)), depth - 1)
    return _merged(below, content), file.parent if "eds" in content else folder


def _merged(below: Table, above: Table) -> dict[str, Any]:
    """Tables are merged key by key. A quantity whose unit changes is a new one, at its old objects."""
    merged = dict(below)
    for name, value in above.items():
        old = merged.get(name)
        if isinstance(old, Mapping) and isinstance(value, Mapping):
            kept = old if "unit" not in value else {k: v for k, v in old.items() if k in ("object", "demand")}
            merged[name] = _merged(kept, value)
        else:
            merged[name] = value
    return merged


def read_roles(content: Table) -> Roles:
    """The roles in a CANopen profile. Raises BenchError where a part has no object."""
    try:
        quantities, export = content["quantities"], content.get("export", {})
        stored = content.get("control", {})
        position = quantities["position"]
        return Roles(
            family=content["family"],
            modes=content.get("modes", {}),
            position=_quantity(position),
            demand=_key(position["demand"]),
            speed=_quantity(quantities.get("speed")),
            torque=_quantity(quantities.get("torque")),
            torque_added=_quantity(quantities.get("torque_added")),
            acceleration=_quantity(quantities.get("acceleration")),
            clock=_optional(content.get("sync", {}).get("clocked_by_sync")),
            generator=_generator(content.get("generator")),
            trace=_trace(content.get("trace")),
            table=_table(export.get("table")),
            scalar=_scalar(export.get("scalar")),
            harmonics=_harmonics(export.get("harmonics")),
            host_played=_quantity(export.get("host_played")),
            gains={name: _scaled(part) for name, part in stored.items()},
        )
    except (KeyError, TypeError, ValueError, AttributeError) as error:
        raise BenchError(
            f"profile {content.get('family', '')}".rstrip(),
            f"cannot be acted out ({type(error).__name__}: {error})",
            "See `schwung profile check`.",
        ) from error


def _key(text: str) -> int:
    index, _, subindex = text.partition(":")
    return key(int(index, 16), int(subindex or "0", 16))


def _optional(text: str | None) -> int | None:
    return None if text is None else _key(text)


def _quantity(part: Table | None) -> Any:
    if part is None:
        return None
    return Quantity(
        object=_key(part["object"]),
        unit=part["unit"],
        scale=part.get("scale"),
        resolution=_optional(part.get("resolution")),
        resolution_factor=part.get("resolution_factor", 1.0),
        rated=_key(part.get("rated", "6076:00")),
        rated_torque_scale=part.get("rated_torque_scale", 1e-3),
    )


def _setting(part: Table | None) -> Setting | None:
    return None if part is None else Setting(_key(part["object"]), part["value"])


def _scaled(part: Table) -> Scaled:
    return Scaled(_key(part["object"]), float(part["scale"]))


def _control(part: Table) -> Control:
    return Control(_key(part["object"]), {name: value for name, value in part.items() if name != "object"})


def _generator(part: Table | None) -> Generator | None:
    if part is None:
        return None
    phase = part.get("phase")
    return Generator(
        _quantity(part["amplitude"]),
        _scaled(part["frequency"]),
        None if phase is None else _scaled(phase),
        _control(part["control"]),
    )


def _trace(part: Table | None) -> TraceRole | None:
    if part is None:
        return None
    period, status = part.get("period"), part["status"]
    return TraceRole(
        base_rate_hz=float(part["base_rate_hz"]),
        divider=_optional(part.get("divider")),
        period=None if period is None else _scaled(period),
        length=_optional(part.get("length")),
        max_samples=part["max_samples"],
        control=_control(part["control"]),
        status=_key(status["object"]),
        status_mask=status.get("mask", 0xFFFFFFFF),
        states={name: status[name] for name in ("full", "armed", "running") if name in status},
        trigger=part["trigger"],
        columns=tuple(_column(column) for column in part["columns"]),
        data=_optional(part.get("data")),
    )


def _column(part: Table) -> Column:
    return Column(
        part["quantity"],
        part["type"],
        part.get("scale"),
        _optional(part.get("data")),
        _optional(part.get("selector")),
        part.get("selection"),
    )


def _table(part: Table | None) -> TableRole | None:
    if part is None:
        return None
    return TableRole(
        values=_key(part["values"]),
        points=part["points"],
        scale_kgm2=part["scale_kgm2"],
        start=_key(part["start"]),
        step=_key(part["step"]),
        angle_scale_rad=part["angle_scale_rad"],
        count=_optional(part.get("count")),
        enable=_setting(part.get("enable")),
    )


def _scalar(part: Table | None) -> ScalarRole | None:
    if part is None:
        return None
    return ScalarRole(
        _key(part["object"]),
        part["scale_kgm2"],
        _optional(part.get("per")),
        part.get("of", "load") == "total",
        _setting(part.get("enable")),
    )


def _harmonics(part: Table | None) -> HarmonicRole | None:
    if part is None:
        return None
    return HarmonicRole(
        _scaled(part["offset"]),
        _key(part["amplitudes"]),
        part["amplitude_scale_kgm2"],
        _key(part["phases"]),
        part["phase_scale_rad"],
        part["orders"],
        _setting(part.get("enable")),
    )
