"""A CAN log and an EDS -> a session."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import asdict, dataclass, field
from datetime import UTC, datetime
from pathlib import Path

import numpy as np

from schwung.errors import InputError
from schwung.fieldbus.canlog.decoding import Key, PdoReader, Rows, label, read_rows
from schwung.fieldbus.canlog.observed import ObservedObjects, nodes_of, observe
from schwung.fieldbus.canlog.runs import Signals, find_runs
from schwung.fieldbus.canlog.scaling import LoggedDrive, integer_reader, logged_drive
from schwung.fieldbus.canopen.recorder import measure_timing
from schwung.fieldbus.eds import EdsFile, read_eds
from schwung.fieldbus.profile import CanopenProfile, ObjectRef
from schwung.motion import Array
from schwung.session import Session
from schwung.session.imports import Imported
from schwung.session.imports.canframes import Frames, read_frames
from schwung.session.imports.motions import with_repeats
from schwung.session.model import Axis

_STATUSWORD: Key = (0x6041, 0)
#: Where a quantity of CiA 402 may be besides where the profile looks for it, the best first.
_ALSO: Mapping[str, tuple[Key, ...]] = {
    "position": ((0x6064, 0),),
    "speed": ((0x606C, 0),),
    "torque": ((0x6077, 0),),
    "position_demand": ((0x607A, 0), (0x6062, 0)),
    "torque_added": ((0x60B2, 0),),
}


@dataclass(frozen=True)
class LogRecipe:
    """How to read a log. `said`: SI per count by quantity ("position", "speed", "torque"), where the user says it; on a
    linear axis in m, m/s and N."""

    eds: Path
    node_id: int | None = None
    channel: str | None = None
    profile: str | None = None
    said: Mapping[str, float] = field(default_factory=dict)
    axis: Axis = "rotary"


def import_can_log(path: Path, recipe: LogRecipe) -> Imported:
    """A logged commissioning as a session: PDO mapping, units, motions and injection from the log itself; what it does
    not hold, from EDS or DCF, a profile or the user.

    Raises InputError naming frame, object and remedy where something that is needed is nowhere to be found.
    """
    frames = read_frames(path, recipe.channel)
    node = _node(frames, recipe.node_id)
    file = read_eds(recipe.eds, node)
    objects = observe(frames, node)
    reader = PdoReader(frames, objects, file)
    mapped = frozenset(
        entry.key
        for frame in reader.boundaries[:-1]
        for pdo in reader.mappings(frame)
        for entry in pdo.entries
    )
    drive = logged_drive(objects, file, recipe.profile, recipe.said, mapped, recipe.axis)
    sources = _sources(drive.profile, mapped)
    for name in ("position", "torque"):
        if name not in sources:
            listed = ", ".join(sorted(label(key) for key in mapped)) or "nothing"
            raise InputError(
                f"{path}: {name} of node {node}", f"is in no PDO of the log; mapped is {listed}",
                "Log a commissioning that exchanges it, or give the DCF as the drive was configured.",
            )  # fmt: skip
    wanted = {_STATUSWORD, *sources.values()}
    rows = read_rows(frames, reader, lambda key: key in wanted)
    signals = _signals(rows, sources, drive)
    extra = {
        "source_file": path.name,
        "sync_timing": asdict(measure_timing("log", 1 / rows.rate_hz, rows.time_s)),
        "speed_source": "reported" if "speed" in sources else "position",
    }
    if "speed" not in sources:
        extra["speed_origin"] = "derived from position"
    found = find_runs(signals, extra)
    if not found.runs:
        raise InputError(
            f"{path}: node {node}", f"makes no motion that could be read ({rows.time_s.size} SYNCs)",
            "Log the motion itself, with the drive enabled.",
        )  # fmt: skip
    runs = with_repeats(found.runs)
    notes = [
        f"read as {frames.kind}: {len(frames)} frames, node {node}, {len(objects.of)} objects seen in SDO transfers",
        *drive.notes,
        _units_note(drive, sources, recipe.axis),
        *(f"{name} is {label(key)}, by {rows.origin.get(key, 'no frame')}" for name, key in sources.items()),
        f"SYNC: {rows.rate_hz:g} Hz, {int(rows.piece[-1])} interruptions",
        *(
            [f"{rows.late} answers came after the following SYNC and were attributed by order"]
            if rows.late
            else []
        ),
        *found.notes,
        *_motion_notes(runs),
    ]
    session = Session(
        runs=tuple(runs),
        created=_created(frames),
        source=f"imported from {path.name} ({frames.kind} log, {recipe.eds.name}, node {node})",
        drive=_described(drive, file, objects, rows),
        axis=recipe.axis,
    )
    return Imported(session, tuple(notes))


def _node(frames: Frames, wanted: int | None) -> int:
    nodes = nodes_of(frames)
    if wanted is not None:
        if nodes and wanted not in nodes:
            raise InputError(f"{frames.path}: --node {wanted}", "no such node is in the log",
                             f"There are: {', '.join(map(str, nodes))}.")  # fmt: skip
        return wanted
    if len(nodes) == 1:
        return nodes[0]
    if not nodes:
        raise InputError(str(frames.path), "shows no CANopen node (no SDO, TPDO or heartbeat)",
                         "Name it with --node, or give a DBC with --dbc.")  # fmt: skip
    raise InputError(str(frames.path), f"shows several nodes ({', '.join(map(str, nodes))})",
                     f"Say which one: --node {nodes[0]}.")  # fmt: skip


def _sources(profile: CanopenProfile, mapped: frozenset[Key]) -> dict[str, Key]:
    """Which object each signal is taken from: the profile's, else the standard's, where a PDO carries it."""
    q = profile.quantities
    named: dict[str, ObjectRef | None] = {
        "position": q.position.object,
        "speed": q.speed.object if q.speed else None,
        "torque": q.torque.object if q.torque else None,
        "position_demand": q.position.demand,
        "torque_added": q.torque_added.object if q.torque_added else None,
    }
    found: dict[str, Key] = {}
    for name, others in _ALSO.items():
        ref = named[name]
        keys = ([(ref.index, ref.subindex)] if ref is not None else []) + list(others)
        key = next((key for key in keys if key in mapped), None)
        if key is not None:
            found[name] = key
    return found


def _signals(rows: Rows, sources: Mapping[str, Key], drive: LoggedDrive) -> Signals:
    """Row k: what was commanded with SYNC k, and what SYNC k+1 sampled."""
    size = rows.time_s.size - 1
    scales = drive.scales

    def sampled(key: Key | None, scale: float) -> Array | None:
        counts = None if key is None else rows.sampled.get(key)
        return None if counts is None else counts[1:] * scale

    def commanded(key: Key | None) -> Array | None:
        if key is None:
            return None
        own = rows.commanded.get(key)
        if own is not None:
            return own[:-1]
        told = rows.sampled.get(key)  # 6062, which the drive reports of itself
        return None if told is None else told[1:]

    none = np.full(size, np.nan)
    demand, added = commanded(sources.get("position_demand")), commanded(sources.get("torque_added"))
    position, torque = (
        sampled(sources["position"], scales.position_rad),
        sampled(sources["torque"], scales.torque_nm),
    )
    return Signals(
        time_s=rows.time_s[1:] - rows.time_s[0],
        rate_hz=rows.rate_hz,
        piece=rows.piece[1:],
        position=none if position is None else position,
        torque=none if torque is None else torque,
        speed=sampled(sources.get("speed"), scales.speed_rad_s),
        demand=None if demand is None else demand * scales.position_rad,
        added=None if added is None else added * scales.torque_added_nm,
        demand_counts=demand,
        added_counts=added,
        statusword=sampled(_STATUSWORD, 1.0),
        count_rad=scales.position_rad,
        count_nm=scales.torque_added_nm,
    )


def _units_note(drive: LoggedDrive, sources: Mapping[str, Key], axis: Axis) -> str:
    scales = drive.scales
    length, force = ("rad", "N·m") if axis == "rotary" else ("m", "N")
    worth = [f"position {scales.position_rad:.6g} {length}", f"torque {scales.torque_nm:.6g} {force}"]
    if "speed" in sources:
        worth.insert(1, f"speed {scales.speed_rad_s:.6g} {length}/s")
    return f"one count is worth: {', '.join(worth)}"


def _motion_notes(runs: tuple[object, ...]) -> list[str]:
    roles = [getattr(run, "role", "") for run in runs]
    excited = roles.count("excited")
    known = sum(getattr(run, "motion", None) is not None for run in runs)
    return [
        f"{len(runs)} runs: {len(runs) - excited} without and {excited} with an injected sine; the commanded motion of "
        f"{known} was recognised"
    ]


def _created(frames: Frames) -> str:
    """When the log began, where its stamps are dates; else when it was read."""
    first = float(frames.time_s[0])
    moment = datetime.fromtimestamp(first, UTC) if first > 1e8 else datetime.now(UTC)
    return moment.isoformat(timespec="seconds")


def _described(drive: LoggedDrive, file: EdsFile, objects: ObservedObjects, rows: Rows) -> dict[str, object]:
    """The drive as the session file describes one; gains where the profile knows them and somebody read them."""
    read = integer_reader(objects, file)
    gains: dict[str, float] = {}
    for name in type(drive.profile.control).model_fields:
        gain = getattr(drive.profile.control, name)
        counts = None if gain is None else read(gain.object.index, gain.object.subindex)
        if counts is not None:
            gains[name] = counts * gain.scale
    scales = drive.scales
    return {
        "protocol": "CANopen CiA 402",
        "identity": None if drive.identity is None else asdict(drive.identity),
        "profile": drive.profile.family,
        "profile_name": drive.profile.name,
        "units": {
            "position_rad": scales.position_rad, "speed_rad_s": scales.speed_rad_s, "torque_nm": scales.torque_nm,
            "torque_added_nm": scales.torque_added_nm,
        },
        "settings": {"sync_rate_hz": rows.rate_hz, "sampling": "sync", **({"control": gains} if gains else {})},
    }  # fmt: skip
