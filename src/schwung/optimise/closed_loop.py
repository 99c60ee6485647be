"""The best motion under the drive's own controller: how far the axis is off while it follows."""

from __future__ import annotations

import numpy as np

from schwung.drivetrain import FeedForward, Machine, Simulated, simulate
from schwung.errors import InputError
from schwung.optimise.formats import cycle_torque
from schwung.optimise.values import Stroke, Task

#: Setpoints per second, where nobody says otherwise; and how much finer the motion is simulated.
RATE_HZ, FINER = 1000.0, 8


def followed_by_the_drive(machine: Machine, stroke: Stroke, rate_hz: float = RATE_HZ) -> Simulated:
    """The stroke and the rest behind it, with its torque beside the setpoints and the demanded speed fed forward.

    Raises InputError where the machine has no [control].
    """
    motion = stroke.motion(start_time_s=2 / rate_hz)
    time, cycles = motion.time(FINER * rate_hz), motion.time(rate_hz)
    torque = cycle_torque(stroke, None, motion, cycles) - stroke.hold_start_nm
    cycle = np.minimum(
        np.arange(time.size) // FINER + 1, cycles.size - 1
    )  # held before the setpoint it is for
    return simulate(
        machine, motion.demand(time), time, torque[cycle], feed_forward=FeedForward(speed_share=1.0),
        start_rad=stroke.start_rad, hold_torque_added=True,
    )  # fmt: skip


def require_followed(machine: Machine, task: Task, stroke: Stroke) -> None:
    """Raise InputError where the axis would be further off than the task allows."""
    allowed = task.limits.following_error_rad
    if allowed is None:
        return
    worst = followed_by_the_drive(machine, stroke).peak_following_error_rad
    if worst > allowed:
        raise InputError(
            "--following-error",
            f"is {allowed:.3g} rad, and the drive would be off by {worst:.3g} rad on the best motion",
            "Give a longer --duration, a limit of jerk (--max-jerk), or more weight on vibration.",
        )
