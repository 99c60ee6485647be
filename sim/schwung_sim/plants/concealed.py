"""What a plant can conceal: the 24 physics names of the file contract, each really modelled.

Syntax of `--conceal`: effects separated by commas, an effect's keys by colons.

    coulomb_friction                                   defaults, scaled to the machine
    coulomb_friction=3                                 first key, defaults for the others
    stribeck_friction:coulomb_torque_nm=3:breakaway_torque_nm=5
    stribeck_friction=3:breakaway_torque_nm=5          both
    load_torque:table=0/0~1.57/5~3.14/-2               points angle/torque, held constant outside

The tool under test never learns any of it.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, field
from itertools import pairwise
from typing import Any, Literal

import numpy as np

from schwung_sim.errors import BenchError
from schwung_sim.plants.profile import Profile

Unit = Literal["", "torque", "stiffness", "damping", "inertia"]
Range = Literal["any", "not negative", "positive"]
Table = tuple[tuple[float, float], ...]
Value = float | Table


@dataclass(frozen=True)
class Scale:
    """How big torques, stiffness, damping and inertia are on a machine (SI)."""

    torque_nm: float
    stiffness_nm_rad: float
    damping_nms: float
    inertia_kgm2: float

    def of(self, unit: Unit) -> float:
        """What a default's share is a share of."""
        return {
            "": 1.0,
            "torque": self.torque_nm,
            "stiffness": self.stiffness_nm_rad,
            "damping": self.damping_nms,
            "inertia": self.inertia_kgm2,
        }[unit]


@dataclass(frozen=True)
class Key:
    """A parameter of an effect: its default is `share` of the machine's `unit`."""

    name: str
    share: float
    unit: Unit = ""
    range: Range = "any"


@dataclass(frozen=True)
class Effect:
    """One physics name: what it is, and its keys; the first takes a bare value."""

    text: str
    keys: tuple[Key, ...]
    table: bool = False

    @property
    def key_names(self) -> tuple[str, ...]:
        """All keys that are accepted."""
        return tuple(key.name for key in self.keys) + (("table",) if self.table else ())


def _torque(name: str, share: float, allowed: Range = "not negative") -> Key:
    return Key(name, share, "torque", allowed)


EFFECTS: Mapping[str, Effect] = {
    "coulomb_friction": Effect("dry friction of the motor shaft", (_torque("torque_nm", 0.013),)),
    "stribeck_friction": Effect(
        "dry friction that falls from breakaway to Coulomb as exp(-(ω/ω_s)²)",
        (
            _torque("coulomb_torque_nm", 0.013),
            _torque("breakaway_torque_nm", 0.021),
            Key("stribeck_speed_rad_s", 1.0, "", "positive"),
        ),
    ),
    "asymmetric_friction": Effect(
        "dry friction that differs by direction",
        (_torque("torque_positive_nm", 0.017), _torque("torque_negative_nm", 0.009)),
    ),
    "viscous_friction": Effect("change of the motor's viscous coefficient", (Key("coefficient_nms", 0.2),)),
    "quadratic_drag": Effect("windage, c ω|ω|", (Key("coefficient_nms2", 0.02, "", "not negative"),)),
    "local_friction": Effect(
        "a tight spot of the motor shaft: raised cosine, `width_rad` from end to end",
        (
            _torque("torque_nm", 0.02),
            Key("centre_rad", 1.5),
            Key("width_rad", 0.5, "", "positive"),
        ),
    ),
    "friction_drift": Effect(
        "dry friction that changes evenly from the first motion to the `motions`-th (the bench's own key)",
        (_torque("change_nm", 0.013, "any"), Key("motions", 10.0, "", "positive")),
    ),
    "load_torque": Effect(
        "load torque amplitude·sin(θ_l + phase), or a table over θ_l",
        (_torque("amplitude_nm", 0.03, "any"), Key("phase_rad", 0.0)),
        table=True,
    ),
    "torque_offset": Effect("constant torque on the motor shaft", (_torque("torque_nm", 0.01, "any"),)),
    "load_event": Effect(
        "one raised-cosine pulse on the load, `time_s` after the demand leaves rest",
        (
            Key("time_s", 0.1, "", "not negative"),
            Key("duration_s", 0.03, "", "positive"),
            _torque("peak_nm", 0.08, "any"),
        ),
    ),
    "periodic_disturbance": Effect(
        "a torque of fixed frequency on the motor shaft; its phase follows from the seed",
        (Key("frequency_hz", 32.0, "", "positive"), _torque("amplitude_nm", 0.01)),
    ),
    "cogging": Effect(
        "torque ripple amplitude·sin(order·θ + phase), θ the motor angle",
        (Key("order", 24.0, "", "positive"), _torque("amplitude_nm", 0.01), Key("phase_rad", 0.0)),
    ),
    "torque_constant": Effect("true torque over reported torque", (Key("gain", 0.93, "", "positive"),)),
    "torque_lag": Effect(
        "first-order lag of the true torque", (Key("time_constant_s", 0.5e-3, "", "positive"),)
    ),
    "torque_saturation": Effect(
        "true torque clipped, unknown to the drive", (_torque("limit_nm", 0.2, "positive"),)
    ),
    "measurement_delay": Effect("reported speed lags", (Key("delay_s", 0.5e-3, "", "not negative"),)),
    "encoder_eccentricity": Effect(
        "encoder error amplitude·sin θ, in the loop too", (Key("amplitude_rad", 1e-3, "", "not negative"),)
    ),
    "backlash": Effect("play in the coupling, whole gap", (Key("gap_rad", 2e-3, "", "not negative"),)),
    "coupling_stiffness": Effect(
        "the true stiffness", (Key("stiffness_nm_rad", 0.8, "stiffness", "positive"),)
    ),
    "coupling_damping": Effect("the true damping", (Key("damping_nms", 1.6, "damping", "not negative"),)),
    "nonlinear_stiffness": Effect(
        "cubic stiffness beside the linear one",
        (Key("cubic_nm_rad3", 2.5e4, "stiffness", "not negative"),),
    ),
    "extra_compliance": Effect(
        "a further mass on a spring behind the load",
        (
            Key("inertia_kgm2", 0.15, "inertia", "positive"),
            Key("stiffness_nm_rad", 0.2, "stiffness", "positive"),
            Key("damping_nms", 0.2, "damping", "not negative"),
        ),
    ),
    "load_inertia": Effect(
        "true load inertia scale·J + delta",
        (Key("delta_kgm2", 0.15, "inertia"), Key("scale", 1.0, "", "positive")),
    ),
    "inertia_profile_shift": Effect("true load inertia J(θ + shift)", (Key("shift_rad", 0.1),)),
}


@dataclass(frozen=True)
class Sensor:
    """What is wrong with the measurement: the encoder's error amplitude·sin θ, and a late reported speed."""

    eccentricity_rad: float = 0.0
    speed_delay_s: float = 0.0


@dataclass(frozen=True)
class Concealed:
    """The effects that are switched on, with the values given; the others default to the machine's scale."""

    effects: Mapping[str, Mapping[str, Value]] = field(default_factory=dict)

    def values(self, name: str, scale: Scale) -> dict[str, Any]:
        """All keys of one effect; {} where it is off."""
        if name not in self.effects:
            return {}
        given = self.effects[name]
        full: dict[str, Any] = {key.name: key.share * scale.of(key.unit) for key in EFFECTS[name].keys}
        if "scale" in given and "delta_kgm2" not in given:
            full["delta_kgm2"] = 0.0  # a scale alone means nothing but the scale
        if "table" in given and "amplitude_nm" not in given:
            full["amplitude_nm"] = 0.0
        return full | dict(given)

    def sensor(self, scale: Scale) -> Sensor:
        """The effects that act in the measurement."""
        return Sensor(
            self.values("encoder_eccentricity", scale).get("amplitude_rad", 0.0),
            self.values("measurement_delay", scale).get("delay_s", 0.0),
        )

    def apply(self, parameters: Any, scale: Scale, seed: int) -> Profile:
        """Write the plant's effects into its PARAMETERS record (1,); returns load torque over the angle."""
        for name, value in (("torque_gain", 1.0), ("inertia_scale", 1.0), ("torque_limit_nm", math.inf),
                            ("stribeck_speed_rad_s", 1.0), ("drift_motions", 2.0)):  # fmt: skip
            parameters[name] = value
        for name, keys in _SET.items():
            values = self.values(name, scale)
            for key, target in keys.items():
                if values:
                    parameters[target] = values[key]
        for name, added in _ADD.items():
            values = self.values(name, scale)
            for key, targets in added.items():
                for target in targets:
                    parameters[target] += values.get(key, 0.0)
        if stribeck := self.values("stribeck_friction", scale):
            rise = stribeck["breakaway_torque_nm"] - stribeck["coulomb_torque_nm"]
            parameters["stribeck_rise_nm"] = rise
        parameters["periodic_phase_rad"] = np.random.default_rng([seed, 1]).uniform(0, 2 * np.pi)
        table = self.values("load_torque", scale).get("table")
        if table is None:
            return Profile.constant(0.0)
        profile = Profile.of_pairs(*np.array(table).T)
        parameters["load_table"] = 1.0
        return profile


_SET: Mapping[str, Mapping[str, str]] = {
    "stribeck_friction": {"stribeck_speed_rad_s": "stribeck_speed_rad_s"},
    "quadratic_drag": {"coefficient_nms2": "drag_nms2"},
    "local_friction": {
        "torque_nm": "local_friction_nm", "centre_rad": "local_centre_rad", "width_rad": "local_width_rad",
    },
    "friction_drift": {"change_nm": "drift_nm", "motions": "drift_motions"},
    "load_torque": {"amplitude_nm": "load_amplitude_nm", "phase_rad": "load_phase_rad"},
    "torque_offset": {"torque_nm": "offset_nm"},
    "load_event": {"time_s": "event_time_s", "duration_s": "event_duration_s", "peak_nm": "event_peak_nm"},
    "periodic_disturbance": {
        "frequency_hz": "periodic_frequency_hz", "amplitude_nm": "periodic_amplitude_nm",
    },
    "cogging": {
        "order": "cogging_order", "amplitude_nm": "cogging_amplitude_nm", "phase_rad": "cogging_phase_rad",
    },
    "torque_constant": {"gain": "torque_gain"},
    "torque_lag": {"time_constant_s": "torque_lag_s"},
    "torque_saturation": {"limit_nm": "torque_limit_nm"},
    "backlash": {"gap_rad": "gap_rad"},
    "coupling_stiffness": {"stiffness_nm_rad": "stiffness_nm_rad"},
    "coupling_damping": {"damping_nms": "damping_nms"},
    "nonlinear_stiffness": {"cubic_nm_rad3": "cubic_nm_rad3"},
    "extra_compliance": {
        "inertia_kgm2": "third_inertia_kgm2", "stiffness_nm_rad": "third_stiffness_nm_rad",
        "damping_nms": "third_damping_nms",
    },
    "load_inertia": {"delta_kgm2": "inertia_delta_kgm2", "scale": "inertia_scale"},
    "inertia_profile_shift": {"shift_rad": "inertia_shift_rad"},
}  # fmt: skip

_BOTH_WAYS = ("coulomb_positive_nm", "coulomb_negative_nm")
_ADD: Mapping[str, Mapping[str, tuple[str, ...]]] = {
    "coulomb_friction": {"torque_nm": _BOTH_WAYS},
    "stribeck_friction": {"coulomb_torque_nm": _BOTH_WAYS},
    "asymmetric_friction": {
        "torque_positive_nm": _BOTH_WAYS[:1], "torque_negative_nm": _BOTH_WAYS[1:],
    },
    "viscous_friction": {"coefficient_nms": ("rotor_viscous_nms",)},
}  # fmt: skip


def parse_conceal(text: str) -> Concealed:
    """Read the `--conceal` syntax. Raises BenchError that lists what exists for an unknown name or key."""
    effects: dict[str, dict[str, Value]] = {}
    for item in filter(None, (part.strip() for part in text.split(","))):
        head, *rest = item.split(":")
        name, equals, first = head.partition("=")
        name = name.strip()
        if name not in EFFECTS:
            raise BenchError(
                "--conceal", f'no physics is called "{name}"', f"There are {', '.join(EFFECTS)}."
            )
        if name in effects:
            raise BenchError(
                "--conceal", f"{name} is given twice", "Put its keys together, separated by colons."
            )
        assignments = ([f"{EFFECTS[name].keys[0].name}={first}"] if equals else []) + rest
        effects[name] = {}
        for assignment in assignments:
            key, _, value = (part.strip() for part in assignment.partition("="))
            effects[name][key] = _read_value(name, key, value)
    return Concealed(effects)


def _read_value(name: str, key: str, text: str) -> Value:
    effect, place = EFFECTS[name], f"--conceal {name}"
    if key not in effect.key_names:
        raise BenchError(place, f'has no key "{key}"', f"There are {', '.join(effect.key_names)}.")
    try:
        if key == "table":
            points = tuple(tuple(map(float, point.split("/"))) for point in text.split("~"))
            if len(points) < 2 or any(len(point) != 2 for point in points) or not np.all(np.isfinite(points)):
                raise ValueError
            if any(a[0] >= b[0] for a, b in pairwise(points)):
                raise BenchError(place, "the table's angles do not increase", "Sort them.")
            return tuple((angle, torque) for angle, torque in points)
        value = float(text)
    except ValueError:
        form = "angle/torque~angle/torque~… with numbers" if key == "table" else "a number"
        raise BenchError(place, f'{key} is "{text}"', f"Give {form}.") from None
    allowed = next(k.range for k in effect.keys if k.name == key)
    if not math.isfinite(value) or (allowed == "positive" and value <= 0) or (allowed != "any" and value < 0):
        wanted = "of either sign" if allowed == "any" else allowed
        raise BenchError(place, f"{key} is {text}", f"Give a finite number, {wanted}.")
    return value
