"""What the drive reports: true torque against reported, times, the encoder.

gain (g − 1)·T        lag −τ F T' (the true torque comes later)        filter +τ T' (the reported one does)
drop −s (|T|/T_peak)^p T        ripple s T sin nθ        saturation clip(T, ±L) − T        speed late −δ F α
fade −s h T, τ dh/dt = (T/T_peak)² − h, each run's h at first its own
F = 1/(1 + φ d/dt): with φ = τ a filter's lag, with φ = τ/2 a delay, but for the third order in ωτ (Padé), which a late
speed has besides; the shape's second number is how much of what two filters of half the time do otherwise is there
eccentricity a sin(θ + φ) in the angle, its rate in the speed        harmonic a sin(nθ + φ) likewise
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import numpy as np

from schwung.drivetrain.fade import heated
from schwung.explain.causes.along import Along, Ranges
from schwung.explain.causes.candidate import RIGHT_TO, Candidate, Shape, grid
from schwung.explain.causes.curves import column
from schwung.explain.causes.joined import run_by_run
from schwung.explain.causes.late import acceleration_bent, beyond_bent, lagging
from schwung.explain.causes.vocabulary.load import of_any_order, polar
from schwung.explain.causes.vocabulary.turning import turning
from schwung.innovations.effect import Effect
from schwung.innovations.splines import slopes
from schwung.motion import Array

#: Standard deviations (s): of delays and lags that are a defect, of the filter that torque and speed share in any
#: drive, and of the times by which each of the two is off it.
DEFECT_S, USUAL_S, APART_S = 1e-3, 3e-4, 5e-5
#: Period of a drive's own loop (s), where nobody said: most have 62.5 to 500 µs.
TICK_S = 250e-6
#: How a late signal bends (s): half of the delay for a delay, the time constant or nothing for a filter.
BENDS_S = np.concatenate([np.linspace(-2e-4, 6e-4, 9), np.geomspace(9e-4, 5e-3, 6)])
#: Of what is late by m₁ on average the next order is ½ m₂ ≥ ½ m₁²: it bends by half of the time as a delay, by all of
#: it as a filter of first order; what undoes it, m₁² − ½ m₂, by half of it or nothing. Each with how far off that.
LAG_BENDS, DELAY_BENDS, UNDONE_BENDS = (0.75, 0.5), (0.5, 0.5), (0.25, 0.5)
#: Time constants of the heat that are looked for, over the longest run; what is slower than that grows evenly.
_HEATS = (0.05, 0.25, 1.2, 6.0)
#: By what a motor is hot, T² on average, over its peak's: a natural share of the torque is that much more at the peak.
_HOT, _NO_SHARE = 10.0, 1e-12
_DIFFERENCE_S = 1e-5
#: What other filters do at the band's end, over what a law is usually off by.
_AS_MUCH = 10.0
BEND_STEP_S, LEAST_BEND_S, MOST_BEND_S = 1e-4, -1e-3, 2e-2
#: How much more than the one filter's is taken off the third order in ωτ: nothing; 1 for two filters alike; 4/3 for a
#: delay, which is any number of them.
ORDERS = (0.0, 4 / 3)


def _gain(along: Along, _shape: Shape) -> Effect:
    return Effect(column(along.torque))


def _earlier(along: Along, shape: Shape) -> Effect:
    return Effect(column(along.reported_rate + shape[0] * along.reported_bend))


def _twice(along: Along, values: Array, shape: Shape) -> Array:
    """By how much a shape's signal differs from that through one filter: two of half the time each do so from the third
    order in ωτ on."""
    time_s, share = shape
    if share == 0:
        return np.zeros_like(values)
    half = lagging(along, lagging(along, values, time_s / 2), time_s / 2)
    return np.asarray(share * (half - lagging(along, values, time_s)))


def _later(along: Along, shape: Shape) -> Effect:
    rate = along.given_rate
    return Effect(column(-lagging(along, rate, shape[0]) - _twice(along, rate, shape)))


def _bent(along: Along, shape: Shape, late_s: float | None = None) -> Array:
    """The acceleration that a speed is late by; `late_s`: as a whole."""
    return acceleration_bent(along, shape[0], late_s) + _twice(along, along.acceleration, shape)


def _speed_later(along: Along, shape: Shape) -> Effect:
    return Effect(speed=column(-_bent(along, shape)))


def _later_yet(along: Along, shape: Shape, coefficients: Array) -> tuple[Effect, Effect]:
    """About a delay: what more of it does, and all that it does."""
    delay = float(coefficients[0])

    def late(by_s: float) -> Array:
        return beyond_bent(along, by_s, shape[0]) - by_s * _bent(along, shape, by_s)

    more = (late(delay + _DIFFERENCE_S) - late(delay - _DIFFERENCE_S)) / (2 * _DIFFERENCE_S)
    return Effect(speed=column(more)), Effect(speed=column(late(delay)))


def _further(law: Callable[[Along, Shape], Array]) -> Callable[[Along, Shape], Array]:
    """What filters of another order do beside a law's, (n, 2): from the third order in ωτ on, and from the fourth; ten
    times as much as the law at the end of the band."""

    @run_by_run
    def beyond(along: Along, shape: Shape) -> Array:
        run, found, bend = along.run, [], law(along, shape)
        for _ in range(3):
            bend = run.quiet(slopes(bend, run.step_s)) / (2 * np.pi * run.band_hz)
            found.append(bend)
        return _AS_MUCH * np.stack(found[1:], 1)

    return beyond


def _filters(name: str, torque: Callable[[Along, Shape], Array]) -> Candidate:
    """What other filters do to the torque that a law makes late."""
    further = _further(torque)
    return Candidate(f"{name}, inexact", lambda a, s: Effect(further(a, s)), (1.0,) * 2, named=False)


def _late_torque(along: Along, shape: Shape) -> Array:
    return -lagging(along, along.given_rate, shape[0])


def _early_torque(along: Along, _shape: Shape) -> Array:
    return along.reported_rate


_further_speed = _further(lambda along, shape: -acceleration_bent(along, shape[0]))
_OTHER_DELAYS = Candidate(
    "measurement_delay, inexact", lambda a, s: Effect(speed=_further_speed(a, s)), (1.0,) * 2, named=False
)


@run_by_run
def _clipped(along: Along, shape: Shape) -> Effect:
    """Of what is asked for, which is reported, through a filter: what drives the machine is clipped, and so is noise
    that is reported."""
    (limit,) = shape
    return Effect(
        column(along.run.drive.asked(lambda nm: np.clip(nm, -limit, limit) - nm, along.beyond.filter_s))
    )


def _ripple(along: Along, shape: Shape) -> Effect:
    return Effect(along.torque[:, None] * turning(along, shape[0]))


def _misread(along: Along, order: float) -> tuple[Array, Array]:
    """Of the angle sin and cos nθ over n, and of the speed what goes with that, (n, 2) each."""
    waves = turning(along, order)
    return waves / order, waves[:, ::-1] * (along.speed[:, None] * [1.0, -1.0])


def _harmonic(along: Along, shape: Shape) -> Effect:
    """Coefficients are a n: by what share the reported speed is off, which is as natural at any order.

    Where the angle is misread, load and all that follows the angle are those of another one: of half a degree that may
    be more than all else.
    """
    angle, speed = _misread(along, *shape)
    further, faster = np.split(along.load_torque_slopes, 2, axis=1)
    on_motor, on_load = np.split(along.push_slopes, 2, axis=1)
    return Effect(
        -on_motor * angle if np.any(on_motor) else None,
        (further - on_load) * angle + faster * speed,
        position=angle,
        speed=speed,
    )


def _harmonic_whole(along: Along, shape: Shape, coefficients: Array) -> Effect:
    """Its states are at the true angle, where the load is what it is there."""
    angle, speed = _misread(along, *shape)
    return Effect(position=column(angle @ coefficients), speed=column(speed @ coefficients))


def reporting(of: Ranges, share: float) -> list[Candidate]:
    """The family; `share`: of the peak torque, natural for any cause."""
    peak, apart = of.peak_torque_nm, float(np.hypot(APART_S, APART_S))  # of two signals
    # of torque and speed, whichever is late: what the usual ones take back of it is none, however it bends
    torque_later = {"usual_torque_timing": (-1.0, 0.0), "usual_speed_timing": (1.0, 0.0)}
    torque_earlier = {"usual_torque_timing": (1.0, 0.0), "usual_speed_timing": (-1.0, 0.0)}

    def drop(along: Along, shape: Shape) -> Effect:
        return Effect(column(-((np.abs(along.torque) / peak) ** shape[0]) * along.torque))

    @run_by_run
    def hot(along: Along, shape: Shape) -> Array:
        """What it heats, what heat it starts with on average, and how much more each run does."""
        found = np.zeros((along.speed.size, 2 + of.runs))
        found[:, 0] = heated(along.true_torque.asked_nm, peak, shape[0], along.run.step_s)
        found[:, 1] = np.exp((along.time_s[0] - along.time_s) / shape[0])
        if along.number < of.runs:  # of a run that is yet to come it is the average
            found[:, 2 + along.number] = found[:, 1]
        return found

    @run_by_run
    def fade(along: Along, shape: Shape) -> Effect:
        return Effect(-hot(along, shape) * along.true_torque.asked_nm[:, None])

    def dropped(along: Along, shape: Shape, coefficients: Array) -> Array:
        return np.asarray(-coefficients[0] * (1 + shape[0]) * (np.abs(along.torque) / peak) ** shape[0])

    def faded(along: Along, shape: Shape, coefficients: Array) -> Array:
        return -hot(along, shape) @ coefficients

    def too_hot(coefficients: Array, _shape: Shape) -> bool:
        """Whether runs begin with more heat than the peak torque makes where it lasts: what differs then is no heat."""
        return bool(np.max(np.abs(coefficients[1] + coefficients[2:]), initial=0.0) > coefficients[0])

    def passes_more(clipped: Array, shape: Shape) -> bool:
        """Whether less than half of what is asked for beyond the limit is clipped, but for what noise makes seem so:
        that is nearer to no limit than to one, and a file's limit passes nothing."""
        limits, shares = np.transpose(of.seems_clipped)
        return bool(clipped[0] - np.interp(shape[0], limits, shares) < 0.5)

    return [
        Candidate("torque_constant", _gain, (share,), lambda c, _: {"gain": 1 + c[0]}, coordinate="torque",
                  known_to=RIGHT_TO),
        Candidate("torque_lag", _later, (DEFECT_S,), lambda c, _: {"time_constant_s": c[0]}, positive=(0,),
                  shapes=grid(BENDS_S, (0.0,)), spacing=(BEND_STEP_S, 1.0),
                  logarithmic=(False, False), bounds=((LEAST_BEND_S, MOST_BEND_S), ORDERS), endless=(1,),
                  coordinate="frequency", known_to=apart, family="lag", with_usual=torque_later, bends=LAG_BENDS,
                  bends_told=1.0, late=(-1.0, 0.0), others=_filters("torque_lag", _late_torque)),
        Candidate("torque_filter", _earlier, (DEFECT_S,), lambda c, _: {"time_constant_s": c[0]},
                  positive=(0,), shapes=grid(BENDS_S), spacing=(BEND_STEP_S,), logarithmic=(False,),
                  bounds=((LEAST_BEND_S, MOST_BEND_S),), coordinate="frequency", known_to=apart, family="lag",
                  with_usual=torque_earlier, unfilters=True, bends=UNDONE_BENDS, late=(1.0, 0.0),
                  others=_filters("torque_filter", _early_torque)),
        Candidate("measurement_delay", _speed_later, (DEFECT_S,), lambda c, _: {"delay_s": c[0]},
                  positive=(0,), bent=_later_yet, shapes=grid(BENDS_S, (0.0,)), spacing=(BEND_STEP_S, 1.0),
                  logarithmic=(False, False), bounds=((LEAST_BEND_S, MOST_BEND_S), ORDERS), endless=(1,),
                  coordinate="acceleration", known_to=apart, with_usual=torque_later, bends=DELAY_BENDS,
                  bends_told=0.5, late=(0.0, 1.0), others=_OTHER_DELAYS),
        Candidate("torque_constant_drop", drop, (share,),
                  lambda c, s: {"share_at_peak": c[0], "peak_nm": peak, "order": s[0]}, positive=(0,),
                  shapes=grid([0.5, 1.0, 2.0, 4.0]), spacing=(0.7,), logarithmic=(True,), bounds=((0.3, 10.0),),
                  coordinate="torque", passes=dropped),
        Candidate("torque_constant_fade", fade, (share * _HOT, *(share,) * (1 + of.runs)),
                  lambda c, s: {"share_at_peak": c[0], "peak_nm": peak, "time_constant_s": s[0],
                                "start_heat": max(c[1] / max(c[0], _NO_SHARE), 0.0)},
                  positive=(0,), shapes=grid(of.longest_s * np.array(_HEATS)), spacing=(1.6,), logarithmic=(True,),
                  bounds=((of.longest_s * _HEATS[0], of.longest_s * _HEATS[-1]),), endless=(0,), coordinate="torque",
                  none_of=too_hot, passes=faded),
        Candidate("torque_ripple", _ripple, (share, share),
                  lambda c, s: {"order": s[0], "share": polar(c)[0], "phase_rad": polar(c)[1]},
                  shapes=grid(range(1, 15)), spacing=(0.25,), logarithmic=(False,), bounds=((0.5, 60.0),),
                  coordinate="position", passes=lambda along, s, c: turning(along, s[0]) @ c),
        Candidate("torque_saturation", _clipped, (1.0,), lambda _, s: {"limit_nm": s[0]},
                  shapes=grid(peak * np.linspace(0.5, 0.97, 12)), spacing=(0.04 * peak,),
                  logarithmic=(False,), bounds=((0.2 * peak, 0.99 * peak),), positive=(0,),
                  coordinate="torque", passes=lambda along, s, c: -c[0] * (np.abs(along.torque) > s[0]),
                  none_of=passes_more),
        Candidate("encoder_eccentricity", lambda a, _: _harmonic(a, (1.0,)), (share * of.span_rad / 10,) * 2,
                  lambda c, _: dict(zip(("amplitude_rad", "phase_rad"), polar(c), strict=True)),
                  whole=lambda a, _, c: _harmonic_whole(a, (1.0,), c), coordinate="position"),
        *(replace(harmonic, whole=_harmonic_whole) for harmonic in of_any_order(
            of, "encoder_harmonic", _harmonic, (share * of.span_rad / 10,) * 2,
            lambda c, s: {"order": s[0], "amplitude_rad": polar(c)[0] / s[0], "phase_rad": polar(c)[1]},
        )),
    ]  # fmt: skip


def usual(tick_s: float) -> list[Candidate]:
    """Present in every set: a filter that torque and speed share, if there is one, a little apart, and each of any
    order; what is held is taken at any time. `tick_s`: period of the drive's own loop.

    No drive reports torque and speed before the angle that they belong to: a filter of less than nothing beside a late
    speed takes what is a late torque.

    A first-order filter is undone in the torque by T + τ T' to the last, a delay by T + δ T' + ½ δ² T''; in the speed
    the one is − τ α + τ² α', the other − δ α + ½ δ² α'. At the injection T'' is what a stiffness a part in a thousand
    off would do.

    Beyond the band either may be late by any time: a loop answers its encoder's noise up to its own bandwidth, at the
    coupling's resonance as well, where a lag would be a damping.

    An injection that a bus holds is taken at any share of the step. The controller answers the rotor's move about the
    corners (`corners`), so that what is sampled is off by a share of ΔT, the more if a sample shows the injection that
    came after it; and the rotor answers that, by up to B₃ and B₄, of a loop as fast as the bus. So it is with all
    torque, which a drive holds from tick to tick of its own loop: ΔT = T' h, and a speed that is read at the tick, in
    the corner, is T' h²/(12 J_r) off. At 69 Hz and 8 kHz that was half a per cent of an apparent inertia.
    """

    def both(along: Along, _shape: Shape) -> Effect:
        return Effect(column(along.reported_rate), speed=column(-along.acceleration_before))

    def torque(along: Along, _shape: Shape) -> Effect:
        return Effect(np.stack([along.reported_rate, along.reported_bend], 1))

    def speed(along: Along, _shape: Shape) -> Effect:
        return Effect(speed=np.stack([-along.acceleration_before, along.jerk_before], 1))

    def beyond(along: Along, _shape: Shape) -> Effect:
        changes = along.beyond_band
        none = np.zeros_like(changes[:, :1])
        return Effect(np.hstack([changes[:, :1], none]), speed=np.hstack([none, -changes[:, 1:]]))

    def held(along: Along, _shape: Shape) -> Effect:
        return Effect(column(np.zeros_like(along.speed)))  # the filter's equations know of it

    @run_by_run
    def answered(along: Along, _shape: Shape) -> Effect:
        step = along.run.step_s
        jump = step * slopes(along.run.drive.held.curve(along.beyond.held_late * step), step)
        moved, none = jump * step / along.rotor, np.zeros_like(jump)
        return Effect(
            np.stack([jump, none, none], 1),
            position=np.stack([none, none, moved * step], 1),
            speed=np.stack([none, moved, none], 1),
        )

    def corners(along: Along, _shape: Shape) -> Effect:
        return Effect(speed=column(along.torque_rate / along.rotor))

    return [
        Candidate("usual_hold", held, (1 / np.sqrt(3),), named=False, holds=True),
        Candidate(
            "usual_answer", answered, (0.5, 1 / (6 * np.sqrt(840)), 1 / (24 * np.sqrt(2100))), named=False
        ),
        Candidate("usual_corners", corners, (tick_s**2 / 12,), named=False),
        Candidate(
            "usual_filter",
            both,
            (USUAL_S,),
            positive=(0,),
            often_none=True,
            named=False,
            unfilters=True,
            late=(1.0, 1.0),
        ),
        Candidate(
            "usual_torque_timing",
            torque,
            (APART_S, (USUAL_S / 2) ** 2 / 2),
            named=False,
            unfilters=True,
            late=(1.0, 0.0),
        ),
        Candidate("usual_timing_beyond", beyond, (USUAL_S, USUAL_S), named=False),
        Candidate("usual_speed_timing", speed, (APART_S, USUAL_S**2), named=False, late=(0.0, 1.0)),
    ]
