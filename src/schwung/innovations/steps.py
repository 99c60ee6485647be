"""Exact steps of a run about its states, and their derivatives."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from schwung.errors import InputError
from schwung.innovations import step_kernel
from schwung.innovations.held import early_moments
from schwung.innovations.signals import Signals
from schwung.innovations.splines import interpolated
from schwung.innovations.values import Shaft
from schwung.motion import Array

#: Inertias at which a step is worked out; between them it is interpolated (relative error below 1e-7).
_NODES = 32
#: Shares of a step at which what is within is worked out, and their weights in its mean by Boole's rule, ends apart.
WITHIN, _MEAN = np.array([[0.25], [0.5], [0.75]]), np.array([32.0, 12.0, 32.0]) / 90
_NO_PART = 1e-9  # share of a step that is none
_DIFFERENCE = 1e-4  # of log k and log b, for their sensitivities


@dataclass(frozen=True, eq=False)
class Steps:
    """Every step of a run, which depends on the load inertia alone: state⁺ = Φ state + inputs · torques.

    `torques`: at start, at end, and the height of a parabola between, on motor and load each. The derivatives hold
    Φ and inputs side by side, (m, s, s + 6).
    """

    transition: Array  # (m, s, s)
    inputs: Array  # (m, s, 6)
    by_inertia: Array  # ∂/∂ log J_l
    by_stiffness: Array  # ∂/∂ log k
    by_damping: Array

    @property
    def whole(self) -> Array:
        """Φ and inputs side by side, (m, s, s + 6)."""
        return np.concatenate([self.transition, self.inputs], axis=2)

    @classmethod
    def of(cls, shaft: Shaft, inertia: Array, step_s: float, *, slopes: bool) -> Steps:
        """Steps of the given inertias (m,); without `slopes` the derivatives are empty.

        Raises InputError where the numbers run away, as a fit's do to signals that belong to no such machine.
        """
        logs = np.log(inertia)
        nodes = np.linspace(logs.min() - 1e-3, logs.max() + 1e-3, _NODES)

        def table(which: Shaft) -> Array:
            return np.asarray(step_kernel.steps(which, np.exp(nodes), step_s))

        def by(name: str) -> Array:
            ends = [
                table(shaft._replace(**{name: getattr(shaft, name) * np.exp(d)}))
                for d in (_DIFFERENCE, -_DIFFERENCE)
            ]
            return at((ends[0] - ends[1]) / (2 * _DIFFERENCE))

        def at(values: Array) -> Array:
            return interpolated(values, nodes[0], nodes[1] - nodes[0], logs)

        stepped = table(shaft)
        if not np.all(np.isfinite(stepped)):
            raise no_such_machine()
        transition, inputs = np.split(at(stepped), [-6], axis=2)
        none = np.empty(0)
        if not slopes:
            return cls(transition, inputs, none, none, none)
        by_inertia = interpolated(stepped, nodes[0], nodes[1] - nodes[0], logs, 1)
        if shaft.rigid:
            none = np.zeros_like(by_inertia)
            return cls(transition, inputs, by_inertia, none, none)
        return cls(transition, inputs, by_inertia, by("stiffness"), by("damping"))

    @classmethod
    def of_each(cls, shaft: Shaft, coupling: Array, inertia: Array, step_s: float) -> Steps:
        """Steps of a coupling whose stiffness and damping (m, 2) are others in each, exactly; without derivatives."""
        transition, inputs = np.split(
            step_kernel.steps_of_each(shaft, coupling, inertia, step_s), [-6], axis=2
        )
        none = np.empty(0)
        return cls(transition, inputs, none, none, none)

    def early(self, shaft: Shaft, coupling: Array, inertia: Array, step_s: float, share: float) -> Array:
        """What a torque of one on the motor does over the first `share` of each step, (m, s), less what the parabola of
        its moments does (`Drive.taken`). `coupling`: stiffness and damping, of all (2,) or of each (m, 2).

        A resonance at a third of the sampling rate answers a corner in the middle of a step by a hundredth more.
        """

        def part(length_s: float) -> Steps:
            if coupling.ndim > 1:
                return Steps.of_each(shaft, coupling, inertia, length_s)
            return Steps.of(shaft, inertia, length_s, slopes=False)

        if min(share, 1 - share) < _NO_PART:
            return np.zeros(self.inputs.shape[:2])
        first, rest = part(share * step_s).inputs, part((1 - share) * step_s).transition
        exact = np.einsum("kst,kt->ks", rest, first[:, :, 0] + first[:, :, 2])
        return np.asarray(exact - self.inputs[:, :, 0::2] @ early_moments(share))

    def added(self, nodes: Array, shaft: int) -> Array:
        """What torques at the samples (n, c) add to each step, (n − 1, s, c); `shaft` 0: motor, 1: load."""
        start, end = self.inputs[:, :, shaft], self.inputs[:, :, 2 + shaft]
        return np.asarray(start[:, :, None] * nodes[:-1, None, :] + end[:, :, None] * nodes[1:, None, :])


def off_middle(inertia: Array, run: Signals) -> tuple[Array, Array, Array]:
    """Torque taken by what the inertia differs from that of the middle of each step, (J − J_m) dω_l/dt:
    at the start of each step, at its end, and its height over the straight line between them; (n − 1,) each.
    """
    accelerated = run.load_acceleration
    half = np.diff(inertia) / 2
    middle = (accelerated[1:] + accelerated[:-1]) / 2
    return (
        -half * accelerated[:-1],
        half * accelerated[1:],
        bulge(inertia) * middle - half * np.diff(accelerated) / 2,
    )


def bulge(values: Array, ends: Array | None = None) -> Array:
    """Height over the straight line of a smooth curve in the middle between samples (n,), (n − 1,).

    `ends`: where curves begin and end, of which there are several one behind another; None: there is one.
    """
    bend = np.zeros_like(values)
    bend[1:-1] = values[2:] - 2 * values[1:-1] + values[:-2]
    if ends is not None:
        bend[ends] = 0.0
    return np.asarray(-(bend[1:] + bend[:-1]) / 16)


def straight(start: Array, end: Array) -> Array:
    """Within steps that begin and end with these (m,), (3, m)."""
    return np.asarray(start * (1 - WITHIN) + end * WITHIN)


def smoothly(values: Array, ends: Array | None = None) -> Array:
    """Within the steps between samples (n,) of a smooth curve, (3, n − 1); `ends`: see `bulge`."""
    return np.asarray(straight(values[:-1], values[1:]) + 4 * WITHIN * (1 - WITHIN) * bulge(values, ends))


def sloping(values: Array, slopes: Array, step_s: Array | float) -> Array:
    """The same of a curve whose slopes are known (Hermite's cubic); `step_s`: of each step, or of all."""
    x, y = WITHIN, 1 - WITHIN
    ends = y**2 * (1 + 2 * x) * values[:-1] + x**2 * (1 + 2 * y) * values[1:]
    return np.asarray(ends + step_s * x * y * (y * slopes[:-1] - x * slopes[1:]))


def height_of(off: Array) -> Array:
    """Height of the parabola over a step whose mean is that of what is off the straight line within it, (3, m) -> (m,):
    it is momentum that counts.
    """
    return np.asarray(1.5 * (_MEAN @ off))


def no_such_machine() -> InputError:
    """What is said where the numbers run away."""
    return InputError(
        "torque and speed",
        "no inertia, friction and coupling make the one of the other",
        "Check the units of torque and speed, and motor.inertia in the machine file.",
    )
