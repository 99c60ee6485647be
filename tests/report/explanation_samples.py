"""Names and runs made by hand: the torque that a machine needs along a motion, with effects that the belief leaves out.

The effects' signals have realistic shapes; nothing here is found by the tool.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import cache
from typing import Any

import numpy as np

from schwung.drivetrain.machine import Machine, paper_machine
from schwung.explain.publishing.values import Name
from schwung.explain.values import Overlay, Quantity
from schwung.motion import Array, Motion

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
    """One concealed effect: name, parameters (value, unit), signal."""

    physics: str
    parameters: dict[str, tuple[Any, str]]
    effect: Effect


COULOMB = Concealed(
    "coulomb_friction",
    {"torque_nm": (COULOMB_NM, "N·m")},
    lambda m: COULOMB_NM * np.tanh(m.speed / 0.02),
)


#: One of each of the other names.
OTHERS = (
    Concealed("stribeck_friction", {"coulomb_torque_nm": (3.0, "N·m"), "breakaway_torque_nm": (6.0, "N·m"),
                                    "stribeck_speed_rad_s": (1.5, "rad/s")},
              lambda m: (3 + 3 * np.exp(-((m.speed / 1.5) ** 2))) * np.tanh(m.speed / 0.02)),
    Concealed("asymmetric_friction", {"torque_positive_nm": (5.0, "N·m"), "torque_negative_nm": (3.0, "N·m")},
              lambda m: np.where(m.speed > 0, 5.0, -3.0) * np.tanh(np.abs(m.speed) / 0.02)),
    Concealed("viscous_friction", {"coefficient_nms": (0.31, "N·m·s/rad")}, lambda m: 0.31 * m.speed),
    Concealed("quadratic_drag", {"coefficient_nms2": (0.02, "N·m·s²/rad²")},
              lambda m: 0.02 * m.speed * np.abs(m.speed)),
    Concealed("local_friction", {"torque_nm": (7.0, "N·m"), "centre_rad": (1.2, "rad"), "width_rad": (0.25, "rad")},
              lambda m: 7 * np.exp(-(((m.position - 1.2) / 0.25) ** 2) / 2) * np.tanh(m.speed / 0.02)),
    Concealed("friction_drift", {"change_nm": (3.0, "N·m")},
              lambda m: 3 * m.number / 5 * np.tanh(m.speed / 0.02)),
    Concealed("load_torque", {"table": (tuple((0.4 * i, 5 * np.sin(0.4 * i)) for i in range(9)), "N·m")},
              lambda m: 5 * np.sin(m.position)),
    Concealed("torque_offset", {"torque_nm": (-3.2, "N·m")}, lambda m: -3.2 + 0 * m.time),
    Concealed("load_event", {"time_s": (0.31, "s"), "duration_s": (0.05, "s"), "peak_nm": (9.0, "N·m")},
              lambda m: 9 * np.exp(-(((m.time - 0.31) / 0.02) ** 2))),
    Concealed("periodic_disturbance", {"frequency_hz": (37.0, "Hz"), "amplitude_nm": (2.0, "N·m")},
              lambda m: 2 * np.sin(2 * np.pi * 37 * m.time + m.number)),
    Concealed("cogging", {"order": (24.0, "1"), "amplitude_nm": (2.5, "N·m"), "phase_rad": (0.4, "rad")},
              lambda m: 2.5 * np.sin(24 * m.position + 0.4)),
    Concealed("torque_constant", {"gain": (0.93, "1")}, lambda m: 0.07 * m.needed),
    Concealed("torque_lag", {"time_constant_s": (2e-3, "s")}, lambda m: -2e-3 * np.gradient(m.needed, m.time)),
    Concealed("torque_saturation", {"limit_nm": (40.0, "N·m")},
              lambda m: m.needed - np.clip(m.needed, -40, 40)),
    Concealed("measurement_delay", {"delay_s": (1.5e-3, "s")}, lambda m: 1.5e-3 * np.gradient(m.needed, m.time)),
    Concealed("encoder_eccentricity", {"amplitude_rad": (2e-3, "rad")},
              lambda m: 0.1 * 2e-2 * m.speed**2 * np.sin(m.position)),
    Concealed("backlash", {"gap_rad": (2e-3, "rad")}, lambda m: 4 * np.exp(-((m.needed / 3) ** 2))),
    Concealed("coupling_stiffness", {"stiffness_nm_rad": (17000.0, "N·m/rad")},
              lambda m: 1e-5 * np.gradient(np.gradient(m.needed, m.time), m.time)),
    Concealed("coupling_damping", {"damping_nms": (21.0, "N·m·s/rad")},
              lambda m: 2 * np.sin(2 * np.pi * 61 * m.time) * np.exp(-((m.time - 0.4) ** 2) / 0.01)),
    Concealed("nonlinear_stiffness", {"cubic_nm_rad3": (3e9, "N·m/rad³")}, lambda m: 1e-5 * m.needed**3),
    Concealed("extra_compliance", {"inertia_kgm2": (0.01, "kg·m²"), "stiffness_nm_rad": (900.0, "N·m/rad"),
                                   "damping_nms": (0.05, "N·m·s/rad")},
              lambda m: 2 * np.sin(2 * np.pi * 48 * m.time) * np.exp(-((m.time - 0.4) ** 2) / 0.03)),
    Concealed("load_inertia", {"delta_kgm2": (0.021, "kg·m²"), "scale": (1.0, "1")},
              lambda m: 0.021 * m.acceleration),
    Concealed("inertia_profile_shift", {"shift_rad": (0.11, "rad")},
              lambda m: 0.02 * np.cos(2 * m.position) * m.acceleration),
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


@dataclass(frozen=True, eq=False)
class Explained:
    """Names, and runs for pictures."""

    names: tuple[Name, ...]
    overlays: tuple[Overlay, ...]


def explained(concealed: Sequence[Concealed] = (COULOMB,)) -> Explained:
    """What names the concealed effects."""
    rng = np.random.default_rng(1)
    overlays = []
    for run in moved():
        terms = {c.physics: c.effect(run) for c in concealed}
        whole = run.needed + sum(terms.values())
        torque = whole + NOISE_NM * rng.normal(size=run.time.size)
        considered = (np.abs(run.speed) > 0.05).astype(float)
        overlays.append(
            Overlay(
                run.number, run.number in HELD_OUT, run.time, run.position, run.speed, run.acceleration, torque,
                run.needed, whole, terms, considered,
            )
        )  # fmt: skip
    return Explained(tuple(Name(c.physics, 0.99, _quantities(c), True) for c in concealed), tuple(overlays))


def _quantities(concealed: Concealed) -> dict[str, Quantity]:
    return {key: Quantity(value, unit, None) for key, (value, unit) in concealed.parameters.items()}
