"""A drive without a bus: parameters in a dictionary, motion by the believed simulation. For the procedure's tests."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Any

import numpy as np

from schwung.clock import SteppedClock
from schwung.drivetrain import Control, Coupling, FeedForward, Load, Machine, Motor, simulate
from schwung.errors import InputError, SdoError
from schwung.fieldbus.drive import (
    Acquisition,
    BusLoad,
    Capability,
    DriveIdentity,
    DriveLimits,
    DriveState,
    Parameter,
    ParameterValue,
    Progress,
    Recording,
    Resolution,
    Setpoints,
    SyncTiming,
)
from schwung.motion import Demand


def believed_machine(load_inertia: float | None = 0.11) -> Machine:
    """The paper's machine with a guessed, constant load."""
    return Machine(
        name="test machine",
        motor=Motor(inertia_kgm2=0.012, viscous_friction_nms=0.2, peak_torque_nm=233.0),
        coupling=Coupling(stiffness_nm_rad=24963.0, damping_nms=8.62),
        load=Load(viscous_friction_nms=0.1, inertia_kgm2=load_inertia),
        control=Control(
            position_gain_per_s=40.0, speed_gain_nms=12.0, speed_integral_time_s=20e-3, sample_rate_hz=8000.0
        ),
    )


#: Motions of the creep where nothing hides the injected torque: at standstill, and one stroke.
CREEP_PLAYS = 2


class DeskDrive:
    """Fulfils the Drive protocol. `calls` logs what was asked of it; `before_play` may raise in mid-procedure, and is
    told the number of the run, from 0: what is played before is the creep."""

    def __init__(self, machine: Machine) -> None:
        self.sync_timing: SyncTiming | None = None  # of a thread that would send it
        self.machine = machine
        self.clock = SteppedClock()
        self.identity = DriveIdentity(3, 0x53574E47, 0x402, 0x10000, 7, "desk drive")
        self.calls: list[str] = []
        self.objects: dict[tuple[int, int], int] = {
            (0x6060, 0): 1,
            (0x1016, 1): 0,
            (0x1017, 0): 0,
            (0x6041, 0): 0x1237,
        }
        self.before_play: Callable[[int], None] = lambda number: None
        self.lost: dict[int, list[int]] = {}  # playback number -> lost indices
        self.jitter_s = 0.0
        self.sync_is_slow_by = 0.0
        self.unwritable: set[tuple[int, int]] = set()
        self.plays = -CREEP_PLAYS
        self.on_the_way: list[tuple[int, int]] = []
        self.on_call: Callable[[int], None] = lambda number: None  # told the number of each call, from 0

    def _called(self, what: str) -> None:
        self.calls.append(what)
        self.on_call(len(self.calls) - 1)

    def state(self) -> DriveState:
        return DriveState("PRE-OPERATIONAL", "Switch on disabled", 0.0)

    def limits(self) -> DriveLimits:
        return DriveLimits(-0.5, 4.0, 60.0, 233.0, 70.0, 0.5, 0.1)

    def resolution(self) -> Resolution:
        return Resolution(6e-6, 1e-4, 0.07, 0.07)

    def capabilities(self) -> tuple[Capability, ...]:
        return (Capability("torque injection", True, "60B2 is mapped"),)

    def bus_load(self, acquisition: Acquisition) -> BusLoad:
        return BusLoad(0.43 * acquisition.sample_rate_hz / 1000, "1000 kbit/s")

    def measure_sync(self, sample_rate_hz: float) -> SyncTiming | None:
        return self.sync_timing

    def parameter(self, index: int, subindex: int = 0) -> Parameter:
        if (index, subindex) not in self.objects:
            raise InputError("desk drive", f"has no 0x{index:04X}:{subindex:02X}")
        return Parameter(index, subindex, "UNSIGNED32", f"object {index:04X}")

    def read(self, parameter: Parameter) -> ParameterValue:
        return ParameterValue(parameter, self.objects[parameter.index, parameter.subindex])

    def write(self, values: Sequence[ParameterValue]) -> None:
        for value in values:
            key = (value.parameter.index, value.parameter.subindex)
            if key in self.unwritable:
                raise SdoError(value.parameter.label, "cannot be written now")
            self.objects[key] = int(value.raw)
            self._called(f"write {key[0]:04X}={value.raw}")

    def passed_through(self, values: Sequence[ParameterValue]) -> list[Parameter]:
        return [self.parameter(*key) for key in self.on_the_way]

    def setup(self, acquisition: Acquisition) -> list[ParameterValue]:
        return [
            ParameterValue(self.parameter(0x6060), 8),
            ParameterValue(self.parameter(0x1016, 1), 0x7F012C),
            ParameterValue(self.parameter(0x1017), 100),
        ]

    def start(self, acquisition: Acquisition) -> None:
        self._called("start")

    def enable(self) -> None:
        self._called("enable")

    def play(self, setpoints: Setpoints, progress: Progress | None = None) -> Recording:
        number = self.plays
        self.plays += 1  # 0 is the first run's
        self._called("play")
        self.before_play(number)
        rate = setpoints.sample_rate_hz
        time = np.arange(setpoints.position_rad.size) / rate
        speed = np.gradient(setpoints.position_rad, time)
        demand = Demand(setpoints.position_rad, speed, np.gradient(speed, time))
        made = simulate(
            self.machine, demand, time, torque_added_nm=setpoints.torque_added_nm,
            feed_forward=FeedForward(speed_share=1.0), hold_torque_added=True,
        )  # fmt: skip
        if progress is not None:
            progress(time.size, time.size)
        lost = np.array(self.lost.get(number, []), dtype=np.int64)
        position = made.position_rad.copy()
        position[lost] = np.nan
        index = np.arange(time.size)
        return Recording(
            sample_rate_hz=rate, sync_count=index, receive_time_s=time, statusword=np.full(time.size, 0x1237),
            position_rad=position, speed_rad_s=made.speed_rad_s, torque_nm=made.torque_nm,
            position_demand_rad=setpoints.position_rad, torque_added_nm=setpoints.torque_added_nm, lost=lost,
            timing=SyncTiming(
                "thread", (1 + self.sync_is_slow_by) / rate, self.jitter_s / 2, self.jitter_s, self.jitter_s * 2
            ),
        )  # fmt: skip

    def halt(self) -> None:
        self._called("halt")

    def disable(self) -> None:
        self._called("disable")

    def stop(self) -> None:
        self._called("stop")

    def store(self) -> None:
        self._called("store")

    def describe(self) -> dict[str, Any]:
        return {"identity": vars(self.identity), "profile": "desk"}

    def close(self) -> None:
        self._called("close")


class Silence:
    """An observer that keeps what it was told."""

    def __init__(self) -> None:
        self.notes: list[str] = []

    def phase(self, text: str) -> None: ...

    def progress(self, done: int, total: int) -> None: ...

    def note(self, text: str) -> None:
        self.notes.append(text)
