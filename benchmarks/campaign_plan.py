"""What is commissioned in the fault campaign, and how: the ways, the machine as believed, the plan in plain numbers."""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import cache
from typing import Any

from schwung.drivetrain import Coupling, Load, Machine, Motor
from schwung.fieldbus.canopen import driver
from schwung.fieldbus.profile import DeviceProfile, load_profile
from schwung_sim.campaign.monitor import Expected

NODE = 3
OVERDUE_S = 90.0  # of simulated time: all patience of a tool whose drive answers nothing, thrice
MOVED_RAD = 0.02  # by so much the axis may have been moved before it starts
AFTERMATH_S = 0.25  # for so long one looks whether a drive that nobody looks after has stopped by itself
DISTANCE_RAD, DURATION_S = 0.5, 0.15
ROOM_RAD = 0.15  # between the stroke and the ends of the window
SPEED_RAD_S, TORQUE_NM, FOLLOWING_RAD = 12.05, 60.0, 0.1
# The bench's drive, as its data sheet would have it: counts a turn, rated torque, per cent of it that is injected.
COUNT_RAD = 2 * math.pi / 2**20
COARSE_COUNTS = 1000
RATED_TORQUE_NM = 70.0
SILENCE_S, DECELERATION_RAD_S2 = 0.3, 10_000 * 2 * math.pi / 60


@dataclass(frozen=True)
class Way:
    """One way of commissioning, and how often it is taken."""

    name: str
    weight: float
    wishes: dict[str, Any]
    mode: int = 8
    writable: frozenset[int] = frozenset({0x6040})


_PP = frozenset({0x6040, 0x6081, 0x6083, 0x6084})
_OWN = frozenset({0x2100, 0x2200})
_TRACED = {"sampling": "trace", "trace_rate_hz": 500.0}
WAYS = (
    Way("setpoints, 500 Hz", 5.0, {"sample_rate_hz": 500.0}),
    Way("setpoints, 1 kHz", 2.0, {"sample_rate_hz": 1000.0, "frequency_hz": 100.0}),
    Way("one way", 1.0, {"sample_rate_hz": 500.0, "returns": False}),
    Way("profile position", 1.0, {"sample_rate_hz": 500.0, "mode": "pp"}, 1, _PP),
    Way("by itself", 0.7, {**_TRACED, "sample_rate_hz": 200.0, "mode": "pp", "injecting": "generator"}, 1, _PP | _OWN),
    Way("setpoints, trace", 0.5, {**_TRACED, "sample_rate_hz": 500.0}, 8, _PP | _OWN),
)  # fmt: skip


@cache
def profile(stays: bool = False) -> DeviceProfile:
    """The bench's; `stays`: one that has no opinion on 605A, which then is as in the drive."""
    whole = load_profile("schwung-bench")
    return (
        whole.model_copy(update={"stop": whole.stop.model_copy(update={"quick_stop_option": None})})
        if stays
        else whole
    )


#: The dictionary is read from its file once for all sessions; nobody changes it.
read_eds = cache(driver.eds.read_eds)


@cache
def machine() -> Machine:
    return Machine(
        name="campaign",
        motor=Motor(inertia_kgm2=0.012, viscous_friction_nms=0.2, peak_torque_nm=233.0),
        coupling=Coupling(stiffness_nm_rad=24963.0, damping_nms=8.62),
        load=Load(viscous_friction_nms=0.1, inertia_kgm2=0.11),
    )


def expected(way: Way, start_rad: float) -> Expected:
    """The plan, computed from the wishes: peak speed of the trapezoid with equal thirds is 1.5 times the mean."""
    period_s = 1.0 / way.wishes["sample_rate_hz"]
    step = 1.5 * DISTANCE_RAD / DURATION_S * period_s
    bend = 4.5 * DISTANCE_RAD / DURATION_S**2 * period_s**2  # that speed is reached in a third of the time
    return Expected(
        node_id=NODE,
        low_rad=start_rad - ROOM_RAD,
        high_rad=start_rad + DISTANCE_RAD + ROOM_RAD,
        speed_rad_s=SPEED_RAD_S,
        torque_nm=TORQUE_NM,
        silence_s=SILENCE_S,
        deceleration_rad_s2=DECELERATION_RAD_S2,
        step_rad=DISTANCE_RAD + MOVED_RAD if way.mode == 1 else step,
        bend_rad=None if way.mode == 1 else bend,
        added_counts=math.ceil(0.2 * TORQUE_NM / RATED_TORQUE_NM * 1000),
        mode=way.mode,
        writable=way.writable,
    )
