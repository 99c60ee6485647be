"""Machines that another integrator moved, as recordings and as what is weighed of them."""

from collections.abc import Sequence

import numpy as np

from schwung.drivetrain.machine import Machine
from schwung.explain.weighing.along import ranges_of
from schwung.explain.weighing.known import known
from schwung.explain.weighing.round import View
from schwung.explain.weighing.true_torque import TrueTorque
from schwung.innovations.likelihood import Noise
from schwung.innovations.signals import signals_of
from schwung.motion import Array
from schwung.session.model import Run

RATE_HZ = 2000.0


def sampled(number: int, time: Array, moved: Array, torque: Array, noise: Noise) -> Run:
    """A run with noise; `moved`: angle and speed of the motor in the first two of its rows."""
    sizes = (noise.position_rad, noise.speed_rad_s, noise.torque_nm)
    noisy = sizes * np.random.default_rng(number).standard_normal((time.size, 3))
    return Run(
        role="reference",
        repeat=number,
        sample_rate_hz=RATE_HZ,
        time_s=time,
        position_rad=moved[0] + noisy[:, 0],
        speed_rad_s=moved[1] + noisy[:, 1],
        torque_nm=torque + noisy[:, 2],
    )


def view_of(recorded: Sequence[Run], machine: Machine) -> View:
    """What is weighed of them."""
    runs = [signals_of(run, machine, 160.0) for run in recorded]
    of = ranges_of(runs, 0.002, 160.0)
    torques = tuple(TrueTorque(run, run.drive.whole_nm) for run in runs)
    return View(recorded, tuple(runs), known(machine, of.low_rad, of.high_rad), of, torques, dry_nm=0.0)
