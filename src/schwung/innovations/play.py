"""A coupling with play, passed by Kalman's filter: it touches as surely as the filter knows its wind-up.

Whether the coupling touches follows from the states, and these from whether it touches. Going from one to the other and
back comes to rest in many places. A filter that goes forward meets each step with the states up to there, and the
torque that such a coupling carries on average over what is still open of its wind-up, which is Gaussian (statistical
linearisation: Gelb, Applied Optimal Estimation, 1974, section 6.2). So the likelihood is as smooth over the gap as the
wind-up is uncertain.
"""

from __future__ import annotations

from dataclasses import replace
from math import erf

import numpy as np

from schwung.compiled import compiled, inlined
from schwung.innovations.kalman import begun, carried, deviance, updated
from schwung.innovations.likelihood import Equations, Noise, problem_of
from schwung.innovations.signals import Signals
from schwung.innovations.steps import Steps
from schwung.innovations.values import Shaft, System
from schwung.motion import Array

#: A coupling that carries nothing within its play still has this share of its stiffness.
LEAST_SHARE = 1e-3
#: Parts of a step, in each of which it is asked whether the coupling touches.
_PARTS = 8
#: The wind-up is never surer than to this share of the gap.
_SUREST = 1e-9


def through_play(
    equations: Equations,
    steps: Steps,
    shaft: Shaft,
    coupling: Array,
    inertia: Array,
    gap_rad: float,
    noise: Noise,
    run: Signals,
) -> tuple[Equations, Steps]:
    """The equations of a run whose coupling has a gap (rad), from those of one without.

    `coupling`: stiffness and damping where it touches, (n − 1, 2), or (2,) where they are the same in all steps;
    `inertia`: of the load in each step, (n − 1,).
    """
    part_s, count = run.step_s / _PARTS, inertia.size
    free = shaft._replace(stiffness=LEAST_SHARE * shaft.stiffness, damping=LEAST_SHARE * shaft.damping)
    if coupling.ndim == 1:
        touching = Steps.of(shaft, inertia, part_s, slopes=False)
    else:
        touching = Steps.of_each(shaft, coupling, inertia, part_s)
    system = problem_of(equations, noise, run)
    system = system._replace(
        transition=system.transition.copy(), forcing=system.forcing.copy(), noise=system.noise.copy()
    )
    inputs, coupling = steps.inputs.copy(), np.ascontiguousarray(np.broadcast_to(coupling, (count, 2)))
    parts = (touching.whole, Steps.of(free, inertia, part_s, slopes=False).whole)
    logs, _ = deviance(system)
    _through(system, *parts, equations.torques, coupling, gap_rad, inputs)
    passed = replace(
        equations,
        transition=system.transition,
        forcing=system.forcing,
        noise=system.noise,
        logs_without_gap=logs,
    )
    return passed, replace(steps, transition=system.transition[:, :-1, :-1], inputs=inputs)


@inlined
def _touching(twist: float, ahead: float, half: float, spread: float) -> tuple[float, float]:
    """How surely a coupling touches on one side, and the torque over the stiffness that it lacks there (rad).

    `twist` towards that side, `ahead`: the same and what the damping adds to it, over the stiffness; a contact that
    lifts lets go where it would pull.
    """
    away = (min(twist, ahead) - half) / spread
    sure = 0.5 * (1.0 + erf(away / np.sqrt(2.0)))
    return sure, half * sure - spread * np.exp(-0.5 * away * away) / np.sqrt(2.0 * np.pi)


@compiled
def _through(
    system: System,
    touching: Array,
    free: Array,
    torques: Array,
    coupling: Array,
    gap: float,
    inputs: Array,
) -> None:
    """Write to the system's steps, and to what torques at their ends do, those of a coupling with a gap."""
    count, size, half = system.measured.shape[0], 5, gap / 2
    x, p = np.empty(size), np.empty((size, size))
    gain, row, ahead, lower = np.empty((2, size)), np.empty(size), np.empty(size), np.empty((size, size))
    phi, onto, push = np.empty((4, 4)), np.empty((4, 4)), np.empty(4)
    new_phi, new_onto, new_push = np.empty((4, 4)), np.empty((4, 4)), np.empty(4)
    step, here = np.empty((4, 10)), np.empty(4)
    errors, spreads = np.empty(2), np.empty(2)
    begun(system, x, p, size)
    for k in range(count):
        if k > 0:
            i = k - 1
            spread = max(np.sqrt(max(p[2, 2], 0.0)), _SUREST * gap)
            stiffness, damping = coupling[i, 0], coupling[i, 1]
            phi[:, :], onto[:, :], push[:] = 0.0, 0.0, 0.0
            for a in range(4):
                phi[a, a] = 1.0
            for part in range(_PARTS):
                early, late = part / _PARTS, (part + 1) / _PARTS
                for a in range(4):
                    here[a] = push[a] - onto[a, 0] * x[4]
                    for b in range(4):
                        here[a] += phi[a, b] * x[b]
                bent = here[2] + damping / stiffness * (here[1] - here[3])
                sure, lacks = _touching(here[2], bent, half, spread)
                other, misses = _touching(-here[2], -bent, half, spread)
                sure, lacks = sure + other, stiffness * (lacks - misses)
                for a in range(4):
                    for b in range(10):
                        step[a, b] = sure * touching[i, a, b] + (1.0 - sure) * free[i, a, b]
                bulge_m, bulge_l = (
                    4 * early * (1 - early) * torques[i, 4],
                    4 * early * (1 - early) * torques[i, 5],
                )
                later_m, later_l = (
                    4 * late * (1 - late) * torques[i, 4],
                    4 * late * (1 - late) * torques[i, 5],
                )
                motor = torques[i, 0] * (1 - early) + torques[i, 2] * early + bulge_m + lacks
                load = torques[i, 1] * (1 - early) + torques[i, 3] * early + bulge_l - lacks
                motor_on = torques[i, 0] * (1 - late) + torques[i, 2] * late + later_m + lacks
                load_on = torques[i, 1] * (1 - late) + torques[i, 3] * late + later_l - lacks
                for a in range(4):
                    new_push[a] = (
                        step[a, 4] * motor + step[a, 5] * load + step[a, 6] * motor_on + step[a, 7] * load_on
                    )
                    new_push[a] += (step[a, 8] * torques[i, 4] + step[a, 9] * torques[i, 5]) / _PARTS**2
                    new_onto[a, 0] = step[a, 4] * (1 - early) + step[a, 6] * (1 - late)
                    new_onto[a, 1] = step[a, 5] * (1 - early) + step[a, 7] * (1 - late)
                    new_onto[a, 2] = step[a, 4] * early + step[a, 6] * late
                    new_onto[a, 3] = step[a, 5] * early + step[a, 7] * late
                    for b in range(4):
                        new_phi[a, b] = 0.0
                    for c in range(4):
                        factor = step[a, c]
                        new_push[a] += factor * push[c]
                        for b in range(4):
                            new_phi[a, b] += factor * phi[c, b]
                            new_onto[a, b] += factor * onto[c, b]
                phi, new_phi = new_phi, phi
                onto, new_onto = new_onto, onto
                push, new_push = new_push, push
            for a in range(4):
                system.forcing[i, a] = push[a]
                system.transition[i, a, 4], system.noise[i, a] = -onto[a, 0], -onto[a, 2]
                for b in range(4):
                    system.transition[i, a, b], inputs[i, a, b] = phi[a, b], onto[a, b]
            carried(system, i, x, p, ahead, lower, size)
        updated(system, k, x, p, gain, row, errors, spreads, size)
