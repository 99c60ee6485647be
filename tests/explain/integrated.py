"""Machines that another integrator moved, as recordings and as what is weighed of them."""

from collections.abc import Callable, Sequence

import numpy as np

from schwung.drivetrain.machine import Machine
from schwung.explain.causes.along import ranges_of
from schwung.explain.causes.known import known
from schwung.explain.causes.true_torque import TrueTorque
from schwung.explain.weighing.round import View
from schwung.innovations.likelihood import Noise
from schwung.innovations.signals import picked_signals_of
from schwung.motion import Array
from schwung.session.model import Run

RATE_HZ = 2000.0
TICK_S, TICKS = 62.5e-6, 16000


def shaken(slope: Callable[[Array, float], Array]) -> tuple[Array, Array, Array]:
    """Instants (n,), states (n, 4) and torque (n,) of a rotor that a spring and a damper hold, shaken at 40 Hz while it
    is carried there and back, by Runge and Kutta; `slope`: of a state, angle and speed first, under a torque."""
    time, state, states, torques = np.arange(TICKS) * TICK_S, np.zeros(4), [], []
    for now in time:
        wished = 1.5 * np.sin(2 * np.pi * 1.2 * max(now - 0.1, 0.0)) ** 2
        held = 125.0 * (wished - state[0]) - 5.0 * state[1]
        torque = held + 5.0 * np.sin(2 * np.pi * 40 * now) * min(now / 0.05, 1.0)
        states.append(state)
        torques.append(torque)
        one = slope(state, torque)
        two = slope(state + TICK_S / 2 * one, torque)
        three = slope(state + TICK_S / 2 * two, torque)
        four = slope(state + TICK_S * three, torque)
        state = state + TICK_S / 6 * (one + 2 * two + 2 * three + four)
    torque_nm = np.array(torques)
    # the torque of a tick is held until the next: on average it belongs half a tick later
    torque_nm[1:] = (torque_nm[1:] + torque_nm[:-1]) / 2
    return time, np.array(states), torque_nm


def sampled(
    number: int, time: Array, moved: Array, torque: Array, noise: Noise, rate_hz: float = RATE_HZ
) -> Run:
    """A run with noise; `moved`: angle and speed of the motor in the first two of its rows."""
    sizes = (noise.position_rad, noise.speed_rad_s, noise.torque_nm)
    noisy = sizes * np.random.default_rng(number).standard_normal((time.size, 3))
    return Run(
        role="reference",
        repeat=number,
        sample_rate_hz=rate_hz,
        time_s=time,
        position_rad=moved[0] + noisy[:, 0],
        speed_rad_s=moved[1] + noisy[:, 1],
        torque_nm=torque + noisy[:, 2],
    )


def view_of(recorded: Sequence[Run], machine: Machine) -> View:
    """What is weighed of them, of as many samples as say all there is."""
    runs = [picked_signals_of(run, machine, 160.0) for run in recorded]
    of = ranges_of(runs, 0.002, 160.0)
    torques = tuple(TrueTorque(run, run.drive.whole_nm) for run in runs)
    return View(recorded, tuple(runs), known(machine, of.low_rad, of.high_rad), of, torques, dry_nm=0.0)
