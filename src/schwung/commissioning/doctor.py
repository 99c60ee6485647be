"""What is missing before a drive can be commissioned, in plain words, and how to mend it. Reads only.

Three looks: at the bus (`bus_checks`, without a word; `node_checks`, who is there), at what the drive says by itself
(`drive_checks`, any protocol), and at its CANopen dictionary (`dictionary_checks`).
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TypeVar

from schwung.commissioning.checks import COMFORT, Check, Severity, meaning_checks, ready_checks
from schwung.commissioning.guarding import lacking_checks
from schwung.commissioning.journal import read_backup
from schwung.commissioning.survey import MAX_BUS_LOAD
from schwung.commissioning.ways import INJECTED, MOVING, SAMPLED, Way, choose_way
from schwung.errors import DriveError, InputError, ParameterError, SchwungError
from schwung.fieldbus.canopen import BusOptions
from schwung.fieldbus.connecting import connected
from schwung.fieldbus.drive import (
    ENERGISED,
    Acquisition,
    Capability,
    Drive,
    DriveIdentity,
    DriveLimits,
    DriveState,
    Parameter,
)
from schwung.fieldbus.profile import DeviceProfile

#: The gravest first.
_ORDER: tuple[Severity, ...] = ("stop", "warning", "note", "ok")
_RATES_HZ = (1000.0, 500.0, 250.0, 200.0, 100.0)
_TRACE_S = 1.0  # of a motion, to see whether a trace can be set up

#: What to do about a capability that commissioning is better with, where drive or profile lack it.
_REMEDIES = {
    "speed": "It is derived from position, which is coarser.",
    "stop by heartbeat": "Keep a hand at the emergency stop: the drive will not notice a dead computer.",
    "store": "Write an export again after every power-off, or store it in the vendor's tool.",
    "control gains": "Give [control] in machine.toml.",
    "table feed-forward": "Export --as mean, max or at=ANGLE, or take the CSV.",
}
_EXTEND = "Write a profile that extends this one with that scale (docs/profiles.md)."
_OTHER = "Take another drive, or a profile that offers it."

Phase = Callable[[str], None]
_T = TypeVar("_T")


@dataclass(frozen=True)
class Diagnosis:
    """Everything that was looked at, the gravest first."""

    checks: tuple[Check, ...]
    profile: str | None = None
    identity: DriveIdentity | None = None
    way: Way | None = None
    capabilities: tuple[Capability, ...] = ()

    @property
    def can_start(self) -> bool:
        """Nothing stands in the way of commissioning."""
        return all(check.severity != "stop" for check in self.checks)


def examine_connected(
    options: BusOptions, node_id: int, profile_name: str | None, folder: Path, phase: Phase
) -> Diagnosis:
    """Look at a drive on a bus about which there is nothing more to know than whether the drive answers (Modbus).

    Raises InputError for options that are wrong in themselves.
    """
    phase(f"Asking unit {node_id}")
    try:
        with connected(options, node_id, profile_name) as found:
            diagnosis = examine_drive(found.drive, found.profile, phase)
            return with_checks(diagnosis, pending_backups([folder], found.drive.identity))
    except DriveError as error:
        trouble = Check("bus", "stop", f"{error.place}: {error.problem}", error.remedy)
        return with_checks(Diagnosis(()), [trouble])


def by_gravity(checks: Iterable[Check]) -> tuple[Check, ...]:
    """The gravest first; within a gravity as they were found."""
    return tuple(sorted(checks, key=lambda check: _ORDER.index(check.severity)))


def examine_drive(drive: Drive, profile: DeviceProfile, phase: Phase) -> Diagnosis:
    """All that any drive tells by itself: state, units, limits, capabilities, and whether it can be set up.

    Raises DriveError where it stops answering.
    """
    phase("Reading state, units and limits")
    checks = [Check("identity", "ok", _identity(drive.identity, profile))]
    units = list(_told(lambda: _units(drive), "units", lambda text: [Check("units", "ok", text)]))
    if all(
        check.severity == "ok" for check in units
    ):  # without units there is neither a state nor a limit in rad
        checks += [
            *_told(drive.state, "state", lambda state: [*state_checks(state), *ready_checks(state)]),
            *_told(
                drive.limits,
                "limits",
                lambda limits: [*limit_checks(limits), *meaning_checks(limits), *lacking_checks(limits)],
            ),
        ]
    checks += units
    phase("Asking what it can")
    capabilities = drive.capabilities()
    full, rate = _rate(drive)
    way = choose_way(profile, capabilities, bus_is_full=full)
    checks += capability_checks(capabilities, way, profile)
    checks += _rate_checks(drive, way, rate)
    if all(check.severity != "stop" or check.name == "state" for check in checks):
        checks += _setup_checks(drive, way)
    return Diagnosis(tuple(checks), profile.family, drive.identity, way, capabilities)


def _told(ask: Callable[[], _T], name: str, judge: Callable[[_T], Iterable[Check]]) -> Iterator[Check]:
    """Judge an answer; where the drive or the profile has none, that is the finding."""
    try:
        found = ask()
    except InputError as error:
        yield Check(name, "stop", f"{error.place}: {error.problem}", error.remedy)
    except ParameterError as error:
        yield Check(
            name, "stop", f"{error.place}: {error.problem}", error.remedy or "Is this the right profile?"
        )
    else:
        yield from judge(found)


def _identity(identity: DriveIdentity, profile: DeviceProfile) -> str:
    verified = "" if profile.verified == "hardware" else "; the profile is proven on a simulated drive only"
    return (
        f"{identity.name or 'a drive without a name'}, serial {identity.serial}, revision 0x{identity.revision:08X}, "
        f"profile {profile.family}{verified}"
    )


def _units(drive: Drive) -> str:
    r = drive.resolution()
    known = (
        ("position", r.position_rad, "rad"), ("speed", r.speed_rad_s, "rad/s"), ("torque", r.torque_nm, "N·m"),
    )  # fmt: skip
    return "one count is " + ", ".join(
        f"{x:.3g} {unit} of {name}" for name, x, unit in known if math.isfinite(x)
    )


def state_checks(state: DriveState) -> Iterator[Check]:
    """The power stage has to be off, no fault be present, and the position be known."""
    told = state.cia402.lower()
    if "fault" in told:
        error = f": {state.error}" if state.error else "; the drive reports no error code"
        yield Check(
            "state", "stop", f"a fault is present{error}",
            "Mend its cause, then reset the fault in the vendor's tool or by a power cycle; Schwung does not do it.",
        )  # fmt: skip
    elif told in ENERGISED:
        yield Check(
            "state", "stop", f"the power stage is on ({state.cia402})",
            "Switch it off in whatever holds it (PLC, vendor's tool); after a crash of ours, `schwung restore` does.",
        )  # fmt: skip
    elif told == "unknown":
        yield Check(
            "state",
            "stop",
            "it cannot be read: drive or profile have no statusword",
            "Is it the right profile?",
        )
    else:
        nmt = "" if state.nmt == "UNKNOWN" else f"{state.nmt.lower()}, "
        yield Check("state", "ok", f"{nmt}{state.cia402.lower()}, no fault")
    if math.isfinite(state.position_rad):
        yield Check("position", "ok", f"{state.position_rad:.4g} rad")
    else:
        yield Check(
            "position",
            "stop",
            "the drive does not show it",
            "Is an encoder connected, and this the right profile?",
        )


def limit_checks(limits: DriveLimits) -> Iterator[Check]:
    """Which limits the drive keeps by itself; the others have to be given, and only Schwung keeps them."""
    window = None
    if limits.position_min_rad is not None and limits.position_max_rad is not None:
        window = f"{limits.position_min_rad:.4g} … {limits.position_max_rad:.4g} rad"
    speed, torque = _text(limits.speed_max_rad_s, "rad/s"), _text(limits.torque_max_nm, "N·m")
    following = _text(limits.following_error_rad, "rad")
    rows = (
        ("position limits", window, "software position limits are off", "607D", "--min-position and --max-position"),
        ("speed limit", speed, "no speed limit is set", "6080", "--max-speed"),
        ("torque limit", torque, "no torque limit is known", "6072", "--max-torque"),
        ("following error", following, "its supervision is off", "6065", "--following-error"),
    )  # fmt: skip
    for name, value, missing, index, option in rows:
        if value is not None:
            yield Check(name, "ok", f"the drive keeps {value}")
        else:
            yield Check(
                name, "warning", f"{missing} in the drive",
                f"Set it there (on CANopen {index}), or give {option}, which it is then told where it can.",
            )  # fmt: skip


def _text(value: float | None, unit: str) -> str | None:
    return None if value is None else f"{value:.4g} {unit}"


def capability_checks(
    capabilities: Sequence[Capability], way: Way, profile: DeviceProfile
) -> Iterator[Check]:
    """What the chosen way needs has to be there; what else commissioning is better with is worth a note."""
    needed = {"torque", MOVING[way.mode], SAMPLED[way.sampling], INJECTED[way.injecting]}
    quantities = profile.quantities
    asked = {"torque": quantities.torque, "torque injection": quantities.torque_added}
    other = []
    for capability in capabilities:
        if capability.available:
            continue
        name, reason = capability.name, capability.reason
        if name in needed:
            quantity = asked.get(name)
            by_scale = quantity is not None and quantity.unit == "user"
            yield Check(name, "stop", reason, _EXTEND if by_scale else _OTHER)
        elif name in _REMEDIES:
            # without gains preflight has no drive to simulate: commission asks for them
            yield Check(name, "warning" if name == "control gains" else "note", reason, _REMEDIES[name])
        else:
            other.append(name)
    if other:
        yield Check("cannot, need not", "ok", ", ".join(other))
    ready = [c.name for c in capabilities if c.available]
    if ready:
        yield Check("can", "ok", ", ".join(ready))
    reasons = f": {'; '.join(way.reasons)}" if way.reasons else ""
    yield Check(
        "way", "note" if way.reasons else "ok",
        f"{way.mode.upper()}, sampled by {'SYNC' if way.sampling == 'sync' else 'its trace buffer'}, injected by "
        f"{'torque over the bus' if way.injecting == 'setpoints' else 'its generator'}{reasons}",
    )  # fmt: skip


def _rate(drive: Drive) -> tuple[bool, float | None]:
    """Whether 1 kHz is too much for this bus, and the highest usual rate that is not."""
    for rate in _RATES_HZ:
        if drive.bus_load(Acquisition("csp", rate)).share <= MAX_BUS_LOAD:
            return rate != _RATES_HZ[0], rate
    return True, None


def _rate_checks(drive: Drive, way: Way, rate: float | None) -> Iterator[Check]:
    if way.sampling != "sync":
        return
    load = drive.bus_load(Acquisition(way.mode, rate or _RATES_HZ[-1]))
    text = f"takes {load.share:.0%} of the bus time ({load.basis})"
    if rate is None:
        yield Check("sample rate", "stop", f"even {_RATES_HZ[-1]:g} Hz {text}", "Raise the bit rate.")
    elif rate < _RATES_HZ[0]:
        most = f"{rate:g} Hz is the most: it {text}"
        yield Check("sample rate", "warning", most, f"Give --rate {rate:g}, or raise the bit rate.")
    elif load.share > COMFORT:
        yield Check("sample rate", "warning", f"{rate:g} Hz {text}", "Leave the bus to this drive.")
    else:
        yield Check("sample rate", "ok", f"{rate:g} Hz {text}")


def _setup_checks(drive: Drive, way: Way) -> Iterator[Check]:
    """Whether PDOs, mode, heartbeats, trace can be set up: what would have to be written, or why it cannot be."""
    acquisition = Acquisition(
        way.mode, way.sync_rate_hz, sampling=way.sampling, injecting=way.injecting, trace_s=_TRACE_S
    )
    try:
        wanted = drive.setup(acquisition)
    except (InputError, ParameterError) as error:
        yield Check(
            "set-up", "stop", f"{error.place}: {error.problem}", error.remedy or "Is this the right profile?"
        )
        return
    labels = ", ".join(value.parameter.label for value in wanted[:3])
    more = f" (and {len(wanted) - 3} more)" if len(wanted) > 3 else ""
    text = (
        f"{len(wanted)} parameters would be changed for it and put back: {labels}{more}"
        if wanted
        else "nothing to change"
    )
    yield Check("set-up", "ok", text)


def pending_backups(folders: Iterable[Path], identity: DriveIdentity | None) -> Iterator[Check]:
    """Runs of this drive that were cut short: what they had changed is still changed."""
    for folder in folders:
        for path in sorted({*folder.glob("setup.backup.json"), *folder.glob("*/setup.backup.json")}):
            try:
                backup = read_backup(path)
            except SchwungError:
                continue
            was = backup.drive.get("identity") or {}
            other = identity is not None and was.get("serial", identity.serial) != identity.serial
            if backup.restored is None and backup.changes and not other:
                yield Check(
                    "earlier run", "warning", f"{len(backup.changes)} parameters of {path} were not put back",
                    f"Run schwung restore {path}.",
                )  # fmt: skip


def with_checks(diagnosis: Diagnosis, more: Iterable[Check]) -> Diagnosis:
    """The same with further findings, all by gravity."""
    return replace(diagnosis, checks=by_gravity([*diagnosis.checks, *more]))


def absent_text(missing: Sequence[Parameter], shown: int = 4) -> str:
    """A few parameters by name."""
    labels = ", ".join(parameter.label for parameter in missing[:shown])
    return labels + (f" (and {len(missing) - shown} more)" if len(missing) > shown else "")
