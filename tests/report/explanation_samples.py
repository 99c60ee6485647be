"""Explanations made by hand: the torque that a machine needs along a motion, with an effect that the belief leaves out.

The effects' signals have realistic shapes; nothing here is found by the tool.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import cache
from typing import Any

import numpy as np

from schwung.drivetrain.machine import Machine, paper_machine
from schwung.drivetrain.physics_term import PhysicsTerm
from schwung.explain.values import (
    Explanation,
    Finding,
    HeldOut,
    Located,
    Misfit,
    NoiseFloor,
    Overlay,
    Quantity,
    Verdict,
)
from schwung.motion import Array, Motion
from schwung.session import Run, Session

RATE_HZ = 1000.0
NOISE_NM = 0.25
COULOMB_NM = 4.0
#: Motion times (s) of the runs; the last two are kept aside.
DURATIONS_S = (0.5, 0.5, 0.3, 0.3, 0.4, 0.4)
HELD_OUT = (4, 5)


@dataclass(frozen=True)
class Moved:
    """Signals of one run without noise, arrays (n,)."""

    number: int
    time: Array
    position: Array
    speed: Array
    acceleration: Array
    needed: Array  # torque that the rigid belief needs


Effect = Callable[[Moved], Array]


@dataclass(frozen=True)
class Concealed:
    """One concealed effect: name, parameters (value, unit), signal, where it shows, what it resembles."""

    physics: str
    parameters: dict[str, tuple[Any, str]]
    effect: Effect
    coordinate: Any = "speed"
    interval: tuple[float, float] = (-12.0, 12.0)
    unit: str = "rad/s"
    like: tuple[str, ...] = ()


COULOMB = Concealed(
    "coulomb_friction",
    {"torque_nm": (COULOMB_NM, "N·m")},
    lambda m: COULOMB_NM * np.tanh(m.speed / 0.02),
    like=("stribeck_friction",),
)


#: One of each of the other names.
OTHERS = (
    Concealed("stribeck_friction", {"coulomb_torque_nm": (3.0, "N·m"), "breakaway_torque_nm": (6.0, "N·m"),
                                    "stribeck_speed_rad_s": (1.5, "rad/s")},
              lambda m: (3 + 3 * np.exp(-((m.speed / 1.5) ** 2))) * np.tanh(m.speed / 0.02)),
    Concealed("asymmetric_friction", {"torque_positive_nm": (5.0, "N·m"), "torque_negative_nm": (3.0, "N·m")},
              lambda m: np.where(m.speed > 0, 5.0, -3.0) * np.tanh(np.abs(m.speed) / 0.02),
              "direction", (-1.0, 1.0), "1", ("coulomb_friction", "torque_offset")),
    Concealed("viscous_friction", {"coefficient_nms": (0.31, "N·m·s/rad")}, lambda m: 0.31 * m.speed),
    Concealed("quadratic_drag", {"coefficient_nms2": (0.02, "N·m·s²/rad²")},
              lambda m: 0.02 * m.speed * np.abs(m.speed)),
    Concealed("local_friction", {"torque_nm": (7.0, "N·m"), "centre_rad": (1.2, "rad"), "width_rad": (0.25, "rad")},
              lambda m: 7 * np.exp(-(((m.position - 1.2) / 0.25) ** 2) / 2) * np.tanh(m.speed / 0.02),
              "position", (0.9, 1.5), "rad"),
    Concealed("friction_drift", {"change_nm": (3.0, "N·m")},
              lambda m: 3 * m.number / 5 * np.tanh(m.speed / 0.02), "run", (0.0, 5.0), "1"),
    Concealed("load_torque", {"table": (tuple((0.4 * i, 5 * np.sin(0.4 * i)) for i in range(9)), "N·m")},
              lambda m: 5 * np.sin(m.position), "position", (0.0, 3.14), "rad", ("torque_offset",)),
    Concealed("torque_offset", {"torque_nm": (-3.2, "N·m")}, lambda m: -3.2 + 0 * m.time, "time_in_motion",
              (0.0, 1.2), "s"),
    Concealed("load_event", {"time_s": (0.31, "s"), "duration_s": (0.05, "s"), "peak_nm": (9.0, "N·m")},
              lambda m: 9 * np.exp(-(((m.time - 0.31) / 0.02) ** 2)), "time_in_motion", (0.27, 0.35), "s"),
    Concealed("periodic_disturbance", {"frequency_hz": (37.0, "Hz"), "amplitude_nm": (2.0, "N·m")},
              lambda m: 2 * np.sin(2 * np.pi * 37 * m.time + m.number), "frequency", (36.0, 38.0), "Hz"),
    Concealed("cogging", {"order": (24.0, "1"), "amplitude_nm": (2.5, "N·m"), "phase_rad": (0.4, "rad")},
              lambda m: 2.5 * np.sin(24 * m.position + 0.4), "position", (0.0, 3.14), "rad"),
    Concealed("torque_constant", {"gain": (0.93, "1")}, lambda m: 0.07 * m.needed, "torque", (-60.0, 60.0), "N·m",
              ("load_inertia",)),
    Concealed("torque_lag", {"time_constant_s": (2e-3, "s")}, lambda m: -2e-3 * np.gradient(m.needed, m.time),
              "frequency", (0.0, 20.0), "Hz"),
    Concealed("torque_saturation", {"limit_nm": (40.0, "N·m")},
              lambda m: m.needed - np.clip(m.needed, -40, 40), "torque", (40.0, 80.0), "N·m"),
    Concealed("measurement_delay", {"delay_s": (1.5e-3, "s")}, lambda m: 1.5e-3 * np.gradient(m.needed, m.time),
              "frequency", (0.0, 20.0), "Hz", ("torque_lag",)),
    Concealed("encoder_eccentricity", {"amplitude_rad": (2e-3, "rad")},
              lambda m: 0.1 * 2e-2 * m.speed**2 * np.sin(m.position), "position", (0.0, 3.14), "rad"),
    Concealed("backlash", {"gap_rad": (2e-3, "rad")}, lambda m: 4 * np.exp(-((m.needed / 3) ** 2)), "torque",
              (-5.0, 5.0), "N·m"),
    Concealed("coupling_stiffness", {"stiffness_nm_rad": (17000.0, "N·m/rad")},
              lambda m: 1e-5 * np.gradient(np.gradient(m.needed, m.time), m.time), "frequency", (20.0, 90.0), "Hz"),
    Concealed("coupling_damping", {"damping_nms": (21.0, "N·m·s/rad")},
              lambda m: 2 * np.sin(2 * np.pi * 61 * m.time) * np.exp(-((m.time - 0.4) ** 2) / 0.01), "frequency",
              (55.0, 68.0), "Hz"),
    Concealed("nonlinear_stiffness", {"cubic_nm_rad3": (3e9, "N·m/rad³")}, lambda m: 1e-5 * m.needed**3, "torque",
              (-60.0, 60.0), "N·m"),
    Concealed("extra_compliance", {"inertia_kgm2": (0.01, "kg·m²"), "stiffness_nm_rad": (900.0, "N·m/rad"),
                                   "damping_nms": (0.05, "N·m·s/rad")},
              lambda m: 2 * np.sin(2 * np.pi * 48 * m.time) * np.exp(-((m.time - 0.4) ** 2) / 0.03), "frequency",
              (45.0, 52.0), "Hz"),
    Concealed("load_inertia", {"delta_kgm2": (0.021, "kg·m²"), "scale": (1.0, "1")},
              lambda m: 0.021 * m.acceleration, "acceleration", (-300.0, 300.0), "rad/s²", ("torque_constant",)),
    Concealed("inertia_profile_shift", {"shift_rad": (0.11, "rad")},
              lambda m: 0.02 * np.cos(2 * m.position) * m.acceleration, "position", (0.0, 3.14), "rad"),
)  # fmt: skip


@cache
def moved() -> tuple[Moved, ...]:
    """The paper's machine, rigid, along its demand."""
    found = []
    for number, duration in enumerate(DURATIONS_S):
        motion = Motion(kind="poly5", distance_rad=np.pi, duration_s=duration)
        time = motion.time(RATE_HZ)
        demand = motion.demand(time)
        needed = _needed(paper_machine(), demand.position_rad, demand.speed_rad_s, demand.acceleration_rad_s2)
        found.append(
            Moved(number, time, demand.position_rad, demand.speed_rad_s, demand.acceleration_rad_s2, needed)
        )
    return tuple(found)


def _needed(machine: Machine, position: Array, speed: Array, acceleration: Array) -> Array:
    """Torque of the rigid machine for a motion (A7 with k → ∞)."""
    table = machine.load.inertia_table
    assert table is not None
    total = machine.motor.inertia_kgm2 + table.at(position)
    viscous = machine.motor.viscous_friction_nms + machine.load.viscous_friction_nms
    return total * acceleration + table.slope_at(position) * speed**2 / 2 + viscous * speed


def session() -> Session:
    """The runs as a session, with dry friction in the plant and noise on torque."""
    rng = np.random.default_rng(2)
    runs = []
    for run in moved():
        torque = run.needed + COULOMB.effect(run) + NOISE_NM * rng.normal(size=run.time.size)
        duration = DURATIONS_S[run.number]
        motion = Motion(kind="poly5", distance_rad=np.pi, duration_s=duration)
        runs.append(
            Run(
                "reference", run.number % 2, RATE_HZ, run.time, run.position, run.speed, torque, motion=motion
            )
        )
    return Session(
        runs=tuple(runs), created="2025-03-04T05:06:07+00:00", source="simulated <script>alert(1)</script>"
    )


def explained(
    concealed: Sequence[Concealed] = (COULOMB,),
    verdict: Verdict = "explained",
    *,
    unnamed: Sequence[Concealed] = (),
    notes: tuple[str, ...] = ("No repeats of the 500 ms motion: the floor rests on <one> pair.",),
) -> Explanation:
    """An explanation that names the concealed effects; `unnamed` ones are left in what remains."""
    rng = np.random.default_rng(1)
    overlays = []
    for run in moved():
        size = run.time.size
        noise = NOISE_NM * rng.normal(size=size)
        terms = {c.physics: c.effect(run) for c in concealed}
        torque = run.needed + sum(terms.values()) + sum(c.effect(run) for c in unnamed) + noise
        considered = (np.abs(run.speed) > 0.05).astype(float)
        overlays.append(
            Overlay(
                run.number, run.number in HELD_OUT, run.time, run.position, run.speed, run.acceleration, torque,
                run.needed, run.needed + sum(terms.values()), terms, considered,
            )
        )  # fmt: skip
    located = tuple(_located(c, 0.9 / (i + 1)) for i, c in enumerate([*concealed, *unnamed]))
    return Explanation(
        verdict=verdict,
        axis="rotary",
        noise_floor=NoiseFloor(NOISE_NM, "Differences of 3 pairs of repeats"),
        mismatch=located,
        findings=tuple(_finding(c, where) for c, where in zip(concealed, located, strict=False)),
        fit=HeldOut(
            tuple(i for i in range(len(DURATIONS_S)) if i not in HELD_OUT),
            HELD_OUT,
            _misfit(overlays, "before_nm"),
            _misfit(overlays, "after_nm"),
        ),
        machine=paper_machine().model_copy(update={"physics": tuple(_term(c) for c in concealed)}),
        overlays=tuple(overlays),
        notes=notes,
        remainder=tuple(_located(c, 0.8) for c in unnamed),
    )


def consistent() -> Explanation:
    """Nothing above the floor."""
    return explained((), "consistent")


def _located(concealed: Concealed, share: float) -> Located:
    return Located(
        concealed.coordinate, concealed.interval, concealed.unit, share, 0.0005,
        f"The residual follows {concealed.coordinate.replace('_', ' ')}.",
    )  # fmt: skip


def _finding(concealed: Concealed, where: Located) -> Finding:
    quantities = {}
    for key, (value, unit) in concealed.parameters.items():
        if isinstance(value, tuple):
            quantities[key] = Quantity(value, unit, None)
        else:
            low, high = sorted((0.98 * value, 1.025 * value))
            quantities[key] = Quantity(value, unit, (low, high))
    return Finding(
        concealed.physics, quantities, where, concealed.like, {"log_likelihood_gain": 812.5},
        f"{concealed.physics.replace('_', ' ').capitalize()} carries most of the mismatch.",
    )  # fmt: skip


def _term(concealed: Concealed) -> PhysicsTerm:
    return PhysicsTerm.model_validate(
        {"name": concealed.physics}
        | {
            key: [list(pair) for pair in value] if isinstance(value, tuple) else value
            for key, (value, _) in concealed.parameters.items()
        }
    )


def _misfit(overlays: Sequence[Overlay], which: str) -> Misfit:
    parts = [o.torque_nm - getattr(o, which) for o in overlays if o.heldout]
    inside = [o.considered > 0 for o in overlays if o.heldout]
    missed = np.concatenate([part[where] for part, where in zip(parts, inside, strict=True)])
    error = float(np.sqrt(np.mean(missed**2)))
    return Misfit(error, 0.01 * error)
