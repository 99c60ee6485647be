"""The machine as extended and sigma-point Kalman filters see it: two masses, and an inertia that walks at random.

State: speed of rotor and load, wind-up of the coupling, ln J_l; the logarithm keeps an inertia positive and makes
its walk free of scale. Input: the denoised torque, straight between samples; measured: the denoised speed. On
the denoised signals friction is linear, and neither load torque nor ½ J' ω² of the motion is in the way; J' ω₀ of
the injection is not modelled, as in the sources. A rigid machine is one mass whose two speeds are one.
"""

from __future__ import annotations

import math
from abc import ABC, abstractmethod
from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np

from schwung.compiled import compiled
from schwung.drivetrain.inertia import InertiaTable
from schwung.drivetrain.machine import Machine
from schwung.estimation.inversion import two_mass_response
from schwung.estimation.methods import Outcome, Task
from schwung.estimation.rivals.common import labelled, memory_s, noise_level, started
from schwung.estimation.values import Denoised, Trace
from schwung.motion import Array

STATES = 4
ROTOR, LOAD, TWIST, LOG_INERTIA = range(STATES)
#: Of the time constant for the walk: speed answers to an inertia by its integral, which takes as long again. The lag
#: (`lag_s`) then comes out as that of the other rivals, on stiff and soft machines, at 1 and 4 kHz.
SHARE_OF_MEMORY = 0.5
#: Fastest motion (rad/s) times step of the integration; fourth order, so that this is exact to 1e-6.
STEP = 0.25
#: Change of ln J within the filter's memory by which its lag is measured.
RAMP = 1e-3
#: The first guess of the inertia may be wrong by a factor e^±1.
FIRST_GUESS_STD = 1.0


class Params(NamedTuple):
    """Plain numbers for the compiled steps; SI."""

    rotor_inertia: float
    motor_friction: float
    load_friction: float
    stiffness: float
    damping: float
    rigid: bool
    substeps: int
    step_s: float


@dataclass(frozen=True, eq=False)
class Filtering:
    """Everything that a filter needs for one run."""

    params: Params
    torque_nm: Array
    speed_rad_s: Array
    state: Array  # (4,)
    covariance: Array  # (4, 4)
    process: Array  # covariance that a step adds, diagonal (4,)
    speed_variance: float
    memory_s: float

    @property
    def arguments(self) -> tuple[Array, Array, Array, Array, Array, float, Params]:
        """What a compiled filter takes: torque and speed (n,), first state and covariance, what each step adds, …"""
        return (
            self.torque_nm, self.speed_rad_s, self.state, self.covariance, self.process, self.speed_variance,
            self.params,
        )  # fmt: skip


@dataclass(frozen=True)
class AugmentedKalman(ABC):
    """One pass of a Kalman filter per run; how it passes a sample is the subclass's."""

    name: str = ""
    needs_reference: bool = True

    @abstractmethod
    def log_inertia(self, run: Filtering) -> Array:
        """ln J_l after each sample, (n,)."""

    def inertia(self, run: Filtering) -> Array:
        """J_l (kg·m²) after each sample, (n,)."""
        return np.asarray(np.exp(self.log_inertia(run)))

    def traces(self, task: Task) -> Outcome:
        """Filter, take the inertia, label it by the filter's lag. Raises InputError as denoising does."""
        start, traces = started(task, self.name), []
        for pair, trace in zip(start.denoised, start.traces, strict=True):
            run = filtering(task, pair, trace)
            age = lag_s(self.inertia, run)
            traces.append(labelled(trace, pair, task, self.inertia(run), age=age))
        return replace(start, traces=tuple(traces))


def filtering(task: Task, pair: Denoised, trace: Trace) -> Filtering:
    """Set a filter up by the rule of `common`.

    Noise: from the signals; torque noise is process noise of the rotor. First guess: the machine's inertia, or
    else the median of the SDFT's. The walk of ln J: a Kalman filter of one parameter with information I per
    second and a walk q forgets with 1/√(q I), so that q = 1/(memory² I); I is how clearly the speed at f_est
    tells ln J, |∂ω/∂ln J|²/2 f_s/variance, at the first guess and the measured amplitude.
    """
    machine, rate = task.machine, pair.excited.sample_rate_hz
    guess = first_guess(machine, trace)
    torque_std, speed_std = noise_level(pair.torque_nm), noise_level(pair.speed_rad_s)
    amplitude = float(np.nanmedian(trace.torque_amplitude_nm))
    slope, gain = _sensitivity(machine, task.frequency_hz, guess)
    variance = speed_std**2 + (gain * torque_std) ** 2
    information = (slope * amplitude) ** 2 / 2 * rate / variance
    memory = SHARE_OF_MEMORY * memory_s(task.frequency_hz)
    walk = 1 / (memory**2 * information)
    moved = machine.motor.inertia_kgm2 + (guess if machine.coupling is None else 0.0)
    process = np.zeros(STATES)
    process[ROTOR] = (torque_std / moved / rate) ** 2
    process[LOG_INERTIA] = walk / rate
    return Filtering(
        params=params_of(machine, guess, 1 / rate),
        torque_nm=pair.torque_nm,
        speed_rad_s=pair.speed_rad_s,
        state=np.array([0.0, 0.0, 0.0, math.log(guess)]),
        covariance=np.diag([speed_std**2, speed_std**2, 0.0, FIRST_GUESS_STD**2]),
        process=process,
        speed_variance=speed_std**2,
        memory_s=memory,
    )


def first_guess(machine: Machine, trace: Trace) -> float:
    """The inertia (kg·m²) to start from: as believed, or the median of a quick estimate."""
    believed = machine.load_inertia
    if isinstance(believed, InertiaTable):
        return float(np.mean(believed.inertia_kgm2))
    positive = trace.inertia_kgm2[np.nan_to_num(trace.inertia_kgm2) > 0]
    return believed or float(np.median(positive))


def lag_s(kalman: Callable[[Filtering], Array], run: Filtering) -> float:
    """How far a filter's inertia comes behind (s), the median: its answer to a slow ramp of ln J, simulated.

    The torque is that of the run, so that the excitation is what it was; the speed is the model's, without noise.
    """
    drift = RAMP * run.params.step_s / run.memory_s  # of ln J per sample
    log_inertia = run.state[LOG_INERTIA] + drift * np.arange(run.torque_nm.size)
    speed = _speed(run.torque_nm, log_inertia, run.params)
    behind = (log_inertia - np.log(kalman(replace(run, speed_rad_s=speed)))) / drift
    return float(np.median(behind[behind.size // 4 : -behind.size // 4])) * run.params.step_s


def params_of(machine: Machine, inertia_kgm2: float, step_s: float) -> Params:
    """Numbers for the compiled steps; as many sub-steps as the coupling needs."""
    rotor, coupling = machine.motor.inertia_kgm2, machine.coupling
    stiffness, damping = (coupling.stiffness_nm_rad, coupling.damping_nms) if coupling else (0.0, 0.0)
    mobility = 1 / rotor + 1 / (inertia_kgm2 * math.exp(-2 * FIRST_GUESS_STD))
    fastest = max(math.sqrt(stiffness * mobility), damping * mobility)
    return Params(
        rotor_inertia=rotor,
        motor_friction=machine.motor.viscous_friction_nms,
        load_friction=machine.load.viscous_friction_nms,
        stiffness=stiffness,
        damping=damping,
        rigid=coupling is None,
        substeps=max(1, math.ceil(fastest * step_s / STEP)),
        step_s=step_s,
    )


def _sensitivity(machine: Machine, frequency_hz: float, inertia_kgm2: float) -> tuple[float, float]:
    """|∂G/∂ln J_l| and |G| of speed over torque at f_est, rad/s per N·m, friction neglected."""
    omega, rotor = 2 * math.pi * frequency_hz, machine.motor.inertia_kgm2
    inertias = inertia_kgm2 * np.array([0.99, 1.0, 1.01])
    if machine.coupling is None:
        response = 1 / (1j * omega * (rotor + inertias))
    else:
        response = two_mass_response(inertias, omega, rotor, machine.coupling)
    return float(abs(response[2] - response[0])) / 0.02, float(abs(response[1]))


@compiled
def _slope(state: Array, torque: float, p: Params, out: Array) -> None:
    """Time derivative of speeds and wind-up, into `out`."""
    load_inertia = math.exp(state[LOG_INERTIA])
    out[LOG_INERTIA] = 0.0
    if p.rigid:
        friction = (p.motor_friction + p.load_friction) * state[ROTOR]
        out[ROTOR] = (torque - friction) / (p.rotor_inertia + load_inertia)
        out[LOAD], out[TWIST] = out[ROTOR], 0.0
        return
    shaft = p.damping * (state[ROTOR] - state[LOAD]) + p.stiffness * state[TWIST]
    out[ROTOR] = (torque - shaft - p.motor_friction * state[ROTOR]) / p.rotor_inertia
    out[LOAD] = (shaft - p.load_friction * state[LOAD]) / load_inertia
    out[TWIST] = state[ROTOR] - state[LOAD]


@compiled
def advance(state: Array, before: float, after: float, p: Params, out: Array, work: Array) -> None:
    """One sample on, torque going straight from `before` to `after`; Runge-Kutta, fourth order.

    `state` (4,) stays, the result goes into `out` (4,); `work` (5, 4) is scratch.
    """
    h = p.step_s / p.substeps
    out[:] = state
    for i in range(p.substeps):
        first = before + (after - before) * i / p.substeps
        last = before + (after - before) * (i + 1) / p.substeps
        middle = (first + last) / 2
        _slope(out, first, p, work[0])
        for k in range(STATES):
            work[4, k] = out[k] + h / 2 * work[0, k]
        _slope(work[4], middle, p, work[1])
        for k in range(STATES):
            work[4, k] = out[k] + h / 2 * work[1, k]
        _slope(work[4], middle, p, work[2])
        for k in range(STATES):
            work[4, k] = out[k] + h * work[2, k]
        _slope(work[4], last, p, work[3])
        for k in range(STATES):
            out[k] += h / 6 * (work[0, k] + 2 * work[1, k] + 2 * work[2, k] + work[3, k])


@compiled
def _speed(torque: Array, log_inertia: Array, p: Params) -> Array:
    """The rotor's speed (n,) from rest, with ln J_l (n,) as given, straight torque between samples."""
    state, after, work = np.zeros(STATES), np.empty(STATES), np.empty((5, STATES))
    speed = np.zeros(torque.size)
    for i in range(1, torque.size):
        before, now = math.exp(log_inertia[i - 1]), math.exp(log_inertia[i])
        # the inertia changes between samples, and momentum stays
        if p.rigid:
            state[ROTOR] *= (p.rotor_inertia + before) / (p.rotor_inertia + now)
        state[LOAD] *= before / now
        state[LOG_INERTIA] = log_inertia[i]
        advance(state, torque[i - 1], torque[i], p, after, work)
        state[:] = after
        speed[i] = state[ROTOR]
    return speed
