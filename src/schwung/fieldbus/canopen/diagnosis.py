"""Why a drive does not move, or has stopped, in the drive's own words where it has any."""

from __future__ import annotations

import contextlib

from schwung.errors import DriveError, DriveFaultError, SdoError, StateError
from schwung.fieldbus import cia402
from schwung.fieldbus.canopen import nmt
from schwung.fieldbus.canopen.emcy import describe_code
from schwung.fieldbus.canopen.sdo import SdoChannel
from schwung.fieldbus.cia402 import State

_EMERGENCY_S = 0.1  # an emergency may come a little after the statusword that shows the fault


def why_stuck(
    sdo: SdoChannel, monitor: nmt.NodeMonitor, status: int | None, word: int, wanted: State, mode: int | None,
    *, tells_voltage: bool = True,
) -> DriveError:  # fmt: skip
    """The error that names why the state machine does not reach `wanted`; asks the drive what it can."""
    seen = shown = None
    code = 0
    with contextlib.suppress(SdoError):
        seen = sdo.read_integer(0x6040, 0, "UNSIGNED16")
        code = sdo.read_integer(0x603F, 0, "UNSIGNED16") or 0
        if mode is not None:
            shown = sdo.read_integer(0x6061, 0, "INTEGER8")
    reason = cia402.why_stuck(
        status,
        word,
        wanted,
        nmt=monitor.nmt if monitor.nmt != nmt.UNKNOWN else "OPERATIONAL",
        mode=mode,
        mode_display=shown,
        controlword_seen=seen,
        error=describe_code(code) if code else "",
        tells_voltage=tells_voltage,
    )
    faulty = cia402.decode(status) in (State.FAULT, State.FAULT_REACTION)
    kind = DriveFaultError if faulty else StateError
    return kind(f"node {sdo.node_id}", reason.problem, reason.remedy)


def explain(sdo: SdoChannel, monitor: nmt.NodeMonitor, since_s: float, trouble: DriveError) -> DriveError:
    """A fault with the drive's own words for it: its emergency since then, else its error code; others as they are."""
    if not isinstance(trouble, DriveFaultError):
        return trouble
    monitor.clock.wait(lambda: monitor.last_emergency(since_s) is not None, _EMERGENCY_S)
    emergency = monitor.last_emergency(since_s)
    words = f"emergency {emergency}" if emergency is not None else ""
    if emergency is None:
        with contextlib.suppress(DriveError):
            code = sdo.read_integer(0x603F, 0, "UNSIGNED16") or 0
            words = describe_code(code) if code else ""
    if not words or words in trouble.problem:
        return trouble
    return DriveFaultError(trouble.place, f"{trouble.problem}: {words}", trouble.remedy)
