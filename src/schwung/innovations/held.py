"""A torque that a bus sends once a sample and a drive holds until it takes the next, then or a little later."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np
from scipy.interpolate import CubicSpline

from schwung.motion import Array


def early_moments(share: float) -> Array:
    """A torque of one over the first `share` of a step as it is at the step's start, at its end, and the height of the
    parabola between, (3,): its projection on Legendre's polynomials of the step."""
    mean, tilt, bend = share, 3 * (share**2 - share), 5 * (2 * share**3 - 3 * share**2 + share)
    return np.array([mean - tilt + bend, mean + tilt + bend, -1.5 * bend])


def early_moments_slope(share: float) -> Array:
    """What that changes by for each share that there is more, (3,)."""
    tilt, bend = 3 * (2 * share - 1), 5 * (6 * share**2 - 6 * share + 1)
    return np.array([1 - tilt + bend, 1 + tilt + bend, -1.5 * bend])


def corners(u: float) -> tuple[float, float]:
    """Bernoulli's polynomials B₂ and B₃ at the share u of a step.

    A staircase whose steps rise by ΔT (and that by Δ²T) lies above the curve that has its means by ½ − u of ΔT and
    ½ B₂(u) of Δ²T. An inertia J that it drives is faster than that curve makes it by −h/J (½ B₂(u) ΔT − ⅓ B₃(u) Δ²T).
    """
    return u**2 - u + 1 / 6, u**3 - 1.5 * u**2 + 0.5 * u


@dataclass(frozen=True, eq=False)
class Held:
    """Of one run: what is sent at each sample (n,) but the last for the step behind it, (n − 1,)."""

    time_s: Array
    torque_nm: Array

    @cached_property
    def is_any(self) -> bool:
        """Whether there is any."""
        return bool(self.torque_nm.any())

    def curve(self, late_s: float) -> Array:
        """Smooth, through the middles of its steps, where they are so much later, at the samples, (n,)."""
        if not self.is_any:
            return np.zeros_like(self.time_s)
        spline = self._spline
        return np.asarray(spline(np.clip(self.time_s - late_s, spline.x[0], spline.x[-1])))

    @cached_property
    def _spline(self) -> CubicSpline:
        return CubicSpline((self.time_s[1:] + self.time_s[:-1]) / 2, self.torque_nm)

    def changes(self, late_s: float) -> tuple[float, Array]:
        """At what share of each step it changes where it is taken so much later, and by how much (N·m), (n − 1,)."""
        share, now, before = self._around(late_s)
        return share, now - before

    def over_steps(self, late_s: float) -> Array:
        """Taken so much later: over each step at its start, at its end, and the height of the parabola between that has
        the step's moments, (n − 1, 3)."""
        share, now, before = self._around(late_s)
        return np.stack([now, now, np.zeros_like(now)], axis=1) - np.outer(now - before, early_moments(share))

    def slope(self, late_s: float) -> Array:
        """What changes of that in a step's time, (n − 1, 3); where it is taken at a sample, if it is taken later."""
        share, now, before = self._around(late_s)
        return -np.outer(now - before, early_moments_slope(share))

    @property
    def _step_s(self) -> float:
        return float(self.time_s[1] - self.time_s[0])

    def _around(self, late_s: float) -> tuple[float, Array, Array]:
        """At what share of each step it changes, to what, and from what."""
        steps = late_s / self._step_s
        whole = int(np.floor(steps))
        at = np.arange(self.torque_nm.size) - whole
        now, before = (self.torque_nm[np.clip(each, 0, at.size - 1)] for each in (at, at - 1))
        return steps - whole, now, before
