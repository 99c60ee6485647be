"""What a physics term is to the explainer: where a fit may start, what it then moves, and where its mismatch shows."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field

import numpy as np

from schwung.drivetrain.effects import Effects
from schwung.drivetrain.machine import Machine
from schwung.explain.residual import Moving, Residuals
from schwung.explain.values import Coordinate
from schwung.motion import Array

Fields = Mapping[str, float]
#: Of a bump over place or time: from a box to what looks like a Gaussian.
SHARPNESS = (0.003, 20.0)


@dataclass(frozen=True, eq=False)
class View:
    """What starts are chosen from: the runs, the belief, and how big things are."""

    residuals: Residuals
    runs: tuple[int, ...]  # that may be looked at

    @property
    def machine(self) -> Machine:
        return self.residuals.machine

    def gathered(self, name: str) -> Array:
        """One channel of all compared samples, (n,)."""
        every = self.residuals.prepared.every
        parts = [
            getattr(self.residuals.runs[run].signals, name)[::every][self.residuals.valid(run)]
            for run in self.runs
        ]
        return np.concatenate(parts) if parts else np.zeros(0)

    @property
    def peak_speed_rad_s(self) -> float:
        return self.residuals.prepared.peak_speed_rad_s

    @property
    def torque_nm(self) -> float:
        """Root mean square of the reported torque."""
        return float(np.sqrt(np.mean(self.gathered("torque_nm") ** 2)))

    @property
    def peak_torque_nm(self) -> float:
        return float(np.max(np.abs(self.gathered("torque_nm"))))

    @property
    def mean_inertia_kgm2(self) -> float:
        """Mean believed load inertia over the samples."""
        machine = self.machine
        if machine.load_inertia is None:
            return machine.motor.inertia_kgm2
        return float(np.mean(machine.load_inertia_at(self.gathered("position_rad"))))

    @property
    def stiffness_nm_rad(self) -> float:
        return self.machine.coupling.stiffness_nm_rad if self.machine.coupling else 0.0

    @property
    def damping_nms(self) -> float:
        return self.machine.coupling.damping_nms if self.machine.coupling else 0.0

    @property
    def wind_up_rad(self) -> float:
        """Typical wind-up of the coupling."""
        return self.torque_nm / self.stiffness_nm_rad if self.stiffness_nm_rad else 0.0


@dataclass(frozen=True, eq=False)
class Start:
    """A place from which a term may be fitted: `directions` move the residual almost in proportion.

    `shape` holds what stands still in the linear look; `decode` turns the directions' coefficients into the fields
    where the fit starts (None: each direction's fields times its coefficient, summed).
    """

    shape: Fields
    directions: tuple[Fields, ...]
    decode: Callable[[Sequence[float]], Fields] | None = None
    absolute: bool = False  # the directions' values replace the fields' instead of adding to them
    earlier_s: float = 0.0  # by so much the motion moves before the torque along with it
    torques: Callable[[Moving], Array] | None = (
        None  # (directions, n) on the motor: a quick look for scanned starts
    )

    def moved(self, effects: Effects, direction: int) -> Effects:
        """Effects with one direction gone for one unit."""
        fields = self.directions[direction]
        change = fields if self.absolute else {f: getattr(effects, f) + v for f, v in fields.items()}
        return effects._replace(**{**self.shape, **change})

    def fields(self, coefficients: Sequence[float]) -> dict[str, float]:
        """Values of all fields at given coefficients."""
        if self.decode is not None:
            return {**self.shape, **self.decode(coefficients)}
        neutral = Effects()
        values = dict(self.shape)
        for direction, coefficient in zip(self.directions, coefficients, strict=True):
            for name, unit in direction.items():
                values[name] = values.get(name, getattr(neutral, name)) + coefficient * unit
        return values


@dataclass(frozen=True, eq=False)
class Term:
    """One physics name. `tied`: fields that always have one value, the first being the parameter."""

    name: str
    coordinate: Coordinate
    starts: Callable[[View], list[Start]]
    parameters: tuple[str, ...]  # fields that are fitted
    bounds: Mapping[str, tuple[float, float]]
    simplicity: int = 0  # of two that fit alike the lower is preferred
    tied: tuple[str, ...] = ()
    #: Fields that are fitted beside them only where that is well worth it, and where that may start; none named: from
    #: a tenth of what is missed, at the peak of the speed.
    refinements: Mapping[str, tuple[float, ...]] = field(default_factory=dict)
    scanned: bool = False  # its starts depend on the residual's fine structure: looked for anew at every step


def at(base: float = 0.0, earlier_s: float = 0.0, **fields: float) -> Start:
    """A start at finite values, for what is far from proportional; a linear look may move it towards `base`."""

    def decode(coefficients: Sequence[float]) -> Fields:
        gone = min(max(coefficients[0], 0.05), 1.5)
        return {field: base + gone * (value - base) for field, value in fields.items()}

    return Start({}, (fields,), decode, absolute=True, earlier_s=earlier_s)


def polar(name: str, phase: str, unit: float = 1.0) -> Callable[[Sequence[float]], Fields]:
    """Coefficients of sine and cosine -> amplitude and phase."""

    def decode(coefficients: Sequence[float]) -> Fields:
        sine, cosine = coefficients[-2], coefficients[-1]
        return {name: unit * float(np.hypot(sine, cosine)), phase: float(np.arctan2(cosine, sine))}

    return decode
