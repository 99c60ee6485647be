"""What causes of torque, and errors of what is reported, add to the innovations of a run.

To first order in its coefficients any cause is a torque on the motor, a torque on the load, and an error of the
reported angle and speed, all along the run's smoothed states: another stiffness is k·twist between both, another
inertia −δJ·α on the load, a late speed −δt·α in the speed's samples.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from schwung.innovations import kernel
from schwung.innovations.likelihood import Equations, Noise, problem_of
from schwung.innovations.signals import Signals
from schwung.innovations.steps import Steps
from schwung.motion import Array


@dataclass(frozen=True, eq=False)
class Effect:
    """What a unit of each of p coefficients adds along one run, (n, p) each; None: nothing."""

    on_motor: Array | None = None  # N·m
    on_load: Array | None = None
    position: Array | None = None  # rad, of the reported angle
    speed: Array | None = None  # rad/s, of the reported speed

    @property
    def parts(self) -> tuple[Array | None, ...]:
        """The four, in their order."""
        return self.on_motor, self.on_load, self.position, self.speed

    @property
    def count(self) -> int:
        """p."""
        return next(int(part.shape[1]) for part in self.parts if part is not None)

    def of(self, coefficients: Array) -> tuple[Array | float, Array | float, Array | float, Array | float]:
        """The four with these coefficients (p,), summed, (n,) each; 0.0: nothing."""
        motor, load, position, speed = (
            0.0 if part is None else np.asarray(part @ coefficients) for part in self.parts
        )
        return motor, load, position, speed


def joined(effects: Sequence[Effect], samples: int) -> Effect:
    """Side by side, in their order; (samples, Σp) each."""
    sides = []
    for which in range(4):
        each = [effect.parts[which] for effect in effects]
        counts = [effect.count for effect in effects]
        sides.append(
            np.concatenate(
                [np.zeros((samples, p)) if one is None else one for one, p in zip(each, counts, strict=True)],
                axis=1,
            )
        )
    return Effect(*sides)


@dataclass(frozen=True, eq=False)
class Passed:
    """One run, filtered: what effects are whitened by."""

    equations: Equations
    steps: Steps
    result: kernel.Filtered

    @classmethod
    def of(cls, equations: Equations, steps: Steps, noise: Noise, run: Signals) -> Passed:
        """Filter a run."""
        return cls(equations, steps, kernel.filtered(problem_of(equations, noise, run)))

    @property
    def innovations(self) -> Array:
        """Angle's and speed's in turn, white with deviation 1 where the model holds, (2n,)."""
        return np.asarray(self.result.error / np.sqrt(self.result.variance)).reshape(-1)

    @property
    def deviance(self) -> float:
        """−2 log likelihood of the run, but for a constant."""
        return float(np.sum(np.log(self.result.variance)) + self.innovations @ self.innovations)

    def states(self) -> Array:
        """Smoothed ones, (n, s), and the torque's error (N·m) behind them."""
        return np.asarray(kernel.smoothed(self.equations.transition, self.result))

    def whitened(self, effect: Effect) -> Array:
        """An effect as the innovations show it, (2n, p): filtered alike, over their deviation."""
        size, count = self.steps.transition.shape[1], effect.count
        samples = self.result.error.shape[0]
        made = np.zeros((samples - 1, size + 1, count))
        for shaft, torque in enumerate((effect.on_motor, effect.on_load)):
            if torque is not None:
                start, end = self.steps.inputs[:, :, shaft], self.steps.inputs[:, :, 2 + shaft]
                acting = np.any(torque, axis=0)
                alone = torque if acting.all() else torque[:, acting]
                part = np.zeros((samples - 1, size, alone.shape[1]))
                kernel.add_outer(part, start, alone[:-1])
                kernel.add_outer(part, end, alone[1:])
                made[:, :size, acting] += part
        reported = np.zeros((samples, 2, count))
        for which, error in enumerate((effect.position, effect.speed)):
            if error is not None:
                reported[:, which] = error
        return np.asarray(kernel.whitened(self.equations.transition, self.result, made, reported))
