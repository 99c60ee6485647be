"""The motor's inertia, the coupling and what swings behind it: a change ΔC of its torque is −ΔC on the motor and ΔC
on the load.

rotor −δJ_m α, α the motor's
stiffness δk·φ        damping δb·φ'        cubic κ φ³        along the way k a sin nθ·φ        φ the wind-up
play −½ gap · k · sign φ where it touches, else all that the coupling would carry (`innovations/play.py`)
transmission e = a sin nθ in the angle that drives it: k e + b e' ω, and −e' C on the motor besides
a further mass: −J₃ · H · α on the load, H = (2ζω₃ s + ω₃²)/(s² + 2ζω₃ s + ω₃²)
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import numpy as np

from schwung.drivetrain.machine import Coupling
from schwung.explain.causes.along import Along, Ranges
from schwung.explain.causes.candidate import LADDER, RIGHT_TO, Candidate, Shape, grid
from schwung.explain.causes.curves import BentCurve, column
from schwung.explain.causes.joined import run_by_run
from schwung.explain.causes.third_mass import third_mass
from schwung.explain.causes.vocabulary.hanging import hanging
from schwung.explain.causes.vocabulary.load import of_any_order, polar
from schwung.explain.causes.vocabulary.turning import turning
from schwung.innovations.effect import Effect
from schwung.innovations.values import FurtherMass
from schwung.motion import Array

#: What a contact that opens and closes damps may differ by so much from what the coupling was believed to damp.
_OF_CONTACTS = 0.3
#: Gaps from which the search for one begins, as shares of the largest wind-up.
_GAPS = np.geomspace(1e-4, 1.0, 9)
#: How far a coupling without a name is a curve over its wind-up, over the largest that is believed; within what share
#: of that it is alike.
_WOUND, _ALIKE = 2.0, 0.1
#: Where a further mass is looked for: frequencies as far apart as the least damped of them is wide.
#: Slower ones, of which no motion is long enough to tell how wide they are, each half as fast again as the last.
_SLOW_HZ = 18.0 / 1.5 ** np.arange(1, 6)[::-1]
_RESONANCES_HZ, _DAMPING_RATIOS = np.concatenate([_SLOW_HZ, np.geomspace(18, 120, 33)]), (0.03, 0.1)


def between(change: Array) -> Effect:
    """Of torque that the coupling takes from the motor and gives to the load, (n, p)."""
    return Effect(-change, change)


def _rotor(along: Along, _shape: Shape) -> Effect:
    return Effect(column(-along.acceleration))


def _stiffness(along: Along, _shape: Shape) -> Effect:
    return between(column(along.wound))


def _damping(along: Along, _shape: Shape) -> Effect:
    return between(column(along.winding))


#: A wave is none but for its harmonics: what gives by a sine is as stiff as one over that.
_PHASES = tuple(lambda along, shape, which=which: turning(along, shape[0])[:, which] for which in (0, 1))


def _of_one(errors: Array, shape: Shape) -> dict[str, float]:
    """Of a wave."""
    amplitude, phase = polar(errors)
    return {"order": shape[0], "amplitude_rad": amplitude / shape[0], "phase_rad": phase}


def _of_both(errors: Array, shape: Shape) -> dict[str, float]:
    """Teeth that do not run true, a pulley that is no circle: a wave of twice the order besides."""
    first, second = polar(errors[:2]), polar(errors[2:])
    return {
        "order": shape[0], "amplitude_rad": first[0] / shape[0], "phase_rad": first[1],
        "second_amplitude_rad": second[0] / (2 * shape[0]), "second_phase_rad": second[1],
    }  # fmt: skip


def _cubic(along: Along, _shape: Shape) -> Effect:
    return between(column(along.wound**3))


@run_by_run
def _third_mass(along: Along, shape: Shape) -> Effect:
    rate, ratio = shape
    return Effect(on_load=column(-third_mass(along.load_acceleration, rate, ratio, along.run.step_s)))


def shaft(
    of: Ranges, coupling: Coupling, torque_nm: float, rotor_kgm2: float, inertia_kgm2: float
) -> list[Candidate]:
    """The family of a machine with a coupling: without one, the motor's inertia is the load's."""
    k, b = coupling.stiffness_nm_rad, coupling.damping_nms
    damping = max(b, 1e-3 * k / of.band_hz)
    sprung = k / (2 * np.pi * of.band_hz)  # a damping that carries as much as the spring at the band's end
    share, wound = torque_nm / of.peak_torque_nm, of.peak_torque_nm / k

    def lost(along: Along, gap: float) -> Array:
        """What a coupling with a gap carries less than one without (N·m)."""
        there, (apart, rate) = along.present.coupling or coupling, along.apart.T
        whole = there.stiffness_nm_rad * apart + there.damping_nms * rate
        touched = there.stiffness_nm_rad * gap / 2 * np.sign(apart)
        return np.asarray(np.where(along.touches_with(gap), touched, whole))

    def play_about(along: Along, _shape: Shape, gap: Array) -> tuple[Effect, Effect]:
        """What a further opening takes where the coupling touches, and all that it takes."""
        there = along.present.coupling or coupling
        whole = lost(along, along.beyond.gap_rad) - lost(along, along.beyond.gap_rad - float(gap[0]))
        opening = np.column_stack([-0.5 * there.stiffness_nm_rad * along.contact[:, 1], along.winding])
        return between(opening), between(column(float(gap[1]) * along.winding - whole))

    def play(along: Along, shape: Shape) -> Effect:
        further = lost(along, along.beyond.gap_rad + shape[0]) - lost(along, along.beyond.gap_rad)
        return between(np.column_stack([-further / shape[0], along.winding]))

    @run_by_run
    def closing(along: Along, _shape: Shape) -> Array:
        """How fast a contact closes, over the fastest, −1…1: what it does then no stiffness and damping say exactly."""
        rate = along.apart[:, 1]
        return np.asarray(along.contact[:, 1] * rate / max(float(np.max(np.abs(rate))), 1e-12))

    def cubic_tangent(along: Along, _shape: Shape, cubic: Array) -> Array:
        return np.stack([3 * cubic[0] * along.wound**2, 0 * along.wound], 1)

    curve = BentCurve.over(-_WOUND * wound, _WOUND * wound, _ALIKE)
    # as a whole it is stiffer or softer, too, by as much as a stiffness is naturally off
    curve = replace(curve, modes=np.column_stack([3 * curve.points / wound, curve.modes]))

    def over_wind_up(along: Along, _shape: Shape) -> Effect:
        return between(curve.at(along.wound))

    def over_wind_up_whole(along: Along, _shape: Shape, coefficients: Array) -> Effect:
        return between(column(curve.folded(along.wound, coefficients)))

    def over_wind_up_tangent(along: Along, _shape: Shape, coefficients: Array) -> Array:
        return np.stack([curve.slope(along.wound, coefficients), 0 * along.wound], 1)

    def over_angle(along: Along, shape: Shape) -> Effect:
        there = along.present.coupling or coupling
        return between(there.stiffness_nm_rad * along.wound[:, None] * turning(along, shape[0]))

    def driven_about(along: Along, shape: Shape, errors: Array) -> tuple[Effect, Effect]:
        """Coefficients are a n, as of an encoder, of a wave or of two. The motor feels the coupling by the ratio that
        drives it."""
        there, (further, faster) = along.present.coupling or coupling, further_by(along, shape, errors.size)
        quicker, bent = faster * along.speed[:, None], along.coupling_about(there)
        pushed = along.contact[:, :1] * (bent[:, :1] * further + bent[:, 1:] * quicker)
        more, carried = column(faster @ errors), column(along.carried)
        # what bends the coupling is wound up by it, too; whether a gap touches follows from it, and is the filter's
        straight = column((there.stiffness_nm_rad * further + there.damping_nms * quicker) @ errors)
        pushes = along.contact[:, :1] * straight if along.beyond.gap_rad == 0 else 0 * more
        return (
            Effect(-(1 + more) * pushed - faster * carried, pushed),
            Effect(-pushes - more * carried, pushes),
        )

    def further_by(along: Along, shape: Shape, size: int) -> tuple[Array, Array]:
        """How much further it drives the coupling for a unit of each, and by which ratio faster, (n, size)."""
        orders = [(1 + wave) * shape[0] for wave in range(size // 2)]
        waves = [turning(along, order) for order in orders]
        further = np.concatenate([wave / order for wave, order in zip(waves, orders, strict=True)], axis=1)
        faster = np.concatenate([wave[:, ::-1] * [1.0, -1.0] for wave in waves], axis=1)
        return further, faster

    def drives(along: Along, shape: Shape, errors: Array) -> tuple[Array, Array]:
        further, faster = further_by(along, shape, errors.size)
        return further @ errors, faster @ errors * along.speed

    def each_turn(shape: Shape) -> float:
        """Of a n what is a: a shaft is where it is told to be as closely as the peak torque winds it up."""
        return 1 / shape[0]

    def transmission(size: int, keys: Callable[[Array, Shape], dict[str, float]]) -> list[Candidate]:
        natural = (share * of.span_rad / 10,) * size
        return of_any_order(
            of, "kinematic_error", lambda a, s: driven_about(a, s, np.zeros(size))[0], natural, keys, lowest=1
        )

    def over_angle_tangent(along: Along, shape: Shape, shares: Array) -> Array:
        there = along.present.coupling or coupling
        return np.outer(there.stiffness_nm_rad * (turning(along, shape[0]) @ shares), [1.0, 0.0])

    return [
        Candidate("motor_inertia", _rotor, (3 * share * rotor_kgm2,),
                  lambda c, _: {"inertia_kgm2": rotor_kgm2 + c[0]}, positive=(0,), least=(-rotor_kgm2,),
                  coordinate="acceleration", rotor=1.0, known_to=RIGHT_TO * rotor_kgm2),
        Candidate("coupling_stiffness", _stiffness, (3 * share * k,),
                  lambda c, _: {"stiffness_nm_rad": k + c[0]}, positive=(0,), least=(-k,),
                  coordinate="torque", coupling=(1.0, 0.0, 0.0), known_to=RIGHT_TO * k, elsewhere=(-k / 2, k)),
        Candidate("coupling_damping", _damping, (10 * share * damping,),
                  lambda c, _: {"damping_nms": b + c[0]}, positive=(0,), least=(-b,),
                  coordinate="frequency", coupling=(0.0, 1.0, 0.0), known_to=RIGHT_TO * (damping + sprung)),
        # how it bends is its kind, and no number that is off: rubber is as stiff again where it is wound up
        Candidate("nonlinear_stiffness", _cubic, (k / wound**2,),
                  lambda c, _: {"cubic_nm_rad3": c[0]}, positive=(0,), coordinate="torque",
                  tangent=cubic_tangent, elsewhere=(k / wound**2,)),
        Candidate("stiffness_over_angle", over_angle, (3 * share, 3 * share),
                  lambda c, s: {"order": s[0], "share": polar(c)[0], "phase_rad": polar(c)[1]},
                  shapes=grid(range(1, 15)), spacing=(0.25,), logarithmic=(False,), bounds=((0.5, 60.0),),
                  coordinate="position", tangent=over_angle_tangent, own=_PHASES, known_to=RIGHT_TO),
        *(replace(error, bent=driven_about, drives=drives, known_to=RIGHT_TO * wound, felt=each_turn)
          for errors in (transmission(2, _of_one), transmission(4, _of_both)) for error in errors),
        Candidate("backlash", play, (2 * share * wound, _OF_CONTACTS * damping),
                  lambda c, _: {"gap_rad": c[0]}, positive=(0, 1), least=(0.0, -b),
                  shapes=grid(wound * _GAPS),
                  coordinate="torque", bent=play_about, own=(closing,), coupling=(0.0, 0.0, 1.0)),
        Candidate("extra_compliance", _third_mass, (3 * share * inertia_kgm2,),
                  lambda c, s: {"inertia_kgm2": c[0], "stiffness_nm_rad": c[0] * s[0] ** 2,
                                "damping_nms": 2 * c[0] * s[0] * s[1]},
                  shapes=grid(2 * np.pi * _RESONANCES_HZ, _DAMPING_RATIOS), spacing=(0.06, 0.7),
                  logarithmic=(True, True), bounds=((2 * np.pi * 1, 2 * np.pi * of.band_hz), (0.005, 0.5)),
                  positive=(0,), coordinate="frequency", known_to=RIGHT_TO * inertia_kgm2, swings=True,
                  further=lambda c, s: FurtherMass(float(c[0]), s[0], s[1]), limit="load_inertia", causes=2,
                  felt=lambda s: 1 / (2 * s[1])),  # at its resonance, where it is as if the load were so much heavier
        hanging(of, 3 * share * inertia_kgm2, RIGHT_TO * inertia_kgm2),
        Candidate("wind_up", over_wind_up, (torque_nm,) * curve.size, scales=LADDER, named=False,
                  coordinate="wind_up", tangent=over_wind_up_tangent, whole=over_wind_up_whole,
                  cases=frozenset({"coupling_stiffness", "nonlinear_stiffness"})),
    ]  # fmt: skip
