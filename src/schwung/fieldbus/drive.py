"""A drive that can be commanded and sampled: the protocol every driver fulfils, in SI units.

The border runs here: on this side rad, rad/s, N·m and seconds; on the other side counts, registers and frames.
Who moves a machine (commissioning) sees nothing but this file.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from typing import Any, Literal, Protocol, runtime_checkable

import numpy as np
from numpy.typing import NDArray

from schwung.clock import Clock
from schwung.motion import Array

OperatingMode = Literal["csp", "pp"]
Sampling = Literal["sync", "trace"]  # TPDOs on SYNC | the drive's own trace buffer, read out afterwards
Injecting = Literal["setpoints", "generator"]  # one torque offset per SYNC | the drive's own sine
Space = Literal["object", "register"]
RawValue = int | float | str | bytes


@dataclass(frozen=True)
class DriveIdentity:
    """Who answers: object 1018 and 1008 on CANopen."""

    node_id: int
    vendor_id: int
    product_code: int
    revision: int
    serial: int
    name: str = ""


@dataclass(frozen=True)
class DriveLimits:
    """What the drive enforces by itself, and what changes the meaning of that; None where it cannot say. SI, motor
    side."""

    position_min_rad: float | None  # 607D:01, in the frame of the position, see `home_offset_rad`
    position_max_rad: float | None  # 607D:02
    speed_max_rad_s: float | None  # 6080
    torque_max_nm: float | None  # 6072
    rated_torque_nm: float | None  # 6076
    following_error_rad: float | None  # 6065
    following_error_time_s: float | None  # 6066
    stop_deceleration_rad_s2: float | None = None  # 6085 or 6084, whichever a quick stop takes by 605A
    quick_stop_option: int | None = None  # 605A as it will be, the profile's value where that sets it
    home_offset_rad: float = 0.0  # 607C
    range_rad: tuple[float, float] | None = None  # 607B: where positions wrap
    polarity: int = 0  # 607E: bit 7 turns position, bit 6 speed
    brake_closed: bool = False  # 60FE: an output that the bus rules holds the brake closed
    lacking: tuple[
        str, ...
    ] = ()  # objects by which a drive could be guarded, and that this one does not have


@dataclass(frozen=True)
class Resolution:
    """SI value of one count of each quantity that is exchanged cyclically."""

    position_rad: float
    speed_rad_s: float
    torque_nm: float
    torque_added_nm: float


#: CiA 402 states, in lower case, in which the power stage is on.
ENERGISED = ("operation enabled", "quick stop active", "fault reaction active")


@dataclass(frozen=True)
class DriveState:
    """A look at the drive, without changing it."""

    nmt: str  # "PRE-OPERATIONAL", "OPERATIONAL", …
    cia402: str  # "Switch on disabled", "Operation enabled", "Fault", …
    position_rad: float
    error: str = ""  # decoded error code where the drive reports one
    others: str = ""  # what another master of its bus sends, in words
    voltage: bool | None = None  # the power stage is supplied: no STO, no missing mains (6041 bit 4)
    remote: bool | None = None  # it takes controlwords (6041 bit 9)
    inputs: int | None = None  # 60FD: bit 0 negative, bit 1 positive limit switch, bit 3 interlock


@dataclass(frozen=True)
class Capability:
    """One thing that commissioning wants of a drive, and whether profile and drive offer it."""

    name: str  # "cyclic position", "torque injection", "sampling by SYNC", "table feed-forward", …
    available: bool
    reason: str


@dataclass(frozen=True)
class Parameter:
    """One parameter of a drive: an object of the dictionary (CANopen), or a register (Modbus: `index` is its
    address, `subindex` 0)."""

    index: int
    subindex: int
    type: str  # CiA 301 name: "UNSIGNED32", "INTEGER16", "REAL32", "VISIBLE_STRING", "DOMAIN"
    name: str = ""
    space: Space = "object"

    @property
    def label(self) -> str:
        """As people write it: 0x6065:00 Following error window; register 7706 Position window."""
        if self.space == "register":
            return f"register {self.index} {self.name}".rstrip()
        return f"0x{self.index:04X}:{self.subindex:02X} {self.name}".rstrip()


@dataclass(frozen=True)
class ParameterValue:
    """A parameter and the raw value that it has, or that it shall get."""

    parameter: Parameter
    raw: RawValue


@dataclass(frozen=True)
class BusLoad:
    """Share of the bus time that the cyclic frames take, 0…1 and above, and what it was computed from."""

    share: float
    basis: str  # "1000 kbit/s, worst-case stuffing"


@dataclass(frozen=True)
class Guard:
    """Limits that the drive shall keep by itself; SI, motor side. None: as the drive has it."""

    position_min_rad: float
    position_max_rad: float
    torque_max_nm: float
    following_error_rad: float
    following_error_time_s: float | None = None
    speed_max_rad_s: float | None = None
    stop_deceleration_rad_s2: float | None = None  # of a quick stop, at the least
    travel_rad: tuple[float, float] | None = None  # where the axis has to be let, within the window


#: Heartbeats that may be missing before a node counts as dead, where nobody says otherwise.
MISSES_ALLOWED = 3
#: Who sends SYNC on CANopen: see canopen/cyclic.py.
SyncChoice = Literal["auto", "lockstep", "kernel", "thread"]


@dataclass(frozen=True)
class Acquisition:
    """How a motion shall be commanded and sampled."""

    mode: OperatingMode
    sample_rate_hz: float
    heartbeat_s: float = 0.1
    misses_allowed: int = (
        MISSES_ALLOWED  # heartbeats: after so many the drive stops by itself, and we give it up
    )
    moves: tuple[Move, ...] = ()  # PP: the strokes that will be played, so that `setup` covers their dynamics
    guard: Guard | None = None  # where the drive's own limits are wider, `setup` tightens them
    sampling: Sampling = "sync"
    injecting: Injecting = "setpoints"
    trace_rate_hz: float | None = None  # wanted of a trace buffer; None: as fast as it holds the whole motion
    trace_s: float = 0.0  # how long the longest trace shall be

    @property
    def silence_allowed_s(self) -> float:
        """How long either side may be silent."""
        return self.misses_allowed * self.heartbeat_s


@dataclass(frozen=True)
class Move:
    """One stroke for drives that make their own profile (PP): a trapezoid."""

    at_index: int
    target_rad: float
    peak_speed_rad_s: float
    acceleration_rad_s2: float


@dataclass(frozen=True)
class Sine:
    """The injection of a drive's own generator: amplitude_nm * sin(2π frequency_hz t + phase_rad)."""

    frequency_hz: float
    amplitude_nm: float
    phase_rad: float = 0.0
    from_motion: bool = (
        False  # True: starts with the motion, where t is 0; False: is on before, t is the drive's own
    )


@dataclass(frozen=True, eq=False)
class Setpoints:
    """What to play, one value per SYNC: absolute position demand and injected torque, (n,)."""

    sample_rate_hz: float
    position_rad: Array
    torque_added_nm: Array  # zeros where the generator injects
    moves: tuple[Move, ...] = ()
    generator: Sine | None = None
    recorded: bool = True  # False: nobody will look at what comes back, so that a trace need not be read out


@dataclass(frozen=True)
class SyncTiming:
    """How evenly SYNC came: intervals between receive times (kernel) or send times (thread) against their mean.

    In lockstep the drive's time is SYNC itself: the period is the nominal one, and there is no deviation.
    """

    producer: str  # "kernel", "thread", "lockstep"
    period_s: float  # the mean interval, as achieved
    rms_s: float
    p99_s: float
    max_s: float


@dataclass(frozen=True, eq=False)
class Recording:
    """What came back, one row per SYNC or per sample of the drive's trace, (n,). Rows in `lost` hold NaN: nothing is
    bridged. Of a trace, `sync_count` counts its rows, `statusword` is -1, `receive_time_s` NaN, as is any column that
    it does not hold. Where nobody knows what was injected, `torque_added_nm` is NaN."""

    sample_rate_hz: float
    sync_count: NDArray[np.int64]
    receive_time_s: Array
    statusword: NDArray[np.int64]
    position_rad: Array
    speed_rad_s: Array
    torque_nm: Array
    position_demand_rad: Array
    torque_added_nm: Array
    lost: NDArray[np.int64]  # indices of SYNCs of which not every TPDO came
    timing: SyncTiming
    notes: tuple[str, ...] = field(default=())
    start_s: float = (
        0.0  # of a trace: when row 0 was sampled, on the clock on which setpoint k is due at k / rate
    )
    sampling: Sampling = "sync"


@dataclass(frozen=True, eq=False)
class LiveSamples:
    """A piece of a motion while it goes on, one row per SYNC, (n,); what has not come is NaN. `motion` counts motions,
    `time_s` is the motion's own."""

    motion: int
    time_s: Array
    position_rad: Array
    speed_rad_s: Array
    torque_nm: Array
    position_demand_rad: Array
    torque_added_nm: Array


@runtime_checkable
class Watched(Protocol):
    """A drive whose motion can be watched."""

    def live(self) -> LiveSamples | None:
        """What came since it was last asked for; None: nothing. For one watcher, from any thread."""
        ...


#: Called with the number of samples done and the number of samples in all.
Progress = Callable[[int, int], None]


def attach_recording(error: BaseException, recording: Recording) -> None:
    """Give an error what was recorded before it, as its attribute `recording`."""
    vars(error)["recording"] = recording


def partial_recording(error: BaseException) -> Recording | None:
    """What `play` had recorded before it raised; None where there is nothing."""
    found = getattr(error, "recording", None)
    return found if isinstance(found, Recording) else None


class Drive(Protocol):
    """One drive on its bus. Methods raise errors of the DriveError family, never a library's own.

    Order of use: connect (constructor) → look (identity, limits, resolution, …) → write what `setup` asks for
    → start → enable → play … → disable → stop → write back → close. `halt` may be called at any time, from any
    thread, more than once, and never raises.
    """

    clock: Clock  # by which it waits, and whose date its records get

    @property
    def identity(self) -> DriveIdentity: ...

    def state(self) -> DriveState: ...

    def limits(self) -> DriveLimits: ...

    def resolution(self) -> Resolution: ...

    def capabilities(self) -> tuple[Capability, ...]: ...

    def bus_load(self, acquisition: Acquisition) -> BusLoad:
        """Share of the bus time taken by the cyclic frames."""
        ...

    def measure_sync(self, sample_rate_hz: float) -> SyncTiming | None:
        """How evenly SYNC would come where this program itself has to send it: by what is measured now, while nothing
        moves. None where somebody keeps the time (a kernel, the drive, a simulated clock) or where there is no SYNC."""
        ...

    def parameter(self, index: int, subindex: int = 0) -> Parameter:
        """Look up a parameter. Raises InputError when the dictionary does not have it."""
        ...

    def read(self, parameter: Parameter) -> ParameterValue: ...

    def write(self, values: Sequence[ParameterValue]) -> None:
        """Write parameters, in the order and NMT state that the standard demands (PDO objects: CiA 301 7.5.2.36)."""
        ...

    def passed_through(self, values: Sequence[ParameterValue]) -> list[Parameter]:
        """Parameters, beyond these, that writing them changes on the way (a PDO is switched off meanwhile), or that
        `play` will, after `setup` (the generator): they are as before when that is over, but not when it is cut
        short."""
        ...

    def setup(self, acquisition: Acquisition) -> list[ParameterValue]:
        """What has to be written (and later restored) for such an acquisition: PDOs, heartbeats, mode, reactions."""
        ...

    def start(self, acquisition: Acquisition) -> None:
        """Heartbeats on, node operational, PDO exchange ready; the power stage stays off."""
        ...

    def enable(self) -> None:
        """Power stage on, holding the present position (CiA 402: Operation enabled)."""
        ...

    def play(self, setpoints: Setpoints, progress: Progress | None = None) -> Recording:
        """Play setpoints and record. A lost node, fault or bus error stops the drive and raises; what was
        recorded until then is in the exception's `recording` attribute."""
        ...

    def halt(self) -> None:
        """Quick stop, now. Never raises. Whatever was under way, nothing is energised or started any more before
        it has been switched off (`disable`) and is started anew, or `reset_fault`."""
        ...

    def reset_fault(self) -> None:
        """Acknowledge a fault, on request only; ends in Switch on disabled, the power stage stays off."""
        ...

    def disable(self) -> None:
        """Power stage off after standstill."""
        ...

    def stop(self) -> None:
        """End PDO exchange and heartbeats; node pre-operational."""
        ...

    def store(self) -> None:
        """Save parameters in the drive's memory (1010). Raises SdoError where it refuses."""
        ...

    def describe(self) -> dict[str, Any]:
        """JSON-ready: identity, profile, units, bus, as stored with a session."""
        ...

    def close(self) -> None: ...
