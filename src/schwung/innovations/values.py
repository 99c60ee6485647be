"""What the filter takes and leaves behind, as plain numbers and arrays."""

from __future__ import annotations

from typing import NamedTuple

from schwung.motion import Array

#: Terms of the Taylor series, and the largest |eigenvalue| × step that it is used for; longer steps are doublings.
TERMS, REACH = 10, 0.5


class FurtherMass(NamedTuple):
    """A mass behind the load on a spring of its own: its inertia, and its natural frequency (rad/s) and damping ratio
    behind a load that is held; rate 0: there is none."""

    inertia: float = 0.0
    rate: float = 0.0
    ratio: float = 0.0


class Shaft(NamedTuple):
    """What does not change along a trajectory; SI."""

    rotor_inertia: float
    motor_friction: float
    load_friction: float
    stiffness: float
    damping: float
    rigid: bool
    further: FurtherMass = FurtherMass()

    @property
    def states(self) -> int:
        """Of motor and load, and of what is behind that."""
        return (2 if self.rigid else 4) + (2 if self.further.rate > 0 else 0)


class System(NamedTuple):
    """x⁺ = Φx + forcing + noise·w, of which the first two states are measured; the last is the torque's error,
    which is forgotten from step to step: its row of Φ is zero.

    Where `apart` is not 0, a step has torque of which the steps beside it have nothing: on the motor at its start and
    at its end, on the load likewise, and on the motor all along it.
    """

    transition: Array  # (n − 1, s, s)
    forcing: Array  # (n − 1, s)
    noise: Array  # (n − 1, s)
    power: Array  # (n − 1,) variance of w
    apart: Array  # (n − 1, 3) that of a step's own torques, on the motor, on the load, and all along, (N·m)²
    measured: Array  # (n, 2)
    variances: Array  # (n, 2) of the measurements
    first: Array  # (s,) the state at first, and how well it is known
    spread: Array  # (s,)
    open_contact: Array  # (n − 1, s) a deviation of what a coupling with a gap may carry besides
    on_load: Array  # (n − 1, 2, s) what units of torque on the load at a step's start and end do; 0, where none is open


class Filtered(NamedTuple):
    """What the filter leaves behind: per sample k the two scalar updates (position, then speed)."""

    error: Array  # (n, 2) innovations
    variance: Array  # (n, 2) theirs
    gain: Array  # (n, 2, s)
    state: Array  # (n, s) after both updates
    covariance: Array  # (n, s, s)


class Added(NamedTuple):
    """What a unit of each parameter adds to each step, and to the samples: c coefficients of curves, then p others.

    Curves add little at a time: a spline's row is zero but for a few entries.
    """

    start: Array  # (n − 1, s) what a unit of torque at a step's start does
    end: Array  # (n − 1, s) and at its end
    torque: Array  # (n, c) that the coefficients make at the samples
    inertia: Array  # (n − 1, s) what the relative change of a step's inertia does
    share: Array  # (n − 1, ≤ c) that the first coefficients change it by
    others: Array  # (n − 1, s, p)
    reported: Array  # (n, 2, p): what the others add to the samples of angle and speed
