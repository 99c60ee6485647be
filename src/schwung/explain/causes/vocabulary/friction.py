"""Friction, all of it against the motion: −F·d, d = tanh(ω/ω_s) the direction on the motor, d_l that of the load.

coulomb −F d        asymmetric −F₊ (1 + d)/2 + F₋ (1 − d)/2       viscous −b ω        drag −c |ω| ω
stribeck −(F + ΔF e^{−|ω/ω_S|ⁿ}) d        local −F d · bump(θ)        over the angle −F(θ) d
drift −ΔF d · share of the session, as it settles        load-dependent −s |C| d, C what the shaft carries
behind it −F d_l        and there −b ω_l        −c |ω_l| ω_l
"""

from __future__ import annotations

import numpy as np

from schwung.compiled import compiled
from schwung.explain.causes.along import Along, Ranges
from schwung.explain.causes.candidate import LADDER, NATURAL, Candidate, Shape, grid
from schwung.explain.causes.curves import Curve, column
from schwung.explain.causes.known import Known
from schwung.innovations.effect import Effect
from schwung.motion import Array

#: Friction that falls within so many times the speed at which the sign is smoothed is not told from the smoothing.
OPEN = 6.0
#: Exponents of the fall that textbooks have (Tustin's 1, Stribeck's 2), and between which it is fitted.
_FALLS, _STEEPEST = (1.0, 2.0), (0.5, 4.0)
#: Within which the sharpness of a bump and the settling of a drift are looked for.
SHARP, _SETTLING = (0.01, 100.0), (-20.0, 20.0)


@compiled
def bump(away: Array, width: float, sharpness: float) -> Array:
    """A raised cosine to a power, 1 in the middle, `width` from end to end."""
    high = np.zeros_like(away)
    for i in range(away.size):
        if abs(away[i]) < 0.5 * width:
            high[i] = (0.5 + 0.5 * np.cos(2 * np.pi * away[i] / width)) ** sharpness
    return high


def settled(share: Array | float, settling: float) -> Array | float:
    """What of a drift has come after a share of the session: evenly, or the sooner the more it settles."""
    return share if abs(settling) < 1e-3 else np.expm1(-settling * share) / np.expm1(-settling)


def _coulomb(along: Along, _shape: Shape) -> Effect:
    return Effect(column(-along.direction))


def _asymmetric(along: Along, _shape: Shape) -> Effect:
    """At rest the middle of what it may be: as an offset and a dry friction would be, of which it is the sum."""
    return Effect(np.stack([-(1 + along.direction) / 2, (1 - along.direction) / 2], 1))


def _viscous(along: Along, _shape: Shape) -> Effect:
    return Effect(column(-along.speed))


def _drag(along: Along, _shape: Shape) -> Effect:
    return Effect(column(-np.abs(along.speed) * along.speed))


def _stribeck(along: Along, shape: Shape) -> Effect:
    fall = np.exp(-((np.abs(along.speed) / shape[0]) ** shape[1]))
    return Effect(np.stack([-along.direction, -along.direction * fall], 1))


def _away(along: Along, shape: Shape) -> Array:
    away = along.angle - shape[0]
    return np.asarray(away - 2 * np.pi * np.round(away / (2 * np.pi)))  # a tight spot comes back every turn


def _local(along: Along, shape: Shape) -> Effect:
    return Effect(column(-along.direction * bump(_away(along, shape), *shape[1:])))


def _within(along: Along, shape: Shape) -> Array:
    return np.clip(2 * _away(along, shape) / shape[1], -1.0, 1.0)


def _drift(along: Along, shape: Shape) -> Effect:
    return Effect(column(-along.direction * settled(along.share, shape[0])))


def _viscous_drift(along: Along, _shape: Shape) -> Effect:
    return Effect(column(-along.speed * along.share))


def _gear_loss(along: Along, _shape: Shape) -> Effect:
    return Effect(column(-np.abs(along.carried) * along.direction))


def _behind(along: Along, _shape: Shape) -> Effect:
    return Effect(on_load=column(-along.load_direction))


def _viscous_behind(along: Along, _shape: Shape) -> Effect:
    return Effect(on_load=column(-along.load_speed))


def _drag_behind(along: Along, _shape: Shape) -> Effect:
    return Effect(on_load=column(-np.abs(along.load_speed) * along.load_speed))


def friction(of: Ranges, torque_nm: float, rigid: bool, known: Known) -> list[Candidate]:
    """The family; `torque_nm`: a natural torque; `known`: whose frictions no change makes negative."""
    speed, span = of.peak_speed_rad_s, min(of.span_rad, 2 * np.pi)
    natural, viscous = torque_nm, torque_nm / speed
    e, plain = known.effects, known.machine
    ahead, back = e.coulomb_positive_nm, e.coulomb_negative_nm
    rubbing = (
        e.viscous_nms
        + plain.motor.viscous_friction_nms
        + plain.load.viscous_friction_nms
        + e.load_viscous_nms
    )
    slowest = OPEN * of.sticking_rad_s
    angle = Curve.over(of.low_rad, of.high_rad, 0.3)
    level = Curve(angle.points, np.concatenate([np.ones((angle.points.size, 1)), angle.modes], 1))
    spots = [
        shape
        for width in np.array([0.05, 0.1, 0.2, 0.4]) * span
        for shape in grid(np.arange(of.low_rad, of.low_rad + span + width / 4, width / 3), [width], [1.0])
    ]
    found = [
        Candidate("coulomb_friction", _coulomb, (natural,), lambda c, _: {"torque_nm": c[0]},
                  positive=(0,), least=(-min(ahead, back),), coordinate="direction", family="dry"),
        Candidate("asymmetric_friction", _asymmetric, (natural, natural),
                  lambda c, _: {"torque_positive_nm": c[0], "torque_negative_nm": c[1]},
                  positive=(0, 1), least=(-ahead, -back), coordinate="direction", family="dry",
                  cases=frozenset({"torque_offset", "coulomb_friction"})),
        Candidate("viscous_friction", _viscous, (viscous,), lambda c, _: {"coefficient_nms": c[0]},
                  positive=(0,), least=(-rubbing,), coordinate="speed"),
        Candidate("quadratic_drag", _drag, (viscous / speed,), lambda c, _: {"coefficient_nms2": c[0]},
                  positive=(0,), least=(-e.drag_nms2,), coordinate="speed"),
        Candidate("stribeck_friction", _stribeck, (natural, natural),
                  lambda c, s: {"coulomb_torque_nm": c[0], "breakaway_torque_nm": c[0] + c[1],
                                "stribeck_speed_rad_s": s[0], "exponent": s[1]},
                  shapes=grid(np.geomspace(slowest, 0.5 * speed, 10), _FALLS), spacing=(0.3, 0.3),
                  logarithmic=(True, True), bounds=((slowest, speed), _STEEPEST), endless=(1,),
                  positive=(0, 1), least=(-min(ahead, back), 0.0), coordinate="speed", family="dry",
                  cases=frozenset({"coulomb_friction"})),
        Candidate("local_friction", _local, (natural,),
                  lambda c, s: {"torque_nm": c[0], "centre_rad": s[0], "width_rad": s[1], "sharpness": s[2]},
                  shapes=tuple(spots), spacing=(0.03 * span, 0.5, 0.5), logarithmic=(False, True, True),
                  bounds=((of.low_rad - 0.2 * span, of.high_rad + 0.2 * span), (0.01 * span, 0.8 * span), SHARP),
                  endless=(2,),
                  positive=(0,), coordinate="position", own=(_within,)),
        Candidate("friction_over_angle", lambda a, _: Effect(-a.direction[:, None] * level.at(a.angle)),
                  (natural,) * level.size, scales=LADDER, coordinate="position", family="dry",
                  frictions=(level.modes, min(ahead, back)),
                  whole=lambda a, _, c: Effect(-a.direction[:, None] * level.folded(c).at(a.angle))),
        Candidate("friction_drift", _drift, (natural,), lambda c, s: {"change_nm": c[0], "settling": s[0]},
                  shapes=grid([0.0]), spacing=(1.0,), logarithmic=(False,), bounds=(_SETTLING,), coordinate="run"),
        Candidate("viscous_drift", _viscous_drift, (viscous,), lambda c, _: {"change_nms": c[0]},
                  coordinate="run"),
        Candidate("load_dependent_friction", _gear_loss, (NATURAL,), lambda c, _: {"share": c[0]},
                  positive=(0,), coordinate="torque"),
    ]  # fmt: skip
    return found if rigid else [*found, *_on_load(natural, viscous, viscous / speed, known)]


def _on_load(dry: float, viscous: float, drag: float, known: Known) -> list[Candidate]:
    """The same behind the coupling; natural sizes. Viscous friction and drag have one name, on whichever side."""
    e, plain = known.effects, known.machine.load.viscous_friction_nms
    return [
        Candidate("load_side_friction", _behind, (dry,), lambda c, _: {"torque_nm": c[0]},
                  positive=(0,), coordinate="direction", behind="coulomb_friction"),
        Candidate("viscous_friction", _viscous_behind, (viscous,), lambda c, _: {"load_coefficient_nms": c[0]},
                  positive=(0,), least=(-plain - e.load_viscous_nms,), coordinate="speed", behind="viscous_friction"),
        Candidate("quadratic_drag", _drag_behind, (drag,), lambda c, _: {"load_coefficient_nms2": c[0]},
                  positive=(0,), least=(-e.load_drag_nms2,), coordinate="speed", behind="quadratic_drag"),
    ]  # fmt: skip
