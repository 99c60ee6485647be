"""What counts as right: the coordinate that a mismatch follows, its interval, and how far a parameter is off.

True coordinates, the first of `mismatch` has to be one of them:

    direction       coulomb, stribeck and asymmetric friction: dry friction turns with the sign of the speed
    speed           viscous friction, quadratic drag; stribeck, too, whose fall over the speed is what makes it one
    position        local friction, load torque, cogging, eccentricity, profile shift
    time_in_motion  load event
    frequency       periodic disturbance
    run             friction drift; direction, too: on the session's average a drift is dry friction
    acceleration    load inertia; a wrong torque constant is off by the torque, nearly all of which accelerates: both
    torque          torque constant (see above), saturation, backlash (play is crossed where the torque turns)

Two or more are equally right for

    eccentricity            a·sin θ differentiated twice: cos θ dω/dt − sin θ ω², so position, speed and acceleration
    profile shift           J' θ_s dω/dt + ½ J'' θ_s ω²: position, acceleration, speed
    lag, measurement delay  what is off is the rate of change of torque or acceleration, strongest where the injection
                            shakes: acceleration, torque, frequency
    stiffness, damping, cubic stiffness, extra mass
                            off where the coupling is wound up and where it resonates: acceleration, torque, frequency
    load inertia, backlash  seen through the acceleration as through the torque that makes it
    torque offset           a constant goes with no coordinate: any will do that is named over its whole range

True intervals: local friction centre ± width/2 (and a turn on), an event its duration, saturation the torques beyond
its limit (on either side), a periodic disturbance its frequency ± what the run's length resolves; any other effect acts
over the whole range of the coordinate that the motions cover; where an accepted coordinate is a frequency that follows
from the machine, there is none.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np
from scipy.interpolate import PchipInterpolator

Interval = tuple[float, float]
Effect = Mapping[str, Any]

_WOUND_UP = ("acceleration", "torque", "frequency")
_ANY = ("direction", "position", "speed", "acceleration", "torque", "time_in_motion", "run")
COORDINATES: Mapping[str, tuple[str, ...]] = {
    "coulomb_friction": ("direction",),
    "stribeck_friction": ("direction", "speed"),
    "asymmetric_friction": ("direction",),
    "viscous_friction": ("speed",),
    "quadratic_drag": ("speed",),
    "local_friction": ("position",),
    "friction_drift": ("run", "direction"),
    "load_torque": ("position",),
    "torque_offset": _ANY,
    "load_event": ("time_in_motion",),
    "periodic_disturbance": ("frequency",),
    "cogging": ("position",),
    "torque_constant": ("torque", "acceleration"),
    "torque_lag": _WOUND_UP,
    "torque_saturation": ("torque",),
    "measurement_delay": _WOUND_UP,
    "encoder_eccentricity": ("position", "speed", "acceleration"),
    "backlash": ("torque", "acceleration"),
    "coupling_stiffness": _WOUND_UP,
    "coupling_damping": _WOUND_UP,
    "nonlinear_stiffness": _WOUND_UP,
    "extra_compliance": _WOUND_UP,
    "load_inertia": ("acceleration", "torque"),
    "inertia_profile_shift": ("position", "acceleration", "speed"),
}
#: What the vocabulary calls effects that the room calls foreign.
WORDS = {
    "dahl_presliding": "presliding_friction",
    "hysteretic_coupling": "coupling_hysteresis",
    "mesh_stiffness": "stiffness_over_angle",
    "payload_slosh": "extra_compliance",
    "thermal_fade": "torque_constant_fade",
}
#: Parameters of the virtual machine room alone.
_INTERNAL = ("motions",)


def intervals(effect: Effect, coordinate: str, label: Mapping[str, Any]) -> list[Interval]:
    """Intervals of a coordinate any of which is right; none where the truth has no interval."""
    name, values, covered = effect["physics"], effect["parameters"], label["covered"]
    low, high = covered[coordinate]
    if coordinate == "frequency":
        if name != "periodic_disturbance":
            return []
        resolved = 1 / covered["time_in_motion"][1]
        return [(values["frequency_hz"] - resolved, values["frequency_hz"] + resolved)]
    if name == "local_friction" and coordinate == "position":
        half, turn = 0.5 * values["width_rad"], 2 * np.pi
        centres = [values["centre_rad"] + turn * n for n in range(-3, 4)]
        return [(c - half, c + half) for c in centres if low < c < high]
    if name == "load_event" and coordinate == "time_in_motion":
        return [(values["time_s"], values["time_s"] + values["duration_s"])]
    if name == "torque_saturation" and coordinate == "torque":
        limit = values["limit_nm"]
        return [side for side in ((limit, high), (low, -limit)) if side[0] < side[1]]
    return [(low, high)]


def overlap(found: Interval, true: Interval) -> float:
    """Intersection over union of two intervals."""
    union = max(found[1], true[1]) - min(found[0], true[0])
    return max(min(found[1], true[1]) - max(found[0], true[0]), 0.0) / union if union > 0 else 1.0


def parameter_errors(
    effect: Effect, found: Mapping[str, Any], label: Mapping[str, Any]
) -> list[tuple[str, float, bool | None]]:
    """Key, relative error, and whether the 95 % interval holds the truth (None: it has none), of one finding.

    An angle's error in rad is the error of what it turns; a place's is relative to its width, an instant's to its
    duration; a load torque is compared as a curve over the angles covered, a load inertia as its change on average.
    """
    name, truth = effect["physics"], effect["parameters"]
    if name == "load_torque":
        return [("curve", _curve_error(truth, found, label), _all_held(truth, found))]
    if name == "load_inertia":
        return [_inertia_error(truth, found, label)]
    return [
        (
            key,
            _error(key, float(value), float(found[key]["value"]), truth),
            _held(key, float(value), found[key]),
        )
        for key, value in truth.items()
        if key not in _INTERNAL and key in found
    ]


def _turned(key: str, difference: float) -> float:
    """The difference of two angles that come back every turn."""
    periodic = key in ("phase_rad", "centre_rad")
    return float((difference + np.pi) % (2 * np.pi) - np.pi) if periodic else difference


def _error(key: str, true: float, found: float, truth: Mapping[str, Any]) -> float:
    scale = {"phase_rad": 1.0, "centre_rad": truth.get("width_rad"), "time_s": truth.get("duration_s")}
    return abs(_turned(key, found - true)) / abs(scale.get(key) or true)


def _held(key: str, true: float, found: Mapping[str, Any]) -> bool | None:
    if found.get("ci95") is None:
        return None
    low, high = found["ci95"]
    middle = 0.5 * (low + high)
    return bool(abs(_turned(key, true - middle)) <= 0.5 * (high - low))


def _all_held(truth: Mapping[str, Any], found: Mapping[str, Any]) -> bool | None:
    """Both of a sine's parameters, which are one vector."""
    pairs = [
        key for key in ("amplitude_nm", "phase_rad") if key in truth and key in found and "table" not in truth
    ]
    held = [_held(key, float(truth[key]), found[key]) for key in pairs]
    return None if not held or None in held else all(held)


def _curve(values: Mapping[str, Any], angles: np.ndarray) -> np.ndarray:
    if "table" in values:
        points = np.array(
            values["table"], dtype=float
        )  # a curve without overshoot, constant outside: so the plant's
        curve = PchipInterpolator(points[:, 0], points[:, 1])
        return np.asarray(curve(np.clip(angles, points[0, 0], points[-1, 0])))
    return np.asarray(values["amplitude_nm"] * np.sin(angles + values["phase_rad"]))


def _curve_error(truth: Mapping[str, Any], found: Mapping[str, Any], label: Mapping[str, Any]) -> float:
    angles = np.linspace(*label["covered"]["position"], 200)
    true = _curve(truth, angles)
    seen = _curve({key: quantity["value"] for key, quantity in found.items()}, angles)
    return float(np.linalg.norm(seen - true) / np.linalg.norm(true))


def _inertia_error(
    truth: Mapping[str, Any], found: Mapping[str, Any], label: Mapping[str, Any]
) -> tuple[str, float, bool | None]:
    mean = label["machine"]["mean_inertia_kgm2"]
    seen = {key: quantity["value"] for key, quantity in found.items()}

    def change(values: Mapping[str, Any]) -> float:
        return float((values.get("scale", 1.0) - 1.0) * mean + values.get("delta_kgm2", 0.0))

    key = "scale" if truth.get("scale", 1.0) != 1.0 else "delta_kgm2"
    held = _held(key, float(truth[key]), found[key]) if key in found else None
    return "change", abs(change(seen) / change(truth) - 1), held
