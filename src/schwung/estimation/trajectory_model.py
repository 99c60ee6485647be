"""What the trajectory fit believes: two masses, an inertia and a load torque over angle, friction, delays.

    J_r dω_r/dt = T(t − d_T) − b_r ω_r − F tanh(ω_r/ω_s) − v ω_r − C        C = b (ω_r − ω_l) + k (θ_r − θ_l)
    J_l(θ_l) dω_l/dt = C − b_l ω_l + T_l(θ_l) − ½ J_l'(θ_l) ω_l²            speed reported: ω_r(t − d_ω)

T is the *measured* motor torque, whose error is white; angle and speed are measured with white errors. log J_l and
T_l are cubic B-splines over the load angle. What depends on the trajectory (J_l, J_l', T_l, friction) is taken along
the latest smoothed one, so that each step of the filter is linear; it changes by parts in 10⁴ between iterations.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import astuple, dataclass, replace

import numpy as np
from scipy.interpolate import CubicSpline

from schwung.drivetrain.machine import Machine
from schwung.estimation import trajectory_kernel as kernel
from schwung.estimation.sampling import is_held
from schwung.motion import Array
from schwung.session.model import Run

#: Dry friction is smoothed within this share of the peak speed; up to a few times that its sign is open.
STICKING = 0.005


@dataclass(frozen=True)
class Basis:
    """Uniform cubic B-splines over an angle range, `pieces` + 3 of them; constant outside."""

    low_rad: float
    high_rad: float
    pieces: int

    @property
    def size(self) -> int:
        return self.pieces + 3

    def rows(self, angle_rad: Array) -> tuple[Array, Array]:
        """All splines and their derivatives at angles (n,): (n, size) each."""
        step = (self.high_rad - self.low_rad) / self.pieces
        at = np.clip((angle_rad - self.low_rad) / step, 0.0, self.pieces)
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
        return value, slope


@dataclass(frozen=True)
class Layout:
    """Where each parameter stands in the vector of all."""

    basis: Basis

    @property
    def inertia(self) -> slice:  # log of kg·m²
        return slice(0, self.basis.size)

    @property
    def load_torque(self) -> slice:  # N·m
        return slice(self.basis.size, 2 * self.basis.size)

    @property
    def coulomb(self) -> int:  # N·m
        return 2 * self.basis.size

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
    def size(self) -> int:
        return self.coulomb + 7


@dataclass(frozen=True)
class Noise:
    """Standard deviations of the errors of each sample, and of the torque."""

    torque_nm: float
    speed_rad_s: float
    position_rad: float

    def differs_from(self, other: Noise, share: float = 0.03) -> bool:
        """Whether any of the three differs by more than this share."""
        mine, others = np.array(astuple(self)), np.array(astuple(other))
        return bool(np.any(np.abs(np.log(mine / others)) > share))


@dataclass(frozen=True, eq=False)
class Drive:
    """The torque of one run, between its samples."""

    time_s: Array
    smooth: CubicSpline  # all of it, or the controller's part where the injection is held
    held_nm: Array  # (n − 1,) held over each interval

    def between(self, delay_s: float, controller_delay_s: float) -> tuple[Array, Array, Array, Array]:
        """Torque at start and end of each interval (n − 1,), and what either delay changes in both.

        The straight line between both has the true mean over the interval.
        """
        step = float(self.time_s[1] - self.time_s[0])
        at = np.clip(self.time_s - delay_s - controller_delay_s, self.time_s[0], self.time_s[-1])
        value = self.smooth(at)
        rise = np.diff(value)
        area = np.diff(self.smooth.antiderivative()(at))
        lift = area / np.maximum(np.diff(at), 1e-12) - (value[1:] + value[:-1]) / 2
        before = np.concatenate([self.held_nm[:1], self.held_nm[:-1]])
        after = np.concatenate([self.held_nm[1:], self.held_nm[-1:]])
        jump = self.held_nm - before if delay_s >= 0 else after - self.held_nm
        lift = np.where(np.diff(at) > 0, lift, 0.0) + self.held_nm - jump * delay_s / step
        return value[:-1] + lift, value[1:] + lift, -(rise + jump) / step, -rise / step


@dataclass(frozen=True, eq=False)
class Signals:
    """One run, and the latest belief of its states (n, s)."""

    time_s: Array
    step_s: float
    position_rad: Array
    speed_rad_s: Array
    drive: Drive
    states: Array
    rigid: bool

    @property
    def load_angle_rad(self) -> Array:
        return self.position_rad if self.rigid else self.states[:, 0] - self.states[:, 2]

    @property
    def load_speed_rad_s(self) -> Array:
        return np.asarray(self.states[:, 1 if self.rigid else 3])


#: Inertias at which a step is worked out; between them it is interpolated (relative error below 1e-9).
_NODES = 96
_DIFFERENCE = 1e-4  # of log k and log b, for their sensitivities


@dataclass(frozen=True, eq=False)
class Steps:
    """Every step of a run, which depends on the load inertia alone: state⁺ = Φ state + S start + E end.

    The three stand side by side, (m, s, s + 4), to be applied to `stacked` (m, s + 4).
    """

    matrix: Array
    by_inertia: Array  # ∂/∂ log J_l
    by_stiffness: Array
    by_damping: Array

    @classmethod
    def of(cls, shaft: kernel.Shaft, inertia: Array, step_s: float, *, slopes: bool) -> Steps:
        logs = np.log(inertia)
        nodes = np.linspace(logs.min() - 1e-3, logs.max() + 1e-3, _NODES)

        def table(which: kernel.Shaft) -> Array:
            return np.concatenate(kernel.steps(which, np.exp(nodes), step_s), axis=2)

        def by(name: str) -> Array:
            ends = [
                table(shaft._replace(**{name: getattr(shaft, name) * np.exp(d)}))
                for d in (_DIFFERENCE, -_DIFFERENCE)
            ]
            return np.asarray(CubicSpline(nodes, (ends[0] - ends[1]) / (2 * _DIFFERENCE))(logs))

        curve = CubicSpline(nodes, table(shaft))
        matrix = curve(logs)
        if not slopes:
            return cls(matrix, *(np.empty(0),) * 3)
        if shaft.rigid:
            return cls(matrix, curve(logs, 1), *(np.zeros_like(matrix),) * 2)
        return cls(matrix, curve(logs, 1), by("stiffness"), by("damping"))


@dataclass(frozen=True, eq=False)
class Linearised:
    """One run about its latest states: all that the filter takes."""

    transition: Array
    forcing: Array
    noise: Array
    slack: Array  # (N·m)², what the torque's variance is more than the sensor's in each interval
    measured: Array
    first: Array
    columns: Array  # empty (…, 0) where not asked for
    of_speed: Array


def signals_of(run: Run, machine: Machine) -> Signals:
    """A recorded run made ready; where the injection is held, the torque is a staircase plus the controller's."""
    held, smooth = np.zeros(len(run) - 1), run.torque_nm
    if is_held(run) and run.torque_added_nm is not None:
        held, smooth = run.torque_added_nm[1:], run.torque_nm - run.torque_added_nm
    position, rigid = run.position_rad, machine.coupling is None
    speed = (
        CubicSpline(run.time_s, position).derivative()(run.time_s) if np.ptp(run.speed_rad_s) == 0 else None
    )
    speed = run.speed_rad_s if speed is None else speed
    states = [position, speed] if rigid else [position, speed, np.zeros_like(speed), speed]
    return Signals(
        time_s=run.time_s,
        step_s=1 / run.sample_rate_hz,
        position_rad=position,
        speed_rad_s=run.speed_rad_s,
        drive=Drive(run.time_s, CubicSpline(run.time_s, smooth), held),
        states=np.column_stack(states),
        rigid=rigid,
    )


@dataclass(frozen=True, eq=False)
class Model:
    """The machine as believed, the layout of its unknowns, and the scale of its speed."""

    machine: Machine
    layout: Layout
    sticking_rad_s: float

    def shaft(self, parameters: Array) -> kernel.Shaft:
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

    def linearised(self, run: Signals, parameters: Array, *, columns: bool) -> Linearised:
        """The run's filter equations about its states, with the parameters' columns if asked for."""
        at, shaft = self.layout, self.shaft(parameters)
        rows, slopes = at.basis.rows(run.load_angle_rad)
        inertia = np.exp(rows @ parameters[at.inertia])
        bend = inertia * (slopes @ parameters[at.inertia])
        centrifugal = run.load_speed_rad_s**2 / 2
        load = rows @ parameters[at.load_torque] - bend * centrifugal
        load += self.machine.load_torque_at(run.load_angle_rad)
        speed = run.states[:, 1]
        direction = np.tanh(speed / self.sticking_rad_s)
        friction = parameters[at.coulomb] * direction + parameters[at.viscous] * speed
        start, end, by_delay, by_controller = run.drive.between(
            parameters[at.torque_delay], parameters[at.controller_delay]
        )
        on_motor, on_load = -friction, load + _lift(load)
        torques = (
            np.stack([start + on_motor[:-1], on_load[:-1]], 1),
            np.stack([end + on_motor[1:], on_load[1:]], 1),
        )
        middle = (inertia[1:] + inertia[:-1]) / 2
        steps = Steps.of(shaft, middle, run.step_s, slopes=columns)
        size = run.states.shape[1]
        transition = np.ascontiguousarray(steps.matrix[:, :, :size])
        at_start, at_end = steps.matrix[:, :, size : size + 2], steps.matrix[:, :, size + 2 :]
        stacked = np.concatenate([run.states[:-1], *torques], axis=1)
        forcing = np.einsum("ksi,ki->ks", steps.matrix[:, :, size:], stacked[:, size:])
        motor = np.ascontiguousarray((at_start + at_end)[:, :, 0])
        late = CubicSpline(run.time_s, speed)
        then = np.clip(run.time_s - parameters[at.speed_delay], run.time_s[0], run.time_s[-1])
        measured = np.column_stack([run.position_rad, run.speed_rad_s - late(then) + speed])
        slack = self._slack(speed, parameters[at.coulomb])
        result = Linearised(
            transition, forcing, motor, slack, measured, run.states[0],
            np.empty((0, 0, 0)), np.empty((0, 0)),
        )  # fmt: skip
        if not columns:
            return result
        by_inertia, by_stiffness, by_damping = (
            np.einsum("ksi,ki->ks", slope, stacked)
            for slope in (steps.by_inertia, steps.by_stiffness, steps.by_damping)
        )
        made = np.zeros((middle.size, transition.shape[1], at.size))
        share = inertia[:, None] * rows / 2
        on = -centrifugal[:, None] * (bend[:, None] * rows + inertia[:, None] * slopes)
        made[:, :, at.inertia] = (
            by_inertia[:, :, None] * ((share[1:] + share[:-1]) / middle[:, None])[:, None, :]
        )
        made[:, :, at.inertia] += _added(at_start, at_end, on, 1)
        made[:, :, at.load_torque] = _added(at_start, at_end, rows, 1)
        made[:, :, [at.coulomb, at.viscous]] = _added(at_start, at_end, -np.stack([direction, speed], 1), 0)
        made[:, :, at.torque_delay] = motor * by_delay[:, None]
        made[:, :, at.controller_delay] = motor * by_controller[:, None]
        made[:, :, at.stiffness], made[:, :, at.damping] = by_stiffness, by_damping
        of_speed = np.zeros((speed.size, at.size))
        of_speed[:, at.speed_delay] = -late(then, 1)
        return replace(result, columns=made, of_speed=of_speed)

    def _slack(self, speed: Array, coulomb_nm: float) -> Array:
        """Where the shaft may stick, friction is anything within ±F for as long: the torque is not known there."""
        sticking = np.exp(-((speed / (3 * self.sticking_rad_s)) ** 2))
        return np.asarray(100 * coulomb_nm**2 * (sticking[1:] + sticking[:-1]) / 2)


def _lift(values: Array) -> Array:
    """What makes the straight line between nodes have the cubic's mean, about, (n,)."""
    bent = np.zeros_like(values)
    bent[1:-1] = -(values[2:] - 2 * values[1:-1] + values[:-2]) / 12
    return bent


def _added(at_start: Array, at_end: Array, nodes: Array, shaft: int) -> Array:
    """What torques at the nodes (n, c) add to each step, (n − 1, s, c)."""
    start, end = at_start[:, :, shaft], at_end[:, :, shaft]
    return np.asarray(start[:, :, None] * nodes[:-1, None, :] + end[:, :, None] * nodes[1:, None, :])


def load_angle_range(runs: Sequence[Signals]) -> tuple[float, float]:
    """Lowest and highest load angle (rad) of all runs."""
    angles = [run.load_angle_rad for run in runs]
    return min(float(a.min()) for a in angles), max(float(a.max()) for a in angles)
