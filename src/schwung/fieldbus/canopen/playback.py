"""From setpoints to RPDO frames, and from answered frames to a Recording in SI."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from schwung.errors import InputError
from schwung.fieldbus import cia402
from schwung.fieldbus.canopen.pdo import Layout, Layouts, Lookup
from schwung.fieldbus.canopen.recorder import Recorder, arrange, measure_timing
from schwung.fieldbus.drive import (
    Move,
    OperatingMode,
    ParameterValue,
    Recording,
    Setpoints,
    SyncTiming,
)
from schwung.fieldbus.profile import CanopenProfile
from schwung.fieldbus.units import Scales
from schwung.motion import Array

OFF_RATE = 0.005  # share by which the achieved rate may be off before it is noted
_HANDSHAKE_S = 0.01  # how long the new-set-point bit stays set
ACKNOWLEDGED_WITHIN_S = 0.1


@dataclass(frozen=True, eq=False)
class Playable:
    """Setpoints as frames, and the counts in them, (n,)."""

    frames: list[bytes]
    after: bytes  # what is held after the last one: its position, without torque
    position_counts: NDArray[np.int64]
    torque_added_counts: NDArray[np.int64]


def pack(
    setpoints: Setpoints,
    mode: OperatingMode,
    profile: CanopenProfile,
    layout: Layout,
    scales: Scales,
    target: int,
) -> Playable:
    """Frames for every setpoint; `target` is the target (counts) that holds now. Raises InputError for setpoints that
    the drive cannot be given: not finite, out of range of the mapped object, injection without an object for it."""
    count = setpoints.position_rad.size
    if count == 0 or setpoints.torque_added_nm.size != count:
        raise InputError(
            "setpoints", "are empty or of unequal length", "Give one position and torque per SYNC."
        )
    q = profile.quantities
    words = np.full(count, cia402.ENABLE_OPERATION, dtype=np.int64)
    if mode == "pp":
        position = _moves(setpoints, words, scales, target)
    else:
        position = _counts(setpoints.position_rad, scales.position_rad, layout, str(q.position.demand))
    columns: dict[str, Any] = {"6040:00": words, str(q.position.demand): position}
    added = np.zeros(count, dtype=np.int64)
    if q.torque_added is not None:
        added = _counts(setpoints.torque_added_nm, scales.torque_added_nm, layout, str(q.torque_added.object))
        columns[str(q.torque_added.object)] = added
    elif np.any(setpoints.torque_added_nm != 0):
        raise InputError(
            f"profile {profile.family}", "has no object for injected torque", "Choose another drive."
        )
    if layout.carries("6060:00"):
        columns["6060:00"] = profile.modes[mode]
    packed, size = layout.pack(columns, count), layout.size
    last = {
        name: values[-1] if isinstance(values, np.ndarray) else values for name, values in columns.items()
    }
    last["6040:00"] = cia402.ENABLE_OPERATION
    if q.torque_added is not None:
        last[str(q.torque_added.object)] = 0
    frames = [packed[i * size : (i + 1) * size] for i in range(count)]
    return Playable(frames, layout.pack(last, 1), position, added)


def _counts(values: Array, scale: float, layout: Layout, name: str) -> NDArray[np.int64]:
    if not np.all(np.isfinite(values)):
        raise InputError("setpoints", f"are not finite (for {name})", "Check motion and excitation.")
    if not math.isfinite(scale):
        if np.any(values):
            raise InputError(
                f"setpoints, {name}",
                "nobody tells its unit",
                "Give its scale in a profile that extends this one.",
            )
        return np.zeros(values.size, dtype=np.int64)
    counts = np.rint(values / scale)
    limits = np.iinfo(layout.dtype[name])
    if counts.min() < limits.min or counts.max() > limits.max:
        raise InputError(
            "setpoints", f"exceed what {name} can hold", "Move less, or home the axis nearer to 0."
        )
    return counts.astype(np.int64)


def _moves(setpoints: Setpoints, words: NDArray[np.int64], scales: Scales, target: int) -> NDArray[np.int64]:
    """Profile position: target and new-set-point bit over the samples; fills `words`.

    A target is sent ahead of its bit: within a frame, a drive may act on the controlword before it has the target.
    """
    if not setpoints.moves:
        raise InputError("setpoints", "have no moves for profile position", "Give the strokes as moves.")
    handshake = max(2, round(_HANDSHAKE_S * setpoints.sample_rate_hz))
    position = np.full(words.size, target, dtype=np.int64)
    free_from = 2
    for move in setpoints.moves:
        begin = move.at_index
        if begin < free_from or begin + 2 * handshake > words.size:
            raise InputError(
                "setpoints",
                f"move at sample {begin} is too near another, the begin or the end",
                "Space them out.",
            )
        position[max(free_from - handshake, 0) :] = round(move.target_rad / scales.position_rad)
        words[begin : begin + handshake] |= cia402.NEW_SET_POINT | cia402.CHANGE_AT_ONCE
        free_from = begin + 2 * handshake
    return position


def fastest_rad_s(setpoints: Setpoints) -> float:
    """How fast an axis that follows these turns at most (rad/s)."""
    steps = np.abs(np.diff(setpoints.position_rad)) * setpoints.sample_rate_hz
    return max([float(np.max(steps, initial=0.0)), *(move.peak_speed_rad_s for move in setpoints.moves)])


def dynamics(moves: Sequence[Move], scales: Scales, lookup: Lookup) -> list[ParameterValue]:
    """Values of 6081, 6083 and 6084 for strokes that share them; a drive without 6084 brakes as it accelerates.

    Raises InputError where the strokes differ, or the drive has no such object.
    """
    if not moves:
        return []
    if len({(m.peak_speed_rad_s, m.acceleration_rad_s2) for m in moves}) > 1:
        raise InputError("setpoints", "moves differ in speed or acceleration", "Play them one by one.")
    speed = moves[0].peak_speed_rad_s / abs(scales.speed_rad_s)
    acceleration = moves[0].acceleration_rad_s2 / abs(scales.acceleration_rad_s2)
    if not (
        np.isfinite(speed) and np.isfinite(acceleration) and round(speed) > 0 and round(acceleration) > 0
    ):
        raise InputError("setpoints", "speed or acceleration has no unit or is 0", "Give quantities.speed.")
    values = []
    for index, value in ((0x6081, speed), (0x6083, acceleration), (0x6084, acceleration)):
        parameter = lookup(index, 0)
        if parameter is not None:
            values.append(ParameterValue(parameter, round(value)))
        elif index != 0x6084:
            raise InputError(
                f"0x{index:04X}", "the EDS lacks it, but strokes need it", "Use the EDS of this drive."
            )
    return values


def build(
    recorder: Recorder,
    playable: Playable,
    profile: CanopenProfile,
    layouts: Layouts,
    scales: Scales,
    producer: str,
    sample_rate_hz: float,
    demand_rad: Array | None = None,
) -> Recording:
    """Bring a log in order and into SI. Rows of lost samples hold NaN (statusword -1). `demand_rad` replaces the played
    target where the drive makes its own profile."""
    samples = arrange(recorder, len(playable.frames))
    rows = samples.setpoint.size
    fields: dict[str, NDArray[Any]] = {}
    for layout, frames in zip(layouts.tpdos, samples.frames, strict=True):
        blank = bytes(layout.size)
        records = layout.unpack(frame if frame is not None else blank for frame in frames)
        for name in layout.dtype.names or ():
            fields[name] = records[name]

    def si(name: str | None, scale: float) -> Array:
        values = np.full(rows, np.nan) if name is None else fields[name].astype(float) * scale
        values[samples.lost] = np.nan
        return values

    q = profile.quantities
    statusword = fields["6041:00"].astype(np.int64)
    statusword[samples.lost] = -1
    held = np.clip(samples.setpoint, 0, len(playable.frames) - 1)
    demand = playable.position_counts[held] * scales.position_rad if demand_rad is None else demand_rad[:rows]
    known = q.torque_added is not None and math.isfinite(scales.torque_added_nm)
    added = playable.torque_added_counts[held] * (scales.torque_added_nm if known else 0.0)
    notes = []
    if samples.late:
        notes.append(f"{samples.late} answers came after the following SYNC and were attributed by order")
    if np.any(samples.setpoint != np.arange(rows)):
        notes.append("setpoints and SYNC slipped against each other; the demand column shows what held")
    period = 1.0 / sample_rate_hz
    timing = (
        SyncTiming(producer, period, 0.0, 0.0, 0.0)  # the drive's time is SYNC: there is no grid to miss
        if producer == "lockstep"
        else measure_timing(producer, period, samples.sync_time_s)
    )
    if abs(timing.period_s / period - 1) > OFF_RATE:
        notes.append(f"SYNC came at {1 / timing.period_s:.2f} Hz instead of {sample_rate_hz:g} Hz")
    return Recording(
        sample_rate_hz=sample_rate_hz,
        sync_count=samples.sync_count,
        receive_time_s=samples.receive_time_s,
        statusword=statusword,
        position_rad=si(str(q.position.object), scales.position_rad),
        speed_rad_s=si(str(q.speed.object) if q.speed else None, scales.speed_rad_s),
        torque_nm=si(str(q.torque.object) if q.torque else None, scales.torque_nm),
        position_demand_rad=np.asarray(demand, dtype=float),
        torque_added_nm=np.asarray(added, dtype=float),
        lost=samples.lost,
        timing=timing,
        notes=tuple(notes),
    )


def unacknowledged(recording: Recording, moves: Sequence[Move]) -> Move | None:
    """The first move that the drive never acknowledged (statusword bit 12), though its samples came."""
    span = round(ACKNOWLEDGED_WITHIN_S * recording.sample_rate_hz)
    for move in moves:
        words = recording.statusword[move.at_index : move.at_index + span]
        words = words[words >= 0]
        if words.size and not np.any(words & cia402.SET_POINT_ACKNOWLEDGE):
            return move
    return None
