"""What the trajectory fit believes: two masses, an inertia and a load torque over angle, friction, delays.

    J_r dω_r/dt = T(t − d_T) − b_r ω_r − F tanh(ω_r/ω_s) − v ω_r − C        C = b (ω_r − ω_l) + k (θ_r − θ_l)
    J_l(θ_l) dω_l/dt = C − b_l ω_l + T_l(θ_l) − ½ J_l'(θ_l) ω_l²            speed reported: ω_r(t − d_ω)

less what `left_out.py` takes of T where the record shows it.

T is the *measured* motor torque, whose error is white; angle and speed are measured with white errors. log J_l and
T_l are cubic B-splines over the load angle. What depends on the trajectory (J_l, J_l', T_l, friction) is taken along
the latest smoothed one, so that each step of the filter is linear; it changes by parts in 10⁴ between iterations.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from schwung.drivetrain.machine import Machine
from schwung.estimation.left_out import LEFT_OUT, along_way, taken
from schwung.innovations.likelihood import STICKING, Equations
from schwung.innovations.signals import Between, Signals
from schwung.innovations.splines import Basis
from schwung.innovations.steps import Steps, bulge, no_such_machine, off_middle
from schwung.innovations.values import Added, Shaft
from schwung.motion import Array

#: No machine has an inertia whose logarithm is so large.
BEYOND = 100.0


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
    def left_out(self) -> slice:  # see `left_out.py`
        return slice(self.coulomb + 8, self.size)

    @property
    def size(self) -> int:
        return self.coulomb + 8 + len(LEFT_OUT)


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
    left_out: Array  # what a unit of each takes from the motor, (n, 8)
    centrifugal: Array  # ½ ω_l²

    @property
    def middle(self) -> Array:
        """Inertia of each step."""
        return np.asarray((self.inertia[1:] + self.inertia[:-1]) / 2)


@dataclass(frozen=True, eq=False)
class _Linear(Equations):
    """With what they were made of."""

    along: _Along
    motor: Between


@dataclass(frozen=True, eq=False)
class Model:
    """The machine as believed, the layout of its unknowns, and the scale of its speed."""

    machine: Machine
    layout: Layout
    sticking_rad_s: float

    def shaft(self, parameters: Array) -> Shaft:
        """The coupling and the inertias and frictions that are not asked for."""
        motor, coupling = self.machine.motor, self.machine.coupling
        k, b = (coupling.stiffness_nm_rad, coupling.damping_nms) if coupling else (0.0, 0.0)
        return Shaft(
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
        logs = rows @ parameters[at.inertia]
        if not np.all(np.abs(logs) < BEYOND):
            raise no_such_machine()
        inertia = np.exp(logs)
        speed = run.states[:, 1]
        direction = np.tanh(speed / self.sticking_rad_s)
        return _Along(
            rows=rows,
            slopes=slopes,
            gentle=at.coarse.rows(run.load_angle_rad)[0],
            inertia=inertia,
            bend=inertia * (slopes @ parameters[at.inertia]),
            speed=speed,
            direction=direction,
            left_out=self._left_out(run, direction),
            centrifugal=run.load_speed_rad_s**2 / 2,
        )

    def _left_out(self, run: Signals, direction: Array) -> Array:
        """Along the run's states; what the coupling carries as believed, which is near."""
        coupling, basis = self.machine.coupling, self.layout.basis
        torque = run.quiet(run.drive.whole_nm)
        carried = torque
        if coupling is not None:
            wound, winding = run.states[:, 2], run.states[:, 1] - run.states[:, 3]
            carried = run.quiet(coupling.stiffness_nm_rad * wound + coupling.damping_nms * winding)
        along = along_way(run.load_angle_rad, basis.low_rad, basis.high_rad)
        peak, top = self.machine.motor.peak_torque_nm, self.sticking_rad_s / STICKING
        return taken(torque, carried, run.states[:, 1], direction, along, peak, top)

    def equations(self, run: Signals, parameters: Array) -> Equations:
        """The run's filter equations about its states."""
        at, along = self.layout, self._along(run, parameters)
        load = along.gentle @ parameters[at.load_torque] - along.bend * along.centrifugal
        load += self.machine.load_torque_at(run.load_angle_rad)
        friction = parameters[at.coulomb] * along.direction + parameters[at.viscous] * along.speed
        friction += along.left_out @ parameters[at.left_out]
        motor = run.drive.between(parameters[at.torque_delay], parameters[at.controller_delay])
        start, end = motor.start_nm - friction[:-1], motor.end_nm - friction[1:]
        early, late, between = off_middle(along.inertia, run)
        load_start, load_end, load_bulge = load[:-1] - early, load[1:] - late, bulge(load) - between
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
        apart = np.zeros((load.size - 1, 2))
        return _Linear(transition, forcing, noise, slack, apart, measured, first, torques, along, motor)

    def columns(self, run: Signals, parameters: Array, equations: Equations) -> Added:
        """What a unit of each parameter adds to each step, and to the samples.

        About *quiet* states and torques, from which the noise above the motion's band is filtered: in the sensitivities
        it would meet itself in the innovations and bias the parameters (errors in variables), stiffness above all. As
        instruments, quiet ones are as good and know nothing of it.
        """
        assert isinstance(equations, _Linear)  # this model's own
        at, along, motor = self.layout, equations.along, equations.motor
        steps = Steps.of(self.shaft(parameters), along.middle, run.step_s, slopes=True)
        stacked = np.concatenate([run.quiet(run.states)[:-1], run.quiet(equations.torques)], axis=1)[
            ..., None
        ]
        share = along.inertia[:, None] * along.rows / 2
        on_load = along.bend[:, None] * along.rows + along.inertia[:, None] * along.slopes
        others = np.zeros((*steps.transition.shape[:2], at.size - at.coulomb))
        reported = np.zeros((along.speed.size, 2, at.size - at.coulomb))

        def of(parameter: int) -> int:
            return parameter - at.coulomb

        bent = run.quiet(run.drive.smooth(run.time_s, 2))
        friction = np.column_stack([along.direction, along.speed, bent, along.left_out])
        of_friction = [at.coulomb, at.viscous, at.loss, *range(at.size)[at.left_out]]
        others[:, :, [of(each) for each in of_friction]] = steps.added(-friction, 0)
        both = steps.inputs[:, :, 0] + steps.inputs[:, :, 2]
        others[:, :, of(at.torque_delay)] = both * motor.by_delay[:, None]
        others[:, :, of(at.controller_delay)] = both * motor.by_controller_delay[:, None]
        others[:, :, of(at.stiffness)] = (steps.by_stiffness @ stacked)[..., 0]
        others[:, :, of(at.damping)] = (steps.by_damping @ stacked)[..., 0]
        reported[:, 1, of(at.loss)] = run.quiet(run.speed_at(0.0, derivative=2))
        reported[:, 1, of(at.speed_delay)] = -run.speed_at(parameters[at.speed_delay], derivative=1)
        return Added(
            start=np.ascontiguousarray(steps.inputs[:, :, 1]),
            end=np.ascontiguousarray(steps.inputs[:, :, 3]),
            torque=np.concatenate([-along.centrifugal[:, None] * on_load, along.gentle], axis=1),
            inertia=(steps.by_inertia @ stacked)[..., 0],
            share=(share[1:] + share[:-1]) / along.middle[:, None],
            others=others,
            reported=reported,
        )
