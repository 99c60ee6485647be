"""Compiled loops: a whole run played on a servo axis, and the torque that a plain machine needs for a motion."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from schwung_sim.compiled import compiled
from schwung_sim.drives.axis import ServoAxis
from schwung_sim.drives.controller import add_torque, control_law, follow_setpoint, sample
from schwung_sim.plants.profile import read_profile
from schwung_sim.plants.two_mass import TICK_S, TwoMassPlant, two_mass_tick

Array = NDArray[np.float64]


@compiled
def _play(cs: Any, memory: Any, machine: Any, demand: Any, added: Any, jitter: Any, rows: Any) -> None:
    """As recording.play does it tick by tick: setpoint, added torque, control, plant, sample; the encoder is noisy."""
    segments, inertia, history, trace = memory
    ps, ss, tables = machine
    c, p, s = cs[0], ps[0], ss[0]
    for tick in range(demand.size):
        follow_setpoint(cs, segments, demand[tick], TICK_S)
        add_torque(cs, added[tick], False)
        torque = control_law(c, segments, inertia, trace)
        if c.motion_started != 0:
            s.motion_time_s = 0.0
            s.motions += 1.0
        two_mass_tick(p, s, tables, torque)
        sample(c, segments, history, s.motor_rad + jitter[tick])
        rows[tick, 0] = c.position_rad
        rows[tick, 1] = c.reported_speed_rad_s
        rows[tick, 2] = c.reported_torque_nm


class PlayedAxis(ServoAxis):
    """A servo axis over a two-mass plant that plays a run without leaving compiled code."""

    def __init__(self, plant: TwoMassPlant, *arguments: Any, **options: Any) -> None:
        super().__init__(plant, *arguments, **options)
        self.two_mass = plant

    def play(self, demand_rad: Array, torque_added_nm: Array, jitter_rad: Array) -> Array:
        """Position (rad), speed (rad/s), torque (N·m) as reported after every tick, (m, 3).

        `jitter_rad` is the encoder's noise, (m,); the loop reacts to it as to any angle.
        Raises BenchError where the plant diverges.
        """
        rows = np.empty((demand_rad.size, 3))
        memory = (self._segments, self._table, self._history, self._trace)
        _play(self._control, memory, self._machine, demand_rad, torque_added_nm, jitter_rad, rows)
        self._ticks += demand_rad.size
        self.plant.check()
        return rows


@compiled
def _load_acceleration(
    p: Any, inertia: Any, motor: float, motor_speed: float, angle: float, speed: float
) -> Any:
    """Load acceleration (rad/s²) and coupling torque (N·m) of the plain machine at one instant."""
    shaft = p.stiffness_nm_rad * (motor - angle) + p.damping_nms * (motor_speed - speed)
    j, slope = read_profile(inertia, angle)
    return (shaft - p.load_viscous_nms * speed - 0.5 * slope * speed**2) / j, shaft


@compiled
def needed_torque(ps: Any, inertia: Any, start_rad: float, speed: Any, needed: Any) -> None:
    """Motor torque (N·m), (m,), that the plain machine in `ps` needs to move at the motor speeds (rad/s), (m,).

    The load hangs on the prescribed motor motion and is integrated from rest at `start_rad`, Runge-Kutta of fourth
    order, one step per tick; the first and last two values have no acceleration and are those of the neighbours.
    """
    p, h, n = ps[0], TICK_S, speed.size
    motor, angle, load_speed = start_rad, start_rad, speed[0]
    for i in range(n):
        v0 = speed[i]
        a1, shaft = _load_acceleration(p, inertia, motor, v0, angle, load_speed)
        k = min(max(i, 2), n - 3)
        motor_acceleration = (8 * (speed[k + 1] - speed[k - 1]) - (speed[k + 2] - speed[k - 2])) / (12 * h)
        needed[i] = p.rotor_inertia_kgm2 * motor_acceleration + p.rotor_viscous_nms * v0 + shaft
        v2 = speed[min(i + 1, n - 1)]
        # between the ticks the speed has the curvature of its neighbours
        bend = (v0 + v2 - speed[max(i - 1, 0)] - speed[min(i + 2, n - 1)]) / 16.0
        v1 = 0.5 * (v0 + v2) + bend
        m1 = motor + 0.5 * h * (v0 + 0.5 * (v1 - v0))
        m2 = motor + h * (v0 + 4 * v1 + v2) / 6.0
        s1 = load_speed + 0.5 * h * a1
        a2, _ = _load_acceleration(p, inertia, m1, v1, angle + 0.5 * h * load_speed, s1)
        s2 = load_speed + 0.5 * h * a2
        a3, _ = _load_acceleration(p, inertia, m1, v1, angle + 0.5 * h * s1, s2)
        s3 = load_speed + h * a3
        a4, _ = _load_acceleration(p, inertia, m2, v2, angle + h * s2, s3)
        angle += h * (load_speed + 2 * s1 + 2 * s2 + s3) / 6.0
        load_speed += h * (a1 + 2 * a2 + 2 * a3 + a4) / 6.0
        motor = m2
