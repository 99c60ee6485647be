"""What a sealed session hides that the tool has no name for, and how unlike it is to everything that has one.

The strength of a foreign effect is what it changes beyond its best likeness: the residual that is left once the most
alike of the named effects, at its best size, has been taken away. What a named effect imitates nobody could tell.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

from schwung_sim.errors import BenchError
from schwung_sim.plants.concealed import Concealed, Value
from schwung_sim.plants.foreign import FOREIGN
from schwung_sim.plants.two_mass import TwoMassPlant
from schwung_sim.sealed.machines import Chance, DrawnMachine
from schwung_sim.sealed.shapes import Shape
from schwung_sim.sealed.strength import play_runs, residuals, rms

Array = NDArray[np.float64]

FOREIGN_NAMES = tuple(FOREIGN)


def _dahl(chance: Chance, drawn: DrawnMachine) -> Shape:
    """Builds up over a sixth to a half of the stroke: far from dry friction, and from any spring."""
    over = chance.uniform(0.15, 0.5) * abs(drawn.distance_rad)
    return Shape(
        "dahl_presliding",
        lambda size: {"torque_nm": size, "stiffness_nm_rad": size / over},
        0.3 * drawn.drive.peak_torque_nm,
    )


def _hysteresis(chance: Chance, drawn: DrawnMachine) -> Shape:
    """Beside the spring, with a quarter to all of its stiffness until it yields."""
    stiffness = chance.uniform(0.25, 1.0) * drawn.drive.stiffness_nm_rad
    return Shape(
        "hysteretic_coupling",
        lambda size: {"torque_nm": size, "stiffness_nm_rad": stiffness},
        0.15 * drawn.drive.peak_torque_nm,
    )


def _slosh(chance: Chance, drawn: DrawnMachine) -> Shape:
    """At 6 to 15 Hz at rest, three to six times as fast at the highest speed."""
    rest, fastest = 2 * np.pi * chance.uniform(6.0, 15.0), chance.uniform(3.0, 6.0)
    share = (fastest**2 - 1) * (rest / drawn.peak_speed_rad_s) ** 2
    damping = 2 * chance.uniform(0.02, 0.1)
    mean = float(np.mean(drawn.profile.at(drawn.angles_rad())))
    return Shape(
        "payload_slosh",
        lambda size: {
            "inertia_kgm2": size,
            "stiffness_nm_rad": size * rest**2,
            "damping_nms": damping * size * rest,
            "speed_share": share,
        },
        0.8 * mean,
    )


def _ripple(chance: Chance, drawn: DrawnMachine) -> Shape:
    order, phase = float(chance.integers(2, 13)), chance.uniform(-np.pi, np.pi)
    return Shape(
        "torque_ripple", lambda size: {"share": size, "order": order, "phase_rad": float(phase)}, 0.25
    )


def _fade(chance: Chance, drawn: DrawnMachine) -> Shape:
    """Within a good part of a run; `loss` is at a quarter of the peak torque."""
    time, torque = chance.uniform(0.15, 0.6), 0.25 * drawn.drive.peak_torque_nm
    return Shape(
        "thermal_fade", lambda size: {"loss": size, "time_constant_s": float(time), "torque_nm": torque}, 0.4
    )


def _angle_damping(chance: Chance, drawn: DrawnMachine) -> Shape:
    order, phase = float(chance.integers(1, 5)), chance.uniform(-np.pi, np.pi)
    return Shape(
        "angle_damping",
        lambda size: {"coefficient_nms": size, "order": order, "phase_rad": float(phase)},
        0.4 * drawn.drive.peak_torque_nm / drawn.peak_speed_rad_s,
    )


def _mesh(chance: Chance, drawn: DrawnMachine) -> Shape:
    order, phase = float(chance.integers(2, 9)), chance.uniform(-np.pi, np.pi)
    return Shape(
        "mesh_stiffness", lambda size: {"share": size, "order": order, "phase_rad": float(phase)}, 0.7
    )


_SHAPES: Mapping[str, Callable[[Chance, DrawnMachine], Shape]] = {
    "dahl_presliding": _dahl,
    "hysteretic_coupling": _hysteresis,
    "payload_slosh": _slosh,
    "torque_ripple": _ripple,
    "thermal_fade": _fade,
    "angle_damping": _angle_damping,
    "mesh_stiffness": _mesh,
}


def draw_foreign(chance: Chance, drawn: DrawnMachine, name: str) -> Shape:
    """A random shape of a foreign effect on this machine."""
    return _SHAPES[name](chance, drawn)


def _named(drawn: DrawnMachine) -> list[dict[str, dict[str, Value]]]:
    """The named effects at small sizes: everything that could be taken for a foreign one."""
    drive = drawn.drive
    torque, speed = 0.02 * drive.peak_torque_nm, drawn.peak_speed_rad_s
    mean = float(np.mean(drawn.profile.at(drawn.angles_rad())))
    edges = np.linspace(0.0, drawn.distance_rad, 9)
    bumps: list[dict[str, dict[str, Value]]] = [
        {
            "local_friction": {
                "torque_nm": torque,
                "centre_rad": float((a + b) / 2),
                "width_rad": float(2 * abs(b - a)),
            }
        }
        for a, b in pairwise(edges)
    ]
    masses: list[dict[str, dict[str, Value]]] = [
        {
            "extra_compliance": {
                "inertia_kgm2": 0.02 * mean,
                "stiffness_nm_rad": 0.02 * mean * rate**2,
                "damping_nms": 0.002 * mean * rate,
            }
        }
        for rate in 2 * np.pi * np.geomspace(8.0, 90.0, 6)
    ]
    return [
        {"coulomb_friction": {"torque_nm": torque}},
        {
            "stribeck_friction": {
                "coulomb_torque_nm": 0.0, "breakaway_torque_nm": torque, "stribeck_speed_rad_s": 0.1 * speed,
            }
        },
        {"torque_offset": {"torque_nm": torque}},
        {"viscous_friction": {"coefficient_nms": torque / speed}},
        {"quadratic_drag": {"coefficient_nms2": torque / speed**2}},
        {"friction_drift": {"change_nm": torque, "motions": float(len(drawn.runs))}},
        {"load_torque": {"amplitude_nm": torque, "phase_rad": 0.0}},
        {"load_torque": {"amplitude_nm": torque, "phase_rad": 0.5 * np.pi}},
        {"torque_constant": {"gain": 0.98}},
        {"torque_lag": {"time_constant_s": 1e-4}},
        {"measurement_delay": {"delay_s": 1e-4}},
        {"encoder_eccentricity": {"amplitude_rad": 1e-3}},
        {"backlash": {"gap_rad": 0.1 * drive.peak_torque_nm / drive.stiffness_nm_rad}},
        {"coupling_stiffness": {"stiffness_nm_rad": 0.9 * drive.stiffness_nm_rad}},
        {"coupling_damping": {"damping_nms": 1.2 * drive.damping_nms}},
        {"nonlinear_stiffness": {"cubic_nm_rad3": drive.stiffness_nm_rad**3 / drive.peak_torque_nm**2}},
        {"load_inertia": {"delta_kgm2": 0.02 * mean}},
        {"load_inertia": {"scale": 1.02, "delta_kgm2": 0.0}},
        {"inertia_profile_shift": {"shift_rad": 0.02}},
        *bumps,
        *masses,
    ]  # fmt: skip


class Likeness:
    """The named effects' residuals on one machine's runs (`without` one), to take the most alike away from another."""

    def __init__(self, drawn: DrawnMachine, seed: int, indices: list[int], without: str = "") -> None:
        silent = residuals(
            drawn, play_runs(drawn, TwoMassPlant(drawn.drive, drawn.profile, seed=seed), seed, indices)
        )
        self._silent = silent
        self._directions: list[tuple[str, Array]] = []
        for effects in _named(drawn):
            if without in effects:
                continue
            plant = TwoMassPlant(drawn.drive, drawn.profile, Concealed(effects), seed)
            try:
                change = residuals(drawn, play_runs(drawn, plant, seed, indices)) - silent
            except BenchError:
                continue
            if rms(change) > 2 * rms(silent):
                self._directions.append((next(iter(effects)), change / np.linalg.norm(change)))

    def beyond(self, residual_nm: Array) -> tuple[float, str]:
        """What is left (N·m rms) of a residual, (m,), without its best likeness, and what that likeness is called."""
        change = residual_nm - self._silent
        overlaps = [abs(float(direction @ change)) for _, direction in self._directions]
        best = int(np.argmax(overlaps))
        left = max(float(change @ change) - overlaps[best] ** 2 - float(self._silent @ self._silent), 0.0)
        return float(np.sqrt(left / change.size)), self._directions[best][0]
