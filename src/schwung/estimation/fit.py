"""One curve J_l(θ) from the ripples of a session: all groups and repeats, each with the weight it deserves."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from schwung.drivetrain.machine import Machine
from schwung.errors import InputError
from schwung.estimation.balance import Balance, Basis, Equations, LoadSide, load_side
from schwung.estimation.pull import pulls
from schwung.estimation.ripple import Ripple
from schwung.estimation.sdft import ComplexArray
from schwung.estimation.solve import Solution, solve
from schwung.motion import Array

#: What nobody would leave out of a machine file: friction of this share of the peak torque (at top speed).
FRICTION_SHARE = 0.1
#: Solutions in a row: the later ones know the weights and how the load answers to friction and delay.
ROUNDS = 3
#: Noise is taken as even over so wide a part of the band, as a share of the injected frequency (standard deviation).
EVEN = 0.25
#: An inertia positive over this share of the angles, and torque explained to this share, make a machine.
MOSTLY = 0.9
#: No machine leaves the phase between torque and speed more open than this.
MAX_PHASE_STD_RAD = 0.05
#: From this share of its amplitude on an injection says something.
INJECTED = 0.1
#: The share of its amplitude that a torque without lag may have lost to a filter.
NO_LOSS = 1e-6


@dataclass(frozen=True)
class Nuisance:
    """What the fit found beside J_l: a value and its standard deviation."""

    value: float
    std: float

    @property
    def clear(self) -> bool:
        """Whether it stands clear of the noise."""
        return abs(self.value) > 4 * self.std


NOTHING = Nuisance(0.0, 0.0)


@dataclass(frozen=True, eq=False)
class CurveFit:
    """J_l over the load angle with its covariance; `loads` are the ripples' load sides, in order."""

    basis: Basis
    solution: Solution
    loads: tuple[LoadSide, ...]
    ripples: tuple[Ripple, ...]
    viscous_nms: Nuisance  # of the motor, beyond the machine file
    dry_nm: Nuisance
    delay_s: Nuisance  # of speed (and angle) behind torque, or behind the injection alone where that is held
    unexplained_share: float  # of the power of the load's driving torque in the band
    pulls: tuple[Array, ...]  # dT_l/dθ along each load's motion (N·m/rad), (n,)

    @property
    def physical(self) -> bool:
        """Whether torque and speed belong together: a positive inertia, of which the phase is sure as well, explains
        most of the torque.
        """
        positive = float(np.mean(self.solution.coefficients > 0)) > MOSTLY
        turned = 2 * np.pi * max(ripple.frequency_hz for ripple in self.ripples) * self.delay_s.std
        return positive and self.unexplained_share < 1 - MOSTLY and turned < MAX_PHASE_STD_RAD

    def inertia_at(self, angle_rad: Array, derivative: int = 0) -> Array:
        """J_l (kg·m²) or its derivatives by angle, (n,)."""
        values: Array = np.matmul(self.basis.at(angle_rad, derivative), self.solution.coefficients)
        return values

    def std_at(self, angle_rad: Array) -> Array:
        """Standard deviation of J_l (kg·m²), (n,): noise and what the roughness prior leaves open."""
        basis, size = self.basis.at(angle_rad), self.basis.size
        variance = np.einsum("ij,jk,ik->i", basis, self.solution.covariance[:size, :size], basis)
        return np.asarray(np.sqrt(np.maximum(variance, 0.0)))

    def passed(self, angle_rad: Array) -> NDArray[np.bool_]:
        """Whether the load passed each of the uniform angles (n,) while the injection was on: else what the curve
        says there is its smoothness alone.
        """
        reach = float(angle_rad[1] - angle_rad[0])
        result = np.zeros(angle_rad.size, dtype=bool)
        for load, ripple in zip(self.loads, self.ripples, strict=True):
            excitation = ripple.runs[0].excitation
            assert excitation is not None  # guaranteed by Run
            on = excitation.envelope(ripple.time_s) >= INJECTED
            steps = np.abs(np.gradient(load.angle_rad))
            at, near = load.angle_rad[on], np.maximum(steps[on], reach)
            for number, angle in enumerate(angle_rad):
                result[number] |= bool(np.any(np.abs(at - angle) <= near))
        return result

    def unexplained(self, number: int) -> ComplexArray:
        """What the torque of one ripple leaves over, N·m, (n,)."""
        load, ripple = self.loads[number], self.ripples[number]
        rate = ripple.sample_rate_hz
        inertia, slope, bend = (self.inertia_at(load.angle_rad, order) for order in range(3))
        turning = bend * load.speed_rad_s**2 / 2 + slope * load.acceleration_rad_s2
        known = slice(0, self.solution.nuisances.size)
        spoiled = load.spoilers[:, known] @ self.solution.nuisances
        wind_up = load.spoilers_wind_up[:, known] @ self.solution.nuisances
        rate_of_wind_up = load.spoilers_wind_up_rate[:, known] @ self.solution.nuisances
        momentum = np.gradient(inertia * (load.ripple_speed_rad_s + rate_of_wind_up), 1 / rate)
        turned = turning * (load.ripple_angle_rad + wind_up)
        sprung = self.pulls[number] * load.ripple_angle_rad
        return np.asarray(load.driving_torque_nm + sprung - spoiled - momentum - turned)


def fit_curve(ripples: Sequence[Ripple], machine: Machine) -> CurveFit:
    """Fit J_l(θ), friction and delay to all ripples together.

    Each equation is weighted by the noise floors first, then by what its neighbours in frequency left unexplained:
    neither counts of an encoder nor what the model leaves out make noise of the colour that floors tell of.

    Where the injection is held, the delay is its own; the controller's share is as late as it was found before.

    What the drive's filter took off the torque, or how late the controller's share is reported, is not fitted, as the
    curve can make up for it: what little the balance seems to say of it is noise that meets itself. As far as it is
    unknown it widens the band (Schmidt's "considered").

    Raises InputError where a ripple holds no torque or no motion.
    """
    for ripple in ripples:
        if not (
            np.any(ripple.ripple_torque_nm) and np.any(ripple.ripple_speed_rad_s + ripple.ripple_position_rad)
        ):
            raise InputError(
                ripple.name,
                "holds no ripple: torque or speed do not answer to the injection at all",
                "See whether the drive applies the injection, and whether both signals are recorded.",
            )
    loads = tuple(load_side(ripple, machine) for ripple in ripples)
    low = min(float(load.angle_rad.min()) for load in loads)
    high = max(float(load.angle_rad.max()) for load in loads)
    basis = Basis(low, max(high, low + 1e-9))
    top_speed = max(float(np.max(np.abs(load.speed_rad_s))) for load in loads)
    peak = FRICTION_SHARE * machine.motor.peak_torque_nm
    slowest = 2 * np.pi * min(ripple.frequency_hz for ripple in ripples)
    loss = max(*(ripple.loss_std_s2 for ripple in ripples), NO_LOSS / slowest**2)
    late = max(ripple.controller_std_s for ripple in ripples)
    prior = np.array([peak / max(top_speed, 1e-9), peak, 1 / slowest])
    balances = [Balance.of(load, ripple, basis) for load, ripple in zip(loads, ripples, strict=True)]
    weights = [np.ones(2 * load.frequencies.size) for load in loads]
    solution: Solution | None = None
    sprung: list[Array] = [np.zeros(load.angle_rad.size) for load in loads]
    for _ in range(ROUNDS):
        curve = None
        if solution is not None:
            curve = solution.coefficients
            sprung = pulls(loads, ripples, _inertia_of(basis, curve), machine)
        parts = [
            balance.equations(curve, pull).scaled(weight)
            for balance, pull, weight in zip(balances, sprung, weights, strict=True)
        ]
        solution = _solve(parts, prior, np.array([loss, late]))
        ends = np.cumsum([part.y.size for part in parts])[:-1]
        weights = [
            weight / _spread(rest, 1 - followed, load.frequencies / ripple.frequency_hz)
            for weight, rest, followed, load, ripple in zip(
                weights, np.split(solution.residual, ends), np.split(solution.leverage, ends), loads, ripples,
                strict=True,
            )
        ]  # fmt: skip
    assert solution is not None  # ROUNDS is positive
    std = np.sqrt(np.diag(solution.covariance)[basis.size :])
    power = float(np.sum(np.concatenate([part.y for part in parts]) ** 2))
    share = float(np.sum(solution.residual**2)) / max(power, 1e-300)
    viscous, dry, delay = (Nuisance(float(v), float(s)) for v, s in zip(solution.nuisances, std, strict=True))
    return CurveFit(basis, solution, loads, tuple(ripples), viscous, dry, delay, share, tuple(sprung))


def _inertia_of(basis: Basis, curve: Array) -> Callable[[Array, int], Array]:
    def at(angle_rad: Array, derivative: int) -> Array:
        return np.asarray(basis.at(angle_rad, derivative) @ curve)

    return at


def _spread(residual: Array, free: Array, frequency: Array) -> Array:
    """Standard deviation of the noise around each row, (2n,): of real and imaginary parts at n frequencies.

    `free`: the share of each row's noise that is left in its residual.
    """
    near = np.exp(-(((frequency[:, None] - frequency) / EVEN) ** 2) / 2)
    squares, degrees = (values.reshape(2, -1).sum(0) for values in (residual**2, free))
    spread = np.sqrt((near @ squares) / np.maximum(near @ degrees, 1e-300))
    return np.tile(np.maximum(spread, 1e-12), 2)


def _solve(parts: Sequence[Equations], prior: Array, considered: Array) -> Solution:
    width = max(part.nuisance.shape[1] for part in parts)
    every = [np.pad(part.nuisance, ((0, 0), (0, width - part.nuisance.shape[1]))) for part in parts]
    fitted, others = np.split(np.vstack(every), [prior.size], axis=1)
    return solve(
        np.vstack([part.inertia for part in parts]),
        fitted,
        np.concatenate([part.y for part in parts]),
        prior,
        considered=others * considered[: others.shape[1]],
    )
