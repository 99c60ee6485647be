"""The closed loop around the slider-crank; apart from the controller, which has to do without MuJoCo."""

from __future__ import annotations

from typing import Any

from schwung_sim.compiled import compiled
from schwung_sim.drives.controller import control_law, sample
from schwung_sim.plants.crank_kernel import MOTOR, crank_tick


@compiled
def crank_loop(ticks: int, cs: Any, memory: Any, kernel: Any) -> None:
    """Whole ticks without leaving compiled code."""
    segments, inertia, history, trace = memory
    c, s = cs[0], kernel.state[0]
    for _ in range(ticks):
        torque = control_law(c, segments, inertia, trace)
        if c.motion_started != 0:
            s.motion_time_s = 0.0
            s.motions += 1.0
        crank_tick(kernel, torque)
        sample(c, segments, history, kernel.angle[MOTOR] - kernel.shift_rad)
