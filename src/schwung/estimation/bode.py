"""Two masses fitted to measured responses: J_r, k, b and frictions shared by all angles, J_l at each of them.

Complex weighted least squares on speed over torque. The model of a point is what the samples hold, images of a held
injection included: with α = a/T the staircase's share, T = S·a + c, s_i = j2π(f + i·f_s), K the controller's gain at
the images and L = K·G its loop there,

    ω/T = [ G(s) (S(s) α + c_0) + Σ_{i≠0} (s/s_i) G(s_i) S(s_i) α / (1 + L(s_i)) ] e^{−sτ}
    c_0 = (1 − S(s) α + Σ_{i≠0} K G(s_i) S(s_i) α / (1 + L(s_i))) e^{s·lag − s²·smear/2}

τ: the speed is reported late; lag and smear: the controller's torque is reported through a filter, of which they
are mean and variance. All three have a weak prior about zero. Intervals come
from the curvature, widened by the root of χ² per degree of freedom where the model does not reach the noise.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from scipy.optimize import least_squares

from schwung.drivetrain import Machine
from schwung.errors import InputError
from schwung.estimation.bode_values import AngleFit, BodeFit, Fitted, worded
from schwung.estimation.response import ComplexArray, Response, staircase_gain
from schwung.motion import Array

#: Images of the staircase that are counted on either side; what is left falls with the third power.
_IMAGES = 12
#: Prior standard deviation of the delays (s): a few cycles of any drive.
DELAY_PRIOR_S = 5e-4
#: The model's own error per point: a drive's sampling and quantisation are not in it.
MODEL_SHARE = 2e-3
#: Units of the delays within the fit: a tenth of a millisecond, and its square.
_DELAY_UNITS = {"delay": 1e-4, "lag": 1e-4, "smear": 1e-8}
#: Logarithms stay within this factor of the start values.
_FACTOR = np.log(50.0)


@dataclass(frozen=True, eq=False)
class _Data:
    """The fitted points of one angle, and what does not depend on the parameters."""

    response: ComplexArray
    weight: Array
    s: ComplexArray
    alpha: ComplexArray
    images: ComplexArray  # (2·_IMAGES, m), empty where the injection was not held
    hold_s: float
    gain_nms: float
    gain_delay_s: float


@dataclass(frozen=True)
class _Shape:
    """Which parameters there are: coupling or rigid, number of angles."""

    coupled: bool
    angles: int

    @property
    def names(self) -> tuple[str, ...]:
        """Of the shared parameters, in order; the angles' inertias follow."""
        coupled = ("rotor", "stiffness", "damping") if self.coupled else ()
        return (*coupled, "rotor_friction", "load_friction", "delay", "lag", "smear")

    @property
    def logarithmic(self) -> Array:
        """1 where the parameter is a logarithm, (n,)."""
        shared = [float(n in ("rotor", "stiffness", "damping")) for n in self.names]
        return np.array(shared + [1.0] * self.angles)


def mobility(
    s: ComplexArray,
    rotor_kgm2: float,
    rotor_friction_nms: float,
    stiffness_nm_rad: float,
    damping_nms: float,
    inertia_kgm2: float,
    load_friction_nms: float,
) -> ComplexArray:
    """ω_r/T_m of two masses at s (1/s), any shape; stiffness inf: rigid. As `drivetrain.response`, for any s."""
    load = inertia_kgm2 * s + load_friction_nms
    if np.isfinite(stiffness_nm_rad):
        coupling = damping_nms * s + stiffness_nm_rad
        load = coupling * load / (coupling + load * s)
    return np.asarray(1 / (rotor_kgm2 * s + rotor_friction_nms + load))


def fit_bode(responses: Sequence[Response], believed: Machine | None = None) -> BodeFit:
    """Fit all angles at once. `believed`: its values are tried as a start, too; none of them is trusted.

    Raises InputError where fewer than six points are good enough.
    """
    data = [_data(r) for r in responses]
    points = sum(d.s.size for d in data)
    if points < 6 or any(d.s.size == 0 for d in data):
        raise InputError(
            "response",
            f"has {points} points of enough coherence and low enough frequency",
            "Inject more torque, record longer or at more frequencies.",
        )
    flexible = min(
        (_solve(data, _Shape(True, len(data)), start) for start in _starts(responses, believed)),
        key=lambda solved: float(solved.cost),
    )
    rigid = _solve(data, _Shape(False, len(data)), _rigid_start(responses))
    # Schwarz' criterion: three more parameters have to earn their keep
    coupled = 2 * (rigid.cost - flexible.cost) > 3 * np.log(2 * points)
    return _result(responses, data, flexible if coupled else rigid, bool(coupled), believed)


def _data(response: Response) -> _Data:
    used = response.used
    s = np.asarray(2j * np.pi * response.frequency_hz[used], dtype=np.complex128)
    alpha, measured = response.staircase[used], response.response[used]
    std = np.hypot(response.std[used], MODEL_SHARE * np.abs(measured)) / np.sqrt(2)
    hold = response.hold_s or 0.0
    images = np.empty((0, s.size), dtype=np.complex128)
    gain = delay = 0.0
    if hold and s.size:
        orders = np.concatenate([np.arange(-_IMAGES, 0), np.arange(1, _IMAGES + 1)])
        images = s + 2j * np.pi * response.sample_rate_hz * orders[:, None]
        controller = -(1 - staircase_gain(s, hold) * alpha) / measured  # c = −K ω
        fast = s.imag >= np.median(s.imag)
        gain = float(np.median(np.abs(controller[fast])))
        delay = float(np.median(-np.angle(controller[fast]) / s.imag[fast]))
    return _Data(measured, 1 / std, s, alpha, images, hold, gain, delay)


def _named(x: Array, shape: _Shape) -> dict[str, float]:
    """Shared parameters in SI units."""
    p = {name: float(value) for name, value in zip(shape.names, x, strict=False)}
    if shape.coupled:
        p |= {name: float(np.exp(p[name])) for name in ("rotor", "stiffness", "damping")}
    else:
        p |= {"rotor": 0.0, "stiffness": np.inf, "damping": 0.0}
    return p | {name: p[name] * unit for name, unit in _DELAY_UNITS.items()}


def _predict(d: _Data, p: dict[str, float], inertia: float) -> ComplexArray:
    """Speed over torque as sampled, (m,)."""

    def g(s: ComplexArray) -> ComplexArray:
        return mobility(
            s, p["rotor"], p["rotor_friction"], p["stiffness"], p["damping"], inertia, p["load_friction"]
        )

    late = np.exp(-d.s * p["delay"])
    if not d.images.size:
        return np.asarray(g(d.s) * late)
    direct = staircase_gain(d.s, d.hold_s) * d.alpha
    image_gain = g(d.images)
    seen = d.gain_nms * np.exp(-d.images * d.gain_delay_s)  # controller from speed to torque as reported
    injected = image_gain * staircase_gain(d.images, d.hold_s) * d.alpha
    speed = injected / (1 + seen * np.exp(d.images * p["lag"]) * image_gain)
    unfiltered = np.exp(d.s * p["lag"] - d.s**2 * p["smear"] / 2)
    controller = (1 - direct + np.sum(seen * speed, axis=0)) * unfiltered
    folded = np.sum(d.s / d.images * speed * np.exp(-d.images * p["delay"]), axis=0)
    return np.asarray(g(d.s) * (direct + controller) * late + folded)


def _residuals(x: Array, data: Sequence[_Data], shape: _Shape) -> Array:
    p, shared = _named(x, shape), len(shape.names)
    parts = []
    for d, load in zip(data, x[shared:], strict=True):
        off = (_predict(d, p, float(np.exp(load))) - d.response) * d.weight
        parts += [off.real, off.imag]
    return np.concatenate([*parts, _beliefs(p)])


def _beliefs(p: dict[str, float]) -> Array:
    """Residuals of the priors: the delays are about zero."""
    return np.array([p["delay"], p["lag"], p["smear"] / DELAY_PRIOR_S]) / DELAY_PRIOR_S


def _solve(data: Sequence[_Data], shape: _Shape, start: Array) -> Any:
    logs = shape.logarithmic.astype(bool)
    positive = [name.endswith("friction") or name == "smear" for name in shape.names]
    low = np.where(logs, start - _FACTOR, np.where(positive + [False] * shape.angles, 0.0, -np.inf))
    high = np.where(logs, start + _FACTOR, np.inf)
    return least_squares(
        _residuals, start, bounds=(low, high), args=(data, shape), x_scale="jac", xtol=1e-11, ftol=1e-11
    )


def _starts(responses: Sequence[Response], believed: Machine | None) -> list[Array]:
    """Start values: from the shape of each response, and from the belief."""
    seen = [_seen(r) for r in responses]
    total = np.array([s.total_kgm2 for s in seen])
    starts = []
    for wide in (1.0, 3.0):  # the resonance may lie beyond the band: then it is taken above it
        low = np.array([s.anti_resonance_hz for s in seen])
        high = np.maximum(np.array([s.resonance_hz for s in seen]) * wide, 1.2 * low)
        rotor = float(np.median(total * (low / high) ** 2))
        load = np.maximum(total - rotor, 0.05 * total)
        stiffness = float(np.median(load * (2 * np.pi * low) ** 2))
        starts.append(_start(rotor, stiffness, load, total))
    if believed is not None and believed.coupling is not None:
        rotor, stiffness = believed.motor.inertia_kgm2, believed.coupling.stiffness_nm_rad
        starts.append(_start(rotor, stiffness, np.maximum(total - rotor, 0.05 * total), total))
    return starts


def _start(rotor: float, stiffness: float, load: Array, total: Array) -> Array:
    damping = 0.05 * 2 * np.sqrt(stiffness * min(rotor, float(load.min())))
    friction = 1e-3 * float(np.median(total)) * 2 * np.pi * 10
    shared = [np.log(rotor), np.log(stiffness), np.log(damping), friction, friction, 0.0, 0.0, 0.1]
    return np.concatenate([shared, np.log(load)])


def _rigid_start(responses: Sequence[Response]) -> Array:
    total = np.array([_seen(r).total_kgm2 for r in responses])
    friction = 1e-3 * float(np.median(total)) * 2 * np.pi * 10
    return np.concatenate([[friction, friction, 0.0, 0.0, 0.1], np.log(total)])


@dataclass(frozen=True)
class _Seen:
    """What a response shows at first sight."""

    total_kgm2: float
    anti_resonance_hz: float
    resonance_hz: float


def _seen(response: Response) -> _Seen:
    """Total inertia from the lowest frequencies; extremes of the apparent inertia |T/(ω s)| above them."""
    used = response.used
    f = response.frequency_hz[used]
    apparent = 1 / (np.abs(response.response[used]) * 2 * np.pi * f)
    total = float(np.median(apparent[: max(2, f.size // 5)]))
    low = int(np.argmax(apparent))
    high = low + int(np.argmin(apparent[low:]))
    if low == 0:  # no peak: the anti-resonance lies below or above the band
        return _Seen(total, float(f[-1]), 2 * float(f[-1]))
    return _Seen(total, float(f[low]), float(f[max(high, min(low + 1, f.size - 1))]))


def _result(
    responses: Sequence[Response],
    data: Sequence[_Data],
    solved: Any,
    coupled: bool,
    believed: Machine | None,
) -> BodeFit:
    shape = _Shape(coupled, len(data))
    x, shared = np.asarray(solved.x), len(shape.names)
    residual = np.asarray(solved.fun)
    priors = len(_DELAY_UNITS)
    freedom = max(residual.size - priors - x.size, 1)
    chi2 = float(np.sum(residual[:-priors] ** 2)) / freedom
    jacobian = np.asarray(solved.jac)
    covariance = np.linalg.pinv(jacobian.T @ jacobian) * max(chi2, 1.0)
    covariance = (covariance + covariance.T) / 2
    p = _named(x, shape)

    def fitted(of: Callable[[Array], float]) -> Fitted:
        return propagated(of, x, covariance)

    def shared_value(name: str) -> Fitted:
        return fitted(lambda y: _named(y, shape)[name])

    angles, corrected = [], []
    for i, (response, d) in enumerate(zip(responses, data, strict=True)):
        inertia = float(np.exp(x[shared + i]))
        model = mobility(
            d.s, p["rotor"], p["rotor_friction"], p["stiffness"], p["damping"], inertia, p["load_friction"]
        )
        whole = response.response.copy()
        whole[response.used] = d.response * model / _predict(d, p, inertia)
        corrected.append(whole)
        angles.append(_angle_fit(i, response, shape, fitted, believed))
    return worded(
        BodeFit(
            coupled=coupled,
            rotor=shared_value("rotor") if coupled else None,
            stiffness=shared_value("stiffness") if coupled else None,
            damping=shared_value("damping") if coupled else None,
            rotor_friction=shared_value("rotor_friction"),
            load_friction=shared_value("load_friction"),
            delay=shared_value("delay"),
            angles=tuple(angles),
            chi2=chi2,
            responses=tuple(responses),
            corrected=tuple(corrected),
        )
    )


def _angle_fit(
    i: int,
    response: Response,
    shape: _Shape,
    fitted: Callable[[Callable[[Array], float]], Fitted],
    believed: Machine | None,
) -> AngleFit:
    def load(y: Array) -> float:
        return float(np.exp(y[len(shape.names) + i]))

    if not shape.coupled:  # only the sum is seen
        rotor = believed.motor.inertia_kgm2 if believed is not None else 0.0
        return AngleFit(response.position_rad, fitted(lambda y: load(y) - rotor), None, None)

    def anti_resonance(y: Array) -> float:
        return float(np.sqrt(_named(y, shape)["stiffness"] / load(y)) / (2 * np.pi))

    def resonance(y: Array) -> float:
        p = _named(y, shape)
        return float(np.sqrt(p["stiffness"] * (1 / p["rotor"] + 1 / load(y))) / (2 * np.pi))

    return AngleFit(response.position_rad, fitted(load), fitted(anti_resonance), fitted(resonance))


def propagated(of: Callable[[Array], float], x: Array, covariance: Array) -> Fitted:
    """A quantity and its standard deviation, to first order; steps of a hundredth of each parameter's own."""
    steps = 0.01 * np.sqrt(np.diag(covariance)) + 1e-12
    gradient = np.array(
        [(of(x + step) - of(x - step)) / (2 * h) for h, step in zip(steps, np.diag(steps), strict=True)]
    )
    return Fitted(of(x), float(np.sqrt(gradient @ covariance @ gradient)))
