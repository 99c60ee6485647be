"""What the samples of a response hold: two masses under a controller, images of a held injection included.

With α = a/T the staircase's share of the torque, T = S·a + c (`response.py`), s_i = j2π(f + i·f_s) and C the
controller's torque over speed as reported, C° as it acts, the sampled speed over torque is

    ω/T = ω_0 + Σ_{i≠0} (s/s_i) ω_i e^{−s_i τ}       ω_0 = G(s) (S(s) α + c_0) e^{−sτ}
    ω_i = G(s_i) S(s_i) α / (1 + C°(s_i) G(s_i))      c_0 = (1 − S(s) α + Σ_{i≠0} C(s_i) ω_i) · C°(s)/C(s)

τ: the speed is reported late. C°/C = e^{s·lag − s²·smear/2}: torque is reported through a filter, of which lag and
smear are mean and variance. C = K (1 + rise/s + sag/s²) e^{−s·delay + s²·smear_K/2}, a P-PI cascade with dead time and
filters, is needed at the images only, and held to its values within the band.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np

from schwung.estimation.response import ComplexArray, Response, staircase_gain
from schwung.motion import Array

#: Images of the staircase that are counted on either side; what is left falls with the third power.
_IMAGES = 8
#: The model's own error per point: a drive's sampling and quantisation are not in it. For the controller likewise.
MODEL_SHARE, CONTROLLER_SHARE = 2e-3, 1e-2
#: Units within the fit of delays (s), their squares, rise (1/s) and sag (1/s²).
_UNITS = {
    "delay": 1e-4,
    "lag": 1e-4,
    "smear": 1e-8,
    "gain_delay": 1e-4,
    "gain_smear": 1e-8,
    "gain_rise": 100.0,
}
_LOGARITHMIC = ("rotor", "stiffness", "damping", "gain")
_NOT_NEGATIVE = ("rotor_friction", "load_friction", "smear", "gain_smear")


@dataclass(frozen=True)
class Shape:
    """Which parameters there are; those shared by all angles first, then ln J_l of each angle."""

    coupled: bool
    held: bool
    angles: int

    @property
    def names(self) -> tuple[str, ...]:
        """The shared parameters, in order."""
        coupled = ("rotor", "stiffness", "damping") if self.coupled else ()
        held = (
            ("lag", "smear", "gain", "gain_delay", "gain_smear", "gain_rise", "gain_sag") if self.held else ()
        )
        return (*coupled, "rotor_friction", "load_friction", "delay", *held)

    def start(self, values: dict[str, float], inertia_kgm2: Array) -> Array:
        """The parameter vector for values in SI units; what is not given is 0."""
        shared = [
            np.log(values[name]) if name in _LOGARITHMIC else values.get(name, 0.0) / _UNITS.get(name, 1.0)
            for name in self.names
        ]
        return np.concatenate([shared, np.log(inertia_kgm2)])

    def bounds(self, start: Array) -> tuple[Array, Array]:
        """Logarithms within a factor of fifty; frictions and variances not negative."""
        logs = np.array([name in _LOGARITHMIC for name in self.names] + [True] * self.angles)
        positive = np.array([name in _NOT_NEGATIVE for name in self.names] + [False] * self.angles)
        low = np.where(logs, start - np.log(50.0), np.where(positive, 0.0, -np.inf))
        return low, np.where(logs, start + np.log(50.0), np.inf)

    def values(self, x: Array) -> dict[str, float]:
        """The shared parameters in SI units; those that the shape has not are 0, stiffness infinite."""
        absent = {"rotor": 0.0, "stiffness": np.inf, "damping": 0.0, "lag": 0.0, "smear": 0.0}
        return absent | {
            name: float(np.exp(value) if name in _LOGARITHMIC else value * _UNITS.get(name, 1.0))
            for name, value in zip(self.names, x, strict=False)
        }

    def columns(self, x: Array) -> dict[str, Any]:
        """`values` of many vectors (n, p) at once, each (n, 1, 1): for `predict`."""
        return self.values(x[0]) | {
            name: (np.exp(column) if name in _LOGARITHMIC else column * _UNITS.get(name, 1.0))[:, None, None]
            for name, column in zip(self.names, x.T, strict=False)
        }

    def inertias(self, x: Array) -> Array:
        """J_l at each angle (kg·m²)."""
        return np.asarray(np.exp(x[len(self.names) :]))


@dataclass(frozen=True, eq=False)
class Points:
    """The fitted points of one angle, (m,), and what does not depend on the parameters; images (2·_IMAGES, m)."""

    response: ComplexArray
    std: Array  # of real and imaginary part each
    s: ComplexArray
    direct: ComplexArray  # S(s)·α
    images: ComplexArray
    image_torque: ComplexArray  # S(s_i)·α
    known: Array  # weight of the controller's points

    @property
    def held(self) -> bool:
        """The injection was a staircase."""
        return bool(self.images.size)


def points_of(response: Response) -> Points:
    """The points of a response that are good enough to be fitted."""
    used = response.used
    s = np.asarray(2j * np.pi * response.frequency_hz[used], dtype=np.complex128)
    measured, alpha = response.response[used], response.staircase[used]
    std = np.hypot(response.std[used], MODEL_SHARE * np.abs(measured)) / np.sqrt(2)
    none = np.empty((0, s.size), dtype=np.complex128)
    if not response.hold_s or not s.size:
        return Points(measured, std, s, np.zeros_like(s), none, none, np.zeros(s.size))
    orders = np.concatenate([np.arange(-_IMAGES, 0), np.arange(1, _IMAGES + 1)])
    images = np.asarray(s + 2j * np.pi * response.sample_rate_hz * orders[:, None])
    direct = staircase_gain(s, response.hold_s) * alpha
    share = np.maximum(np.abs(1 - direct), 1e-9)  # where the controller does little, little is known of it
    spread = std / np.abs(measured) * (1 + 1 / share)
    known = 1 / np.hypot(CONTROLLER_SHARE, spread)
    return Points(measured, std, s, direct, images, staircase_gain(images, response.hold_s) * alpha, known)


def mobility(p: Mapping[str, Any], inertia_kgm2: Any, s: ComplexArray) -> ComplexArray:
    """ω_r/T_m of two masses at s (1/s), any shape; stiffness inf: rigid. As `drivetrain.response`, for any s."""
    load = inertia_kgm2 * s + p["load_friction"]
    if np.all(np.isfinite(p["stiffness"])):
        coupling = p["damping"] * s + p["stiffness"]
        load = coupling * load / (coupling + load * s)
    return np.asarray(1 / (p["rotor"] * s + p["rotor_friction"] + load))


@dataclass(frozen=True, eq=False)
class Predicted:
    """Sampled speed over torque and the controller within the band, measured over described, (1, m) or (n, 1, m)."""

    response: ComplexArray
    controller: ComplexArray


def predict(d: Points, p: Mapping[str, Any], inertia_kgm2: Any) -> Predicted:
    """What the samples of these points should hold; parameters are numbers, or (n, 1, 1) of n machines."""
    plain = np.atleast_2d(mobility(p, inertia_kgm2, d.s) * np.exp(-d.s * p["delay"]))
    if not d.held:
        return Predicted(plain, np.ones_like(plain))
    g = mobility(p, inertia_kgm2, d.images)
    smear = np.maximum(p["gain_smear"] - p["smear"], 0.0)
    cascade = _cascade(p, d.images)
    acting = cascade * _filtered(d.images, p["gain_delay"] - p["lag"], smear)
    speed = g * d.image_torque / (1 + acting * g)
    seen = cascade * _filtered(d.images, p["gain_delay"], p["gain_smear"])
    reported = 1 - d.direct + np.sum(seen * speed, axis=-2, keepdims=True)
    folded = np.sum(d.s / d.images * np.exp(-d.images * p["delay"]) * speed, axis=-2, keepdims=True)
    unfiltered = np.exp(d.s * p["lag"] - d.s**2 * p["smear"] / 2)
    within = -reported / ((d.response - folded) * np.exp(d.s * p["delay"]))
    described = _cascade(p, d.s) * _filtered(d.s, p["gain_delay"], p["gain_smear"])
    return Predicted(plain * (d.direct + reported * unfiltered) + folded, within / described)


def _cascade(p: Mapping[str, Any], s: ComplexArray) -> ComplexArray:
    """The controller before its dead time and filters."""
    return np.asarray(p["gain"] * (1 + p["gain_rise"] / s + p["gain_sag"] / s**2))


def _filtered(s: ComplexArray, delay_s: Any, smear_s2: Any) -> ComplexArray:
    """A delay that is smeared."""
    return np.asarray(np.exp(s**2 * smear_s2 / 2 - s * delay_s))


def controller_start(data: list[Points]) -> dict[str, float]:
    """The controller at first sight, from low frequencies, where images are small; empty where nothing was held."""
    if not all(d.held for d in data):
        return {}
    parts = []
    for d in data:
        slow = slice(0, max(4, d.s.size // 2))
        parts.append((d.s[slow], -(1 - d.direct[slow]) / d.response[slow], d.known[slow]))
    s, ratio, weight = (np.concatenate(column) for column in zip(*parts, strict=True))
    # K (1 + rise/s + sag/s²) (1 − s·delay) to first order: linear in what is looked for
    terms = np.stack([np.ones_like(s), 1 / s, 1 / s**2, -s], axis=1) * weight[:, None]
    scale = np.linalg.norm(terms, axis=0)
    whole = np.vstack([(terms / scale).real, (terms / scale).imag])
    wanted = np.concatenate([(ratio * weight).real, (ratio * weight).imag])
    gain, rise, sag, delay = np.linalg.lstsq(whole, wanted, rcond=None)[0] / scale
    if not gain > 0:
        gain, rise, sag, delay = float(np.median(np.abs(ratio))), 0.0, 0.0, 0.0
    return {
        "gain": float(gain),
        "gain_rise": float(rise / gain),
        "gain_sag": float(sag / gain),
        "gain_delay": float(np.clip(delay / gain, 0.0, 2e-3)),
        "lag": 1e-4,
        "smear": 1e-9,
        "gain_smear": 1e-8,
    }
