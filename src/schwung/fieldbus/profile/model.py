"""A drive family, as device_profiles/<family>/profile.toml describes it."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path
from typing import Any, Literal, get_args

from pydantic import BaseModel, Field, model_validator

from schwung.fieldbus.drive import OperatingMode
from schwung.fieldbus.profile.acquire import DisturbanceBuffer, Generator, Trace
from schwung.fieldbus.profile.modbus import Limits, Modbus, RegisterIdentity, State, Strokes
from schwung.fieldbus.profile.parts import ObjectRef, Part, Quantities, Quantity, Ref, ScaledObject, Setting
from schwung.fieldbus.profile.targets import Control, Export, Stop

#: What commissioning may want of a drive; the keys of [cannot].
CapabilityName = Literal[
    "cyclic position", "profile position", "sampling by SYNC", "trace buffer", "speed", "torque",
    "torque injection", "generator", "disturbance buffer", "lockstep", "stop by heartbeat",
    "table feed-forward", "scalar feed-forward", "harmonic feed-forward", "host-played feed-forward",
    "control gains", "store",
]  # fmt: skip
CAPABILITIES: tuple[CapabilityName, ...] = get_args(CapabilityName)


class DeviceProfile(Part):
    """What is common to all protocols: who it is, its quantities, what it can do by itself, and what it cannot."""

    version: Literal[1]
    """Version of this format."""
    protocol: Literal["canopen", "modbus"] = "canopen"
    """The bus that it speaks."""
    family: str = Field(pattern=r"^[a-z0-9][a-z0-9-]*$")
    """Name on the command line, and of the folder."""
    name: str
    """Name for people."""
    verified: Literal["bench", "hardware"]
    """How far it is proven: against the simulated drive only, or on a real one."""
    source: str = ""
    """Where the facts are from, in general."""
    sources: dict[str, str] = Field(default_factory=dict)
    """Where single facts are from: part of the profile ("quantities.torque") = source. Every object of the
    manufacturer's range and every literal scale has one."""
    cannot: dict[CapabilityName, str] = Field(default_factory=dict)
    """Capability = why this profile cannot offer it, as the rest of "this profile can't do that, because …"."""
    noted: dict[CapabilityName, tuple[Ref, ...]] = Field(default_factory=dict)
    """Capability = objects that the drive has for it, and that nobody has described well enough to use them."""
    quirks: tuple[str, ...] = ()
    """What is odd about the family, one sentence each, for people."""
    modes: dict[OperatingMode, int] = Field(default_factory=dict)
    """Value of the operating mode (6060) for each mode that Schwung can use: csp, pp."""
    quantities: Quantities
    """What is sampled and commanded, and in which units."""
    generator: Generator | None = None
    """The drive's own sine."""
    disturbance_buffer: DisturbanceBuffer | None = None
    """Torque values that the drive plays from its memory."""
    trace: Trace | None = None
    """The drive's own recorder."""
    stop: Stop = Stop()
    """What the drive shall do by itself when something goes wrong."""
    export: Export = Export()
    """Where an estimated inertia can be written."""
    control: Control = Control()
    """The cascade as the drive holds it."""
    folder: Path = Field(default=Path(), exclude=True)
    """Where the file lies; set by load_profile."""

    def offers(self, capability: CapabilityName) -> bool:
        """True where the profile offers it; the drive may still lack it."""
        return capability not in self.cannot and self._parts().get(capability, True)

    def reason(self, capability: CapabilityName) -> str:
        """Why the profile does not offer a capability, as a sentence."""
        q, played = self.quantities, self.export.host_played
        asked = {
            "torque": q.torque,
            "speed": q.speed,
            "torque injection": q.torque_added,
            "host-played feed-forward": played,
        }.get(capability)
        silent = "its time is its own clock" if capability == "lockstep" else "it says nothing of it"
        hint = asked.hint if asked is not None and asked.unit == "user" else silent
        return f"this profile can't do that, because {self.cannot.get(capability, hint)}"

    def _parts(self) -> dict[CapabilityName, bool]:
        """Capabilities that a part of the file stands for, and whether it is there with a unit."""
        q, export, control = self.quantities, self.export, self.control
        return {
            "cyclic position": "csp" in self.modes,
            "profile position": "pp" in self.modes,
            "trace buffer": self.trace is not None,
            "speed": _has_unit(q.speed),
            "torque": _has_unit(q.torque),
            "torque injection": _has_unit(q.torque_added),
            "generator": self.generator is not None,
            "disturbance buffer": self.disturbance_buffer is not None,
            "table feed-forward": export.table is not None,
            "scalar feed-forward": export.scalar is not None,
            "harmonic feed-forward": export.harmonics is not None,
            "host-played feed-forward": _has_unit(export.host_played),
            "control gains": any(getattr(control, name) is not None for name in type(control).model_fields),
        }

    def refs(self) -> Iterator[tuple[str, ObjectRef]]:
        """Every object that the profile names, with its place in the file ("quantities.torque.object")."""
        for name in type(self).model_fields:
            if name != "noted":
                yield from _refs(name, getattr(self, name))
        for capability, refs in self.noted.items():
            yield from ((f"noted.{capability}", ref) for ref in refs)

    @model_validator(mode="after")
    def _sources_name_parts(self) -> DeviceProfile:
        for key in self.sources:
            value: Any = self
            for step in key.split("."):
                value = value.get(step) if isinstance(value, dict) else getattr(value, step, None)
            if value is None:
                raise ValueError(f'[sources]: this profile has no part "{key}"')
        return self

    @model_validator(mode="after")
    def _does_not_deny_itself(self) -> DeviceProfile:
        for capability in self.cannot:
            if self._parts().get(capability):
                raise ValueError(f'[cannot]: "{capability}" is offered by another part of the file')
        return self


def _has_unit(quantity: Quantity | None) -> bool:
    return quantity is not None and quantity.unit != "user"


def _refs(place: str, value: Any) -> Iterator[tuple[str, ObjectRef]]:
    if isinstance(value, ObjectRef):
        yield place, value
    elif isinstance(value, BaseModel):
        for name in type(value).model_fields:
            yield from _refs(f"{place}.{name}", getattr(value, name))
    elif isinstance(value, tuple):
        for number, item in enumerate(value, start=1):
            yield from _refs(f"{place}[{number}]", item)
    elif isinstance(value, dict):
        for key, item in value.items():
            yield from _refs(f"{place}.{key}", item)


class Identity(Part):
    """Object 1018; a drive that answers otherwise is refused."""

    vendor_id: int = Field(ge=0, le=0xFFFFFFFF)
    """1018:01."""
    product_code: int | None = Field(default=None, ge=0, le=0xFFFFFFFF)
    """1018:02; absent: any."""
    revision: int | None = Field(default=None, ge=0, le=0xFFFFFFFF)
    """1018:03; absent: any."""


class Pdo(Part):
    """One PDO with its mapped objects in order."""

    direction: Literal["rpdo", "tpdo"]
    """"rpdo": the drive receives it; "tpdo": the drive sends it."""
    number: int = Field(ge=1, le=512)
    """Counted from 1."""
    entries: tuple[Ref, ...] = Field(min_length=1, max_length=8)
    """Mapped objects, 8 bytes in all."""
    fixed: bool = False
    """True where the drive's mapping cannot be changed: `entries` then say what it is."""

    @model_validator(mode="after")
    def _no_object_twice(self) -> Pdo:
        if len(set(map(str, self.entries))) != len(self.entries):
            raise ValueError("an object is mapped twice")
        return self


class Sync(Part):
    """Abilities around SYNC."""

    counter: bool = False
    """True where 1019 is there: SYNC can carry its count."""
    clocked_by_sync: Ref | None = None
    """Object that reads 1 where the plant's time is SYNC itself (simulated drives)."""


class CanopenProfile(DeviceProfile):
    """A family that speaks CANopen (CiA 301, CiA 402)."""

    protocol: Literal["canopen"] = "canopen"
    """The bus that it speaks."""
    eds: str
    """Name of the EDS beside the profile, which holds every object that the profile names."""
    identity: Identity | None = None
    """Object 1018; absent: any drive is accepted."""
    pdo: tuple[Pdo, ...]
    """The cyclic exchange: one RPDO, so that one identifier carries a whole motion, and TPDOs."""
    sync: Sync = Sync()
    """Abilities around SYNC."""
    voltage_bit: Literal["supply", "power_stage"] = "supply"
    """What statusword bit 4 says: the power stage is supplied, as CiA 402 has it, or it is on."""

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

    def _parts(self) -> dict[CapabilityName, bool]:
        position = str(self.quantities.position.object)
        return super()._parts() | {
            "sampling by SYNC": any(position in map(str, pdo.entries) for pdo in self.tpdos),
            "lockstep": self.sync.clocked_by_sync is not None,
        }

    @model_validator(mode="after")
    def _only_objects(self) -> CanopenProfile:
        for place, ref in self.refs():
            if ref.space != "object":
                raise ValueError(f"{place}: {ref} is a register, and this is a CANopen profile")
        return self

    @model_validator(mode="after")
    def _pdos_carry_the_exchange(self) -> CanopenProfile:
        numbers = [(p.direction, p.number) for p in self.pdo]
        if len(set(numbers)) != len(numbers):
            raise ValueError("[[pdo]]: a direction and number occurs twice")
        if len(self.rpdos) != 1:
            raise ValueError("[[pdo]]: one rpdo is needed, so that one identifier carries a whole motion")
        if not self.modes:
            return self  # nothing moves: nothing has to be carried
        q = self.quantities
        if q.position.demand is None:
            raise ValueError("quantities.position: demand is missing, and [modes] says that the drive moves")
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


class ModbusProfile(DeviceProfile):
    """A family that speaks Modbus, on TCP or RTU."""

    protocol: Literal["modbus"]
    """The bus that it speaks."""
    modbus: Modbus
    """How registers make parameters, and how the drive wants to be asked."""
    identity: tuple[RegisterIdentity, ...] = ()
    """Parameters that tell this family from others, the manufacturer's before the product's; absent: any drive is
    accepted."""
    serial: Ref | None = None
    """Where the drive tells its serial number."""
    parameters: dict[str, Ref] = Field(default_factory=dict)
    """The manufacturer's names of parameters: of those that this file uses, and of further ones for a backup."""
    state: State | None = None
    """The CiA 402 state machine in registers."""
    strokes: Strokes | None = None
    """What shapes the drive's own positioning."""
    limits: Limits = Limits()
    """What the drive enforces by itself."""
    watchdog: ScaledObject | None = None
    """How long the drive waits for a request before it stops by itself, s per count; 0: for ever."""
    store: Setting | None = None
    """What saves all parameters in the drive's memory."""

    def _parts(self) -> dict[CapabilityName, bool]:
        return super()._parts() | {
            "sampling by SYNC": False,
            "lockstep": False,
            "stop by heartbeat": self.watchdog is not None,
            "store": self.store is not None,
        }

    @model_validator(mode="after")
    def _only_registers(self) -> ModbusProfile:
        for place, ref in self.refs():
            if ref.space != "register":
                raise ValueError(f'{place}: {ref} is an object; write a register like "@7706:INTEGER32"')
        kinds: dict[int, str] = {}
        for place, ref in self.refs():
            if kinds.setdefault(ref.index, ref.type) != ref.type:
                raise ValueError(f"{place}: {ref} is {ref.type} here and {kinds[ref.index]} elsewhere")
        if "pp" in self.modes:
            missing = [
                name
                for name, part in (
                    ("state", self.state),
                    ("strokes", self.strokes),
                    ("quantities.position.demand", self.quantities.position.demand),
                )
                if part is None
            ]
            if missing:
                raise ValueError(f"modes: pp needs {', '.join(missing)}")
        q = self.quantities
        for name in type(q).model_fields:
            quantity = getattr(q, name)
            if quantity is not None and quantity.unit in ("encoder", "si_unit_velocity"):
                raise ValueError(f'quantities.{name}: unit = "{quantity.unit}" is of CANopen objects')
        return self
