"""What acts on the load or disturbs the motor, and the load's inertia.

load torque a sin θ_l + b cos θ_l, or T(θ_l)        offset T        event T · bump(t)
    cogging a sin nθ + b cos nθ
inertia −(δJ α + ½ δJ' ω²): δJ constant, ∝ J, J' · shift, or any curve; α, ω of the load
direction-dependent load T(θ_l) where it moves forward, another backward
"""

from __future__ import annotations

import numpy as np

from schwung.explain.weighing.along import Along, Ranges
from schwung.explain.weighing.candidate import LADDER, Candidate, Curve, Shape, column, grid
from schwung.explain.weighing.vocabulary.friction import bump
from schwung.innovations.effect import Effect
from schwung.motion import Array

#: Highest order of cogging that is looked for.
_HIGHEST = 60
_DIFFERENCE_RAD = 1e-3


def polar(coefficients: Array) -> tuple[float, float]:
    """Amplitude and phase of a·sin + b·cos."""
    return float(np.hypot(*coefficients[:2])), float(np.arctan2(coefficients[1], coefficients[0]))


def _gravity(along: Along, _shape: Shape) -> Effect:
    return Effect(on_load=np.stack([np.sin(along.load_angle), np.cos(along.load_angle)], 1))


def _offset(along: Along, _shape: Shape) -> Effect:
    return Effect(column(np.ones_like(along.speed)))


def _offset_drift(along: Along, _shape: Shape) -> Effect:
    return Effect(column(np.full_like(along.speed, along.share)))


def _event(along: Along, shape: Shape) -> Effect:
    return Effect(on_load=column(bump(along.motion_time_s - shape[0] - shape[1] / 2, shape[1])))


def _cogging(along: Along, shape: Shape) -> Effect:
    return Effect(np.stack([np.sin(shape[0] * along.angle), np.cos(shape[0] * along.angle)], 1))


def moved_inertia(along: Along, change: Array, slope: Array) -> Effect:
    """Of a change of J_l (n, p), and its slope over the angle (n, p)."""
    taken = change * along.load_acceleration[:, None] + 0.5 * slope * along.load_speed[:, None] ** 2
    return Effect(on_load=-taken)


def believed(along: Along) -> tuple[Array, Array, Array]:
    """J_l along the run, its slope and its bend."""
    h, angle, inertia_at = _DIFFERENCE_RAD, along.load_angle, along.machine.load_inertia_at
    low, middle, high = inertia_at(angle - h), inertia_at(angle), inertia_at(angle + h)
    return middle, (high - low) / (2 * h), (high - 2 * middle + low) / h**2


def _delta(along: Along, _shape: Shape) -> Effect:
    one = np.ones((along.speed.size, 1))
    return moved_inertia(along, one, 0 * one)


def _scale(along: Along, _shape: Shape) -> Effect:
    inertia, slope, _ = believed(along)
    return moved_inertia(along, column(inertia), column(slope))


def _shift(along: Along, _shape: Shape) -> Effect:
    _, slope, bend = believed(along)
    return moved_inertia(along, column(slope), column(bend))


def load(
    of: Ranges, torque_nm: float, inertia_kgm2: float, least_kgm2: float, varies: bool
) -> list[Candidate]:
    """The family; `torque_nm`: a natural torque; `least_kgm2`: of the believed inertia; `varies`: whether it does."""
    natural, ripples = (torque_nm, torque_nm), max(of.span_rad, 1e-9)
    mass, share = inertia_kgm2, torque_nm / of.peak_torque_nm
    angle = Curve.over(of.low_rad, of.high_rad, 0.3)
    step = 1e-4 * of.span_rad
    events = [
        shape
        for duration in np.array([0.02, 0.04, 0.08, 0.16]) * max(of.longest_s, 1e-9)
        for shape in grid(np.arange(-duration / 2, of.longest_s - duration / 2, duration / 3), [duration])
    ]
    lowest = max(2, int(np.ceil(2 * np.pi / ripples)))
    highest = int(min(_HIGHEST, max(lowest + 1, 2 * np.pi * of.band_hz / (0.5 * of.peak_speed_rad_s))))

    def profile(along: Along, _shape: Shape) -> Effect:
        where = along.load_angle
        slope = (angle.at(where + step) - angle.at(where - step)) / (2 * step)
        inertia, bend, _ = believed(along)
        curve = angle.at(where)
        return moved_inertia(
            along, inertia[:, None] * curve, inertia[:, None] * slope + bend[:, None] * curve
        )

    def directed(along: Along, _shape: Shape) -> Effect:
        curve, ahead = angle.at(along.load_angle), along.load_direction[:, None]
        return Effect(
            on_load=np.concatenate([curve * np.maximum(ahead, 0), curve * np.maximum(-ahead, 0)], 1)
        )

    found = [
        Candidate("load_torque", _gravity, natural,
                  lambda c, _: dict(zip(("amplitude_nm", "phase_rad"), polar(c), strict=True)),
                  coordinate="position", family="load"),
        Candidate("load_torque", lambda a, _: Effect(on_load=angle.at(a.load_angle)),
                  (torque_nm,) * angle.size, scales=LADDER, coordinate="position", family="load"),
        Candidate("torque_offset", _offset, natural[:1], lambda c, _: {"torque_nm": c[0]},
                  coordinate="direction"),
        Candidate("offset_drift", _offset_drift, natural[:1], lambda c, _: {"change_nm": c[0]},
                  coordinate="run"),
        Candidate("load_event", _event, natural[:1],
                  lambda c, s: {"time_s": s[0], "duration_s": s[1], "peak_nm": c[0]},
                  shapes=tuple(events), spacing=(0.01 * of.longest_s, 0.5), logarithmic=(False, True),
                  bounds=((-0.1, of.longest_s), (2e-3, of.longest_s)), coordinate="time_in_motion"),
        Candidate("cogging", _cogging, natural,
                  lambda c, s: {"order": s[0], "amplitude_nm": polar(c)[0], "phase_rad": polar(c)[1]},
                  shapes=grid(range(lowest, highest + 1)), spacing=(0.25,), logarithmic=(False,),
                  bounds=((0.75 * lowest, 2.0 * highest),), coordinate="position"),
        Candidate("direction_dependent_load", directed, (torque_nm,) * (2 * angle.size), scales=LADDER,
                  coordinate="position", family="load"),
        Candidate("load_inertia", _delta, (share * mass,), lambda c, _: {"delta_kgm2": c[0]},
                  positive=(0,), least=(-least_kgm2,),
                  coordinate="acceleration"),
        Candidate("inertia_profile", profile, (1.0,) * angle.size, scales=tuple(s * share for s in LADDER),
                  coordinate="position"),
    ]  # fmt: skip
    if varies:
        found.append(
            Candidate("load_inertia", _scale, (share,), lambda c, _: {"scale": 1 + c[0]},
                      positive=(0,), least=(-1.0,),
                      coordinate="acceleration")
        )  # fmt: skip
        found.append(
            Candidate("inertia_profile_shift", _shift, (share,), lambda c, _: {"shift_rad": c[0]},
                      coordinate="position")
        )  # fmt: skip
    return found
