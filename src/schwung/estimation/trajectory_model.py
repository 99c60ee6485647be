"""What the trajectory fit believes: two masses, an inertia and a load torque over angle, friction, delays.

    J_r dω_r/dt = T(t − d_T) − b_r ω_r − F tanh(ω_r/ω_s) − v ω_r − C        C = b (ω_r − ω_l) + k (θ_r − θ_l)
    J_l(θ_l) dω_l/dt = C − b_l ω_l + T_l(θ_l) − ½ J_l'(θ_l) ω_l²            speed reported: ω_r(t − d_ω)

T is the *measured* motor torque, whose error is white; angle and speed are measured with white errors. log J_l and
T_l are cubic B-splines over the load angle. What depends on the trajectory (J_l, J_l', T_l, friction) is taken along
the latest smoothed one, so that each step of the filter is linear; it changes by parts in 10⁴ between iterations.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import astuple, dataclass

import numpy as np

from schwung.drivetrain.machine import Machine
from schwung.estimation import trajectory_kernel as kernel
from schwung.estimation.trajectory_signals import Signals, Steps
from schwung.motion import Array

#: Dry friction is smoothed within this share of the peak speed; up to a few times that its sign is open.
STICKING = 0.005


@dataclass(frozen=True)
class Basis:
    """Uniform cubic B-splines over an angle range, `pieces` + 3 of them; straight on outside."""

    low_rad: float
    high_rad: float
    pieces: int

    @property
    def size(self) -> int:
        return self.pieces + 3

    def finer(self) -> Basis:
        """Twice the pieces."""
        return Basis(self.low_rad, self.high_rad, 2 * self.pieces)

    def refined(self, coefficients: Array) -> Array:
        """The same curve's coefficients in the finer basis: each piece halved (exact)."""
        c = coefficients
        between, at = (c[1:] + c[:-1]) / 2, (c[:-2] + 6 * c[1:-1] + c[2:]) / 8
        result = np.empty(between.size + at.size)
        result[::2], result[1::2] = between, at
        return result

    def coefficients_of(self, curve: Callable[[Array], Array]) -> Array:
        """Those that come nearest to a curve over angles (rad), (size,)."""
        grid = np.linspace(self.low_rad, self.high_rad, 8 * self.size)
        return np.asarray(np.linalg.lstsq(self.rows(grid)[0], curve(grid), rcond=None)[0])

    def rows(self, angle_rad: Array) -> tuple[Array, Array]:
        """All splines and their derivatives at angles (n,): (n, size) each."""
        step = (self.high_rad - self.low_rad) / self.pieces
        whole = (angle_rad - self.low_rad) / step
        at = np.clip(whole, 0.0, self.pieces)
        piece = np.minimum(at.astype(int), self.pieces - 1)
        u = at - piece
        v = 1 - u
        values = (v**3 / 6, 2 / 3 - u**2 + u**3 / 2, 2 / 3 - v**2 + v**3 / 2, u**3 / 6)
        slopes = (-(v**2) / 2, -2 * u + 1.5 * u**2, 2 * v - 1.5 * v**2, u**2 / 2)
        value, slope = np.zeros((angle_rad.size, self.size)), np.zeros((angle_rad.size, self.size))
        line = np.arange(angle_rad.size)
        for i in range(4):
            value[line, piece + i] = values[i]
            slope[line, piece + i] = slopes[i] / step
        outside = np.flatnonzero(whole != at)
        value[outside] += ((whole - at) * step)[outside, None] * slope[outside]
        return value, slope


@dataclass(frozen=True)
class Layout:
    """Where each parameter stands in the vector of all."""

    basis: Basis  # of the inertia
    coarse: Basis  # of the load torque

    @property
    def inertia(self) -> slice:  # log of kg·m²
        return slice(0, self.basis.size)

    @property
    def load_torque(self) -> slice:  # N·m
        return slice(self.basis.size, self.basis.size + self.coarse.size)

    @property
    def coulomb(self) -> int:  # N·m
        return self.basis.size + self.coarse.size

    @property
    def viscous(self) -> int:  # N·m·s/rad beyond the machine's
        return self.coulomb + 1

    @property
    def torque_delay(self) -> int:  # s
        return self.coulomb + 2

    @property
    def speed_delay(self) -> int:  # s
        return self.coulomb + 3

    @property
    def controller_delay(self) -> int:  # s, of the controller's part alone where injections are held
        return self.coulomb + 4

    @property
    def stiffness(self) -> int:  # log of k over the machine's
        return self.coulomb + 5

    @property
    def damping(self) -> int:  # log of b over the machine's
        return self.coulomb + 6

    @property
    def loss(self) -> int:  # s²: γ, where a filter took γω² more off torque and speed than was given back
        return self.coulomb + 7

    @property
    def size(self) -> int:
        return self.coulomb + 8


@dataclass(frozen=True)
class Noise:
    """Standard deviations of the errors of each sample, and of the torque."""

    torque_nm: float
    speed_rad_s: float
    position_rad: float

    def times(self, factor: float) -> Noise:
        """All three so many times as large."""
        return Noise(factor * self.torque_nm, factor * self.speed_rad_s, factor * self.position_rad)

    def moved_from(self, other: Noise) -> float:
        """By how much that one of the three differs which differs most, as a logarithm."""
        mine, others = np.array(astuple(self)), np.array(astuple(other))
        return float(np.max(np.abs(np.log(mine / others))))


@dataclass(frozen=True, eq=False)
class Equations:
    """One run about its latest states: all that the filter takes. The last state is the torque's error (N·m)."""

    transition: Array  # (n − 1, s, s)
    forcing: Array  # (n − 1, s)
    noise: Array  # (n − 1, s): what the torque's error of the sample at the end of each step does
    slack: Array  # (n,) variance of the torque (N·m)² beyond the sensor's
    measured: Array  # (n, 2)
    first: Array  # (s,)
    torques: Array  # (n − 1, 6) over each step, see `Steps`


@dataclass(frozen=True, eq=False)
class _Along:
    """What depends on the angles and speeds of a run's latest states, at each sample."""

    rows: Array
    slopes: Array
    gentle: Array
    inertia: Array
    bend: Array  # dJ_l/dθ
    speed: Array
    direction: Array
    centrifugal: Array  # ½ ω_l²

    @property
    def middle(self) -> Array:
        """Inertia of each step."""
        return np.asarray((self.inertia[1:] + self.inertia[:-1]) / 2)


@dataclass(frozen=True, eq=False)
class Model:
    """The machine as believed, the layout of its unknowns, and the scale of its speed."""

    machine: Machine
    layout: Layout
    sticking_rad_s: float

    def shaft(self, parameters: Array) -> kernel.Shaft:
        """The coupling and the inertias and frictions that are not asked for."""
        motor, coupling = self.machine.motor, self.machine.coupling
        k, b = (coupling.stiffness_nm_rad, coupling.damping_nms) if coupling else (0.0, 0.0)
        return kernel.Shaft(
            motor.inertia_kgm2,
            motor.viscous_friction_nms,
            self.machine.load.viscous_friction_nms,
            k * float(np.exp(parameters[self.layout.stiffness])),
            b * float(np.exp(parameters[self.layout.damping])),
            coupling is None,
        )

    def _along(self, run: Signals, parameters: Array) -> _Along:
        at = self.layout
        rows, slopes = at.basis.rows(run.load_angle_rad)
        inertia = np.exp(rows @ parameters[at.inertia])
        speed = run.states[:, 1]
        return _Along(
            rows=rows,
            slopes=slopes,
            gentle=at.coarse.rows(run.load_angle_rad)[0],
            inertia=inertia,
            bend=inertia * (slopes @ parameters[at.inertia]),
            speed=speed,
            direction=np.tanh(speed / self.sticking_rad_s),
            centrifugal=run.load_speed_rad_s**2 / 2,
        )

    def equations(self, run: Signals, parameters: Array) -> Equations:
        """The run's filter equations about its states."""
        at, along = self.layout, self._along(run, parameters)
        load = along.gentle @ parameters[at.load_torque] - along.bend * along.centrifugal
        load += self.machine.load_torque_at(run.load_angle_rad)
        friction = parameters[at.coulomb] * along.direction + parameters[at.viscous] * along.speed
        motor = run.drive.between(parameters[at.torque_delay], parameters[at.controller_delay])
        start, end = motor.start_nm - friction[:-1], motor.end_nm - friction[1:]
        early, late, between = _off_middle(along.inertia, run)
        load_start, load_end, load_bulge = load[:-1] - early, load[1:] - late, _bulge(load) - between
        torques = np.stack([start, load_start, end, load_end, motor.bulge_nm, load_bulge], 1)
        steps = Steps.of(self.shaft(parameters), along.middle, run.step_s, slopes=False)
        size = steps.transition.shape[1]
        transition = np.zeros((load.size - 1, size + 1, size + 1))
        forcing = np.zeros((load.size - 1, size + 1))
        transition[:, :size, :size] = steps.transition
        transition[:, :size, size] = -steps.inputs[:, :, 0]
        noise = np.column_stack([-steps.inputs[:, :, 2], np.ones(load.size - 1)])
        forcing[:, :size] = np.einsum("ksi,ki->ks", steps.inputs, torques)
        before = run.speed_at(parameters[at.speed_delay])
        measured = np.column_stack([run.position_rad, run.speed_rad_s - before + along.speed])
        # where the shaft may stick, dry friction is anything within ±F for as long: the torque is not known there
        sticking = np.exp(-((along.speed / (3 * self.sticking_rad_s)) ** 2))
        slack = 100 * parameters[at.coulomb] ** 2 * sticking
        first = np.append(run.states[0], 0.0)
        return Equations(transition, forcing, noise, slack, measured, first, torques)

    def columns(self, run: Signals, parameters: Array, equations: Equations) -> tuple[Array, Array]:
        """What a unit of each parameter adds to each step (n − 1, s, P), and to the speed's samples (n, P).

        About *quiet* states and torques, from which the noise above the motion's band is filtered: in the sensitivities
        it would meet itself in the innovations and bias the parameters (errors in variables), stiffness above all. As
        instruments, quiet ones are as good and know nothing of it.
        """
        at, along = self.layout, self._along(run, parameters)
        motor = run.drive.between(parameters[at.torque_delay], parameters[at.controller_delay])
        steps = Steps.of(self.shaft(parameters), along.middle, run.step_s, slopes=True)
        size = steps.transition.shape[1]
        stacked = np.concatenate([run.quiet(run.states)[:-1], run.quiet(equations.torques)], axis=1)[
            ..., None
        ]
        made = np.zeros((stacked.shape[0], size + 1, at.size))
        part = made[:, :size]
        share = along.inertia[:, None] * along.rows / 2
        on_load = along.bend[:, None] * along.rows + along.inertia[:, None] * along.slopes
        middle = (share[1:] + share[:-1]) / along.middle[:, None]
        taken = -along.centrifugal[:, None] * on_load
        start, end = steps.inputs[:, :, 1], steps.inputs[:, :, 3]  # on the load
        kernel.add_outer(part[:, :, at.inertia], (steps.by_inertia @ stacked)[..., 0], middle)
        for at_node, each in ((start, slice(None, -1)), (end, slice(1, None))):
            kernel.add_outer(part[:, :, at.inertia], at_node, taken[each])
            kernel.add_outer(part[:, :, at.load_torque], at_node, along.gentle[each])
        friction = np.stack([along.direction, along.speed], 1)
        part[:, :, [at.coulomb, at.viscous]] = steps.added(-friction, 0)
        both = steps.inputs[:, :, 0] + steps.inputs[:, :, 2]
        part[:, :, at.torque_delay] = both * motor.by_delay[:, None]
        part[:, :, at.controller_delay] = both * motor.by_controller_delay[:, None]
        part[:, :, at.stiffness] = (steps.by_stiffness @ stacked)[..., 0]
        part[:, :, at.damping] = (steps.by_damping @ stacked)[..., 0]
        bent = run.quiet(run.drive.smooth(run.time_s, 2))
        part[:, :, at.loss] = steps.added(-bent[:, None], 0)[:, :, 0]
        of_speed = np.zeros((along.speed.size, at.size))
        of_speed[:, at.loss] = run.quiet(run.speed_at(0.0, derivative=2))
        of_speed[:, at.speed_delay] = -run.speed_at(parameters[at.speed_delay], derivative=1)
        return made, of_speed


def _off_middle(inertia: Array, run: Signals) -> tuple[Array, Array, Array]:
    """Torque taken by what the inertia differs from that of the middle of each step, (J − J_m) dω_l/dt:
    at the start of each step, at its end, and its height over the straight line between them; (n − 1,) each.
    """
    accelerated = run.load_acceleration
    half = np.diff(inertia) / 2
    middle = (accelerated[1:] + accelerated[:-1]) / 2
    return (
        -half * accelerated[:-1],
        half * accelerated[1:],
        _bulge(inertia) * middle - half * np.diff(accelerated) / 2,
    )


def _bulge(values: Array) -> Array:
    """Height over the straight line of a smooth curve in the middle between samples (n,), (n − 1,)."""
    bend = np.zeros_like(values)
    bend[1:-1] = values[2:] - 2 * values[1:-1] + values[:-2]
    return np.asarray(-(bend[1:] + bend[:-1]) / 16)
