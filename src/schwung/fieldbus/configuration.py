"""Which objects of a CANopen drive are its configuration: what is worth keeping, and what must not be written back."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from pathlib import Path

from schwung.errors import InputError
from schwung.fieldbus.drive import DriveIdentity, Parameter, ParameterValue
from schwung.fieldbus.eds import EdsFile, read_eds
from schwung.fieldbus.eds.model import Variable
from schwung.fieldbus.profile import CanopenProfile

#: Objects of the standards that are commands or live values, though they can be written (CiA 301, 302, 402).
_NO_PARAMETERS = {
    0x1003: "error history: writing it clears it",
    0x1010: "command: stores parameters",
    0x1011: "command: restores defaults",
    0x1013: "live: time stamp",
    0x1020: "kept by the configuration manager, not by the drive",
    0x1023: "command: of the operating system",
    0x1024: "command: of the operating system",
    0x1025: "command: debugger",
    0x1026: "live: terminal",
    0x6040: "command: controlword",
    0x607A: "live: target position",
    0x60B0: "live: position offset",
    0x60B1: "live: speed offset",
    0x60B2: "live: torque offset",
    0x60C1: "live: interpolation data",
    0x60FE: "live: digital outputs",
    0x60FF: "live: target speed",
    0x6071: "live: target torque",
    0x6042: "live: target speed",
}
_SDO_CHANNELS = "SDO channels: changing the one in use would cut us off"
_PROGRAM = "program download and control"


@dataclass(frozen=True)
class Skipped:
    """A parameter that can be read and written by its EDS, but is not part of the configuration, and why."""

    parameter: Parameter
    reason: str


@dataclass(frozen=True)
class Selection:
    """What an EDS declares: what is the configuration, what is left out, and how much is only read or only written."""

    wanted: tuple[Parameter, ...]
    skipped: tuple[Skipped, ...]
    read_only: int
    write_only: int


def dictionary_of(
    eds: Path | None, profile: CanopenProfile, identity: DriveIdentity, node_id: int
) -> EdsFile:
    """The EDS of a drive as given, else its profile's.

    Raises InputError for one of another manufacturer: what it names would mean something else in this drive.
    """
    dictionary = read_eds(eds or profile.eds_path, node_id)
    told = dictionary.dictionary.device_information.vendor_number
    if eds is not None and told and told != identity.vendor_id:
        raise InputError(
            str(eds), f"is of vendor 0x{told:08X}, and node {identity.node_id} of 0x{identity.vendor_id:08X}",
            "Give the EDS of this drive.",
        )  # fmt: skip
    return dictionary


def select(file: EdsFile, profile: CanopenProfile | None = None) -> Selection:
    """Sort the variables of an EDS. The profile adds what it knows to be a command."""
    commands = _commands(profile)
    wanted, skipped = [], []
    read_only = write_only = 0
    for variable in file.description.variables():
        if not variable.writable:
            read_only += 1
        elif not variable.readable:
            write_only += 1
        else:
            parameter = file.parameter_of(variable)
            reason = _reason(variable, commands)
            if reason:
                skipped.append(Skipped(parameter, reason))
            else:
                wanted.append(parameter)
    return Selection(tuple(wanted), tuple(skipped), read_only, write_only)


def mapped_live(values: Iterable[ParameterValue]) -> dict[tuple[int, int], str]:
    """Objects that the RPDOs among these values carry, by index and sub-index: their values are live."""
    held = {(v.parameter.index, v.parameter.subindex): v.raw for v in values if isinstance(v.raw, int)}
    live = {}
    for number in range(512):
        cob_id, count = held.get((0x1400 + number, 1)), held.get((0x1600 + number, 0))
        if cob_id is None or not isinstance(count, int) or int(cob_id) & 0x80000000:
            continue
        for subindex in range(1, min(count, 64) + 1):
            entry = int(held.get((0x1600 + number, subindex), 0))
            live[entry >> 16, entry >> 8 & 0xFF] = f"live: RPDO {number + 1} writes it"
    return live


def _commands(profile: CanopenProfile | None) -> Mapping[tuple[int, int], str]:
    if profile is None:
        return {}
    words = {
        "generator.control.object": "command: starts the generator",
        "trace.control.object": "command: arms the trace",
        "trace.data": "live: trace data",
        "disturbance_buffer.control.object": "command: starts the buffer",
        "quantities.torque_added.object": "live: torque offset",
        "quantities.position.demand": "live: target position",
    }
    return {(ref.index, ref.subindex): words[place] for place, ref in profile.refs() if place in words}


def _reason(variable: Variable, commands: Mapping[tuple[int, int], str]) -> str:
    """Why a variable is no part of the configuration; empty where it is."""
    index = variable.index
    reasons = (
        (0x1200 <= index < 0x1300, _SDO_CHANNELS),
        (0x1F50 <= index < 0x1F58, _PROGRAM),
        (index in _NO_PARAMETERS, _NO_PARAMETERS.get(index, "")),
        ((index, variable.subindex) in commands, commands.get((index, variable.subindex), "")),
        (variable.type == "DOMAIN", "a block of data, no parameter"),
        (variable.refuses_read, "the EDS asks not to read it (ObjFlags)"),
        (variable.refuses_write, "the EDS asks not to write it (ObjFlags)"),
    )
    return next((reason for holds, reason in reasons if holds), "")
