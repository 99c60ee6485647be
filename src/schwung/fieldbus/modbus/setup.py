"""What must be written into a Modbus drive before it can move and be recorded."""

from __future__ import annotations

from collections.abc import Iterator

from schwung.errors import InputError
from schwung.fieldbus.drive import Acquisition, Guard, ParameterValue
from schwung.fieldbus.modbus.registers import Registers
from schwung.fieldbus.modbus.trace import TraceBuffer
from schwung.fieldbus.profile import CapabilityName, ModbusProfile, ObjectRef
from schwung.fieldbus.tracing import trace_request
from schwung.fieldbus.units import Scales

#: The drive never stops by itself before this (s), nor before what one lost request takes: its time-out, and on a
#: serial line another one for an answer that is only late.
LEAST_WATCHDOG_S = 1.0


def wanted_values(
    profile: ModbusProfile,
    registers: Registers,
    acquisition: Acquisition,
    scales: Scales,
    trace: TraceBuffer | None,
) -> list[ParameterValue]:
    """All that differs between what the acquisition needs and what the drive holds. Raises InputError with the
    profile's reason where the drive has no means for it."""
    _require_means(profile, acquisition)
    wanted: list[tuple[ObjectRef, int]] = []
    if profile.state is not None and profile.state.mode is not None:
        wanted.append((profile.state.mode, profile.modes[acquisition.mode]))
    if profile.watchdog is not None:
        outlived_s = (2 if registers.link.options.transport == "tcp" else 3) * profile.modbus.timeout_s
        seconds = max(acquisition.silence_allowed_s, outlived_s, LEAST_WATCHDOG_S)
        wanted.append((profile.watchdog.object, round(seconds / profile.watchdog.scale)))
    stop = profile.stop
    for setting in (stop.quick_stop_option, stop.connection_lost, stop.fault_reaction):
        if setting is not None:
            wanted.append((setting.object, setting.value))
    if profile.generator is not None:
        wanted.append((profile.generator.control.object, profile.generator.control.off))
    if acquisition.guard is not None:
        wanted += _guarded(acquisition.guard, profile, registers, scales)
    values = [ParameterValue(registers.at(ref), value) for ref, value in wanted]
    if acquisition.sampling == "trace" and trace is not None and profile.trace is not None:
        values += trace.settings(trace_request(profile.trace, acquisition.trace_s, acquisition.trace_rate_hz))
    return [value for value in values if registers.read(value.parameter).raw != value.raw]


def silent_s(acquisition: Acquisition) -> float:
    """After so long a silence of ours (s) the drive is asked for its watchdog's sake: a sixth of the shortest one, so
    that one answer may be lost."""
    return max(acquisition.silence_allowed_s, LEAST_WATCHDOG_S) / 6


def _require_means(profile: ModbusProfile, acquisition: Acquisition) -> None:
    place = f"profile {profile.family}"
    if acquisition.mode not in profile.modes:
        name: CapabilityName = "cyclic position" if acquisition.mode == "csp" else "profile position"
        raise InputError(place, profile.reason(name), "Use --mode pp." if "pp" in profile.modes else "")
    if acquisition.sampling == "trace" and profile.trace is None:
        raise InputError(place, profile.reason("trace buffer"), "Choose another drive.")
    if acquisition.sampling == "sync":
        raise InputError(place, profile.reason("sampling by SYNC"), "Use --sampling trace.")
    if acquisition.injecting == "generator" and profile.generator is None:
        raise InputError(place, profile.reason("generator"), "Choose another drive.")


def _guarded(
    guard: Guard, profile: ModbusProfile, registers: Registers, scales: Scales
) -> Iterator[tuple[ObjectRef, int]]:
    """Limits for the drive to keep by itself; where its own are as tight, they stay."""
    limits = profile.limits
    if limits.position_min is not None and limits.position_max is not None:
        low, high = registers.integer(limits.position_min), registers.integer(limits.position_max)
        ends = sorted(
            round(x / scales.position_rad) for x in (guard.position_min_rad, guard.position_max_rad)
        )
        if low < high:
            ends = [max(ends[0], low), min(ends[1], high)]
        yield limits.position_min, ends[0]
        yield limits.position_max, ends[1]
    if limits.torque_max is not None:
        most = int(guard.torque_max_nm / limits.torque_max.scale + 1e-6)
        present = registers.integer(limits.torque_max.object)
        if not 0 < present <= most:
            yield limits.torque_max.object, most
    speed = guard.speed_max_rad_s
    if limits.speed_max is not None and speed is not None:
        fastest = max(int(speed / limits.speed_max.scale + 1 - 1e-6), 1)
        if not 0 < registers.integer(limits.speed_max.object) <= fastest:
            yield limits.speed_max.object, fastest
    patience = guard.following_error_time_s
    if limits.following_error_time is not None and patience is not None:
        longest = max(round(patience / limits.following_error_time.scale), 1)
        if registers.integer(limits.following_error_time.object) > longest:
            yield limits.following_error_time.object, longest
    if limits.following_error is not None:
        widest = round(guard.following_error_rad / abs(scales.position_rad))
        if not 0 < registers.integer(limits.following_error) <= widest:
            yield limits.following_error, widest
