"""Machines that are run otherwise than a commissioning does: is `schwung explain` right there?

    python benchmarks/operations.py [--only injection] [--first 0] [--machines 1]

A rotor and a load on a shaft, Runge-Kutta of fourth order, a cascade at 4 kHz whose torque is held between its ticks:
an index table that goes on and on, strokes without an injection or without a repeat, a slow log, a torque in coarse
steps, a payload that is changed between runs, an encoder whose counts the loop answers. Dry friction is a hyperbolic
tangent of the speed. Of each operation: the names that were told, and whether they are right; of what nothing tells
apart no name is right that has 90 %.
"""

from __future__ import annotations

import argparse
import time
from dataclasses import dataclass

import numpy as np
from numba import njit
from numpy.typing import NDArray

from schwung.drivetrain.machine import Coupling, Load, Machine, Motor
from schwung.explain.weighing.weigh import weigh
from schwung.motion import Excitation, Motion
from schwung.session.model import Run, Session

Array = NDArray[np.float64]

STEP_S, TICK = 5e-5, 5
ROTOR, LOAD, STIFFNESS, DAMPING, PEAK_NM = 2e-3, 1.2e-2, 3000.0, 1.0, 40.0
#: Of what the speed between two ticks is new, its filter takes so much at each: 0.5 ms.
SPEED_TAKEN = 0.4
ROTOR_VISCOUS, LOAD_VISCOUS = 0.004, 0.003
START_S, DWELL_S, INJECTION_HZ, INJECTION_NM = 0.15, 0.12, 41.0, 2.0
#: Standard deviations of what is reported: angle, speed, torque.
NOISE = (2e-6, 0.02, 0.03)
#: No name has more than this where another says the same.
SURE = 0.9


@dataclass(frozen=True)
class Operation:
    """How it is run, and what it hides."""

    name: str
    right: tuple[str, ...] = ()  # names that are true
    like: tuple[str, ...] = ()  # that nothing tells from them: neither they nor the true ones may be sure
    dry_nm: tuple[float, float] = (0.0, 0.0)  # friction of the motor forward and backward
    weight_nm: float = 0.0  # of the load, a cosine of its angle
    fan: float = 0.0  # drag of the load by the square of its speed
    heavier: tuple[float, ...] = (1.0,)  # the load over what is believed, of one run after another
    times_s: tuple[float, ...] = (0.25, 0.35, 0.5)
    phases: tuple[float | None, ...] = (None, None, 0.0, np.pi)  # of the injection in each repeat
    stroke_rad: float = 2.4
    onwards: bool = False  # each stroke from where the last one ended, and none back
    every: int = 5  # steps of the plant in a sample
    rounded_nm: float = 0.0  # the reported torque
    rounded_rad_s: float = 0.0  # the reported speed
    counts: int = 0  # of the encoder in a turn; the speed is that of the angle between ticks, filtered
    late: bool = False  # whether that is late, which may be told


UNREPEATED, PLAIN = (0.22, 0.3, 0.4, 0.6), (None,)
OPERATIONS = (
    Operation("nothing hidden"),
    Operation("dry friction", ("coulomb_friction",), dry_nm=(0.4, 0.4)),
    Operation("most of the torque is friction", ("coulomb_friction",), dry_nm=(2.0, 2.0)),
    Operation("friction differs by direction", ("asymmetric_friction",), dry_nm=(0.5, 0.2)),
    Operation("a weight", ("load_torque",), weight_nm=0.8),
    Operation("a fan", ("quadratic_drag",), fan=0.002),
    Operation("an index table, nothing hidden", onwards=True, stroke_rad=np.pi / 2),
    Operation("an index table, dry friction", ("coulomb_friction",), dry_nm=(0.4, 0.4), onwards=True,
              stroke_rad=np.pi / 2),
    Operation("an index table, load 8 % heavier", ("load_inertia",), heavier=(1.08,), onwards=True,
              stroke_rad=np.pi / 2),
    Operation("logged at 500 Hz, dry friction", ("coulomb_friction",), dry_nm=(0.4, 0.4), every=40),
    Operation("torque in steps of 0.1, dry friction", ("coulomb_friction",), dry_nm=(0.4, 0.4), rounded_nm=0.1),
    Operation("speed in steps of 1/min, nothing hidden", rounded_rad_s=np.pi / 30),
    Operation("speed in steps of 1/min, dry friction", ("coulomb_friction",), dry_nm=(0.4, 0.4),
              rounded_rad_s=np.pi / 30),
    Operation("an encoder of 18 bits, speed in steps of 1/min, dry friction", ("coulomb_friction",), late=True,
              dry_nm=(0.4, 0.4), counts=2**18, rounded_rad_s=np.pi / 30, every=20),
    Operation("no injection, dry friction", ("coulomb_friction",), dry_nm=(0.4, 0.4), phases=(None, None, None)),
    Operation("no repeat, dry friction", ("coulomb_friction",), dry_nm=(0.4, 0.4), times_s=UNREPEATED, phases=(0.0,)),
    Operation("no injection, load 6 % heavier", ("load_inertia",), ("motor_inertia",), heavier=(1.06,),
              phases=(None, None)),
    Operation("no injection, no repeat, load 6 % heavier", ("load_inertia",), ("motor_inertia",), heavier=(1.06,),
              times_s=UNREPEATED, phases=PLAIN),
    Operation("an injection, no repeat, load 6 % heavier", ("load_inertia",), heavier=(1.06,), times_s=UNREPEATED,
              phases=(0.0,)),
    Operation("slow strokes, dry friction", ("coulomb_friction",), dry_nm=(0.4, 0.4), times_s=(2.0, 3.0),
              stroke_rad=4.0, every=20),
    Operation("another payload in every other run", ("load_inertia",), heavier=(1.0, 1.1)),
    Operation("another payload from the sixth run on", ("load_inertia",), heavier=(1.0,) * 5 + (1.15,) * 7),
    Operation("an encoder of 20 bits, nothing hidden", late=True, counts=2**20),
    Operation("an encoder of 20 bits, dry friction", ("coulomb_friction",), late=True, dry_nm=(0.4, 0.4), counts=2**20),
    Operation("an encoder of 20 bits, 1 kHz, nothing hidden", late=True, counts=2**20, every=20),
    Operation("an encoder of 16 bits, nothing hidden", late=True, counts=2**16),
    Operation("an encoder of 16 bits, dry friction", ("coulomb_friction",), late=True, dry_nm=(0.4, 0.4), counts=2**16),
    Operation("an encoder of 17 bits, 500 Hz, dry friction", ("coulomb_friction",), late=True, dry_nm=(0.4, 0.4),
              counts=2**17, every=40),
)  # fmt: skip


@njit(cache=True)
def _slopes(state: Array, torque: float, load: float, forward: float, backward: float, hung: Array) -> Array:
    """Rates of motor angle and speed, load angle and speed; `hung`: weight and fan."""
    carried = STIFFNESS * (state[0] - state[2]) + DAMPING * (state[1] - state[3])
    dry = (forward if state[1] > 0 else backward) * np.tanh(state[1] / 0.02)
    pulled = hung[0] * np.cos(state[2] + 0.7) + hung[1] * state[3] * abs(state[3])
    return np.array([
        state[1], (torque - carried - ROTOR_VISCOUS * state[1] - dry) / ROTOR,
        state[3], (carried - LOAD_VISCOUS * state[3] - pulled) / load,
    ])  # fmt: skip


@njit(cache=True)
def _played(
    demand: Array,
    added: Array,
    load: float,
    dry: tuple[float, float],
    hung: Array,
    state: Array,
    counts: Array,
) -> tuple[Array, Array]:
    """Angle, speed and torque at every step, (n, 3), and the last state; `counts`: see `_read`."""
    rows, integral, torque, tick_s = np.empty((demand.size, 3)), 0.0, 0.0, TICK * STEP_S
    gain = 100.0 * (ROTOR + LOAD)
    angle, speed = _read(state, counts)
    for i in range(demand.size):
        if counts[0] == 0 or i % TICK == 0:
            before = angle
            angle, latest = _read(state, counts)
            speed = latest if counts[0] == 0 else speed + SPEED_TAKEN * ((angle - before) / tick_s - speed)
        if i % TICK == 0:
            ahead = (demand[min(i + TICK, demand.size - 1)] - demand[i]) / tick_s
            error = 40.0 * (demand[i] - angle) + ahead - speed
            integral += error * tick_s / 0.04
            torque = min(max(gain * (error + integral) + added[i], -PEAK_NM), PEAK_NM)
        rows[i, 0], rows[i, 1], rows[i, 2] = angle, speed, torque
        a = _slopes(state, torque, load, dry[0], dry[1], hung)
        b = _slopes(state + 0.5 * STEP_S * a, torque, load, dry[0], dry[1], hung)
        c = _slopes(state + 0.5 * STEP_S * b, torque, load, dry[0], dry[1], hung)
        d = _slopes(state + STEP_S * c, torque, load, dry[0], dry[1], hung)
        state = state + STEP_S * (a + 2 * b + 2 * c + d) / 6
    return rows, state


@njit(cache=True)
def _read(state: Array, counts: Array) -> tuple[float, float]:
    """Angle, in whole counts where the encoder has any, and speed; `counts`: one (rad), and what of one a run begins
    with."""
    count, first = counts
    return state[0] if count == 0 else np.floor(state[0] / count + first) * count, state[1]


def _stroke(share: Array) -> Array:
    """Rest to rest: the cycloid."""
    u = np.clip(share, 0.0, 1.0)
    return np.asarray(u - np.sin(2 * np.pi * u) / (2 * np.pi))


def _averaged(values: Array, every: int) -> Array:
    """What is held from tick to tick, on average about each sample."""
    before = np.concatenate([np.full(TICK, values[0]), values[:-TICK]])
    return np.asarray((values + before)[::every] / 2)


def session_of(operation: Operation, seed: int) -> Session:
    """Every motion time in every phase."""
    chance, runs, state, begins = np.random.default_rng(seed), [], np.zeros(4), 0.0
    for duration in operation.times_s:
        for phase in operation.phases:
            total = START_S + (1 if operation.onwards else 2) * (duration + DWELL_S)
            time_s = np.arange(round(total / STEP_S)) * STEP_S
            share = _stroke((time_s - START_S) / duration)
            if not operation.onwards:
                share = share - _stroke((time_s - START_S - duration - DWELL_S) / duration)
            motion = Motion(
                kind="poly5", distance_rad=operation.stroke_rad, duration_s=duration, start_time_s=START_S,
                returns=not operation.onwards, dwell_s=DWELL_S,
            )  # fmt: skip
            sine = None
            if phase is not None:
                sine = Excitation(
                    frequency_hz=INJECTION_HZ, amplitude_nm=INJECTION_NM, phase_rad=phase, ramp_s=0.05,
                    end_s=total,
                )  # fmt: skip
            added = np.zeros_like(time_s) if sine is None else sine.torque(time_s)
            load = LOAD * operation.heavier[len(runs) % len(operation.heavier)]
            rows, state = _played(
                begins + operation.stroke_rad * share, added, load, operation.dry_nm,
                np.array([operation.weight_nm, operation.fan]), state,
                np.array([2 * np.pi / operation.counts if operation.counts else 0.0, chance.random()]),
            )  # fmt: skip
            begins += operation.stroke_rad if operation.onwards else 0.0
            state = state if operation.onwards else np.zeros(4)
            every = operation.every
            torque = _averaged(rows[:, 2], every)
            noise = NOISE * chance.standard_normal((torque.size, 3))
            if operation.counts:
                noise[:, :2] = 0.0
            torque = torque + noise[:, 2]
            if operation.rounded_nm:
                torque = np.round(torque / operation.rounded_nm) * operation.rounded_nm
            speed = rows[::every, 1] + noise[:, 1]
            if operation.rounded_rad_s:
                speed = np.round(speed / operation.rounded_rad_s) * operation.rounded_rad_s
            runs.append(
                Run(
                    role="reference" if sine is None else "excited",
                    repeat=0,
                    sample_rate_hz=1 / (every * STEP_S),
                    time_s=time_s[::every],
                    position_rad=rows[::every, 0] + noise[:, 0],
                    speed_rad_s=speed,
                    torque_nm=torque,
                    torque_added_nm=_averaged(added, every),
                    motion=motion,
                    excitation=sine,
                    name=f"{operation.name}, run {len(runs)}",
                )
            )
    return Session(tuple(runs), created="2026-01-01T00:00:00", source="operations")


def belief() -> Machine:
    """All of it but for what is hidden."""
    return Machine(
        name="operated",
        motor=Motor(inertia_kgm2=ROTOR, viscous_friction_nms=ROTOR_VISCOUS, peak_torque_nm=PEAK_NM),
        coupling=Coupling(stiffness_nm_rad=STIFFNESS, damping_nms=DAMPING),
        load=Load(inertia_kgm2=LOAD, viscous_friction_nms=LOAD_VISCOUS),
    )


def judged(operation: Operation, names: dict[str, float]) -> str:
    """ "right": all that is hidden has its names, and nothing else has, or of what nothing tells apart no name is sure;
    "silent": nothing wrong is told, and not all; else "WRONG"."""
    likely = {name for name, p in names.items() if p > 0.5}
    if operation.like:
        known = {*operation.right, *operation.like}
        sure = any(p > SURE for name, p in names.items() if name in operation.like)
        return "WRONG" if sure or likely - known else "right"
    known = {*operation.right, *(("measurement_delay",) if operation.late else ())}
    if likely - known:
        return "WRONG"
    return "right" if likely >= set(operation.right) else "silent"


def main() -> None:
    """Every operation, on so many machines."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--only", default="", help="operations with this in their name")
    parser.add_argument("--first", type=int, default=0)
    parser.add_argument("--machines", type=int, default=1)
    options = parser.parse_args()
    words = []
    for operation in (one for one in OPERATIONS if options.only in one.name):
        for seed in range(options.first, options.first + options.machines):
            began = time.process_time()
            found = weigh(session_of(operation, seed), belief())
            names = {one.name: one.probability for one in found.names if one.probability >= 0.05}
            words.append(judged(operation, names))
            told = ", ".join(f"{name} {p:.2f}" for name, p in names.items()) or "(nothing)"
            curves = ", ".join(
                f"[{one.coordinate}] {one.probability:.2f}"
                for one in found.unnamed
                if one.probability >= 0.05
            )
            print(
                f"{words[-1]:6} {operation.name}: {told} {curves} ({time.process_time() - began:.0f} s)",
                flush=True,
            )
    print(", ".join(f"{words.count(word)} {word}" for word in sorted(set(words))))


if __name__ == "__main__":
    main()
