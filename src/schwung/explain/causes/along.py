"""The coordinates that causes depend on, along one run's smoothed states."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property, wraps

import numpy as np
from numpy.typing import NDArray

from schwung.drivetrain.machine import Coupling, Machine
from schwung.explain.causes.inertia_at import DIFFERENCE_RAD, inertia_of
from schwung.explain.causes.sticking import direction, on_average, slowest
from schwung.explain.causes.true_torque import TrueTorque, seems_clipped
from schwung.innovations.held import corners
from schwung.innovations.low_pass import heard
from schwung.innovations.signals import Signals
from schwung.innovations.splines import slopes
from schwung.innovations.values import FurtherMass
from schwung.motion import Array
from schwung.session.model import Run

#: Beyond so many times the speed at which it may stick, a shaft surely slides.
SLIDES = 10.0


@dataclass(frozen=True)
class Ranges:
    """What the whole session covers: natural units of everything."""

    low_rad: float
    high_rad: float
    peak_speed_rad_s: float
    peak_acceleration_rad_s2: float
    peak_torque_nm: float
    longest_s: float
    sticking_rad_s: float
    runs: int
    band_hz: float
    one_motion: bool = False  # whether all runs repeat one
    unrepeated: bool = False  # whether no run repeats another
    wound_rad: float = 0.0  # how far a coupling was wound up, where a curve over that is drawn
    seems_clipped: tuple[tuple[float, float], ...] = ((0.0, 0.0),)  # by noise, see there

    @property
    def span_rad(self) -> float:
        """The visited angles."""
        return self.high_rad - self.low_rad


_NO_MASS = FurtherMass()
#: Something along a run, (n,) or (n, 2), each part by one cause.
Parts = tuple[Callable[["Along"], Array], ...]
Pairs = tuple[Callable[["Along"], tuple[Array | float, Array | float]], ...]


@dataclass(frozen=True, eq=False)
class Beyond:
    """What is known or present beyond the machine's inertias, spring and damper, as far as others depend on it."""

    gap_rad: float = 0.0  # of the coupling
    filter_s: float = 0.0  # by how much a filter delays the reported torque
    held_late: float = 0.0  # by what share of a step a held injection is taken later than it was sampled
    further: FurtherMass = _NO_MASS  # behind the load, where it is a state of the filter's
    drives: Pairs = ()  # how much further the coupling is driven than the motor turns, and how much faster
    besides: Parts = ()  # what the coupling carries beside spring and damper (N·m)
    eases: Parts = ()  # how much stiffer it is, and more damped, about its wind-up, (n, 2)
    passes: Parts = ()  # what the motor gives more for a torque more that it is asked for; none: as much
    pushes: Pairs = ()  # what acts on motor and load beside the machine (N·m)


_NOTHING = Beyond()


def _kept(coordinate: Callable[[Along], Array]) -> Callable[[Along], Array]:
    """Of the states alone: worked out once for them, whatever else is present."""

    @wraps(coordinate)
    def asked(self: Along) -> Array:
        name = coordinate.__name__
        if name not in self.kept:
            self.kept[name] = coordinate(self)
        return self.kept[name]

    return asked


@dataclass(frozen=True, eq=False)
class Along:
    """One run; arrays (n,)."""

    run: Signals
    machine: Machine  # as believed
    present: Machine  # with what of the causes that are present belongs to it
    ranges: Ranges
    number: int  # of the run in the session, from 0
    starts_s: float  # when the motion leaves rest
    true_torque: TrueTorque
    kept: dict[str, Array] = field(default_factory=dict)  # coordinates by their names, for these states
    loud: Sequence[Array] | None = None  # `loudness` of what noise alone makes: see `View.loud`
    beyond: Beyond = _NOTHING  # what is present beyond that machine
    met: Array | None = None  # `Play.contact` of each step, as the filter met it, (n − 1, 3); None: not known

    @property
    def step_s(self) -> Array | float:
        """Between samples."""
        return self.run.step_s

    @property
    def ends(self) -> Array:
        """The first and the last sample."""
        return np.array([0, self.speed.size - 1])

    @property
    def time_s(self) -> Array:
        return self.run.time_s

    @property
    def motion_time_s(self) -> Array:
        """Since the motion left rest."""
        return self.run.time_s - self.starts_s

    @cached_property
    def resting_nm(self) -> float:
        """The reported torque before the motion leaves rest (N·m), on average; the first, where there is no rest."""
        resting = self.time_s <= max(self.starts_s, self.time_s[0])
        return float(np.mean(self.run.drive.smooth_nm[resting]))

    @property
    def share(self) -> float:
        """How far through the session, 0…1."""
        return self.number / max(self.ranges.runs - 1, 1)

    @property
    def angle(self) -> Array:
        return np.asarray(self.run.states[:, 0])

    @property
    @_kept
    def load_angle(self) -> Array:
        return np.asarray(self.run.load_angle_rad)

    @property
    def speed(self) -> Array:
        return np.asarray(self.run.states[:, 1])

    @property
    def load_speed(self) -> Array:
        return np.asarray(self.run.load_speed_rad_s)

    @property
    @_kept
    def slowest(self) -> Array:
        """`sticking.slowest` of motor and load; ∞ of a load that is one with the motor."""
        speeds = np.column_stack([self.speed, self.load_speed])
        return np.where([False, self.run.rigid], np.inf, slowest(speeds, self._on_average))

    @property
    @_kept
    def direction(self) -> Array:
        """Of the motor's motion, −1…1."""
        return direction(self._on_average[:, 0], self.ranges.sticking_rad_s)

    @cached_property
    def moves(self) -> NDArray[np.bool_]:
        """Where the motor surely slides; everywhere, where it never does."""
        sliding = np.abs(self.speed) > SLIDES * self.ranges.sticking_rad_s
        return sliding if sliding.any() else np.ones_like(sliding)

    @property
    @_kept
    def load_direction(self) -> Array:
        return direction(self._on_average[:, 1], self.ranges.sticking_rad_s)

    @property
    @_kept
    def _on_average(self) -> Array:
        return on_average(np.column_stack([self.angle, self.load_angle]), self.run.step_s)

    def _rate(self, values: Array) -> Array:
        return slopes(self.run.quiet(values), self.run.step_s)

    @property
    @_kept
    def _smooth_acceleration(self) -> Array:
        return self._rate(self.speed)

    @cached_property
    def acceleration(self) -> Array:
        """Of the motor; beyond the band it is that of a coupling which closes and opens."""
        return np.asarray(self._smooth_acceleration - self._sharp_nm / self.present.motor.inertia_kgm2)

    @cached_property
    def _sharp_nm(self) -> Array | float:
        """What a coupling with play carries beyond the band."""
        coupling = self.present.coupling
        if self.beyond.gap_rad <= 0 or coupling is None:
            return 0.0
        apart, rate = self.apart.T
        pressed = coupling.stiffness_nm_rad * (apart - np.sign(apart) * self.beyond.gap_rad / 2)
        carried = self.touches_with(self.beyond.gap_rad) * (pressed + coupling.damping_nms * rate)
        return np.asarray(carried - self.run.quiet(carried))

    @cached_property
    def held(self) -> tuple[Array, Array]:
        """Of a held injection ΔT/J and Δ²T/J (rad/s²), (n,) each: its jumps, as they are at the samples, and by how
        much the next one differs, over what they accelerate (`rotor`)."""
        drive, step = self.run.drive, self.run.step_s
        if not drive.held.is_any:
            return (np.zeros_like(self.time_s),) * 2
        rate = slopes(drive.held.curve(self.beyond.held_late * step), step)
        jump = rate * step / self.rotor
        return jump, np.gradient(jump)

    @property
    def rotor(self) -> Array:
        """What torque accelerates within a step (kg·m²), (n,): the motor alone, where a coupling is behind it."""
        motor = np.full_like(self.angle, self.present.motor.inertia_kgm2)
        return motor if self.machine.coupling else motor + self.machine.load_inertia_at(self.angle)

    @cached_property
    def acceleration_before(self) -> Array:
        """Of the motor just before each sample, which is what a late speed is late by: against the curve through the
        motion's samples, which has the corners' part in them, see `corners`."""
        jump, change = self.held
        return np.asarray(
            self.acceleration
            - (0.5 - self.beyond.held_late) * jump
            + corners(self.beyond.held_late)[0] * change
        )

    @cached_property
    def jerk_before(self) -> Array:
        """Of the motor just before each sample: against the smooth curve a held injection falls within each step."""
        return self._rate(self.acceleration) - self.held[0] / self.run.step_s

    @property
    def accelerated(self) -> Array:
        """The load's acceleration as smoothed."""
        return np.asarray(self.run.load_acceleration + self._sharp_nm / self.inertia)

    @cached_property
    def load_acceleration(self) -> Array:
        """As far as it is heard: of noise it would foresee the noise that it was smoothed from."""
        return (
            self._smooth_load_acceleration
            if self.beyond.gap_rad <= 0
            else self._heard_as_load(self.accelerated)
        )

    @property
    @_kept
    def _smooth_load_acceleration(self) -> Array:
        return self._heard_as_load(np.asarray(self.run.load_acceleration))

    def _heard_as_load(self, accelerated: Array) -> Array:
        return accelerated if self.loud is None else heard(accelerated, self.loud[2])

    @property
    def torque(self) -> Array:
        """The true torque within the band (N·m)."""
        return self.true_torque.quiet_nm + self._injected[1][0] - self._injected[0][0]

    @property
    def torque_rate(self) -> Array:
        return self.reported_rate + self._injected[1][1]

    @cached_property
    def given_rate(self) -> Array:
        """How the torque changes that a motor gives of what it is asked for: what a current loop lags behind."""
        rate = self.torque_rate
        return rate * np.asarray(sum(one(self) for one in self.beyond.passes)) if self.beyond.passes else rate

    @property
    def beyond_band(self) -> Array:
        """`TrueTorque.beyond_band`."""
        return self.true_torque.beyond_band

    @property
    def torque_bend(self) -> Array:
        """Second derivative of the true torque."""
        return self.reported_bend + self._injected[1][2]

    @property
    def reported_rate(self) -> Array:
        """How that part of the torque changes which the drive reports: a held injection is known as it was sent."""
        found = self.true_torque.rate if self.beyond.gap_rad <= 0 else self.true_torque.sharp_rate
        return found - self._injected[0][1]

    @property
    def reported_bend(self) -> Array:
        return self.true_torque.bend - self._injected[0][2]

    @property
    def _injected(self) -> tuple[Sequence[Array | float], Sequence[Array | float]]:
        """A held injection within the band and its two derivatives, taken at once and as late as it is."""
        if not self.run.drive.held.is_any:
            return ((0.0, 0.0, 0.0),) * 2
        return self.run.injected(0.0), self.run.injected(self.beyond.held_late * self.run.step_s)

    @property
    @_kept
    def twist(self) -> Array:
        """Of the coupling (rad), as far as it is heard, all of it where that has play; 0 where there is none."""
        return 0.0 * self.speed if self.run.rigid else self._heard(self.run.states[:, 2], 0)

    @property
    @_kept
    def twist_speed(self) -> Array:
        return 0.0 * self.speed if self.run.rigid else self._heard(self.speed - self.load_speed, 1)

    def touches_with(self, gap_rad: float) -> NDArray[np.bool_]:
        """Whether a coupling with a gap touches, as the states say it, (n,); without one it always does."""
        coupling, (apart, rate) = self.present.coupling, self.apart.T
        if gap_rad <= 0 or coupling is None:
            return np.ones(apart.shape, dtype=bool)
        wound = np.abs(apart) - gap_rad / 2
        push = coupling.stiffness_nm_rad * wound + coupling.damping_nms * np.sign(apart) * rate
        return np.asarray((wound > 0) & (push > 0))

    @cached_property
    def contact(self) -> Array:
        """How surely the coupling touches, on which side, and how much of its wind-up is gap (rad), (n, 3)."""
        if self.met is not None:
            steps = np.concatenate([self.met[:1], self.met, self.met[-1:]])
            return np.asarray(steps[1:] + steps[:-1]) / 2
        touches = self.touches_with(self.beyond.gap_rad).astype(float)
        side = touches * np.sign(self.apart[:, 0])
        return np.column_stack([touches, side, side * self.beyond.gap_rad / 2])

    @cached_property
    def turned(self) -> Array:
        """How far motor and load are turned apart beyond the coupling's gap, and how fast (rad, rad/s), (n, 2)."""
        touches, _, gap = self.contact.T
        return np.column_stack([touches * self.twist - gap, touches * self.twist_speed])

    @cached_property
    def driven(self) -> Array:
        """How much further the coupling is driven than the motor turns, and how much faster (rad, rad/s), (n, 2)."""
        every = [np.column_stack(drives(self)) for drives in self.beyond.drives]
        return np.asarray(sum(every, np.zeros((self.speed.size, 2))))

    @cached_property
    def apart(self) -> Array:
        """How far the coupling's two sides are apart, gap and all, and how fast (rad, rad/s), (n, 2)."""
        return np.column_stack([self.twist, self.twist_speed]) + self.driven

    @cached_property
    def wound(self) -> Array:
        """How far the coupling is wound up beyond its gap (rad)."""
        return np.asarray(self.contact[:, 0] * self.apart[:, 0] - self.contact[:, 2])

    @cached_property
    def winding(self) -> Array:
        """And how fast (rad/s)."""
        return np.asarray(self.contact[:, 0] * self.apart[:, 1])

    def coupling_about(self, coupling: Coupling) -> Array:
        """Stiffness (N·m/rad) and damping (N·m·s/rad) of a coupling that bends so, about its wind-up, (n, 2)."""
        whole = np.broadcast_to([coupling.stiffness_nm_rad, coupling.damping_nms], (self.speed.size, 2))
        return np.asarray(sum((one(self) for one in self.beyond.eases), whole))

    def _heard(self, values: Array, which: int) -> Array:
        if self.beyond.gap_rad > 0:
            return values  # free flights are far above the band
        quiet = np.asarray(self.run.quiet(values))
        return quiet if self.loud is None else heard(quiet, self.loud[which])

    @cached_property
    def inertia(self) -> Array:
        """Of the load, with what is present."""
        return self.present.load_inertia_at(self.load_angle)

    @cached_property
    def push_slopes(self) -> Array:
        """How much more acts on motor and load for each radian further (N·m/rad), (n, 2), beside the machine."""
        angles = ("load_angle",)  # of what follows from the states, all else is as it is
        kept = {name: value for name, value in self.kept.items() if name not in angles}

        def acts(way: int) -> Array:
            by = way * DIFFERENCE_RAD
            states = self.run.states + by * (np.arange(self.run.states.shape[1]) == 0)
            run = replace(self.run, states=states, position_rad=self.run.position_rad + by)
            there, none = replace(self, run=run, kept=dict(kept)), np.zeros((self.speed.size, 2))
            return sum(
                (
                    np.stack(np.broadcast_arrays(*push(there), none[:, 0])[:2], 1)
                    for push in self.beyond.pushes
                ),
                none,
            )

        return (acts(1) - acts(-1)) / (2 * DIFFERENCE_RAD)

    @cached_property
    def load_torque_slopes(self) -> Array:
        """How much more torque the load takes for each radian further (N·m/rad) and each rad/s faster (N·m·s/rad),
        (n, 2), with what is present.

        d/dθ and d/dω of J α + ½ J' ω² − T: where an angle is misread, the load is taken for the one of another angle,
        which is passed at another speed.
        """
        _, slope, bend = inertia_of(self.present, self.load_angle)
        ends = [self.present.load_torque_at(self.load_angle + way * DIFFERENCE_RAD) for way in (1, -1)]
        pulled = (ends[0] - ends[1]) / (2 * DIFFERENCE_RAD)
        further = slope * self.load_acceleration + bend * self.load_speed**2 / 2 - pulled
        return np.column_stack([further, slope * self.load_speed])

    @cached_property
    def carried(self) -> Array:
        """Torque through the shaft to the load (N·m)."""
        if self.present.coupling is None:
            return np.asarray(self.inertia * self.load_acceleration)
        k, b = self.present.coupling.stiffness_nm_rad, self.present.coupling.damping_nms
        return np.asarray(k * self.wound + b * self.winding + sum(one(self) for one in self.beyond.besides))


def leaves_rest_s(recorded: Run) -> float:
    """When the motion of a run begins."""
    return recorded.motion.start_time_s if recorded.motion is not None else 0.0


def ranges_of(runs: list[Signals], sticking: float, band_hz: float) -> Ranges:
    """What the runs cover, by their latest states."""
    angle = np.concatenate([run.load_angle_rad for run in runs])
    speed = max(float(np.max(np.abs(run.states[:, 1]))) for run in runs)
    every = [run.quiet(run.drive.whole_nm) for run in runs]
    rates = [np.gradient(run.quiet(run.states[:, 1]), run.step_s) for run in runs]
    return Ranges(
        low_rad=float(angle.min()),
        high_rad=float(angle.max()),
        peak_speed_rad_s=speed,
        peak_acceleration_rad_s2=max(float(np.max(np.abs(rate))) for rate in rates),
        peak_torque_nm=max(float(np.max(np.abs(torque))) for torque in every),
        longest_s=max(float(run.time_s[-1]) for run in runs),
        sticking_rad_s=sticking * speed,
        runs=len(runs),
        band_hz=band_hz,
        seems_clipped=seems_clipped(runs),
    )
