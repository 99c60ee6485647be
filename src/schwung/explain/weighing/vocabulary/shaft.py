"""The coupling and what swings behind it: a change ΔC of its torque is −ΔC on the motor and ΔC on the load.

stiffness δk·φ        damping δb·φ'        cubic κ φ³        play −½ gap · k · sign φ        φ the wind-up
a further mass: −J₃ · H · α on the load, H = (2ζω₃ s + ω₃²)/(s² + 2ζω₃ s + ω₃²)
"""

from __future__ import annotations

from functools import lru_cache

import numpy as np
from scipy.linalg import expm

from schwung.drivetrain.machine import Coupling
from schwung.explain.weighing.along import Along, Ranges
from schwung.explain.weighing.candidate import Candidate, Shape, column, grid
from schwung.innovations import kernel
from schwung.innovations.effect import Effect
from schwung.motion import Array

#: A coupling's damping is believed to this share of it: so far off, it is no name.
DAMPING_KNOWN_TO = 0.1


def between(change: Array) -> Effect:
    """Of torque that the coupling takes from the motor and gives to the load, (n, p)."""
    return Effect(-change, change)


def _stiffness(along: Along, _shape: Shape) -> Effect:
    return between(column(along.twist))


def _damping(along: Along, _shape: Shape) -> Effect:
    return between(column(along.twist_speed))


def _cubic(along: Along, _shape: Shape) -> Effect:
    return between(column(along.twist**3))


@lru_cache(maxsize=256)
def _swing(rate: float, ratio: float, step_s: float) -> Array:
    """What a step does to the further mass's angle and speed, and what its drive adds, (3, 3)."""
    whole = np.zeros((3, 3))
    whole[:2, :2] = [[0.0, 1.0], [-(rate**2), -2 * ratio * rate]]
    whole[1, 2] = 1.0
    return np.asarray(expm(whole * step_s))


def _third_mass(along: Along, shape: Shape) -> Effect:
    rate, ratio = shape
    step = _swing(rate, ratio, along.run.step_s)
    states = kernel.driven(step[:2, :2], step[:2, 2], along.load_acceleration)
    return Effect(on_load=column(-(states @ np.array([rate**2, 2 * ratio * rate]))))


def shaft(of: Ranges, coupling: Coupling, torque_nm: float, inertia_kgm2: float) -> list[Candidate]:
    """The family of a machine with a coupling."""
    k, b = coupling.stiffness_nm_rad, coupling.damping_nms
    share, wound = torque_nm / of.peak_torque_nm, of.peak_torque_nm / k

    def play(along: Along, _shape: Shape) -> Effect:
        return between(column(-0.5 * k * np.tanh(along.twist / (0.02 * wound))))

    def play_about(along: Along, _shape: Shape, gap: Array) -> tuple[Effect, Effect]:
        """Within the gap the coupling carries nothing; each end of it takes half of a further opening."""
        stiffness, damping = present(along)
        half, side = max(float(gap[0]), 0.0) / 2, np.tanh(along.twist / (0.02 * wound))
        within = np.abs(along.twist) < half
        held = np.where(
            within, stiffness * along.twist + damping * along.twist_speed, stiffness * half * side
        )
        beyond = 0.5 * (1 + np.tanh((np.abs(along.twist) - half) / (0.02 * wound))) if half > 0 else 1.0
        return between(column(-0.5 * stiffness * side * beyond)), between(column(-held))

    def play_tangent(along: Along, gap: Array) -> Array:
        within = np.abs(along.twist) < float(gap[0]) / 2
        return np.where(within[:, None], -np.array(present(along)), 0.0)

    def cubic_tangent(along: Along, cubic: Array) -> Array:
        return np.stack([3 * cubic[0] * along.twist**2, 0 * along.twist], 1)

    def present(along: Along) -> tuple[float, float]:
        there = along.present.coupling or coupling
        return there.stiffness_nm_rad, there.damping_nms

    return [
        Candidate("coupling_stiffness", _stiffness, (3 * share * k,),
                  lambda c, _: {"stiffness_nm_rad": k + c[0]}, positive=(0,), least=(-k,),
                  coordinate="torque", coupling=(1.0, 0.0)),
        Candidate("coupling_damping", _damping, (10 * share * max(b, 1e-3 * k / of.band_hz),),
                  lambda c, _: {"damping_nms": b + c[0]}, positive=(0,), least=(-b,),
                  coordinate="frequency", coupling=(0.0, 1.0)),
        Candidate("usual_damping", _damping, (DAMPING_KNOWN_TO * max(b, 1e-3 * k / of.band_hz),), named=False,
                  coordinate="frequency", coupling=(0.0, 1.0)),
        Candidate("nonlinear_stiffness", _cubic, (3 * share * k / wound**2,),
                  lambda c, _: {"cubic_nm_rad3": c[0]}, positive=(0,), coordinate="torque",
                  tangent=cubic_tangent),
        Candidate("backlash", play, (2 * share * wound,), lambda c, _: {"gap_rad": c[0]}, positive=(0,),
                  coordinate="torque", bent=play_about, tangent=play_tangent),
        Candidate("extra_compliance", _third_mass, (3 * share * inertia_kgm2,),
                  lambda c, s: {"inertia_kgm2": c[0], "stiffness_nm_rad": c[0] * s[0] ** 2,
                                "damping_nms": 2 * c[0] * s[0] * s[1]},
                  shapes=grid(2 * np.pi * np.geomspace(18, 120, 14), [0.03, 0.1]), spacing=(0.1, 0.7),
                  logarithmic=(True, True), bounds=((2 * np.pi * 10, 2 * np.pi * of.band_hz), (0.005, 0.5)),
                  positive=(0,), coordinate="frequency"),
    ]  # fmt: skip
