"""What two sets at rest predict otherwise, of the torque that can be heard.

The noise of the reported torque goes through each set's own machine: where one lets less of it through, it misses less
by chance, at no cost. Near a load's own resonance that was worth twenty nats to a further mass, either way. So what one
set misses is set beside what it would miss if it had the other's prediction, of a torque without its noise.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from schwung.explain.causes.true_torque import TrueTorque, torque_noise
from schwung.explain.weighing.round import Linearised
from schwung.innovations import kalman, kernel
from schwung.innovations.effect import Passed
from schwung.innovations.likelihood import problem_of
from schwung.innovations.low_pass import surely_heard
from schwung.motion import Array


def goes_otherwise(about: Linearised) -> bool:
    """Whether noise may go through one set otherwise than through another: not without a coupling, for then nothing
    swings; and how a gap closes hangs on each filter's own way."""
    return not any(passed.run.rigid or passed.equations.play for passed in about.passed.values())


def misses_less(one: Linearised, other: Linearised, runs: Sequence[int]) -> float:
    """How much less `one` misses than `other`, in sums of squares, alike in both whitenings; what they miss each in its
    own where they do not differ in how a machine moves."""
    if not (goes_otherwise(one) and goes_otherwise(other)):
        return other.square(runs) - one.square(runs)
    return sum(_in_run(one, other, run) for run in runs)


def _in_run(one: Linearised, other: Linearised, run: int) -> float:
    first, second = one.passed[run], other.passed[run]
    misses = [float(np.sum(each.innovations**2)) for each in (first, second)]
    plain = misses[1] - misses[0]
    mine, theirs = first.equations.transition, second.equations.transition
    if mine.shape == theirs.shape and np.array_equal(mine, theirs):
        return plain
    noise = _surely(one, run).noise_nm
    apart = _reads(first, *noise) - _reads(second, *noise)
    shown = [_shown(each, apart) for each in (first, second)]
    by_first = float(np.sum((first.innovations + shown[0]) ** 2)) - misses[0]
    by_second = misses[1] - float(np.sum((second.innovations - shown[1]) ** 2))
    alike = (by_first + by_second) / 2
    return alike if np.isfinite(alike) else plain


def _surely(about: Linearised, run: int) -> TrueTorque:
    """The torque of a run as far as it is surely no noise: what is left of that would meet itself in what is missed."""
    torque, signals = about.view.torques[run], about.view.runs[run]
    injected = signals.drive.injected_nm
    return replace(
        torque, nm=surely_heard(torque.nm - injected, torque_noise(signals, about.noise)) + injected
    )


def _reads(passed: Passed, start: Array, end: Array, height: Array) -> Array:
    """How much more of angle and speed (n, 2) a machine reports than was, from its first state on driven by the torque
    without its noise: at the start and at the end of each step, and the height of a parabola between, (n − 1,)."""
    equations, size = passed.equations, passed.states.shape[1] - 1
    transition, last = equations.transition, equations.noise[:, :size]
    forcing = equations.forcing[:, :size] + transition[:, :size, size] * start[:, None] + last * end[:, None]
    forcing = forcing - passed.steps.inputs[:, :size, 4] * height[:, None]
    moved = kernel.moved(transition[:, :size, :size], forcing, passed.states[0, :size])
    return np.asarray(moved[:, :2] - equations.measured)


def _shown(passed: Passed, apart: Array) -> Array:
    """What so much more of angle and speed (n, 2) is in a run's innovations, (2n,)."""
    still = replace(
        passed.equations,
        forcing=np.zeros_like(passed.equations.forcing),
        measured=apart,
        first=np.zeros_like(passed.equations.first),
    )
    result = kalman.filtered(problem_of(still, passed.noise, passed.run))
    return np.asarray(result.error / np.sqrt(result.variance)).reshape(-1)
