"""What must be written into a drive before it can be commanded and sampled, and in which order it takes it."""

from __future__ import annotations

import contextlib
from collections.abc import Callable, Iterator, Sequence

from schwung.errors import DriveError, InputError
from schwung.fieldbus.canopen import pdo
from schwung.fieldbus.canopen.exchange import COUNTER_OVERFLOW, SYNC_ID
from schwung.fieldbus.canopen.nmt import MASTER_NODE_ID
from schwung.fieldbus.canopen.pdo import Layouts
from schwung.fieldbus.canopen.sdo import SdoChannel
from schwung.fieldbus.drive import Acquisition, Parameter, ParameterValue
from schwung.fieldbus.profile import CanopenProfile

Lookup = Callable[[int, int], Parameter | None]
ReadInteger = Callable[[Parameter], int | None]

_GENERATES_SYNC = 0x40000000  # bit 30 of 1005
_CONSUMER_SLOTS = 16  # sub-indices of 1016 that are looked at


def wanted_values(
    profile: CanopenProfile, layouts: Layouts, acquisition: Acquisition, lookup: Lookup, read: ReadInteger
) -> list[ParameterValue]:
    """All that differs between what the acquisition needs and what the drive holds, in the order to write it.

    Raises InputError for a sample rate that the drive cannot be told, a mode that the profile lacks, or an object
    that the exchange cannot do without.
    """
    wanted: list[tuple[int, int, int]] = []
    for layout in (layouts.rpdo, *layouts.tpdos):
        present = _present(pdo.communication_index(layout.pdo), 1, lookup, read)
        wanted += pdo.wanted(layout, present or 0)
    wanted += _silenced(profile, lookup, read)
    wanted += _sync(profile, acquisition, lookup, read)
    wanted += _heartbeats(acquisition, lookup, read)
    if acquisition.mode not in profile.modes:
        raise InputError(
            f"profile {profile.family}, modes", f'has no "{acquisition.mode}"', "Choose another mode."
        )
    wanted.append((0x6060, 0, profile.modes[acquisition.mode]))
    wanted += _interpolation(acquisition, lookup)
    for setting in (
        profile.stop.quick_stop_option,
        profile.stop.connection_lost,
        profile.stop.fault_reaction,
    ):
        if setting is not None:
            wanted.append((setting.object.index, setting.object.subindex, setting.value))
    values = []
    for index, subindex, value in wanted:
        parameter = lookup(index, subindex)
        if parameter is None:
            raise InputError(
                f"{profile.eds}", f"lacks {index:04X}:{subindex:02X}", "Use the EDS of this drive family."
            )
        if read(parameter) != value:
            values.append(ParameterValue(parameter, value))
    return values


def _present(index: int, subindex: int, lookup: Lookup, read: ReadInteger) -> int | None:
    parameter = lookup(index, subindex)
    return None if parameter is None else read(parameter)


def _silenced(profile: CanopenProfile, lookup: Lookup, read: ReadInteger) -> list[tuple[int, int, int]]:
    """TPDOs that the profile does not name are switched off: they would only load the bus."""
    named = {p.number for p in profile.tpdos}
    values = []
    for number in set(range(1, pdo.PREDEFINED + 1)) - named:
        present = _present(0x1800 + number - 1, 1, lookup, read)
        if present is not None and not present & pdo.INVALID:
            values.append((0x1800 + number - 1, 1, present | pdo.INVALID))
    return values


def _sync(
    profile: CanopenProfile, acquisition: Acquisition, lookup: Lookup, read: ReadInteger
) -> list[tuple[int, int, int]]:
    values = []
    cob_id = _present(0x1005, 0, lookup, read)
    if cob_id is not None and (cob_id & 0x7FF != SYNC_ID or cob_id & _GENERATES_SYNC):
        values.append((0x1005, 0, SYNC_ID))
    if has_counter(profile, lookup):
        values.append((0x1019, 0, COUNTER_OVERFLOW))
    if lookup(0x1006, 0) is not None:
        values.append((0x1006, 0, round(1e6 / acquisition.sample_rate_hz)))
    return values


def has_counter(profile: CanopenProfile, lookup: Lookup) -> bool:
    """True where SYNC shall carry its counter."""
    return profile.sync.counter and lookup(0x1019, 0) is not None


def _heartbeats(acquisition: Acquisition, lookup: Lookup, read: ReadInteger) -> list[tuple[int, int, int]]:
    values = []
    milliseconds = round(1000 * acquisition.heartbeat_s)
    silence = round(1000 * acquisition.silence_allowed_s)
    slot = consumer_slot(lookup, read)
    if slot is not None:
        values.append((0x1016, slot, MASTER_NODE_ID << 16 | silence))
    if lookup(0x1017, 0) is not None:
        values.append((0x1017, 0, milliseconds))
    return values


def consumer_slot(lookup: Lookup, read: ReadInteger) -> int | None:
    """Sub-index of 1016 that is ours or free; None where the drive cannot watch us."""
    free = None
    highest = _present(0x1016, 0, lookup, read)
    if highest is None:
        return None
    for slot in range(1, min(highest, _CONSUMER_SLOTS) + 1):
        value = _present(0x1016, slot, lookup, read)
        if value is None:
            continue
        if value >> 16 & 0x7F == MASTER_NODE_ID:
            return slot
        if free is None and (value & 0xFFFF == 0 or value >> 16 & 0x7F == 0):
            free = slot
    return free


def _interpolation(acquisition: Acquisition, lookup: Lookup) -> list[tuple[int, int, int]]:
    """60C2: period = value · 10^exponent s; the value is UNSIGNED8."""
    if acquisition.mode != "csp" or lookup(0x60C2, 1) is None:
        return []
    for exponent in (-3, -4, -5, -6):
        value = 1 / acquisition.sample_rate_hz / 10.0**exponent
        if 0.5 < value < 255.5 and abs(value - round(value)) < 1e-6 * value:
            return [(0x60C2, 1, round(value)), (0x60C2, 2, exponent)]
    raise InputError(
        "sample_rate_hz",
        f"{acquisition.sample_rate_hz:g} Hz is no interpolation period that 60C2 can hold",
        "Take 1000, 500, 250, 200 or 100 Hz.",
    )


def needs_pre_operational(values: Sequence[ParameterValue]) -> bool:
    """True where a value may only be written in the NMT state pre-operational."""
    return any(
        pdo.is_pdo_object(v.parameter) or v.parameter.index in (0x1005, 0x1006, 0x1019) for v in values
    )


def passed_through(values: Sequence[ParameterValue], lookup: Lookup) -> list[Parameter]:
    """Parameters, beyond these, that `write_ordered` changes on the way: COB-ID and count of a PDO, 1006."""
    given = {(v.parameter.index, v.parameter.subindex) for v in values}
    touched: set[tuple[int, int]] = set()
    for parameter in (v.parameter for v in values):
        if pdo.is_pdo_object(parameter):
            touched.add((parameter.index & 0xFDFF, 1))
            if parameter.index & 0x200:
                touched.add((parameter.index, 0))
        elif parameter.index == 0x1019:
            touched.add((0x1006, 0))
    found = (lookup(*key) for key in sorted(touched - given))
    return [parameter for parameter in found if parameter is not None]


def write_ordered(
    values: Sequence[ParameterValue],
    lookup: Lookup,
    read: Callable[[Parameter], int],
    write: Callable[[ParameterValue], None],
) -> None:
    """Write values in an order that the standard allows: PDOs by their dance, 1019 only while 1006 is 0."""
    pdo_values = [v for v in values if pdo.is_pdo_object(v.parameter)]
    pdo.write_pdos(pdo_values, lookup, read, write)
    rest = [v for v in values if not pdo.is_pdo_object(v.parameter)]
    counter = [v for v in rest if v.parameter.index == 0x1019]
    if counter:
        period = lookup(0x1006, 0)
        given = [v for v in rest if v.parameter.index == 0x1006]
        rest = [v for v in rest if v.parameter.index not in (0x1006, 0x1019)]
        if period is not None:
            final = given[0].raw if given else read(period)
            write(ParameterValue(period, 0))
        write(counter[-1])
        if period is not None and final != 0:
            write(ParameterValue(period, final))
    for value in rest:
        write(value)


@contextlib.contextmanager
def temporarily(sdo: SdoChannel, wanted: Sequence[ParameterValue]) -> Iterator[None]:
    """Values that hold within, and what was there afterwards."""
    changed: list[ParameterValue] = []
    try:
        for value in wanted:
            old = sdo.read(value.parameter)
            if old.raw != value.raw:
                changed.append(old)
                sdo.write(value)
        yield
    finally:
        for old in changed:
            with contextlib.suppress(DriveError):
                sdo.write(old)


def listens_to_us(consumer_heartbeat: int) -> bool:
    """True for a value of 1016 that makes the drive watch our heartbeat."""
    return consumer_heartbeat >> 16 & 0x7F == MASTER_NODE_ID and consumer_heartbeat & 0xFFFF > 0
