"""A drive's whole configuration: read, kept in a file, and written back in an order that the drive takes."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass, field

from schwung.commissioning.journal import Change, ParameterAccess, ParameterJournal
from schwung.errors import InputError, ParameterError, RefusedError
from schwung.fieldbus import cia402
from schwung.fieldbus.canopen import pdo
from schwung.fieldbus.configuration import Selection, Skipped, mapped_live
from schwung.fieldbus.drive import ENERGISED, Parameter, ParameterValue, Progress

_LAST = (0x1016, 0x1017)  # heartbeats are written last: from then on the drive watches us


@dataclass(frozen=True)
class Snapshot:
    """What was read of a drive, and what was not, with reasons."""

    values: tuple[ParameterValue, ...]
    skipped: tuple[Skipped, ...]


@dataclass(frozen=True)
class Refused:
    """A value that the drive did not take, and what it said."""

    value: ParameterValue
    reason: str


@dataclass(frozen=True)
class Written:
    """What became of a configuration that was written."""

    changes: tuple[Change, ...]
    refused: tuple[Refused, ...]
    equal: int  # parameters that were as wanted before


@dataclass(frozen=True)
class Plan:
    """What writing a configuration would change."""

    changes: tuple[tuple[ParameterValue, ParameterValue], ...]  # now, wanted
    equal: int
    absent: tuple[Skipped, ...] = field(default=())


def read_snapshot(
    read: Callable[[Parameter], ParameterValue], selection: Selection, progress: Progress | None = None
) -> Snapshot:
    """Read the selected parameters, PDO settings first: what an RPDO writes is live, and is left out.

    What the drive refuses to show is left out with its reason. Raises DriveError where it does not answer any more.
    """
    settings = [p for p in selection.wanted if pdo.is_pdo_object(p)]
    others = [p for p in selection.wanted if not pdo.is_pdo_object(p)]
    values: list[ParameterValue] = []
    skipped = list(selection.skipped)
    total = len(selection.wanted)
    for done, parameter in enumerate(settings):
        _tell(progress, done, total)
        _read_one(read, parameter, values, skipped)
    live = mapped_live(values)
    for done, parameter in enumerate(others, start=len(settings)):
        _tell(progress, done, total)
        reason = live.get((parameter.index, parameter.subindex))
        if reason is not None:
            skipped.append(Skipped(parameter, reason))
        else:
            _read_one(read, parameter, values, skipped)
    _tell(progress, total, total)
    return Snapshot(_by_index(values), tuple(skipped))


def _read_one(
    read: Callable[[Parameter], ParameterValue],
    parameter: Parameter,
    values: list[ParameterValue],
    skipped: list[Skipped],
) -> None:
    try:
        values.append(read(parameter))
    except ParameterError as error:
        if not was_refused(error):
            raise
        skipped.append(Skipped(parameter, error.problem))
    except InputError as error:
        skipped.append(Skipped(parameter, error.problem))


def was_refused(error: ParameterError) -> bool:
    """True where the drive answered with a refusal; False where it did not answer."""
    return any(getattr(told, "code", None) is not None for told in (error, error.__cause__))


def _tell(progress: Progress | None, done: int, total: int) -> None:
    if progress is not None:
        progress(done, total)


def _by_index(values: Iterable[ParameterValue]) -> tuple[ParameterValue, ...]:
    return tuple(sorted(values, key=lambda v: (v.parameter.index, v.parameter.subindex)))


def plan_restore(
    drive: ParameterAccess, values: Sequence[ParameterValue], progress: Progress | None = None
) -> Plan:
    """Compare a configuration with what the drive holds; reads only."""
    changes: list[tuple[ParameterValue, ParameterValue]] = []
    absent: list[Skipped] = []
    equal = 0
    for done, wanted in enumerate(values):
        _tell(progress, done, len(values))
        found: list[ParameterValue] = []
        _read_one(drive.read, wanted.parameter, found, absent)
        if found and found[0].raw != wanted.raw:
            changes.append((found[0], wanted))
        elif found:
            equal += 1
    _tell(progress, len(values), len(values))
    return Plan(tuple(changes), equal, tuple(absent))


def require_power_off(drive: ParameterAccess, statusword: Parameter | None) -> None:
    """Raises RefusedError where the power stage is on: who holds the axis would lose it."""
    raw = drive.read(statusword).raw if statusword is not None else None
    state = cia402.decode(raw).value if isinstance(raw, int) else ""
    if state.lower() in ENERGISED:
        raise RefusedError(
            f"node {drive.identity.node_id}", f"the power stage is on ({state}), and we did not switch it on",
            "Switch it off in whatever holds it (PLC, vendor's tool), or insist with --force: it is switched off then.",
        )  # fmt: skip


def write_plan(
    drive: ParameterAccess,
    plan: Plan,
    journal: ParameterJournal,
    progress: Progress | None = None,
) -> Written:
    """Write what a plan would change: power stage off first, the old values on disk before the first write.

    PDO settings go together, by the order of CiA 301 7.5.2.36; all others one by one. What is refused is tried again
    when the rest is written, as often as that helps: many values are only taken beside others. Everything is read back.
    """
    wanted = [after for _, after in plan.changes]
    drive.disable()
    journal.remember(wanted)
    left = _groups(wanted)
    refused: list[Refused] = []
    while left:
        refused, still = [], []
        for number, group in enumerate(left):
            _tell(progress, number, len(left))
            trouble = _write_group(drive, group)
            if trouble:
                refused += trouble
                still.append([item.value for item in trouble])
        if sum(map(len, still)) == sum(map(len, left)):
            break
        left = still
    _tell(progress, 1, 1)
    refused += _read_back(
        drive, wanted, {(r.value.parameter.index, r.value.parameter.subindex) for r in refused}
    )
    return Written(journal.changes, tuple(refused), plan.equal)


def _groups(values: Sequence[ParameterValue]) -> list[list[ParameterValue]]:
    """What is written at once: the settings of one PDO, those of SYNC, else one value; heartbeats come last."""
    pdos: dict[int, list[ParameterValue]] = {}
    sync: list[ParameterValue] = []
    single: list[list[ParameterValue]] = []
    last: list[list[ParameterValue]] = []
    for value in values:
        index = value.parameter.index
        if pdo.is_pdo_object(value.parameter):
            pdos.setdefault(index & 0xFDFF, []).append(value)
        elif index in (0x1005, 0x1006, 0x1019):
            sync.append(value)
        else:
            (last if index in _LAST else single).append([value])
    return [*([sync] if sync else []), *single, *pdos.values(), *last]


def _write_group(drive: ParameterAccess, group: list[ParameterValue]) -> list[Refused]:
    """Write, leaving out one by one what the drive refuses. Raises where it does not answer."""
    left, refused = list(group), []
    while left:
        try:
            drive.write(left)
            break
        except ParameterError as error:
            if not was_refused(error):
                raise
            named = [v for v in left if v.parameter.label in error.place] or left
            refused += [Refused(value, error.problem) for value in named]
            left = [value for value in left if value not in named]
        except InputError as error:  # a value that its own type cannot hold never reached the bus
            refused += [Refused(value, error.problem) for value in left]
            break
    return refused


def _read_back(
    drive: ParameterAccess, wanted: Sequence[ParameterValue], known: set[tuple[int, int]]
) -> list[Refused]:
    found = []
    for value in wanted:
        if (value.parameter.index, value.parameter.subindex) in known:
            continue
        held = drive.read(value.parameter).raw
        if held != value.raw:
            found.append(Refused(value, f"it was written, but reads {held!r}"))
    return found
