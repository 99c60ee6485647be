"""Residual of a belief on recorded runs: reported torque minus the torque that the belief needs, within the band."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from copy import copy
from dataclasses import dataclass, field, replace
from functools import lru_cache
from operator import attrgetter
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from schwung.drivetrain.effects import Effects
from schwung.drivetrain.machine import Machine
from schwung.explain import forward
from schwung.explain.filtered import bent
from schwung.explain.measured import Measured
from schwung.explain.noise import motion_noise
from schwung.explain.signals import MOTION_BAND, Prepared, Signals, lasting
from schwung.explain.spectrum import Spectrum
from schwung.motion import Array

#: The fields of Effects upon which the coupling's torque depends, and those that leave the motor's own alone; for other
#: changes neither need be worked out again.
_HUNG = (
    "load_amplitude_nm", "load_phase_rad", "event_time_s", "event_duration_s", "event_peak_nm", "event_sharpness",
    "gap_rad", "stiffness_nm_rad", "damping_nms", "cubic_nm_rad3",
    "third_inertia_kgm2", "third_stiffness_nm_rad", "third_damping_nms",
    "inertia_delta_kgm2", "inertia_scale", "inertia_shift_rad",
)  # fmt: skip
_REPORTED = ("torque_gain", "torque_lag_s", "torque_limit_nm", "speed_delay_s")
#: Those upon which it depends how the load rings.
_RINGS = tuple(name for name in _HUNG if not name.startswith(("load_", "event_")))
_of_coupling = attrgetter(*_HUNG, "eccentricity_rad", "eccentricity_phase_rad")
_of_motor = attrgetter(*(name for name in Effects._fields if name not in (*_HUNG, *_REPORTED)))
#: Nobody's drive clips below this share of the torque that it reports, and no machine has less than LIGHTEST of the
#: inertia that is believed: a fit there would explain the recording away.
LEAST_LIMIT, LIGHTEST = 0.3, 0.02
#: A limit among the torque's noise would take noise away, and be liked for that alone.
LIMIT_OVER_NOISE = 15.0
#: Samples for which a clipped torque lasts: single ones beyond a limit are noise, which no limit takes away.
_CLIPPED = 4
#: So much of the highest torque may wind up the coupling as a run begins, where nobody has measured it.
#: Ringing of less than so many deviations of the floor is none.
WOUND_UP, DIED_AWAY = 0.1, 0.1
#: Points of a load torque over the visited angles that no sine describes, and where twice as many pay, up to so many.
TABLE_POINTS, FINEST = 8, 29
_KEPT = 64  # torques and gains that are remembered, per run


@dataclass(frozen=True)
class Unknowns:
    """What is fitted: the physics, how late the motion is behind the torque (s), and the periodic phase per run."""

    effects: Effects = field(default_factory=Effects)
    timing_s: float = 0.0
    phases_rad: Mapping[int, float] = field(default_factory=dict)
    bend_s2: float = 0.0  # of the reported torque's own filter, beyond the expected one (see filtered.py)
    load_table_nm: tuple[float, ...] = ()  # torque on the load at `Residuals.table_rad(m)`; none where empty


@dataclass(frozen=True, eq=False)
class _Run:
    """One run with what never changes about it."""

    signals: Signals
    motion: forward.Motion
    spectrum: Spectrum
    low: Array
    torque_nm: Array  # within the band
    sharp_nm: Array  # as it was before the drive's own filter, in the motion's band
    bent: NDArray[np.complex128]  # gain of that filter
    peak_nm: float  # beyond the band
    late_nm: Array  # (2, n), its change with the lag of what is reported, and with half the lag's square
    jumps: Array  # (n,) on the compared grid: shape of the controller's answer to images, of length 1
    valid: NDArray[np.bool_]  # on the compared grid


class Memory:
    """The last so many arrays, by what they depend on."""

    def __init__(self, most: int) -> None:
        self._most = most
        self._known: dict[tuple[object, ...], Array] = {}

    def of(self, key: tuple[object, ...], make: Callable[[], Array]) -> Array:
        """The array, made only where it is not known."""
        known = self._known.get(key)
        if known is None:
            if len(self._known) >= self._most:
                del self._known[next(iter(self._known))]
            known = self._known[key] = make()
        return known


@dataclass(frozen=True, eq=False)
class Moving:
    """A run on the compared grid; arrays (n,)."""

    motion_time_s: Array
    position_rad: Array
    speed_rad_s: Array
    direction: Array  # −1…1
    band_hz: float


class _Soft(NamedTuple):
    """Orthogonal directions in which a residual counts as noise, and by which share it is taken away there."""

    directions: Array  # (n, m)
    shrink: Array  # (m,)


class Residuals:
    """Residuals of one session for any unknowns, quickly: what a change does not touch is remembered."""

    def __init__(self, prepared: Prepared, machine: Machine) -> None:
        self.prepared, self.machine = prepared, machine
        self.belief = forward.believed(machine)
        rate, pad = prepared.rate_hz, 3 / prepared.band_hz
        lengths = {signals.time_s.size for signals in prepared.runs}
        self._spectra = {samples: Spectrum(samples, rate, pad) for samples in lengths}
        self.runs = tuple(self._run(signals) for signals in prepared.runs)
        self._couplings, self._motors, self._gains = (Memory(_KEPT * len(self.runs)) for _ in range(3))
        self._loaded = lru_cache(_KEPT)(self._with_table)
        self._peak_nm = max(of.peak_nm for of in self.runs)
        self._lightest_kgm2 = float(np.min(self.belief.inertia_coefficients[3]))
        self._tables: dict[int, Array] = {}  # what a measured inertia may be off, per run
        self._softs: dict[int, _Soft | None] = {}
        self._beside: dict[int, Array] = {}  # what the machine misses of a twin, per run
        self._settled = Effects()
        visited = [signals.position_rad[signals.considered] for signals in prepared.runs]
        angles = np.concatenate([*visited, prepared.runs[0].position_rad[:1]])
        self._visited = float(angles.min()), float(max(angles.max(), angles.min() + 1e-6))

    def _with_table(self, table_nm: tuple[float, ...]) -> forward.Belief:
        return forward.with_load_torque(self.belief, self.table_rad(len(table_nm)), np.array(table_nm))

    def _run(self, signals: Signals) -> _Run:
        spectrum = self._spectra[signals.time_s.size]
        low = spectrum.low_pass(self.prepared.band_hz)
        motion = forward.Motion(
            np.ascontiguousarray(signals.position_rad),
            np.ascontiguousarray(signals.speed_rad_s),
            np.ascontiguousarray(signals.acceleration_rad_s2),
            np.ascontiguousarray(signals.motion_time_s),
            signals.step_s,
        )
        valid = signals.considered[:: self.prepared.every]
        late = np.stack(
            [spectrum.apply(signals.added_nm, low * spectrum.omega**power, "drop") for power in (1, 2)]
        )
        jumps = spectrum.apply(signals.jumps_nm, low)[:: self.prepared.every]
        jumps = jumps / max(float(np.linalg.norm(jumps[valid])), 1e-12)
        torque = spectrum.apply(signals.torque_nm, low)
        filtered = bent(spectrum.omega, self.prepared.bend_s2)
        sharp = spectrum.apply(
            signals.torque_nm, spectrum.low_pass(MOTION_BAND * self.prepared.band_hz) / filtered
        )
        peak = float(np.max(np.abs(signals.torque_nm)))
        return _Run(signals, motion, spectrum, low, torque, sharp, filtered, peak, late, jumps, valid)

    def table_rad(self, points: int) -> Array:
        """Angles at which a load torque has points, (points,), over all that were visited."""
        return np.linspace(*self._visited, points)

    def valid(self, run: int) -> NDArray[np.bool_]:
        """Which samples of the compared grid are compared, (n,)."""
        return self.runs[run].valid

    def moving(self, run: int) -> Moving:
        """The run on the compared grid."""
        signals, every = self.runs[run].signals, self.prepared.every
        speed = signals.speed_rad_s[::every]
        return Moving(
            motion_time_s=signals.motion_time_s[::every],
            position_rad=signals.position_rad[::every],
            speed_rad_s=speed,
            direction=np.tanh(speed / self.prepared.smoothing_rad_s),
            band_hz=self.prepared.band_hz,
        )

    def _reported(self, run: int, unknowns: Unknowns) -> Array:
        """Reported torque within the band, (n,) on the full grid; clipped where the unknowns say it was."""
        of, e = self.runs[run], unknowns.effects
        limit = e.torque_limit_nm / e.torque_gain
        torque = of.torque_nm  # what was clipped is what the drive's filter has not smoothed yet
        if of.peak_nm > limit:
            torque = torque - of.spectrum.apply(of.sharp_nm - _clipped(of.sharp_nm, limit), of.low * of.bent)
        t = unknowns.timing_s
        return np.asarray(torque + t * of.late_nm[0] + 0.5 * t**2 * of.late_nm[1]) if t != 0 else torque

    def _asked(self, run: int, unknowns: Unknowns) -> Array:
        """Torque that the drive would report, were the belief right, at once and in any band; (n,) on the full grid."""
        e, phase = unknowns.effects, unknowns.phases_rad.get(run, 0.0)
        motor = self._motors.of((run, phase, *_of_motor(e)), lambda: self._motor(run, phase, e))
        table = unknowns.load_table_nm
        coupling = self._couplings.of((run, table, *_of_coupling(e)), lambda: self._coupling(run, e, table))
        return np.asarray((motor + coupling) / e.torque_gain)

    def _motor(self, run: int, phase_rad: float, e: Effects) -> Array:
        of = self.runs[run]
        motion = forward.uncentred(of.motion, e.eccentricity_rad, e.eccentricity_phase_rad)
        torque = self.belief.rotor_inertia * motion.acceleration + self.belief.motor_friction * motion.speed
        smoothing = self.prepared.smoothing_rad_s
        helped = forward.motor_helped(e, motion, of.signals.time_s, phase_rad, of.signals.share, smoothing)
        return np.asarray(torque - helped)

    def _coupling(self, run: int, e: Effects, table: tuple[float, ...]) -> Array:
        belief = self._loaded(table) if table else self.belief
        motion = forward.uncentred(self.runs[run].motion, e.eccentricity_rad, e.eccentricity_phase_rad)
        return forward.coupling_needed(belief, e, motion)

    def _gain(self, run: int, unknowns: Unknowns) -> Array:
        """What filters the needed torque: the band, the lag of torque, how late the motion is, the drive's filter."""
        of, lag, timing = self.runs[run], unknowns.effects.torque_lag_s, unknowns.timing_s
        omega, bend = of.spectrum.omega, self.prepared.bend_s2 + unknowns.bend_s2
        return self._gains.of(
            (of.spectrum.samples, lag, timing, bend),
            lambda: of.low * (1 + omega * lag) * np.exp(omega * timing) * bent(omega, bend),
        )

    def _calm(self, spectrum: Spectrum, lag_s: float) -> Array:
        """What leaves of a residual with a lag the noise that one without has.

        The torque that is asked of a slow drive holds the motion's noise differentiated once more, which would speak
        against every lag.
        """

        def gain() -> Array:
            noise = self.prepared.noise
            motion = motion_noise(
                self.prepared, self.machine, noise, np.asarray(spectrum.frequency_hz, float)
            )
            slow = noise.torque_nm**2 + motion * np.abs(1 + spectrum.omega * lag_s) ** 2
            return np.asarray(np.sqrt((noise.torque_nm**2 + motion) / slow))

        return self._gains.of((spectrum.samples, lag_s, "calm"), gain)

    def several(self, run: int, unknowns: Sequence[Unknowns]) -> Array:
        """Reported minus needed torque (N·m) on the compared grid, (unknowns, n); beyond all bounds where impossible.

        Several at once cost less than each alone: they pass through the filter together.
        """
        of, every = self.runs[run], self.prepared.every
        result = np.full((len(unknowns), of.valid.size), 1e3 * self._peak_nm)
        rows = [row for row, one in enumerate(unknowns) if self._possible(one.effects)]
        if rows:
            asked = np.stack([self._asked(run, unknowns[row]) for row in rows])
            gains = np.stack([self._gain(run, unknowns[row]) for row in rows])
            reported = np.stack([self._reported(run, unknowns[row]) for row in rows])
            compared = reported - of.spectrum.apply(asked, gains) - self._beside.get(run, 0.0)
            for row, lag in enumerate(unknowns[row].effects.torque_lag_s for row in rows):
                if lag > 0:
                    compared[row] = of.spectrum.apply(compared[row], self._calm(of.spectrum, lag))
            compared = compared[:, ::every]
            jumps = np.sum(compared[:, of.valid] * of.jumps[of.valid], axis=1)  # rows alike to the last bit
            compared = compared - np.multiply.outer(jumps, of.jumps)
            soft = self._soft(run)
            if soft is not None:
                sizes = np.stack([soft.directions[of.valid].T @ row[of.valid] for row in compared])
                compared -= (sizes * soft.shrink) @ soft.directions.T
            result[rows] = compared
        return result

    def residual(self, run: int, unknowns: Unknowns) -> Array:
        """The same for one of them, (n,)."""
        return np.asarray(self.several(run, (unknowns,))[0])

    def _possible(self, e: Effects) -> bool:
        """Whether there could be such a machine, and whether its motion can be worked out."""
        lightest = self._lightest_kgm2
        rotor = self.belief.rotor_inertia if self.belief.rigid else 0.0
        left = rotor + e.inertia_scale * lightest + e.inertia_delta_kgm2
        least = max(LEAST_LIMIT * self._peak_nm, LIMIT_OVER_NOISE * self.prepared.noise.torque_nm)
        clipped = e.torque_limit_nm < least * e.torque_gain
        if left < LIGHTEST * (rotor + lightest) or clipped:
            return False
        return forward.can_follow(self.belief, e, 1 / self.prepared.rate_hz)

    def settle(self, effects: Effects) -> None:
        """From now on let the loads ring from the first samples on as they do with these terms."""
        self._settled = Effects()._replace(**{name: getattr(effects, name) for name in _RINGS})
        self._softs.clear()

    def _soft(self, run: int) -> _Soft | None:
        """What counts as noise in a run: how its load may ring from the first sample on, and a measured table."""
        if run not in self._softs:
            columns = [c for c in (self._ringing(run), self._tables.get(run)) if c is not None]
            valid = self.runs[run].valid
            self._softs[run] = _softened(np.concatenate(columns, axis=1), valid) if columns else None
        return self._softs[run]

    def _ringing(self, run: int) -> Array | None:
        """How the load rings if it was wound up, or swung, as the run began: (n, 2) over the floor's noise.

        Nobody has measured that, and the first samples of a filtered motion say it badly. None: it has died away.
        """
        of, e = self.runs[run], self._settled
        if self.belief.rigid or not of.valid.any():
            return None
        wound = WOUND_UP * self._peak_nm / self.belief.stiffness
        heaviest = float(np.max(self.belief.inertia_coefficients[3]))
        offsets = ((wound, 0.0), (0.0, wound * float(np.sqrt(self.belief.stiffness / heaviest))))
        begun = np.stack([forward.coupling_needed(self.belief, e, of.motion, one) for one in offsets])
        rings = of.spectrum.apply(begun - self._coupling(run, e, ()), of.low)[:, :: self.prepared.every]
        band, rate = self.prepared.band_hz, self.prepared.source_rate_hz
        rings /= self.prepared.noise.torque_nm * np.sqrt(2 * band / rate)
        return np.asarray(rings.T) if np.sum(rings[:, of.valid] ** 2) > DIED_AWAY**2 else None

    def shaken(self, drawn: Sequence[Array]) -> Residuals:
        """The same session with more noise in its channels: of each run motion (3) and torque, (4, n)."""
        result = copy(self)
        result._couplings, result._motors = (Memory(_KEPT * len(self.runs)) for _ in range(2))
        result.runs = tuple(_shaken(of, more) for of, more in zip(self.runs, drawn, strict=True))
        return result

    def take_off(self, twin: Prepared) -> None:
        """From now on leave out what the machine misses of a twin, which a simulator made of each run (N·m)."""
        alike = Residuals(twin, self.machine)
        for run, of in enumerate(alike.runs):
            missed = of.torque_nm - of.spectrum.apply(alike._asked(run, Unknowns()), of.low)
            self._beside[run] = np.asarray(missed)
        self._softs.clear()

    def soften(self, belief: Measured, floor_nm: float) -> None:
        """From now on count as noise what the belief's inertia may be off: shrink its directions to the floor.

        With noise of the floor's deviation and directions D of one deviation each, the whitening is I − U (1 −
        1/√(1 + S²)) Uᵀ, where U S Vᵀ = D / floor.
        """
        others = [Residuals(self.prepared, belief.moved(i)) for i in range(len(belief.directions_kgm2))]
        for run, of in enumerate(self.runs):
            if of.valid.any():
                here = self.residual(run, Unknowns())
                off = [here - other.residual(run, Unknowns()) for other in others]
                self._tables[run] = np.stack(off, axis=1) / floor_nm
        self._softs.clear()

    @property
    def softened(self) -> bool:
        """Whether the belief's inertia was measured, and counts as off by what its table says."""
        return bool(self._tables)

    def all(self, runs: Sequence[int], unknowns: Unknowns) -> list[Array]:
        """Residuals of several runs."""
        return [self.residual(run, unknowns) for run in runs]


def _shaken(of: _Run, more: Array) -> _Run:
    """A run with more noise in angle, speed, acceleration and torque."""
    angle, speed, acceleration, torque = more
    motion = of.motion._replace(
        angle=of.motion.angle + angle,
        speed=of.motion.speed + speed,
        acceleration=of.motion.acceleration + acceleration,
    )
    signals = replace(of.signals, torque_nm=of.signals.torque_nm + torque)
    within, sharp = of.spectrum.apply(torque, of.low), of.spectrum.apply(torque, of.low / of.bent)
    return replace(
        of, motion=motion, signals=signals, torque_nm=of.torque_nm + within, sharp_nm=of.sharp_nm + sharp
    )


def _softened(columns: Array, valid: NDArray[np.bool_]) -> _Soft:
    """Columns (n, m) that count as noise, each of so many deviations of the floor."""
    _, size, turn = np.linalg.svd(columns[valid], full_matrices=False)
    return _Soft(columns @ turn.T / np.maximum(size, 1e-12), 1 - 1 / np.sqrt(1 + size**2))


def _clipped(torque_nm: Array, limit_nm: float) -> Array:
    """Torque cut off wherever it is beyond a limit for a while, (n,)."""
    beyond = lasting(np.abs(torque_nm) > limit_nm, _CLIPPED)
    return np.where(beyond, np.clip(torque_nm, -limit_nm, limit_nm), torque_nm)
