"""A run's filter equations: the believed machine, and whatever causes act along its latest states."""

from __future__ import annotations

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from schwung.drivetrain.machine import Machine
from schwung.explain.causes.along import Along
from schwung.explain.causes.inertia_at import inertia_of
from schwung.innovations.likelihood import Equations, Noise
from schwung.innovations.play import LEAST_SHARE, through_play
from schwung.innovations.steps import WITHIN, Steps, bulge, height_of, sloping, smoothly, straight
from schwung.innovations.values import FurtherMass, Shaft
from schwung.motion import Array

#: Where the shaft may stick or turn, dry friction is anything within its own size: a variance of so many times its
#: square.
_OPEN = 100.0


@dataclass(frozen=True, eq=False)
class Acting:
    """What acts along a run, (n,) each or 0.0, and how large dry friction is (N·m)."""

    on_motor: Array | float = 0.0
    on_load: Array | float = 0.0
    position: Array | float = 0.0
    speed: Array | float = 0.0
    dry_nm: float = 0.0
    coupling: Array | float = 0.0  # stiffness and damping beyond the machine's, about the wind-up, (n, 2)
    inertia: Array | float = 0.0  # of the load beyond the machine's, about its acceleration

    def within(self, where: slice, dry_nm: float) -> Acting:
        """Of one of several joined runs, and how large dry friction is there."""

        def there(whole: Array | float) -> Array | float:
            return whole if isinstance(whole, float) else whole[where]

        return Acting(
            there(self.on_motor),
            there(self.on_load),
            there(self.position),
            there(self.speed),
            dry_nm,
            there(self.coupling),
            there(self.inertia),
        )

    def __add__(self, other: Acting) -> Acting:
        return Acting(
            together(self.on_motor, other.on_motor),
            together(self.on_load, other.on_load),
            together(self.position, other.position),
            together(self.speed, other.speed),
            max(self.dry_nm, other.dry_nm),
            together(self.coupling, other.coupling),
            together(self.inertia, other.inertia),
        )


def together(one: Array | float, other: Array | float) -> Array | float:
    """Their sum; most of what acts does so in one way of many, so that most are nothing."""
    if isinstance(other, float) and other == 0.0:
        return one
    return other if isinstance(one, float) and one == 0.0 else one + other


def shaft_of(machine: Machine, further: FurtherMass) -> Shaft:
    """The coupling, and the inertias and frictions beside it, and what is behind the load."""
    motor, coupling = machine.motor, machine.coupling
    k, b = (coupling.stiffness_nm_rad, coupling.damping_nms) if coupling else (0.0, 0.0)
    return Shaft(
        motor.inertia_kgm2,
        motor.viscous_friction_nms,
        machine.load.viscous_friction_nms,
        k,
        b,
        coupling is None,
        further,
    )


class LoadTaken(NamedTuple):
    """Inertia of the load in each step; torque on it beyond what accelerates that, at the step's start, at its end, and
    the height of a parabola between, (n − 1,) each."""

    inertia: Array
    start: Array
    end: Array
    height: Array

    def within(self, where: slice) -> LoadTaken:
        """Of one of several joined runs, whose samples are there."""
        return LoadTaken(*(each[where.start : where.stop - 1] for each in self))


def load_taken(along: Along, acting: Acting) -> LoadTaken:
    """What the load takes of one run, or of several that are joined, with a step between each two that is none.

    An inertia may bend within a step more than samples tell: by those alone, at 1 kHz and 30 rad/s, a sound coupling
    had 30 % less damping.
    """
    machine, accelerated, heard = along.present, along.accelerated, along.load_acceleration
    ends, step_s = along.ends, along.step_s
    step_s = step_s[:-1] if isinstance(step_s, np.ndarray) else step_s
    plain, slope, _ = inertia_of(machine, along.load_angle)
    inertia = np.maximum(plain + acting.inertia, LEAST_SHARE * plain)
    further = inertia - plain
    acts = np.broadcast_to(np.asarray(acting.on_load, dtype=float), plain.shape)
    load = machine.load_torque_at(along.load_angle) - slope * along.load_speed**2 / 2 + acts + further * heard
    middle, half = (inertia[1:] + inertia[:-1]) / 2, np.diff(inertia) / 2
    start, end = load[:-1] + half * accelerated[:-1], load[1:] - half * accelerated[1:]

    angle = sloping(along.load_angle, along.load_speed, step_s)
    speed = sloping(along.load_speed, heard, step_s)
    plain, slope = (each.reshape(angle.shape) for each in inertia_of(machine, angle.reshape(-1))[:2])
    whole = machine.load_torque_at(angle.reshape(-1)).reshape(angle.shape) - slope * speed**2 / 2
    added = smoothly(further, ends)
    whole = whole + smoothly(acts, ends) + added * smoothly(heard, ends)
    whole = whole - (plain + added - middle) * smoothly(accelerated, ends)
    return LoadTaken(middle, start, end, height_of(whole - straight(start, end)))


def _off_mean(along: Along, bent: Array, mean: Array) -> tuple[Array, Array, Array]:
    """What a coupling that bends (n, 2) carries less than one with its step's mean (n − 1, 2), on the motor: at the
    step's start, at its end, and the height of a parabola between, (n − 1,) each.

    Left out, a cubic stiffness was found 1 to 10 % too large.
    """
    turned, within = along.turned, np.zeros((WITHIN.size, len(mean)))
    start, end = (np.sum((mean - bent[at]) * turned[at], axis=1) for at in (slice(None, -1), slice(1, None)))
    for each in range(2):
        within += (mean[:, each] - smoothly(bent[:, each])) * smoothly(turned[:, each])
    return start, end, height_of(within - straight(start, end))


def equations_of(
    along: Along, acting: Acting, noise: Noise, load: LoadTaken | None = None
) -> tuple[Equations, Steps]:
    """Of one run about its states; `noise`: as far as it is known, where the coupling has play; `load`: what the load
    takes, where it is worked out already."""
    run, machine = along.run, along.present
    load = load_taken(along, acting) if load is None else load
    push = np.broadcast_to(np.asarray(acting.on_motor, dtype=float), run.time_s.shape)
    motor = run.drive.taken(along.beyond.held_late * run.step_s, along.true_torque.within_steps)
    middle = load.inertia
    torques = np.stack(
        [
            motor.start_nm + push[:-1],
            load.start,
            motor.end_nm + push[1:],
            load.end,
            motor.bulge_nm + bulge(push),
            load.height,
        ],
        axis=1,
    )
    shaft, bent = shaft_of(machine, along.beyond.further), np.asarray(acting.coupling, dtype=float)
    whole = np.array([shaft.stiffness, shaft.damping])
    if bent.ndim:
        coupling = np.maximum(whole + (bent[1:] + bent[:-1]) / 2, LEAST_SHARE * whole)
        steps = Steps.of_each(shaft, coupling, middle, run.step_s)
        for place, torque in enumerate(_off_mean(along, bent, coupling - whole)):
            torques[:, 2 * place] += torque
            torques[:, 2 * place + 1] -= torque
    else:
        coupling = whole
        steps = Steps.of(shaft, middle, run.step_s, slopes=False)
    # sets differ in what they foresee, not in how surely: where no repeats tell noise, it moves what is believed
    alone = along.ranges.unrepeated and shaft.rigid
    surely = _rigid_ratio(along, middle) if alone else np.ones_like(middle)
    size = steps.transition.shape[1]
    forced = np.einsum("ksi,ki->ks", steps.inputs, torques)
    if along.beyond.held_late and run.drive.held.is_any:
        share, jumps = run.drive.held.changes(along.beyond.held_late * run.step_s)
        forced -= jumps[:, None] * steps.early(shaft, coupling, middle, run.step_s, share)
    transition = np.zeros((push.size - 1, size + 1, size + 1))
    forcing = np.zeros((push.size - 1, size + 1))
    transition[:, :size, :size] = steps.transition
    transition[:, :size, size] = -surely[:, None] * steps.inputs[:, :, 0]
    driven = np.column_stack([-surely[:, None] * steps.inputs[:, :, 2], np.ones(push.size - 1)])
    forcing[:, :size] = forced
    measured = np.column_stack([run.position_rad - acting.position, run.speed_rad_s - acting.speed])
    sticking = np.exp(-((along.slowest / (3 * along.ranges.sticking_rad_s)) ** 2))
    apart = _OPEN * acting.dry_nm**2 * sticking
    on_load = None
    if acting.dry_nm > 0 and not shaft.rigid:
        on_load = np.zeros((push.size - 1, 2, size + 1))
        on_load[:, :, :size] = np.swapaxes(steps.inputs[:, :, 1:4:2], 1, 2)
    begin = np.zeros(size + 1)
    begin[: run.states.shape[1]] = run.states[0]
    equations = Equations(
        transition, forcing, driven, run.drive.sharp_nm2, apart, measured, begin, torques, on_load=on_load
    )
    if along.beyond.gap_rad > 0 and not shaft.rigid:
        return through_play(
            equations, steps, shaft, coupling, middle, along.driven, along.beyond.gap_rad, noise, run
        )
    return equations, steps


def _rigid_ratio(along: Along, middle: Array) -> Array:
    """Inertia of a rigid machine with what is present over the believed one, in each step (n − 1,)."""
    motor = along.machine.motor.inertia_kgm2
    believed = along.machine.load_inertia_at(along.load_angle)
    return (motor + middle) / (motor + (believed[1:] + believed[:-1]) / 2)
