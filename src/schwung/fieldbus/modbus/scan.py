"""Who is on a Modbus line, and which profile fits. Reads only."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import replace

from schwung.clock import Clock
from schwung.errors import DriveError, InputError, NodeLostError, RegisterError
from schwung.fieldbus.drive import Progress
from schwung.fieldbus.found import FoundNode
from schwung.fieldbus.modbus.client import Line
from schwung.fieldbus.modbus.driver import ModbusDrive
from schwung.fieldbus.modbus.link import ModbusLink
from schwung.fieldbus.modbus.options import ModbusOptions
from schwung.fieldbus.profile import Modbus, ModbusProfile, list_profiles

_PATIENCE_S = 0.2  # for a unit that may not be there
_PLAIN = Modbus(word_order="high_first")


def modbus_profiles() -> list[ModbusProfile]:
    """All profiles of Modbus families that can be told by a register; the others must be asked for by name."""
    return [p for p in list_profiles() if isinstance(p, ModbusProfile) and p.identity]


def match_profile(
    options: ModbusOptions, unit: int, *, clock: Clock, line: Line | None = None
) -> ModbusProfile:
    """The first profile whose identity the unit answers. Raises InputError when none fits, BusError without a line."""
    refused = ""
    for profile in modbus_profiles():
        if options.transport not in profile.modbus.transports:
            continue
        link = ModbusLink(options, unit, profile.modbus, clock=clock, line=line)
        try:
            ModbusDrive(link, profile)
        except InputError as error:
            refused = f"{error.place} {error.problem}"
        else:
            return profile
        finally:
            link.close()
    raise InputError(
        f"unit {unit} on {options.name}",
        f"fits no profile by its identity{f' ({refused})' if refused else ''}",
        "Name its family with --profile; `schwung scan` shows who answers.",
    )


def scan_units(
    options: ModbusOptions,
    units: Iterable[int],
    progress: Progress | None = None,
    *,
    clock: Clock,
    line: Line | None = None,
) -> tuple[FoundNode, ...]:
    """Ask units one by one; who refuses is there, too. Raises BusError where the line cannot be opened."""
    wanted = list(units)
    hurried = options if options.timeout_s else replace(options, timeout_s=_PATIENCE_S)
    found = []
    for number, unit in enumerate(wanted):
        if progress is not None:
            progress(number, len(wanted))
        node = _examine(hurried, unit, clock, line)
        if node is not None:
            found.append(node)
    if progress is not None:
        progress(len(wanted), len(wanted))
    return tuple(found)


def _examine(options: ModbusOptions, unit: int, clock: Clock, line: Line | None) -> FoundNode | None:
    if not _is_there(options, unit, clock, line):
        return None
    for profile in modbus_profiles():
        link = ModbusLink(options, unit, profile.modbus, clock=clock, line=line)
        try:
            drive = ModbusDrive(link, profile)
            identity, state = drive.identity, drive.state()
            return FoundNode(
                node_id=unit, vendor_id=identity.vendor_id, product_code=identity.product_code, revision=0,
                serial=identity.serial, name=identity.name, device_type=None, nmt="UNKNOWN", cia402=state.cia402,
                profiles=(profile.family,), capabilities=drive.capabilities(),
            )  # fmt: skip
        except (InputError, DriveError):
            continue
        finally:
            link.close()
    return FoundNode(unit, 0, 0, 0, 0, "unknown Modbus device", None, "UNKNOWN", "", (), ())


def _is_there(options: ModbusOptions, unit: int, clock: Clock, line: Line | None) -> bool:
    """Whether anybody answers at all: a refusal is an answer, unless a gateway gives it for somebody who does not."""
    link = ModbusLink(options, unit, _PLAIN, clock=clock, line=line)
    try:
        link.read(0, 1)
    except RegisterError as error:
        return error.code not in (None, 10, 11)
    except NodeLostError:
        return False
    finally:
        link.close()
    return True
