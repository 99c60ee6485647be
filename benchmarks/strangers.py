"""Strangers' machines: a plant, laws, filters and noise written apart from the tool and from its virtual machine room.

A rotor and a load on a shaft, Runge-Kutta of fourth order, a cascade at 8 kHz whose torque is held between its ticks.
What it hides has no formula in common with `schwung`: dry friction is ω/√(ω² + ε²), laws are over the root of the speed
or a cosine of the angle, what bends before it slides is Bouc's and Wen's; what is reported passes through filters of
its own, one per signal.
"""

from __future__ import annotations

import argparse
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numba import njit
from numpy.typing import NDArray

from schwung.drivetrain.machine import Coupling, Load, Machine, Motor, write_machine
from schwung.motion import Excitation, Motion
from schwung.session import SessionWriter
from schwung.session.model import Run, Session

Array = NDArray[np.float64]

TICK_S, SUBSTEPS = 125e-6, 4
PARTS = 6  # of a coupling that slips
PAUSE_S = 0.3  # between runs
ROTOR, LOAD, STIFFNESS, DAMPING = 4.0e-3, 2.2e-2, 9000.0, 1.9
ROTOR_VISCOUS, LOAD_VISCOUS, PEAK_NM = 0.004, 0.003, 60.0
STROKE_RAD, START_S, DWELL_S, INJECTION_HZ, INJECTION_NM = 4.3, 0.15, 0.11, 47.0, 4.0
#: Standard deviations of what is reported: angle, speed, torque.
NOISE = (2e-6, 0.02, 0.05)


@dataclass(frozen=True)
class Stranger:
    """What is hidden. `friction`: [dry, its share over the angle, of the root of the speed, of the torque carried]."""

    name: str
    right: tuple[str, ...]  # names that are true; empty: none is, and a curve or nothing is right
    friction: tuple[float, float, float, float] = (0.0, 0.0, 0.0, 0.0)
    torque_filter_s: float = 0.0  # of the reported torque beyond the speed's
    torque_share: float = 0.0  # noise of the reported torque in proportion to it
    believed_scale: float = 1.0  # believed load inertia over the true one
    curves: tuple[str, ...] = ()  # coordinates of an unnamed curve that are right
    spot: tuple[float, float, float] = (0.0, 0.0, 1.0)  # a tight spot: torque, centre, width; (1 − x²)² of it
    bends: tuple[float, float] = (0.0, 1.0)  # friction that is a spring before it slides: torque, distance
    gap: float = 0.0  # play: a dead zone with round corners, whole
    dips: tuple[float, float] = (0.0, 1.0)  # friction that falls as 1/(1 + (ω/ω_s)²): by how much, ω_s
    teeth: tuple[float, float, float] = (
        0.0,
        1.0,
        0.0,
    )  # cogging: amplitude, order, how far its phase wanders (rad)
    power: float = 0.0  # of friction that grows as |ω|^1.2
    gives: tuple[float, float] = (0.0, 1.0)  # compliance that waves along the way: its share, order
    hum: tuple[float, float] = (0.0, 1.0)  # a rectangular torque: amplitude, frequency (Hz); begins anywhere
    mesh: tuple[float, float] = (0.0, 1.0)  # a transmission that is off likewise
    slots: tuple[float, float] = (0.0, 1.0)  # cogging that leans over: amplitude, order
    oval: tuple[float, float] = (0.0, 1.0)  # a transmission that is off by a wave that leans over likewise
    tracks: tuple[float, float] = (0.0, 1.0)  # error of an encoder whose tracks differ: amplitude, per radian
    slips: tuple[float, float] = (0.0, 1.0)  # what slips in the coupling: torque, wind-up when all of it does
    hangs: tuple[float, float, float] = (
        0.0,
        1.0,
        0.0,
    )  # a pendulum on the load: inertia, frequency at rest (Hz), how much the load's speed is its gravity
    yields: tuple[float, float] = (
        0.0,
        1.0,
    )  # by what share the coupling is softer until it is wound up by this (rad)
    drags: tuple[float, float] = (0.0, 0.0)  # friction of the load: at the start, and more by each radian
    warms: tuple[float, float] = (
        0.0,
        1.0,
    )  # a motor that weakens as it warms: by how much at peak torque, its time (s)
    loop_s: float = (
        0.0  # of each of two filters between the torque that is asked for, and reported, and the true one
    )

    @property
    def laws(self) -> Array:
        """All numbers of its friction."""
        each = (
            *self.friction,
            *self.spot,
            *self.bends,
            self.gap,
            *self.dips,
            *self.teeth,
            self.power,
            *self.gives,
            *self.mesh,
            *self.slots,
            *self.hangs,
            *self.drags,
            *self.yields,
            *self.oval,
        )
        return np.array(each)


STRANGERS = (
    Stranger("nothing hidden", ()),
    Stranger("(1 + 0.6 cos(1.3θ + 0.4)) sign ω", ("friction_over_angle",), (0.9, 0.6, 0.0, 0.0), curves=("position",)),
    Stranger("torque 0.4 ms later than speed", ("torque_filter",), torque_filter_s=0.4e-3),
    Stranger("friction ∝ √|ω|", (), (0.0, 0.0, 0.22, 0.0), curves=("speed",)),
    Stranger("gear loss ∝ |torque|", ("load_dependent_friction",), (0.0, 0.0, 0.0, 0.05), curves=("torque",)),
    Stranger("noise of 1 % of the torque", (), torque_share=0.01),
    Stranger("inertia 5 % off, dry friction", ("load_inertia", "coulomb_friction"), (0.8, 0.0, 0.0, 0.0),
             believed_scale=0.95),
    Stranger("friction that bends over 0.5 rad before it slides", ("presliding_friction",), bends=(1.2, 0.5)),
    Stranger("play with round corners", ("backlash",), gap=2e-4),
    Stranger("friction that falls as 1/(1 + (ω/ω_s)²)", ("stribeck_friction",), (0.8, 0.0, 0.0, 0.0), dips=(0.7, 2.0),
             curves=("speed",)),
    Stranger("cogging whose phase wanders", ("cogging",), teeth=(0.5, 12.0, 0.4), curves=("position",)),
    Stranger("friction ∝ |ω|^1.2", ("viscous_friction",), power=0.02, curves=("speed",)),
    Stranger("a rectangular hum", ("periodic_disturbance",), hum=(0.3, 71.3)),
    Stranger("compliance that waves along the way", ("stiffness_over_angle",), gives=(0.15, 3.0)),
    Stranger("an encoder whose tracks differ in size", ("encoder_harmonic",), tracks=(2e-4, 16.0)),
    Stranger("a transmission that is off likewise", ("kinematic_error",), mesh=(1e-4, 12.0)),
    Stranger("a coupling in which one part after another slips", ("coupling_hysteresis",), slips=(2.0, 1e-3)),
    Stranger("torque through two filters of 0.4 ms", ("torque_lag",), loop_s=4e-4),
    Stranger("cogging that leans over", ("cogging",), slots=(0.5, 11.0), curves=("position",)),
    Stranger("a pendulum that the speed stiffens", ("extra_compliance",), hangs=(1.2e-3, 9.0, 12.0)),
    Stranger("a motor that weakens as 1/(1 + heat)", ("torque_constant_fade",), warms=(1.5, 0.25)),
    Stranger("a guide behind the shaft that drags ever more", ("friction_over_angle", "load_side_friction"),
             drags=(0.4, 0.5), curves=("position",)),
    Stranger("a coupling that is soft until it is wound up", ("nonlinear_stiffness",), yields=(0.6, 6e-4),
             curves=("wind_up",)),
    Stranger("a transmission whose error leans over", ("kinematic_error",), oval=(2e-5, 12.0), curves=("position",)),
)  # fmt: skip


@njit(cache=True)
def _told(angle: float, speed: float, amplitude: float, order: float) -> tuple[float, float]:
    """Angle and speed that an encoder reports which interpolates between a sine and a cosine of different size, and
    those of the output of such a joint (Cardan's at n = 2).

    Its arc tangent is off by 2/n·atan(q sin nθ/(1 − q cos nθ)), about 2q/n·sin nθ; counted from where it was
    switched on, a radian after such a sine's zero.
    """
    off, share = np.zeros(2), amplitude * order / 2
    for i, where in enumerate((1.0, order * angle + 1.0)):
        off[i] = np.arctan2(share * np.sin(where), 1 - share * np.cos(where))
    cosine = np.cos(order * angle + 1.0)
    faster = 2 * share * (cosine - share) / (1 - 2 * share * cosine + share**2)
    return angle + 2 / order * (off[1] - off[0]), speed * (1 + faster)


@njit(cache=True)
def _slopes(state: Array, torque: float, friction: Array, last: float, rubbed: float) -> tuple[Array, float]:
    """Rates of motor angle and speed, load angle and speed, of what is bent, and of what hangs; and the shaft's torque,
    of which `rubbed` is what slips in the coupling."""
    turned, ratio = state[0], 1.0
    if friction[18] > 0:
        turned, ratio = _told(state[0], 1.0, friction[18], friction[19])
    if friction[29] > 0:
        leans = 1 + 0.2 * np.cos(friction[30] * state[0])
        turned += friction[29] * np.sin(friction[30] * state[0]) / leans
        ratio += friction[29] * friction[30] * (leans - 0.96) / (0.2 * leans**2)
    twist, touch = turned - state[2], 1.0
    if friction[9] > 0:
        free = np.tanh(2 * twist / friction[9])
        twist, touch = twist - friction[9] / 2 * free, free**2
    gives = 1 - friction[16] * np.cos(friction[17] * state[0])
    twist -= friction[27] * friction[28] * np.tanh(twist / friction[28])
    shaft = STIFFNESS / gives * twist + DAMPING * touch * (ratio * state[1] - state[3]) + rubbed
    way = state[1] / np.sqrt(state[1] ** 2 + 1e-4)
    level = friction[0] * (1 + friction[1] * np.cos(1.3 * state[0] + 0.4))
    level += friction[2] * np.sqrt(abs(state[1])) + friction[3] * abs(last)
    level += friction[4] * max(1 - (2 * (state[0] - friction[5]) / friction[6]) ** 2, 0.0) ** 2
    level += friction[10] / (1 + (state[1] / friction[11]) ** 2) + friction[15] * abs(state[1]) ** 1.2
    cogs = friction[12] * np.sin(friction[13] * state[0] + friction[14] * np.sin(0.6 * state[0]))
    slot = friction[21] * state[0]
    cogs += friction[20] * np.sin(slot) / (1 + 0.3 * np.cos(slot))
    # it swings by an angle, of which a spring would have the sine's slope
    pulls = (2 * np.pi * friction[23]) ** 2 + friction[24] * state[3] ** 2
    swung = friction[22] * (pulls * np.sin(state[2] - state[5]) + 4.0 * (state[3] - state[6]))
    rates = np.empty(7)
    rates[5], rates[6] = state[6], swung / max(friction[22], 1e-12)
    rates[0], rates[2] = state[1], state[3]
    # R. Bouc 1967, Y. K. Wen 1976: the share of the friction that is there, with the exponent 1.4
    bent = abs(state[4]) ** 1.4 * (0.6 * np.sign(state[1] * state[4]) + 0.4)
    rates[4] = state[1] * (1 - bent) / friction[8]
    rates[1] = (
        torque - ratio * shaft - ROTOR_VISCOUS * state[1] - level * way - friction[7] * state[4] + cogs
    ) / ROTOR
    drag = (friction[25] + friction[26] * state[2]) * state[3] / np.sqrt(state[3] ** 2 + 1e-4)
    rates[3] = (shaft - swung - LOAD_VISCOUS * state[3] - drag) / LOAD
    return rates, shaft


@njit(cache=True)
def _played(
    demand: Array,
    added: Array,
    hum: Array,
    friction: Array,
    tracks: tuple[float, float],
    loop_s: float,
    slips: tuple[float, float],
    warms: tuple[float, float],
    heat: float,
) -> tuple[Array, float]:
    """Angle, speed and torque at every tick, (n, 3), as the drive is told them; `hum`: torque that it knows nothing of,
    `tracks`: its encoder's error, `loop_s`: how late its torque is, twice; `slips` and `warms`: as Stranger
    has them; `heat`: at first, and returned."""
    n, h = demand.size, TICK_S / SUBSTEPS
    # W. D. Iwan 1966: springs in parallel, each of which slips at its own limit
    limits, held = slips[1] * np.arange(1, PARTS + 1) / PARTS, np.zeros(PARTS)
    rows, state, integral, shaft = np.empty((n, 3)), np.zeros(7), 0.0, 0.0
    gain, position_gain, reset = 100.0 * (ROTOR + LOAD), 45.0, 0.03
    follows, halfway, true = 1.0 if loop_s <= 0 else 1 - np.exp(-h / loop_s), 0.0, 0.0
    for i in range(n):
        ahead = (demand[min(i + 1, n - 1)] - demand[max(i - 1, 0)]) / (2 * TICK_S)
        angle, speed = _told(state[0], state[1], tracks[0], tracks[1])
        error = position_gain * (demand[i] - angle) + ahead - speed
        integral += error * TICK_S / reset
        torque = min(max(gain * (error + integral) + added[i], -PEAK_NM), PEAK_NM)
        rows[i, 0], rows[i, 1], rows[i, 2] = angle, speed, torque
        for _ in range(SUBSTEPS):
            halfway += follows * (torque - halfway)
            true += follows * (halfway - true)
            heat += h / warms[1] * ((true / PEAK_NM) ** 2 - heat)
            acts = true / (1 + warms[0] * heat) + hum[i]
            rubbed = slips[0] * np.sum(held) / np.sum(limits)
            a, shaft = _slopes(state, acts, friction, shaft, rubbed)
            b, _ = _slopes(state + 0.5 * h * a, acts, friction, shaft, rubbed)
            c, _ = _slopes(state + 0.5 * h * b, acts, friction, shaft, rubbed)
            d, _ = _slopes(state + h * c, acts, friction, shaft, rubbed)
            way = h * (a + 2 * b + 2 * c + d) / 6
            held = np.minimum(np.maximum(held + way[0] - way[2], -limits), limits)
            state = state + way
    return rows, heat


def _filtered(values: Array, time_s: float) -> Array:
    """Once through a first-order filter."""
    if time_s <= 0:
        return values
    result, share = values.copy(), 1 - np.exp(-TICK_S / time_s)
    for i in range(1, values.size):
        result[i] = result[i - 1] + share * (values[i] - result[i - 1])
    return result


def _stroke(share: Array) -> Array:
    """Rest to rest with zero jerk at both ends: the seventh-order polynomial."""
    u = np.clip(share, 0.0, 1.0)
    return np.asarray(u**4 * (35 - 84 * u + 70 * u**2 - 20 * u**3))


def session_of(
    stranger: Stranger, seed: int, every: int = 2, times: tuple[float, ...] = (0.2, 0.3, 0.45)
) -> Session:
    """A session: of each motion time two references and two phases of the injection; every second tick logged."""
    chance, runs, heat = np.random.default_rng(seed), [], 0.0
    for duration in times:
        total = START_S + 2 * (duration + DWELL_S)
        time = np.arange(round(total / TICK_S)) * TICK_S
        back = START_S + duration + DWELL_S
        demand = STROKE_RAD * (_stroke((time - START_S) / duration) - _stroke((time - back) / duration))
        motion = Motion(
            kind="poly5", distance_rad=STROKE_RAD, duration_s=duration, start_time_s=START_S, returns=True,
            dwell_s=DWELL_S,
        )  # fmt: skip
        for number, phase in enumerate((None, None, 0.0, np.pi)):
            sine = None
            if phase is not None:
                sine = Excitation(
                    frequency_hz=INJECTION_HZ,
                    amplitude_nm=INJECTION_NM,
                    phase_rad=phase,
                    ramp_s=0.04,
                    end_s=total,
                )
            added = np.zeros_like(time) if sine is None else sine.torque(time)
            begins = chance.uniform() if stranger.hum[0] else 0.0
            hum = stranger.hum[0] * np.sign(np.sin(2 * np.pi * (stranger.hum[1] * time + begins)))
            heat *= np.exp(-PAUSE_S / stranger.warms[1])
            rows, heat = _played(
                demand, added, hum, stranger.laws, stranger.tracks, stranger.loop_s, stranger.slips,
                stranger.warms, heat,
            )  # fmt: skip
            # the torque of a tick is held until the next: on average it belongs half a tick later
            torque = _filtered(
                (rows[:, 2] + np.concatenate([[0.0], rows[:-1, 2]])) / 2, stranger.torque_filter_s
            )
            noise = chance.standard_normal(rows.shape)
            torque = torque + (NOISE[2] + stranger.torque_share * np.abs(torque)) * noise[:, 2]
            runs.append(
                Run(
                    role="reference" if sine is None else "excited",
                    repeat=number % 2 if sine is None else 0,
                    sample_rate_hz=1 / (every * TICK_S),
                    time_s=time[::every],
                    position_rad=(rows[:, 0] + NOISE[0] * noise[:, 0])[::every],
                    speed_rad_s=(rows[:, 1] + NOISE[1] * noise[:, 1])[::every],
                    torque_nm=torque[::every],
                    motion=motion,
                    excitation=sine,
                )
            )
    return Session(tuple(runs), created="2026-01-01T00:00:00+00:00", source=stranger.name)


def belief_of(stranger: Stranger) -> Machine:
    """The machine as believed: all of it but for what is hidden."""
    return Machine(
        name=stranger.name,
        motor=Motor(inertia_kgm2=ROTOR, viscous_friction_nms=ROTOR_VISCOUS, peak_torque_nm=PEAK_NM),
        coupling=Coupling(stiffness_nm_rad=STIFFNESS, damping_nms=DAMPING),
        load=Load(viscous_friction_nms=LOAD_VISCOUS, inertia_kgm2=LOAD * stranger.believed_scale),
    )


def judged(stranger: Stranger, names: Mapping[str, float], curves: Mapping[str, float]) -> str:
    """ "right": all that is hidden has its names, or its curve, and nothing else has; "silent": nothing is named though
    something is hidden; else "WRONG", with a name of more than one half that is not true."""
    likely = {name for name, p in names.items() if p > 0.5}
    if likely - set(stranger.right):
        return "WRONG"
    drawn = any(curves.get(coordinate, 0.0) > 0.5 for coordinate in stranger.curves)
    hides = bool(stranger.right or stranger.curves)
    return (
        "right" if (likely == set(stranger.right) and (likely or drawn or not hides)) or drawn else "silent"
    )


def main() -> None:
    """Write a stranger's session and the belief about it, to be looked at with the tool."""
    parser = argparse.ArgumentParser(description="Record a stranger's machine: session.h5 and machine.toml.")
    every = "; ".join(f"{number}: {one.name}" for number, one in enumerate(STRANGERS))
    parser.add_argument("number", type=int, choices=range(len(STRANGERS)), help=every.replace("%", "%%"))
    parser.add_argument("--out", type=Path, default=Path("stranger"), help="folder that is made")
    options = parser.parse_args()
    stranger = STRANGERS[options.number]
    options.out.mkdir(parents=True, exist_ok=True)
    write_machine(belief_of(stranger), options.out / "machine.toml")
    with SessionWriter(options.out / "session.h5", source=stranger.name, overwrite=True) as writer:
        for run in session_of(stranger, 5, every=8, times=(0.25, 0.4)).runs:
            writer.append(run)


if __name__ == "__main__":
    main()
