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
from schwung.innovations.five_states import angle_updated, begun, carried, speed_updated
from schwung.innovations.kalman import deviance
from schwung.innovations.likelihood import Equations, Noise, Play, problem_of
from schwung.innovations.signals import Signals
from schwung.innovations.steps import Steps
from schwung.innovations.values import Shaft, System
from schwung.motion import Array

#: A coupling that carries nothing within its play still has this share of its stiffness.
LEAST_SHARE = 1e-3

#: Of motor and load, or of a part's start and its end.
_Pair = tuple[float, float]
#: A state's row of a part of a step: Φ (4), what units of torque at its start, at its end and of the height of a
#: parabola between do, on motor and load each (6).
_Row = tuple[float, float, float, float, float, float, float, float, float, float]


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
def _torque(torques: Array, k: int, side: int, share: float) -> float:
    """On motor (`side` 0) or load (1), so much of step k on: straight from start to end, with a parabola on top."""
    straight = torques[k, side] * (1 - share) + torques[k, 2 + side] * share
    return float(straight + 4 * share * (1 - share) * torques[k, 4 + side])


@inlined
def _row(free: Array, pressed: Array, k: int, a: int, share: float) -> _Row:
    """Row a of a part of step k, of a coupling that touches for so much of it."""
    return (
        free[k, a, 0] + share * (pressed[k, a, 0] - free[k, a, 0]),
        free[k, a, 1] + share * (pressed[k, a, 1] - free[k, a, 1]),
        free[k, a, 2] + share * (pressed[k, a, 2] - free[k, a, 2]),
        free[k, a, 3] + share * (pressed[k, a, 3] - free[k, a, 3]),
        free[k, a, 4] + share * (pressed[k, a, 4] - free[k, a, 4]),
        free[k, a, 5] + share * (pressed[k, a, 5] - free[k, a, 5]),
        free[k, a, 6] + share * (pressed[k, a, 6] - free[k, a, 6]),
        free[k, a, 7] + share * (pressed[k, a, 7] - free[k, a, 7]),
        free[k, a, 8] + share * (pressed[k, a, 8] - free[k, a, 8]),
        free[k, a, 9] + share * (pressed[k, a, 9] - free[k, a, 9]),
    )


@inlined
def _along(row: _Row, a: float, b: float, c: float, d: float) -> float:
    """What four states become of one."""
    return row[0] * a + row[1] * b + row[2] * c + row[3] * d


@inlined
def _within(
    row: _Row, first: _Pair, last: _Pair, bulges: _Pair, span: _Pair, unknown: float
) -> tuple[float, float, float, float, float, float]:
    """What torques do to a state within a part of a step, on motor and load: units at the step's start and at its end,
    those that act, `first` and `last`, and as much in the coupling as is `unknown` there."""
    motor, load, motors, loads = row[4], row[5], row[6], row[7]
    early, late = span
    pushed = motor * first[0] + motors * last[0] + row[8] * bulges[0]
    pushed += load * first[1] + loads * last[1] + row[9] * bulges[1]
    return (
        motor * (1 - early) + motors * (1 - late),
        load * (1 - early) + loads * (1 - late),
        motor * early + motors * late,
        load * early + loads * late,
        pushed,
        unknown * (load + loads - motor - motors),
    )


@inlined
def _add(done: Array, a: int, more: tuple[float, float, float, float, float, float]) -> None:
    """More to a row's last six."""
    done[a, 4] += more[0]
    done[a, 5] += more[1]
    done[a, 6] += more[2]
    done[a, 7] += more[3]
    done[a, 8] += more[4]
    done[a, 9] += more[5]


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
    count, measured, variances = system.measured.shape[0], system.measured, system.variances
    # up to a part of the step: Φ, what units of torque at the step's ends do, its torques, and what is open
    done, here = np.empty((4, 10)), np.empty(4)
    x, p = begun(system)
    for k in range(count - 1):
        x, p, _, _, _ = angle_updated(x, p, measured[k, 0], variances[k, 0])
        x, p, _, _, _ = speed_updated(x, p, measured[k, 1], variances[k, 1])
        (x0, x1, x2, x3, x4), (_, _, p11, _, p21, p22, _, p31, p32, p33, _, _, _, _, _) = x, p
        drifting = p21 - p32  # covariance of the wind-up and its rate; and the variance of that
        turned = p11 + p33 - 2 * p31
        for a in range(4):
            for b in range(10):
                done[a, b] = 1.0 if a == b else 0.0
        for part in range(PARTS):
            for a in range(4):  # the torque's error is a state as well: it acts as torque on the motor does
                here[a] = done[a, 0] * x0 + done[a, 1] * x1 + done[a, 2] * x2 + done[a, 3] * x3
                here[a] += done[a, 8] - done[a, 4] * x4
            early = (part + 0.5) / PARTS
            further = driven[k, 0] * (1 - early) + driven[k + 1, 0] * early
            faster = driven[k, 1] * (1 - early) + driven[k + 1, 1] * early
            turning = here[1] - here[3] + faster
            since = (2 * part + 1) * middle
            variance = p22 + 2 * since * drifting + since * since * turned
            spread = max(np.sqrt(max(variance, 0.0)), SUREST * gap)
            lifts = (
                coupling[k, 1] / coupling[k, 0] * turning
            )  # a contact that lifts lets go where it would pull
            moves = 2 * turning * middle
            begins = here[2] + further - faster * middle
            up, down = begins + min(lifts, 0.0), begins + max(lifts, 0.0)
            one, missing, open_one = touching(up, up + moves, gap / 2, spread)
            other, misses, open_other = touching(-down, -down - moves, gap / 2, spread)
            touches = one + other
            lacks = coupling[k, 0] * (missing - misses)
            lacks -= touches * (coupling[k, 0] * further + coupling[k, 1] * faster)
            contact[k, 0] += touches / PARTS
            contact[k, 1] += (one - other) / PARTS
            contact[k, 2] += (missing - misses) / PARTS
            unknown = coupling[k, 0] * np.sqrt(open_one**2 + open_other**2)
            span = part / PARTS, (part + 1) / PARTS
            first = _torque(torques, k, 0, span[0]) + lacks, _torque(torques, k, 1, span[0]) - lacks
            last = _torque(torques, k, 0, span[1]) + lacks, _torque(torques, k, 1, span[1]) - lacks
            bulges = torques[k, 4] / PARTS**2, torques[k, 5] / PARTS**2
            one_row, two_row = _row(free, pressed, k, 0, touches), _row(free, pressed, k, 1, touches)
            three_row, four_row = _row(free, pressed, k, 2, touches), _row(free, pressed, k, 3, touches)
            for b in range(10):
                each = done[0, b], done[1, b], done[2, b], done[3, b]
                done[0, b], done[1, b] = _along(one_row, *each), _along(two_row, *each)
                done[2, b], done[3, b] = _along(three_row, *each), _along(four_row, *each)
            _add(done, 0, _within(one_row, first, last, bulges, span, unknown))
            _add(done, 1, _within(two_row, first, last, bulges, span, unknown))
            _add(done, 2, _within(three_row, first, last, bulges, span, unknown))
            _add(done, 3, _within(four_row, first, last, bulges, span, unknown))
        for a in range(4):
            system.forcing[k, a], system.open_contact[k, a] = done[a, 8], done[a, 9]
            system.on_load[k, 0, a], system.on_load[k, 1, a] = done[a, 5], done[a, 7]
            system.transition[k, a, 4], system.noise[k, a] = -done[a, 4], -done[a, 6]
            for b in range(4):
                system.transition[k, a, b], inputs[k, a, b] = done[a, b], done[a, 4 + b]
        x, p = carried(system, k, x, p)
