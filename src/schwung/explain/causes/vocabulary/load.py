"""What acts on the load or disturbs the motor, and the load's inertia.

load torque a sin θ_l + b cos θ_l, or T(θ_l)        offset T        event T · bump(t)
spring at an end −T max(θ_l − p, 0)/r, r from p to the last angle that was visited
    cogging a sin nθ + b cos nθ, or with a wave of 2n besides
inertia −(δJ α + ½ δJ' ω²): δJ constant, ∝ J, J(θ_l + shift) − J(θ_l), or any curve; α, ω of the load
direction-dependent load T(θ_l) where it moves forward, another backward
payload −δJ_r α, of run r
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import replace
from functools import partial

import numpy as np
from scipy.interpolate import CubicSpline, PchipInterpolator, PPoly

from schwung.drivetrain.inertia import InertiaTable
from schwung.drivetrain.machine import Machine
from schwung.explain.causes.along import Along, Ranges
from schwung.explain.causes.candidate import LADDER, RIGHT_TO, Candidate, Shape, grid
from schwung.explain.causes.curves import BentCurve, Curve, column
from schwung.explain.causes.inertia_at import DIFFERENCE_RAD, inertia_of
from schwung.explain.causes.joined import run_by_run
from schwung.explain.causes.vocabulary.friction import SHARP, bump
from schwung.explain.causes.vocabulary.line import finest_order
from schwung.explain.causes.vocabulary.turning import turning
from schwung.innovations.effect import Effect
from schwung.motion import Array

#: Highest order that is tried unasked.
_HIGHEST = 60
#: A believed inertia that varies by less than this share has no profile to shift or to scale.
_VARIES = 0.02
#: Shifts from which the search for one begins: about none, a large one looks like another curve.
_SHIFTS_RAD = (-0.5, -0.2, -0.08, -0.03, 0.03, 0.08, 0.2, 0.5)
#: What is wrong with a measured curve is alike within this share of the visited angles.
_TABLE_REACH = 0.1


def polar(coefficients: Array) -> tuple[float, float]:
    """Amplitude and phase of a·sin + b·cos."""
    return float(np.hypot(*coefficients[:2])), float(np.arctan2(coefficients[1], coefficients[0]))


def _gravity(along: Along, _shape: Shape) -> Effect:
    return Effect(on_load=np.stack([np.sin(along.load_angle), np.cos(along.load_angle)], 1))


def _offset(along: Along, _shape: Shape) -> Effect:
    return Effect(column(np.ones_like(along.speed)))


def _offset_drift(along: Along, _shape: Shape) -> Effect:
    return Effect(column(np.full_like(along.speed, along.share)))


def end_spring(of: Ranges, torque_nm: float) -> list[Candidate]:
    """One at either end; `torque_nm`: a natural torque.

    The coefficient is the torque at the last angle that was visited, the shape how far from there the spring begins:
    one that begins at the very end is nowhere, one over the whole stroke an offset and a line, and neither has a name.
    """
    span = max(of.span_rad, 1e-9)

    def at(side: float, last: float) -> Candidate:
        def entered(along: Along, shape: Shape) -> Array:
            """0 where it begins, 1 at the last angle."""
            return np.maximum(1 - side * (last - along.load_angle) / shape[0], 0.0)

        def keys(coefficients: Array, shape: Shape) -> dict[str, float]:
            found = {"stiffness_nm_rad": coefficients[0] / shape[0], "position_rad": last - side * shape[0]}
            return found if side > 0 else {**found, "side": side}

        return Candidate(
            "end_spring", lambda a, s: Effect(on_load=column(-side * entered(a, s))), (torque_nm,), keys,
            shapes=grid(np.geomspace(0.02, 0.8, 10) * span), spacing=(0.3,), logarithmic=(True,),
            bounds=((0.01 * span, span),), positive=(0,), coordinate="position",
            own=(lambda a, s: np.clip(2 * entered(a, s) - 1, -1.0, 1.0),),
        )  # fmt: skip

    return [at(1.0, of.high_rad), at(-1.0, of.low_rad)]


def _event(along: Along, shape: Shape) -> Effect:
    return Effect(on_load=column(bump(along.motion_time_s - shape[0] - shape[1] / 2, *shape[1:])))


def _during(along: Along, shape: Shape) -> Array:
    return np.clip(2 * (along.motion_time_s - shape[0]) / shape[1] - 1, -1.0, 1.0)


def _cogging(along: Along, shape: Shape) -> Effect:
    return Effect(turning(along, shape[0]))


def _cogging_twice(along: Along, shape: Shape) -> Effect:
    """Teeth are no sine: with a wave of twice the order."""
    return Effect(np.concatenate([turning(along, shape[0]), turning(along, 2 * shape[0])], axis=1))


def _both_waves(coefficients: Array, shape: Shape) -> dict[str, float]:
    first, second = polar(coefficients[:2]), polar(coefficients[2:])
    return {
        "order": shape[0], "amplitude_nm": first[0], "phase_rad": first[1],
        "second_amplitude_nm": second[0], "second_phase_rad": second[1],
    }  # fmt: skip


def of_inertia(unit: Callable[[Array, Shape], Array], step_rad: float) -> Callable[[Along, Shape], Effect]:
    """What a change of J_l takes, −(δJ α + ½ δJ' ω²); `unit`: of each coefficient at angles, (n, p)."""

    def effect(along: Along, shape: Shape) -> Effect:
        where = along.load_angle
        slope = (unit(where + step_rad, shape) - unit(where - step_rad, shape)) / (2 * step_rad)
        taken = unit(where, shape) * along.load_acceleration[:, None]
        return Effect(on_load=-(taken + 0.5 * slope * along.load_speed[:, None] ** 2))

    return effect


def table_error(of: Ranges, machine: Machine) -> list[Candidate]:
    """Present in every set: how far a measured inertia may be off, between its table's points, beyond its ends and,
    where the table says so, at its points.
    """
    table = machine.load.inertia_table
    if not isinstance(table, InertiaTable):
        return []
    between = Candidate("usual_table", partial(_between_points, _off_spline(table)), (1.0,), named=False)
    known = [between, *_beyond_ends(of, table)]
    if table.std_kgm2 is None:
        return known
    at, std = table.position_rad, table.std_kgm2
    curve = BentCurve.over(of.low_rad, of.high_rad, _TABLE_REACH)

    def error(where: Array, _shape: Shape) -> Array:
        return np.asarray(np.interp(where, at, std)[:, None] * curve.at(where))

    known.append(
        Candidate("usual_inertia", of_inertia(error, 1e-4 * of.span_rad), (1.0,) * curve.size, named=False,
                  inertia=error)
    )  # fmt: skip
    return known


def _beyond_ends(of: Ranges, table: InertiaTable) -> list[Candidate]:
    """Where the motion passes a table's end the inertia is not known: a slope and a bend from there on, as large as
    they are within the table. As it is held there, a motion that overshot its table by 0.15 rad had five causes.
    """
    first, last = float(table.position_rad[0]), float(table.position_rad[-1])
    passed = [end for end, over in ((first, first - of.low_rad), (last, of.high_rad - last)) if over > 0]
    within = np.linspace(first, last, 4 * table.position_rad.size)
    steep = float(np.sqrt(np.mean(table.slope_at(within) ** 2)))
    if not passed or steep == 0:
        return []
    bent = steep**2 / float(np.std(table.at(within)))  # of a sine, exactly

    def further(where: Array, _shape: Shape) -> Array:
        beyond = [
            np.minimum(where - end, 0.0) if end == first else np.maximum(where - end, 0.0) for end in passed
        ]
        return np.stack([power for over in beyond for power in (over, over**2 / 2)], 1)

    return [
        Candidate("usual_continuation", of_inertia(further, DIFFERENCE_RAD), (steep, bent) * len(passed),
                  named=False, inertia=further)
    ]  # fmt: skip


def _off_spline(table: InertiaTable) -> PPoly:
    """What the cubic spline through a table's points has more than its PCHIP: so far it is unknown between them."""
    at = table.position_rad
    spline, pchip = CubicSpline(at, table.inertia_kgm2), PchipInterpolator(at, table.inertia_kgm2)
    return PPoly(spline.c - pchip.c, at)


def _between_points(off: PPoly, along: Along, _shape: Shape) -> Effect:
    where = np.clip(along.load_angle, off.x[0], off.x[-1])
    taken = off(where) * along.load_acceleration + 0.5 * off(where, 1) * along.load_speed**2
    return Effect(on_load=column(-taken))


def _payload(of: Ranges, deviation_kgm2: float, least_kgm2: float, known_to_kgm2: float) -> Candidate:
    """An inertia that is another in each run: what is carried was changed. A file says what they share."""
    runs = of.runs

    @run_by_run
    def effect(along: Along, _shape: Shape) -> Effect:
        found = np.zeros((along.speed.size, 1 + runs))
        found[:, 0] = -along.load_acceleration
        if along.number < runs:  # what a run that is yet to come carries besides is not known
            found[:, 1 + along.number] = found[:, 0]
        return Effect(on_load=found)

    @run_by_run
    def heavier(along: Along, _shape: Shape, coefficients: Array) -> Array:
        own = coefficients[1 + along.number] if along.number < runs else 0.0
        return np.full(along.speed.size, coefficients[0] + own)

    def none(coefficients: Array, _shape: Shape) -> bool:
        """Whether the runs carry alike, or one of them less than nothing."""
        own = coefficients[1:][coefficients[1:] != 0]  # of runs that were fitted
        if not own.size:
            return False
        return bool(np.ptp(own) <= known_to_kgm2 or coefficients[0] + np.min(own) <= least_kgm2)

    return Candidate(
        "load_inertia", effect, (deviation_kgm2,) * (1 + runs), lambda c, _: {"delta_kgm2": c[0]},
        positive=(0,), least=(least_kgm2,), coordinate="acceleration", known_to=known_to_kgm2,
        products=np.eye(1 + runs) / runs, heavier=heavier, each_run=True, none_of=none,
        unsaid=lambda c, *_: f"what each run has of it: {_run_by_run(c)} kg·m²",
    )  # fmt: skip


def _run_by_run(coefficients: Array) -> str:
    """What each run that was fitted has, alike in their digits."""
    own = {run: coefficients[0] + each for run, each in enumerate(coefficients[1:]) if each != 0}
    digits = max(1 - int(np.floor(np.log10(max(map(abs, own.values()), default=1.0)))), 0)
    return ", ".join(f"run {run} {round(each, digits) + 0.0:+.{digits}f}" for run, each in own.items())


def of_any_order(
    of: Ranges,
    name: str,
    effect: Callable[[Along, Shape], Effect],
    deviations: Shape,
    keys: Callable[[Array, Shape], Mapping[str, float]],
    lowest: int | None = None,
) -> list[Candidate]:
    """What comes so many times a radian, the one number of its shape: tried one by one, finer ones where one stands out
    of what is missed. `lowest`: from which on; None: the first after 1 that is a whole wave.
    """
    span = max(of.span_rad, 1e-9)
    lowest = lowest or max(2, int(np.ceil(2 * np.pi / span)))
    finest = max(lowest + 1, 2 * np.pi * of.band_hz / (0.5 * of.peak_speed_rad_s))
    highest = int(min(_HIGHEST, finest))
    found = Candidate(
        name, effect, deviations, keys, shapes=grid(range(lowest, highest + 1)), spacing=(0.25,),
        logarithmic=(False,), bounds=((0.75 * lowest, 2.0 * highest),), coordinate="position",
    )  # fmt: skip
    if finest <= highest:
        return [found]
    told_apart, ends = 2 * np.pi / span, (float(highest), float(finest))
    finer = replace(
        found, shapes=(), sought=lambda missed: finest_order(missed, of.low_rad, of.high_rad, ends),
        choices=max(round((finest - highest) / told_apart), 1), spacing=(0.5 * told_apart,),
        bounds=((highest, 2 * finest),),
    )  # fmt: skip
    return [found, finer]


def load(of: Ranges, torque_nm: float, machine: Machine) -> list[Candidate]:
    """The family; `torque_nm`: a natural torque; `machine`: as believed."""
    natural = (torque_nm, torque_nm)
    share = torque_nm / of.peak_torque_nm
    inertia = machine.load_inertia_at(np.linspace(of.low_rad, of.high_rad, 65))
    mass = float(np.mean(inertia)) + (machine.motor.inertia_kgm2 if machine.coupling is None else 0.0)
    varies = bool(np.ptp(inertia) > _VARIES * np.mean(inertia))
    steep = float(np.sqrt(np.mean(np.gradient(inertia, max(of.span_rad, 1e-9) / (inertia.size - 1)) ** 2)))
    angle = Curve.over(of.low_rad, of.high_rad, 0.3)
    # as fine as what has no name, and without edges cut off: what a named curve could not do would be without a name
    fine = Curve.over(of.low_rad, of.high_rad, 0.15, 65, least=1e-4)
    masses = BentCurve.over(of.low_rad, of.high_rad, 0.3)  # its slope is felt, too
    events = [
        shape
        for duration in np.array([0.02, 0.04, 0.08, 0.16]) * max(of.longest_s, 1e-9)
        for shape in grid(
            np.arange(-duration / 2, of.longest_s - duration / 2, duration / 3), [duration], [1.0]
        )
    ]

    def constant(where: Array, _shape: Shape) -> Array:
        return np.ones((where.size, 1))

    def scaled(where: Array, _shape: Shape) -> Array:
        return column(machine.load_inertia_at(where))

    def shifted(where: Array, coefficients: Array) -> Array:
        return machine.load_inertia_at(where + coefficients[0]) - machine.load_inertia_at(where)

    def towards(where: Array, shape: Shape) -> Array:
        return column(shifted(where, np.array(shape)) / shape[0])

    def shift_about(along: Along, shape: Shape, coefficients: Array) -> tuple[Effect, Effect]:
        more = of_inertia(lambda where, _: column(inertia_of(machine, where + coefficients[0])[1]), step)
        whole = of_inertia(lambda where, _: column(shifted(where, coefficients)), step)
        return more(along, shape), whole(along, shape)

    def profile(where: Array, _shape: Shape) -> Array:
        return machine.load_inertia_at(where)[:, None] * masses.at(where)

    def directed(along: Along, _shape: Shape) -> Effect:
        return Effect(on_load=angle.by_direction(along.load_angle, along.load_direction))

    def directed_whole(along: Along, _shape: Shape, coefficients: Array) -> Effect:
        folded = angle.folded_by_direction(along.load_angle, along.load_direction, coefficients)
        return Effect(on_load=folded)

    def load_torque(curve: Curve) -> Candidate:
        def whole(along: Along, _shape: Shape, coefficients: Array) -> Effect:
            return Effect(on_load=curve.folded(coefficients).at(along.load_angle))

        return Candidate(
            "load_torque", lambda a, _: Effect(on_load=curve.at(a.load_angle)), (torque_nm,) * curve.size,
            scales=LADDER, coordinate="position", family="load", cases=frozenset({"end_spring"}), whole=whole,
        )  # fmt: skip

    step = DIFFERENCE_RAD
    found: list[Candidate] = [
        Candidate("load_torque", _gravity, natural,
                  lambda c, _: dict(zip(("amplitude_nm", "phase_rad"), polar(c), strict=True)),
                  coordinate="position", family="load"),
        load_torque(angle),
        load_torque(fine),
        *end_spring(of, torque_nm),
        Candidate("torque_offset", _offset, natural[:1], lambda c, _: {"torque_nm": c[0]},
                  coordinate="direction"),
        Candidate("offset_drift", _offset_drift, natural[:1], lambda c, _: {"change_nm": c[0]},
                  coordinate="run"),
        Candidate("load_event", _event, natural[:1],
                  lambda c, s: {"time_s": s[0], "duration_s": s[1], "peak_nm": c[0], "sharpness": s[2]},
                  shapes=tuple(events), spacing=(0.01 * of.longest_s, 0.5, 0.5), logarithmic=(False, True, True),
                  bounds=((-0.1, of.longest_s), (2e-3, of.longest_s), SHARP), endless=(2,), coordinate="time_in_motion",
                  own=(_during,)),
        *of_any_order(
            of, "cogging", _cogging, natural,
            lambda c, s: {"order": s[0], "amplitude_nm": polar(c)[0], "phase_rad": polar(c)[1]},
        ),
        *of_any_order(of, "cogging", _cogging_twice, 2 * natural, _both_waves),
        Candidate("direction_dependent_load", directed, (torque_nm,) * (2 * angle.size), scales=LADDER,
                  coordinate="position", family="load", cases=frozenset({"end_spring"}), whole=directed_whole),
        Candidate("load_inertia", of_inertia(constant, step), (share * mass,),
                  lambda c, _: {"delta_kgm2": c[0]}, positive=(0,), least=(-float(inertia.min()),),
                  coordinate="acceleration", inertia=constant, known_to=RIGHT_TO * mass, part_of="inertia_profile"),
        _payload(of, share * mass, -float(inertia.min()), RIGHT_TO * mass),
        Candidate("inertia_profile", of_inertia(profile, 1e-4 * of.span_rad), (1.0,) * masses.size,
                  scales=tuple(s * share for s in LADDER), coordinate="position", inertia=profile,
                  known_to=RIGHT_TO, products=masses.modes.T @ masses.modes / masses.points.size),
    ]  # fmt: skip
    if varies:
        found.append(
            Candidate("load_inertia", of_inertia(scaled, step), (share,), lambda c, _: {"scale": 1 + c[0]},
                      positive=(0,), least=(-1.0,), coordinate="acceleration", inertia=scaled,
                      known_to=RIGHT_TO, part_of="inertia_profile")
        )  # fmt: skip
        found.append(
            Candidate("inertia_profile_shift", of_inertia(towards, step), (share,),
                      lambda c, _: {"shift_rad": c[0]}, shapes=grid(_SHIFTS_RAD), coordinate="position",
                      bent=shift_about, inertia=towards, inertia_whole=shifted, known_to=RIGHT_TO * mass / steep)
        )  # fmt: skip
    return found
