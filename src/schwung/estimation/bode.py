"""Two masses fitted to measured responses: J_r, k, b and frictions shared by all angles, J_l at each of them.

Complex weighted least squares on speed over torque, over all angles at once (`bode_model.py` is what it is held
against). Delays have a weak prior about zero. Intervals come from the curvature, widened by the root of χ² per degree
of freedom where the model does not reach the noise.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from scipy.optimize import least_squares

from schwung.drivetrain import Machine
from schwung.errors import InputError
from schwung.estimation.bode_model import Points, Shape, controller_start, mobility, points_of, predict
from schwung.estimation.bode_values import AngleFit, BodeFit, Fitted, worded
from schwung.estimation.response import Response
from schwung.motion import Array

#: Prior standard deviation of the delays (s): a few cycles of any drive. Its square is that of a smear.
DELAY_PRIOR_S = 5e-4
#: Fewer points over all angles are no fit.
_FEWEST = 8
#: Another minimum whose χ² is larger by less than this may be the true one: the intervals reach there.
_NEARLY_AS_WELL = 50.0
#: It is another one where a parameter is so many standard deviations away.
_ELSEWHERE = 4.0


def fit_bode(responses: Sequence[Response], believed: Machine | None = None) -> BodeFit:
    """Fit all angles at once. `believed`: its values are tried as a start, too; none of them is trusted, but that of
    the motor inertia where nothing in the band shows a coupling.

    Raises InputError where fewer than eight points are good enough.
    """
    data = [points_of(r) for r in responses]
    points = sum(d.s.size for d in data)
    if points < _FEWEST or any(d.s.size == 0 for d in data):
        raise InputError(
            "response",
            f"has {points} points of enough coherence and low enough frequency",
            "Inject more torque, record longer or at more frequencies.",
        )
    held = all(d.held for d in data)
    flexible, rigid = Shape(True, held, len(data)), Shape(False, held, len(data))
    starts = [flexible.start(*start) for start in _starts(responses, data, believed)]
    tried = sorted((_solve(data, flexible, start, 1e-3) for start in starts), key=_cost)
    found = sorted((_solve(data, flexible, rough.x, 1e-6) for rough in tried[:_FOLLOWED]), key=_cost)
    two = _solve(data, flexible, found[0].x, 1e-9)
    one = _solve(data, rigid, rigid.start(*_rigid_start(responses, data)), 1e-9)
    # Schwarz' criterion: what is added has to earn its keep
    coupled = 2 * (one.cost - two.cost) > 3 * np.log(2 * points)
    shape, solved = (flexible, two) if coupled else (rigid, one)
    others = [np.asarray(f.x) for f in found if 2 * (f.cost - two.cost) < _NEARLY_AS_WELL] if coupled else []
    return _result(_Solved(responses, data, shape, np.asarray(solved.x), solved, others, believed))


def _cost(solution: Any) -> float:
    return float(solution.cost)


def _residuals(x: Array, data: Sequence[Points], shape: Shape) -> Array:
    """Real and imaginary parts over their standard deviation: responses of all angles, controller, priors."""
    return np.asarray(_rows(x[None, :], data, shape)[0])


def _rows(x: Array, data: Sequence[Points], shape: Shape) -> Array:
    """Residuals of many parameter vectors (n, p), (n, m)."""
    p = shape.columns(x)
    parts, others = [], []
    for d, inertia in zip(data, shape.inertias(x.T), strict=True):
        predicted = predict(d, p, inertia[:, None, None])
        off = (predicted.response[:, 0] - d.response) / d.std
        parts += [off.real, off.imag]
        if d.held:
            controller = (predicted.controller[:, 0] - 1) * d.known
            others += [controller.real, controller.imag]
    priors = p["delay"], p["lag"], p["smear"] / DELAY_PRIOR_S
    prior = [np.broadcast_to(value / DELAY_PRIOR_S, (len(x), 1, 1))[:, 0] for value in priors]
    return np.concatenate([*parts, *others, *prior], axis=1)


def _slopes(x: Array, data: Sequence[Points], shape: Shape, low: Array, high: Array) -> Array:
    """Derivatives of the residuals by the parameters, (m, p): differences as scipy takes them, all of them at once."""
    step = np.sqrt(np.finfo(float).eps) * np.where(x >= 0, 1.0, -1.0) * np.maximum(1.0, np.abs(x))
    step = np.where((x + step < low) | (x + step > high), -step, step)
    rows = _rows(np.vstack([x, x + np.diag(step)]), data, shape)
    return np.asarray((rows[1:] - rows[0]).T / ((x + step) - x))


def _solve(data: Sequence[Points], shape: Shape, start: Array, tolerance: float) -> Any:
    low, high = shape.bounds(start)
    inside = np.clip(start, low + 1e-9, high - 1e-9)

    def slopes(x: Array, data: Sequence[Points], shape: Shape) -> Array:
        return _slopes(x, data, shape, low, high)

    return least_squares(
        _residuals, inside, slopes, bounds=(low, high), args=(data, shape), x_scale="jac",
        xtol=tolerance, ftol=tolerance, gtol=tolerance, max_nfev=100,
    )  # fmt: skip


# ── start values ─────────────────────────────────────────────────────────────────────────────────────────────────

_Start = tuple[dict[str, float], Array]

#: What is tried: J_r as a share of the smallest sum of inertias, damping ratios of the coupling.
_ROTOR_SHARES = (0.02, 0.06, 0.15, 0.3, 0.6)
_DAMPING_RATIOS = (0.02, 0.1, 0.4)
#: So many of what they lead to are followed to the end: there are other minima.
_FOLLOWED = 10


def _starts(responses: Sequence[Response], data: list[Points], believed: Machine | None) -> list[_Start]:
    """From the shape of each response, and from the belief."""
    seen = [_seen(r) for r in responses]
    total = np.array([s.total_kgm2 for s in seen])
    low = np.array([s.anti_resonance_hz for s in seen])
    controller = controller_start(data)
    pairs = []
    for share in _ROTOR_SHARES:  # of the smallest sum; one of them puts the resonance about where it was seen
        rotor = share * float(total.min())
        pairs.append((rotor, float(np.median((total - rotor) * (2 * np.pi * low) ** 2))))
    if believed is not None and believed.coupling is not None:
        pairs.append((believed.motor.inertia_kgm2, believed.coupling.stiffness_nm_rad))
    starts: list[_Start] = []
    for rotor, stiffness in pairs:
        load = np.maximum(total - rotor, 0.05 * total)
        for ratio in _DAMPING_RATIOS:
            damping = 2 * ratio * float(np.sqrt(stiffness * min(rotor, float(load.min()))))
            coupling = {"rotor": rotor, "stiffness": stiffness, "damping": damping}
            starts.append((coupling | _friction(total) | controller, load))
    return starts


def _rigid_start(responses: Sequence[Response], data: list[Points]) -> _Start:
    total = np.array([_seen(r).total_kgm2 for r in responses])
    return _friction(total) | controller_start(data), total


def _friction(total_kgm2: Array) -> dict[str, float]:
    guess = 1e-3 * float(np.median(total_kgm2)) * 2 * np.pi * 10
    return {"rotor_friction": guess, "load_friction": guess}


@dataclass(frozen=True)
class _Seen:
    """What a response shows at first sight."""

    total_kgm2: float
    anti_resonance_hz: float


def _seen(response: Response) -> _Seen:
    """Total inertia from the lowest frequencies; where the apparent inertia |T/(ω s)| is largest, the load resists."""
    used = response.used
    f = response.frequency_hz[used]
    apparent = 1 / (np.abs(response.response[used]) * 2 * np.pi * f)
    total = float(np.median(apparent[: max(2, f.size // 8)]))
    largest = int(np.argmax(apparent))
    return _Seen(total, float(f[largest]) if largest > 0 else float(f[-1]))


# ── the result ───────────────────────────────────────────────────────────────────────────────────────────────────


@dataclass(frozen=True, eq=False)
class _Solved:
    """A solution and what it was found from."""

    responses: Sequence[Response]
    data: Sequence[Points]
    shape: Shape
    x: Array
    solution: Any
    others: Sequence[Array]  # further minima that are nearly as deep
    believed: Machine | None

    @property
    def chi2(self) -> float:
        """Of the responses alone, per degree of freedom."""
        residual = np.asarray(self.solution.fun)[: sum(2 * d.s.size for d in self.data)]
        return float(np.sum(residual**2)) / max(residual.size - self.x.size, 1)

    @property
    def believed_rotor_kgm2(self) -> float:
        """J_r as believed: rigid, only the sum is seen."""
        return self.believed.motor.inertia_kgm2 if self.believed is not None else 0.0

    @property
    def covariance(self) -> Array:
        """Of the parameters, widened where χ² says so."""
        jacobian = np.asarray(self.solution.jac)
        scale = np.maximum(np.linalg.norm(jacobian, axis=0), 1e-30)
        inverse = np.linalg.pinv((jacobian / scale).T @ (jacobian / scale)) / np.outer(scale, scale)
        return np.asarray((inverse + inverse.T) / 2 * max(self.chi2, 1.0))

    @property
    def ways(self) -> list[Array]:
        """To the other minima (n,), where a parameter of the machine is several standard deviations away there."""
        std = np.sqrt(np.diag(self.covariance))
        machine = np.r_[0:3, len(self.shape.names) : std.size]  # J_r, k, b and the inertias
        away = [other - self.x for other in self.others]
        return [way for way in away if np.any(np.abs(way[machine]) > _ELSEWHERE * std[machine])]


def _result(found: _Solved) -> BodeFit:
    shape, x, ways = found.shape, found.x, found.ways
    covariance = found.covariance + sum(np.outer(way, way) for way in ways)

    def fitted(of: Callable[[Array], float]) -> Fitted:
        return _propagated(of, x, covariance)

    def shared(name: str) -> Fitted:
        return fitted(lambda y: shape.values(y)[name])

    p, corrected = shape.values(x), []
    for response, d, inertia in zip(found.responses, found.data, shape.inertias(x), strict=True):
        whole = response.response.copy()
        plain = mobility(p, float(inertia), d.s)
        whole[response.used] = d.response * plain / predict(d, p, float(inertia)).response[0]
        corrected.append(whole)
    return worded(
        BodeFit(
            coupled=shape.coupled,
            rotor=shared("rotor") if shape.coupled else None,
            stiffness=shared("stiffness") if shape.coupled else None,
            damping=shared("damping") if shape.coupled else None,
            rotor_friction=shared("rotor_friction"),
            load_friction=shared("load_friction"),
            delay=shared("delay"),
            angles=tuple(
                _angle_fit(i, response.position_rad, found, fitted)
                for i, response in enumerate(found.responses)
            ),
            chi2=found.chi2,
            responses=tuple(found.responses),
            corrected=tuple(corrected),
            ambiguous=bool(ways),
            believed_rotor_kgm2=found.believed_rotor_kgm2,
        )
    )


def _angle_fit(
    i: int, position_rad: float, found: _Solved, fitted: Callable[[Callable[[Array], float]], Fitted]
) -> AngleFit:
    shape = found.shape

    def load(y: Array) -> float:
        return float(shape.inertias(y)[i])

    def anti_resonance(y: Array) -> float:
        return float(np.sqrt(shape.values(y)["stiffness"] / load(y)) / (2 * np.pi))

    def resonance(y: Array) -> float:
        p = shape.values(y)
        return float(np.sqrt(p["stiffness"] * (1 / p["rotor"] + 1 / load(y))) / (2 * np.pi))

    if not shape.coupled:  # only the sum is seen
        rest = fitted(lambda y: load(y) - found.believed_rotor_kgm2)
        return AngleFit(position_rad, rest, None, None)
    return AngleFit(position_rad, fitted(load), fitted(anti_resonance), fitted(resonance))


def _propagated(of: Callable[[Array], float], x: Array, covariance: Array) -> Fitted:
    """A quantity and its standard deviation, to first order; steps of a hundredth of each parameter's own."""
    steps = 0.01 * np.sqrt(np.diag(covariance)) + 1e-12
    gradient = np.array(
        [(of(x + step) - of(x - step)) / (2 * h) for h, step in zip(steps, np.diag(steps), strict=True)]
    )
    return Fitted(of(x), float(np.sqrt(gradient @ covariance @ gradient)))
