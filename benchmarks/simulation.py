"""How fast and how exact is the compiled simulation? Against scipy's solve_ivp, in one run.

    python benchmarks/simulation.py [SECONDS]

The paper's machine (Table 1) makes a 250 ms stroke under its 8 kHz cascade with 50 Hz injected. Three ways:

- ours, `schwung.drivetrain.simulation.simulate`;
- solve_ivp from tick to tick, as a sampled controller demands, at the loosest tolerance as exact as ours;
- solve_ivp in one call with an analogue controller in the place of the sampled one: another system, and the
  kindest that can be done for solve_ivp. Its error is against its own reference.

The reference is DOP853 at 1e-12. Errors are the largest of the motor's speed at the 8 kHz ticks.
"""

from __future__ import annotations

import bisect
import sys
import time as clock
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import partial

import numpy as np
from scipy.integrate import solve_ivp
from scipy.interpolate import PchipInterpolator

from schwung.drivetrain.inertia import InertiaTable
from schwung.drivetrain.machine import Machine, paper_machine
from schwung.drivetrain.simulation import simulate
from schwung.motion import Array, Excitation, Motion

MOTION = Motion(distance_rad=np.pi, duration_s=0.25, start_time_s=0.02)
EXCITATION = Excitation(frequency_hz=50.0, amplitude_nm=46.6)
TOLERANCES = (1e-4, 1e-6, 1e-7, 1e-8, 1e-9, 1e-10)


@dataclass(frozen=True)
class Result:
    """One way of simulating: wall time (s) and largest error of the motor speed (rad/s)."""

    name: str
    wall_s: float
    error_rad_s: float


class Rival:
    """The two-mass machine in plain Python floats, quick for what it is, for solve_ivp. No load torque."""

    def __init__(self, machine: Machine) -> None:
        table, coupling = machine.load_inertia, machine.coupling
        assert isinstance(table, InertiaTable)
        assert coupling is not None
        self.machine, self.control = machine, machine.required_control()
        self.stiffness, self.damping = coupling.stiffness_nm_rad, coupling.damping_nms
        pieces = PchipInterpolator(table.position_rad, table.inertia_kgm2)
        self.knots, self.pieces = pieces.x.tolist(), pieces.c.T.tolist()

    def inertia(self, angle: float) -> tuple[float, float]:
        """J_l (kg·m²) and dJ_l/dθ at a load angle."""
        inside = min(max(angle, self.knots[0]), self.knots[-1])
        i = min(bisect.bisect_right(self.knots, inside) - 1, len(self.pieces) - 1)
        a, b, c, d = self.pieces[i]
        u = inside - self.knots[i]
        return ((a * u + b) * u + c) * u + d, ((3 * a * u + 2 * b) * u + c) * (inside == angle)

    def rates(self, _: float, state: Sequence[float], torque: float) -> list[float]:
        """Time derivative of motor angle, motor speed, load angle, load speed."""
        motor_angle, motor_speed, load_angle, load_speed = state[:4]
        motor, load = self.machine.motor, self.machine.load
        inertia, slope = self.inertia(load_angle)
        twist = self.damping * (motor_speed - load_speed) + self.stiffness * (motor_angle - load_angle)
        return [
            motor_speed,
            (torque - twist - motor.viscous_friction_nms * motor_speed) / motor.inertia_kgm2,
            load_speed,
            (twist - load.viscous_friction_nms * load_speed - slope * load_speed**2 / 2) / inertia,
        ]

    def sampled(self, time: Array, method: str, tolerance: float) -> Array:
        """Motor speed (rad/s) at the ticks `time`, (n,), one solve_ivp per tick; torque never clips here."""
        control, period = self.control, float(time[1] - time[0])
        demand, added = MOTION.demand(time).position_rad.tolist(), EXCITATION.torque(time).tolist()
        state, integral, speeds = [0.0, 0.0, 0.0, 0.0], 0.0, []
        for wanted, injected in zip(demand, added, strict=True):
            speeds.append(state[1])
            error = control.position_gain_per_s * (wanted - state[0]) - state[1]
            torque = control.speed_gain_nms * error + integral + injected
            integral += control.speed_gain_nms * error * period / control.speed_integral_time_s
            solution = solve_ivp(
                self.rates,
                (0.0, period),
                state,
                method=method,
                rtol=tolerance,
                atol=tolerance,
                args=(torque,),
            )
            state = solution.y[:, -1].tolist()
        return np.array(speeds)

    def analogue(self, time: Array, method: str, tolerance: float) -> Array:
        """Motor speed (rad/s) at `time`, (n,), under an analogue controller: one solve_ivp for all."""
        control = self.control
        demand = MOTION.demand(time).position_rad
        rate, ticks = 1 / float(time[1] - time[0]), time.size - 2

        def rates(t: float, state: Sequence[float]) -> list[float]:
            i = min(int(t * rate), ticks)
            wanted = demand[i] + (demand[i + 1] - demand[i]) * (t * rate - i)
            error = control.position_gain_per_s * (wanted - state[0]) - state[1]
            injected = EXCITATION.amplitude_nm * np.sin(2 * np.pi * EXCITATION.frequency_hz * t)
            torque = control.speed_gain_nms * (error + state[4] / control.speed_integral_time_s) + injected
            return [*self.rates(t, state, torque), error]

        solution = solve_ivp(
            rates,
            (time[0], time[-1]),
            np.zeros(5),
            method=method,
            t_eval=time,
            rtol=tolerance,
            atol=tolerance,
        )
        return np.asarray(solution.y[1])


def _timed(call: Callable[[], Array]) -> tuple[Array, float]:
    start = clock.perf_counter()
    values = call()
    return values, clock.perf_counter() - start


def _loosest(name: str, call: Callable[[float], Array], reference: Array, wanted: float) -> Result:
    """The first tolerance that is as exact as `wanted` (rad/s)."""
    for tolerance in TOLERANCES:
        speeds, wall = _timed(partial(call, tolerance))
        error = float(np.max(np.abs(speeds - reference)))
        if error <= wanted:
            break
    return Result(f"{name}, tolerance {tolerance:g}", wall, error)


def measure(seconds: float, analogue: bool = True) -> list[Result]:
    """Ours first, then the rivals, over so many simulated seconds; the analogue ones only where asked for."""
    machine = paper_machine()
    rival = Rival(machine)
    time = np.arange(round(seconds * 8000) + 1) / 8000
    demand, added = MOTION.demand(time), EXCITATION.torque(time)
    reference = rival.sampled(time, "DOP853", 1e-12)

    def ours() -> Array:
        return simulate(machine, demand, time, added).speed_rad_s

    error = float(np.max(np.abs(ours() - reference)))  # compiled, or loaded from the cache, by now
    walls = [_timed(ours)[1] for _ in range(15)]
    per_tick = _loosest("solve_ivp RK45 per tick", partial(rival.sampled, time, "RK45"), reference, error)
    # Ours lasts some milliseconds: on a computer that stalls, all of them in a row may be inside one stall.
    walls += [_timed(ours)[1] for _ in range(15)]
    results = [Result("ours, compiled", min(walls), error), per_tick]
    if analogue:
        exact = rival.analogue(time, "DOP853", 1e-12)
        for method in ("RK45", "LSODA"):
            call = partial(rival.analogue, time, method)
            results.append(_loosest(f"solve_ivp {method}, analogue controller", call, exact, error))
    return results


def main() -> None:
    seconds = float(sys.argv[1]) if len(sys.argv) > 1 else 1.0
    ours, *rivals = measure(seconds)
    print(f"{seconds:g} s of the paper's machine at 8 kHz; largest error of the motor's speed")
    for result in (ours, *rivals):
        print(
            f"{result.name:56s} {result.wall_s * 1e3:9.2f} ms   {result.error_rad_s:.1e} rad/s"
            f"   {result.wall_s / ours.wall_s:7.0f} ×"
        )


if __name__ == "__main__":
    main()
