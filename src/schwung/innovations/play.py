"""A coupling with play, passed by Kalman's filter: it touches as surely as the filter knows its wind-up.

Whether the coupling touches follows from the states, and these from whether it touches. Going from one to the other and
back comes to rest in many places. A filter that goes forward meets each step with the states up to there, and the
torque that such a coupling carries on average over what is still open of its wind-up, which is Gaussian (statistical
linearisation: Gelb, Applied Optimal Estimation, 1974, section 6.2). So the likelihood is as smooth over the gap as the
wind-up is uncertain. What the coupling carries more or less than that line says is a torque that nobody knows: a filter
that took it for nothing would be sure of a load that it has lost.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from schwung.compiled import compiled_or, inlined
from schwung.innovations import plain
from schwung.innovations.contact import PARTS, SUREST, touching
from schwung.innovations.kalman import begun, carried, deviance, updated
from schwung.innovations.likelihood import Equations, Noise, Play, problem_of
from schwung.innovations.signals import Signals
from schwung.innovations.steps import Steps
from schwung.innovations.values import Shaft, System
from schwung.motion import Array

#: A coupling that carries nothing within its play still has this share of its stiffness.
LEAST_SHARE = 1e-3

#: Φ (4, 4) up to a part of a step, what units of torque at its ends do (4, 4), what its torques do (4,), and what that
#: of the coupling does which its wind-up leaves open (4,).
_Parts = tuple[Array, Array, Array, Array]


def through_play(
    equations: Equations,
    steps: Steps,
    shaft: Shaft,
    coupling: Array,
    inertia: Array,
    driven: Array,
    gap_rad: float,
    noise: Noise,
    run: Signals,
) -> tuple[Equations, Steps]:
    """The equations of a run whose coupling has a gap (rad), from those of one without.

    `coupling`: stiffness and damping where it touches, (n − 1, 2), or (2,) where they are the same in all steps;
    `inertia`: of the load in each step, (n − 1,). `driven`: how much further the coupling is driven than the motor
    turns, and how much faster (rad, rad/s), (n, 2); what that winds up is not in the equations yet.
    """
    part_s, count = run.step_s / PARTS, inertia.size
    free = shaft._replace(stiffness=LEAST_SHARE * shaft.stiffness, damping=LEAST_SHARE * shaft.damping)
    if coupling.ndim == 1:
        pressed = Steps.of(shaft, inertia, part_s, slopes=False)
    else:
        pressed = Steps.of_each(shaft, coupling, inertia, part_s)
    system = problem_of(equations, noise, run)
    logs, _ = deviance(system)
    system = system._replace(
        transition=system.transition.copy(),
        forcing=system.forcing.copy(),
        noise=system.noise.copy(),
        on_load=system.on_load.copy(),
        open_contact=np.zeros_like(system.forcing),
    )
    inputs, coupling = steps.inputs.copy(), np.ascontiguousarray(np.broadcast_to(coupling, (count, 2)))
    parts = (pressed.whole, Steps.of(free, inertia, part_s, slopes=False).whole)
    contact = np.zeros((count, 3))
    _through(system, *parts, equations.torques, coupling, driven, gap_rad, part_s / 2, inputs, contact)
    passed = replace(
        equations,
        transition=system.transition,
        forcing=system.forcing,
        noise=system.noise,
        play=Play(contact, logs, system.open_contact),
        on_load=system.on_load,
    )
    return passed, replace(steps, transition=system.transition[:, :-1, :-1], inputs=inputs)


@inlined
def _torque(torques: Array, side: int, share: float) -> float:
    """On motor (`side` 0) or load (1), so much of a step on: straight from start to end, with a parabola on top."""
    straight = torques[side] * (1 - share) + torques[2 + side] * share
    return float(straight + 4 * share * (1 - share) * torques[4 + side])


@inlined
def _further(step: Array, before: _Parts, after: _Parts) -> None:
    """Φ and what torques do, one part of a step further: by Φ of the part, and what was added to `after` within it."""
    phi, onto, push, opened = before
    new_phi, new_onto, new_push, new_opened = after
    for a in range(4):
        for b in range(4):
            new_phi[a, b] = 0.0
        for c in range(4):
            factor = step[a, c]
            new_push[a] += factor * push[c]
            new_opened[a] += factor * opened[c]
            for b in range(4):
                new_phi[a, b] += factor * phi[c, b]
                new_onto[a, b] += factor * onto[c, b]


@inlined
def _within(
    step: Array, torques: Array, span: tuple[float, float], lacks: float, unknown: float, after: _Parts
) -> None:
    """What torques do within a part of a step: those of the step, units at its start and its end, and as much in the
    coupling as is `unknown` there."""
    early, late = span
    _, new_onto, new_push, new_opened = after
    first = _torque(torques, 0, early) + lacks, _torque(torques, 1, early) - lacks
    last = _torque(torques, 0, late) + lacks, _torque(torques, 1, late) - lacks
    height = (late - early) ** 2
    for a in range(4):
        new_push[a] = 0.0
        new_opened[a] = unknown * (step[a, 5] + step[a, 7] - step[a, 4] - step[a, 6])
        for side in range(2):
            start, end, bulge = step[a, 4 + side], step[a, 6 + side], step[a, 8 + side]
            new_push[a] += start * first[side] + end * last[side] + bulge * height * torques[4 + side]
            new_onto[a, side] = start * (1 - early) + end * (1 - late)
            new_onto[a, 2 + side] = start * early + end * late


@inlined
def _held(system: System, k: int, onto: Array) -> None:
    """What torques on the load do in step k, where what holds it is open."""
    if system.on_load.shape[0] > 0:
        for a in range(4):
            system.on_load[k, 0, a], system.on_load[k, 1, a] = onto[a, 1], onto[a, 3]


@compiled_or(plain.through)
def _through(
    system: System,
    pressed: Array,
    free: Array,
    torques: Array,
    coupling: Array,
    driven: Array,
    gap: float,
    middle: float,
    inputs: Array,
    contact: Array,
) -> None:
    """Write to the system's steps, and to what torques at their ends do, those of a coupling with a gap.

    `pressed`, `free`: steps of a part, where it touches and where not; `middle`: half of a part (s).
    """
    count, size = system.measured.shape[0], 5
    x, p = np.empty(size), np.empty((size, size))
    gain, row, ahead, lower = np.empty((2, size)), np.empty(size), np.empty(size), np.empty((size, size))
    before = (np.empty((4, 4)), np.empty((4, 4)), np.empty(4), np.empty(4))
    phi, onto, push, opened = before
    after = (np.empty((4, 4)), np.empty((4, 4)), np.empty(4), np.empty(4))
    step, here = np.empty((4, 10)), np.empty(4)
    errors, spreads = np.empty(2), np.empty(2)
    begun(system, x, p, size)
    updated(system, 0, x, p, gain, row, errors, spreads, size)
    for k in range(count - 1):
        drifting = p[2, 1] - p[2, 3]  # covariance of the wind-up and its rate; and the variance of that
        turned = p[1, 1] + p[3, 3] - 2 * p[1, 3]
        onto[:, :], push[:], opened[:] = 0.0, 0.0, 0.0
        for a in range(4):
            for b in range(4):
                phi[a, b] = 1.0 if a == b else 0.0
        for part in range(PARTS):
            for a in range(4):  # the torque's error is a state as well: it acts as torque on the motor does
                here[a] = push[a] - onto[a, 0] * x[4]
                for b in range(4):
                    here[a] += phi[a, b] * x[b]
            early = (part + 0.5) / PARTS
            further = driven[k, 0] * (1 - early) + driven[k + 1, 0] * early
            faster = driven[k, 1] * (1 - early) + driven[k + 1, 1] * early
            turning = here[1] - here[3] + faster
            since = (2 * part + 1) * middle
            variance = p[2, 2] + 2 * since * drifting + since * since * turned
            spread = max(np.sqrt(max(variance, 0.0)), SUREST * gap)
            lifts = (
                coupling[k, 1] / coupling[k, 0] * turning
            )  # a contact that lifts lets go where it would pull
            moves = 2 * turning * middle
            begins = here[2] + further - faster * middle
            up, down = begins + min(lifts, 0.0), begins + max(lifts, 0.0)
            one, missing, open_one = touching(up, up + moves, gap / 2, spread)
            other, misses, open_other = touching(-down, -down - moves, gap / 2, spread)
            for a in range(4):
                for b in range(10):
                    step[a, b] = free[k, a, b] + (one + other) * (pressed[k, a, b] - free[k, a, b])
            lacks = coupling[k, 0] * (missing - misses)
            lacks -= (one + other) * (coupling[k, 0] * further + coupling[k, 1] * faster)
            contact[k, 0] += (one + other) / PARTS
            contact[k, 1] += (one - other) / PARTS
            contact[k, 2] += (missing - misses) / PARTS
            unknown = coupling[k, 0] * np.sqrt(open_one**2 + open_other**2)
            _within(step, torques[k], (part / PARTS, (part + 1) / PARTS), lacks, unknown, after)
            _further(step, before, after)
            for a in range(4):  # number by number: an array in another's place takes seconds more to compile
                push[a], opened[a] = after[2][a], after[3][a]
                for b in range(4):
                    phi[a, b], onto[a, b] = after[0][a, b], after[1][a, b]
        for a in range(4):
            system.forcing[k, a], system.open_contact[k, a] = push[a], opened[a]
            system.transition[k, a, 4], system.noise[k, a] = -onto[a, 0], -onto[a, 2]
            for b in range(4):
                system.transition[k, a, b], inputs[k, a, b] = phi[a, b], onto[a, b]
        _held(system, k, onto)
        carried(system, k, x, p, ahead, lower, size)
        updated(system, k + 1, x, p, gain, row, errors, spreads, size)
