"""The coupling and what swings behind it: a change ΔC of its torque is −ΔC on the motor and ΔC on the load.

stiffness δk·φ        damping δb·φ'        cubic κ φ³        φ the wind-up
play −½ gap · k · sign φ where it pushes, else all that the coupling would carry
a further mass: −J₃ · H · α on the load, H = (2ζω₃ s + ω₃²)/(s² + 2ζω₃ s + ω₃²)
"""

from __future__ import annotations

from collections.abc import Callable
from functools import lru_cache

import numpy as np
from numpy.typing import NDArray
from scipy.linalg import expm

from schwung.drivetrain.machine import Coupling
from schwung.explain.weighing.along import Along, Ranges
from schwung.explain.weighing.candidate import RIGHT_TO, Candidate, Shape, column, grid
from schwung.innovations import kernel
from schwung.innovations.effect import Effect
from schwung.innovations.signals import Signals
from schwung.motion import Array

#: A coupling that carries nothing within its play still has this share of its stiffness.
LEAST_SHARE = 1e-3
#: Nobody knows a coupling's damping better than to this share: a smaller change is no finding.
_DAMPING_KNOWN_TO = 0.05
#: Gaps from which the search for one begins, as shares of the largest wind-up.
_GAPS = (3e-4, 3e-3, 3e-2, 0.3)
#: Where a further mass is looked for: frequencies as far apart as the least damped of them is wide.
_RESONANCES_HZ, _DAMPING_RATIOS = np.geomspace(18, 120, 33), (0.03, 0.1)
#: Places within a step where it is looked at what the coupling carries.
_PLACES = 16


def between(change: Array) -> Effect:
    """Of torque that the coupling takes from the motor and gives to the load, (n, p)."""
    return Effect(-change, change)


def _stiffness(along: Along, _shape: Shape) -> Effect:
    return between(column(along.twist))


def _damping(along: Along, _shape: Shape) -> Effect:
    return between(column(along.twist_speed))


def _cubic(along: Along, _shape: Shape) -> Effect:
    return between(column(along.twist**3))


def twist_of(run: Signals) -> tuple[Array, Array]:
    """How far the coupling is wound up, and how fast, as the states say it, (n,) each."""
    return np.asarray(run.states[:, 2]), np.asarray(run.states[:, 1] - run.states[:, 3])


def pushing(coupling: Coupling, twist: Array, turning: Array, gap_rad: float) -> NDArray[np.bool_]:
    """Whether a coupling with a gap touches: it can only push. Without a gap it always does."""
    wound = np.abs(twist) - gap_rad / 2
    push = coupling.stiffness_nm_rad * wound + coupling.damping_nms * np.sign(twist) * turning
    return (wound > 0) & (push > 0) | (gap_rad <= 0)


def without(coupling: Coupling, twist: Array, turning: Array, gap_rad: float) -> Array:
    """What a coupling with a gap carries less than one without (N·m)."""
    whole = coupling.stiffness_nm_rad * twist + coupling.damping_nms * turning
    touched = coupling.stiffness_nm_rad * max(gap_rad, 0.0) / 2 * np.sign(twist)
    return np.where(pushing(coupling, twist, turning, gap_rad), touched, whole)


def over_steps(carries: Callable[[Array, Array], Array], run: Signals) -> Array:
    """What a coupling carries at the start and the end of each step, so that a straight line between them pushes and
    moves a mass as far as it does, (n − 1, 2); `carries`: by twist and its rate, straight from sample to sample.

    A gap opens and closes within a step; at the samples alone it would be late by half of one.
    """
    share = (np.arange(_PLACES) + 0.5) / _PLACES
    finer = (each[:-1, None] + np.diff(each)[:, None] * share for each in twist_of(run))
    inside = run.as_sampled(carries(*finer).reshape(-1), _PLACES).reshape(-1, _PLACES)
    mean, early = np.mean(inside, axis=1), np.mean(inside * (1 - share), axis=1)
    start = 6 * early - 2 * mean
    return np.stack([start, 2 * mean - start], 1)


@lru_cache(maxsize=256)
def _swing(rate: float, ratio: float, step_s: float) -> Array:
    """What a step does to the further mass's angle and speed, and what its drive at the start and the end of the step
    adds, straight between them, (2, 4).
    """
    whole = np.zeros((4, 4))
    whole[:2, :2] = [[0.0, 1.0], [-(rate**2), -2 * ratio * rate]]
    whole[1, 2], whole[2, 3] = 1.0, 1 / step_s
    step = expm(whole * step_s)[:2]
    return np.column_stack([step[:, :2], step[:, 2] - step[:, 3], step[:, 3]])


def third_mass(acceleration: Array, rate: float, ratio: float, step_s: float) -> Array:
    """H · α along a run that begins at rest, (n,), for the load's acceleration (n,)."""
    step = _swing(rate, ratio, step_s)
    transition, start, end = step[:, :2], step[:, 2], step[:, 3]
    late = kernel.driven(np.ascontiguousarray(transition), transition @ end + start, acceleration)
    states = late + end * acceleration[:, None]
    return np.asarray(states @ np.array([rate**2, 2 * ratio * rate]))


def _third_mass(along: Along, shape: Shape) -> Effect:
    rate, ratio = shape
    return Effect(on_load=column(-third_mass(along.load_acceleration, rate, ratio, along.run.step_s)))


def shaft(of: Ranges, coupling: Coupling, torque_nm: float, inertia_kgm2: float) -> list[Candidate]:
    """The family of a machine with a coupling."""
    k, b = coupling.stiffness_nm_rad, coupling.damping_nms
    damping = max(b, 1e-3 * k / of.band_hz)
    share, wound = torque_nm / of.peak_torque_nm, of.peak_torque_nm / k

    def play_about(along: Along, _shape: Shape, gap: Array) -> tuple[Effect, Effect]:
        """What a further opening takes where the coupling pushes, and all that the gap takes."""
        there = along.present.coupling or coupling
        twist, turning = twist_of(along.run)
        lost = without(there, twist, turning, float(gap[0]))
        more = np.where(pushing(there, twist, turning, float(gap[0])), np.sign(twist), 0.0)
        return between(column(-0.5 * there.stiffness_nm_rad * more)), between(column(-lost))

    def play(along: Along, shape: Shape) -> Effect:
        whole = play_about(along, shape, np.array(shape))[1]
        return Effect(*(None if part is None else part / shape[0] for part in whole.parts))

    def play_over_steps(along: Along, gap: Array) -> Array:
        there = along.present.coupling or coupling
        return over_steps(lambda twist, turning: without(there, twist, turning, float(gap[0])), along.run)

    def play_tangent(along: Along, gap: Array) -> Array:
        there = along.present.coupling or coupling
        free = ~pushing(there, *twist_of(along.run), float(gap[0]))
        carried = np.array([there.stiffness_nm_rad, there.damping_nms])
        return np.where(free[:, None], (LEAST_SHARE - 1) * carried, 0.0)

    def cubic_tangent(along: Along, cubic: Array) -> Array:
        return np.stack([3 * cubic[0] * along.twist**2, 0 * along.twist], 1)

    return [
        Candidate("coupling_stiffness", _stiffness, (3 * share * k,),
                  lambda c, _: {"stiffness_nm_rad": k + c[0]}, positive=(0,), least=(-k,),
                  coordinate="torque", coupling=(1.0, 0.0), known_to=RIGHT_TO * k),
        Candidate("coupling_damping", _damping, (10 * share * damping,),
                  lambda c, _: {"damping_nms": b + c[0]}, positive=(0,), least=(-b,),
                  coordinate="frequency", coupling=(0.0, 1.0), known_to=_DAMPING_KNOWN_TO * damping),
        Candidate("nonlinear_stiffness", _cubic, (3 * share * k / wound**2,),
                  lambda c, _: {"cubic_nm_rad3": c[0]}, positive=(0,), coordinate="torque",
                  tangent=cubic_tangent),
        Candidate("backlash", play, (2 * share * wound,), lambda c, _: {"gap_rad": c[0]}, positive=(0,),
                  shapes=grid(wound * np.array(_GAPS)),
                  coordinate="torque", bent=play_about, tangent=play_tangent, over_steps=play_over_steps),
        Candidate("extra_compliance", _third_mass, (3 * share * inertia_kgm2,),
                  lambda c, s: {"inertia_kgm2": c[0], "stiffness_nm_rad": c[0] * s[0] ** 2,
                                "damping_nms": 2 * c[0] * s[0] * s[1]},
                  shapes=grid(2 * np.pi * _RESONANCES_HZ, _DAMPING_RATIOS), spacing=(0.06, 0.7),
                  logarithmic=(True, True), bounds=((2 * np.pi * 10, 2 * np.pi * of.band_hz), (0.005, 0.5)),
                  positive=(0,), coordinate="frequency"),
    ]  # fmt: skip
