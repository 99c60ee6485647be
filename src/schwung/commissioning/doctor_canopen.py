"""The part of the doctor that knows CANopen: the bus, who is on it, and whether the EDS is that of the drive."""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from pathlib import Path

import can

from schwung.commissioning.backup import was_refused
from schwung.commissioning.checks import Check
from schwung.commissioning.doctor import (
    Diagnosis,
    Phase,
    absent_text,
    examine_drive,
    pending_backups,
    state_checks,
    with_checks,
)
from schwung.errors import BusError, DriveError, InputError, ParameterError, SdoError
from schwung.fieldbus import cia402
from schwung.fieldbus.canopen import BusOptions, CanopenDrive, bit_rate, match_profile, open_bus, scan_bus
from schwung.fieldbus.canopen.emcy import describe_code
from schwung.fieldbus.canopen.listening import Heard, listen
from schwung.fieldbus.canopen.sdo import is_absent
from schwung.fieldbus.drive import DriveState, Parameter, RawValue
from schwung.fieldbus.eds import EdsFile, read_eds
from schwung.fieldbus.profile import CanopenProfile, load_canopen_profile
from schwung.fieldbus.profile.check import check_profile

LISTEN_S = 0.5
_SAMPLED = 80  # objects of the EDS that are asked for, beside those of the profile
_GENERIC = "generic-cia402"
_ABSENT, _HIDDEN, _RESIZED = "the drive does not have", "it refuses to show", "it has in another size"


def examine(
    options: BusOptions, node_id: int, profile_name: str | None, eds: Path | None, folder: Path, phase: Phase
) -> Diagnosis:
    """Look at a drive on CANopen from the cable up; stops where nothing more can be seen. Writes nothing.

    Raises InputError for options that are wrong in themselves.
    """
    named = load_canopen_profile(profile_name) if profile_name else None
    options.resolve()
    try:
        bus = open_bus(options)
    except BusError as error:
        return with_checks(
            Diagnosis(()), [Check("bus", "stop", f"{error.place}: {error.problem}", error.remedy)]
        )
    try:
        phase("Listening")
        heard = listen(bus, LISTEN_S)
        found = list(bus_checks(heard, bit_rate(options), str(bus.channel_info)))
        phase(f"Asking node {node_id}")
        profile = named or _matching(bus, node_id, heard, found)
        if profile is None:
            return with_checks(Diagnosis(()), found)
        try:
            drive = CanopenDrive(bus, node_id, profile, bit_rate=bit_rate(options), bus_options=options)
        except InputError as error:
            answers = "does not answer" not in error.problem
            found += (
                [Check("identity", "stop", f"{error.place}: {error.problem}", error.remedy)]
                if answers
                else node_checks(bus, node_id, heard)
            )
            return with_checks(Diagnosis((), profile.family), found)
        dictionary = read_eds(eds or profile.eds_path, node_id)
        try:
            diagnosis = _look(drive, profile, dictionary, heard, phase)
        finally:
            drive.close()
        found += profile_checks(profile, dictionary) if eds is not None else ()
        return with_checks(diagnosis, [*found, *pending_backups([folder], drive.identity)])
    finally:
        bus.shutdown()


def _look(
    drive: CanopenDrive, profile: CanopenProfile, dictionary: EdsFile, heard: Heard, phase: Phase
) -> Diagnosis:
    """All that the drive answers; where it stops answering, that is the gravest finding."""
    diagnosis = Diagnosis((), profile.family, drive.identity)
    more: list[Check] = []
    try:
        diagnosis = examine_drive(drive, profile, phase)
        if not any(check.name == "state" for check in diagnosis.checks):
            more += state_without_units(drive, dictionary)
        more += standard_checks(drive, dictionary, heard)
        phase("Comparing the EDS with the drive")
        more += dictionary_checks(drive, dictionary, profile)
    except DriveError as error:
        remedy = error.remedy or "Check its supply and the cable."
        more.append(Check("answers", "stop", f"not any more: {error.place}: {error.problem}", remedy))
    return with_checks(diagnosis, more)


def _matching(bus: can.BusABC, node_id: int, heard: Heard, found: list[Check]) -> CanopenProfile | None:
    """The profile by identity; where none fits, the generic one with a warning. None: nobody answers."""
    try:
        profile = match_profile(bus, node_id)
    except InputError as error:
        if "does not answer" in error.problem:
            found += node_checks(bus, node_id, heard)
            return None
        found.append(Check(
            "profile", "warning", f"{error.problem}; the generic one is used here",
            "Draft one with `schwung profile new --eds`, or name one with --profile.",
        ))  # fmt: skip
        return load_canopen_profile(_GENERIC)
    return profile


def bus_checks(heard: Heard, rate: int | None, name: str) -> Iterator[Check]:
    """Is the bus alive, at which bit rate, and is somebody else its master?"""
    if heard.failure:
        yield Check("bus", "stop", f"{name}: cannot be read ({heard.failure})", "Is the interface up?")
    elif heard.error_frames:
        yield Check(
            "bus", "stop", f"{heard.error_frames} error frames within {heard.duration_s:g} s",
            "Check bit rate, termination (120 Ω at both ends) and cable.",
        )  # fmt: skip
    else:
        yield Check("bus", "ok", f"{name} is open, {heard.count} frames heard within {heard.duration_s:g} s")
    if rate is None:
        yield Check(
            "bit rate", "note", "unknown to us; 1000 kbit/s is assumed for the load", "Give --bitrate."
        )
    else:
        yield Check("bit rate", "ok", f"{rate / 1000:g} kbit/s")
    if heard.syncs or heard.commands:
        what = " and ".join(
            words for words, count in (("SYNC", heard.syncs), ("NMT commands", heard.commands)) if count
        )
        yield Check(
            "other master", "stop", f"somebody else sends {what} on this bus",
            "Stop the PLC or the vendor's tool: a bus has one master.",
        )  # fmt: skip


def node_checks(bus: can.BusABC, node_id: int, heard: Heard) -> list[Check]:
    """Nobody answered: who does?"""
    others = [found.node_id for found in scan_bus(bus)]
    listed = ", ".join(map(str, others))
    if others:
        what = f"node {node_id} does not answer; {'these do' if len(others) > 1 else 'this does'}: {listed}"
        return [Check("node", "stop", what, f"Give --node {others[0]}, or set the id at the drive.")]
    if heard.heartbeats:
        beating = ", ".join(f"{node} ({state.lower()})" for node, state in sorted(heard.heartbeats.items()))
        return [Check("node", "stop", f"nobody answers, but heartbeats come: {beating}",
                      "A stopped node takes no SDO: cycle its power.")]  # fmt: skip
    if heard.count:
        return [Check("node", "stop", f"nobody answers, though {heard.count} frames were heard",
                      "Is the drive's CANopen switched on, and its node id between 1 and 126?")]  # fmt: skip
    return [Check(
        "node", "stop", "nobody answers, and nothing is heard",
        "Check the drive's supply, cable, termination (120 Ω at both ends), and that the bit rate is the drive's.",
    )]  # fmt: skip


def standard_checks(drive: CanopenDrive, dictionary: EdsFile, heard: Heard) -> Iterator[Check]:
    """What the objects of the standards tell: kind of device, supply, inputs, heartbeat, errors of the past."""
    read = _Reader(drive, dictionary)
    kind = read.integer(0x1000)
    if kind and kind & 0xFFFF != 402:
        yield Check(
            "device type",
            "warning",
            f"1000 is 0x{kind:08X}: no CiA 402 drive by its own word",
            "Is it the right node?",
        )
    yield from _supply(read)
    yield from _heartbeat(read, drive, heard)
    history = read.integer(0x1003)
    if history:
        last = read.integer(0x1003, 1)
        code = f", the last 0x{last & 0xFFFF:04X}" if last else ""
        yield Check("error history", "note", f"{history} errors are kept in 1003{code}", "")
    for node, emergency in heard.emergencies:
        if node == drive.node_id and not emergency.is_reset:
            yield Check(
                "emergency", "warning", f"the drive just sent {emergency}", "Look for its cause first."
            )


def state_without_units(drive: CanopenDrive, dictionary: EdsFile) -> Iterator[Check]:
    """The state alone, of a drive whose position has no unit yet."""
    read = _Reader(drive, dictionary)
    status, code = read.integer(0x6041), read.integer(0x603F)
    name = "unknown" if status is None else cia402.decode(status).value
    state = DriveState("UNKNOWN", name, math.nan, describe_code(code) if code else "")
    return (check for check in state_checks(state) if check.name == "state")


def _supply(read: _Reader) -> Iterator[Check]:
    status = read.integer(0x6041) or 0
    if status & 0x80:
        yield Check(
            "warning bit", "note", "the drive warns (statusword bit 7)", "The vendor's manual says of what."
        )
    volts = read.integer(0x6079)
    if volts is not None:
        yield (
            Check("DC link", "ok", f"{volts / 1000:g} V")
            if volts
            else Check("DC link", "note", "0 V, or it does not tell (6079)", "Is the power supply on?")
        )


def _heartbeat(read: _Reader, drive: CanopenDrive, heard: Heard) -> Iterator[Check]:
    period = read.integer(0x1017)
    if period is None:
        yield Check(
            "heartbeat", "stop", "the drive has no producer heartbeat (1017): we could not see it die",
            "Commissioning needs it; take another profile or firmware.",
        )  # fmt: skip
    elif drive.node_id in heard.heartbeats or period:
        yield Check("heartbeat", "ok", f"every {period} ms" if period else "comes")
    else:
        yield Check("heartbeat", "ok", "off now; it is switched on for the time of commissioning")


def dictionary_checks(drive: CanopenDrive, dictionary: EdsFile, profile: CanopenProfile) -> Iterator[Check]:
    """Is the EDS of this drive and of this firmware? A sample of its objects is asked for."""
    told = dictionary.description.device_info.get("RevisionNumber")
    revision = drive.identity.revision
    if told and int(told, 0) not in (0, revision):
        yield Check(
            "firmware", "note", f"the EDS is for revision 0x{int(told, 0):08X}, the drive has 0x{revision:08X}",
            "Where objects are missing below, ask the vendor for the EDS of this firmware.",
        )  # fmt: skip
    missing: dict[str, list[Parameter]] = {}
    asked = _sample(dictionary, profile)
    for parameter in asked:
        try:
            drive.read(parameter)
        except ParameterError as error:
            if not was_refused(error):
                raise
            gone = isinstance(error, SdoError) and is_absent(error)
            missing.setdefault(_ABSENT if gone else _HIDDEN, []).append(parameter)
        except InputError:
            missing.setdefault(_RESIZED, []).append(parameter)
    name = dictionary.path.name
    if missing:
        told = "; ".join(f"{words} {absent_text(found)}" for words, found in missing.items())
        yield Check(
            "EDS", "warning", f"of {len(asked)} objects of {name}, {told}",
            "Give the vendor's EDS of this firmware (--eds); what is needed of them is told above.",
        )  # fmt: skip
    else:
        yield Check("EDS", "ok", f"{len(asked)} objects of {name} are all there")
    if dictionary.warnings:
        count = len(dictionary.warnings)
        told = (
            f"{count} oddities in {dictionary.path.name}, the first"
            if count > 1
            else f"odd in {dictionary.path.name}"
        )
        more = "`schwung profile check --eds` lists them." if count > 1 else ""
        yield Check("EDS file", "note", f"{told}: {dictionary.warnings[0]}", more)


def profile_checks(profile: CanopenProfile, dictionary: EdsFile) -> Iterator[Check]:
    """Where the vendor's own EDS contradicts the profile: types, access, what a PDO can carry.

    Of the EDS of another manufacturer that alone is told: all else would follow from it.
    """
    found = [finding for finding in check_profile(profile, dictionary) if finding.severity == "error"]
    foreign = [finding for finding in found if finding.place == "identity.vendor_id"]
    for finding in foreign or found:
        yield Check("profile and EDS", "warning", f"{finding.place}: {finding.problem}", finding.remedy)


def _sample(dictionary: EdsFile, profile: CanopenProfile) -> Sequence[Parameter]:
    """What the profile names, and some of everything else, evenly."""
    chosen: dict[tuple[int, int], Parameter] = {}
    for _, ref in profile.refs():
        found = dictionary.find(ref.index, ref.subindex)
        if found is not None and _harmless(dictionary, ref.index, ref.subindex):
            chosen[ref.index, ref.subindex] = found
    rest = [v for v in dictionary.description.variables() if _harmless(dictionary, v.index, v.subindex)]
    step = max(1, math.ceil(len(rest) / _SAMPLED))
    for variable in rest[::step]:
        chosen.setdefault((variable.index, variable.subindex), dictionary.parameter_of(variable))
    return [chosen[key] for key in sorted(chosen)]


def _harmless(dictionary: EdsFile, index: int, subindex: int) -> bool:
    """Readable, short, none that the EDS asks not to read, and none that may be hidden while it is not in use: PDO
    entries, the error history."""
    variable = dictionary.variable(index, subindex)
    if variable is None or not variable.readable or variable.refuses_read or variable.type == "DOMAIN":
        return False
    mapping = 0x1600 <= index < 0x1800 or 0x1A00 <= index < 0x1C00
    return not mapping and not (index == 0x1003 and subindex)


class _Reader:
    """Integers of a drive by index; None where EDS or drive do not have them."""

    def __init__(self, drive: CanopenDrive, dictionary: EdsFile) -> None:
        self._drive, self._dictionary = drive, dictionary

    def integer(self, index: int, subindex: int = 0) -> int | None:
        parameter = self._dictionary.find(index, subindex)
        if parameter is None:
            return None
        try:
            raw: RawValue = self._drive.read(parameter).raw
        except InputError:
            return None
        except ParameterError as error:
            if not was_refused(error):
                raise
            return None
        return raw if isinstance(raw, int) else None
