"""Residual of a belief on recorded runs: reported torque minus the torque that the belief needs, within the band."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from schwung.drivetrain.machine import Machine
from schwung.drivetrain.physics import Effects
from schwung.explain import forward
from schwung.explain.signals import Prepared, Signals, Spectrum
from schwung.motion import Array

#: The fields of Effects upon which the coupling's torque depends; for other changes it need not be worked out again.
_HUNG = (
    "load_amplitude_nm", "load_phase_rad", "event_time_s", "event_duration_s", "event_peak_nm",
    "gap_rad", "stiffness_nm_rad", "damping_nms", "cubic_nm_rad3",
    "third_inertia_kgm2", "third_stiffness_nm_rad", "third_damping_nms",
    "inertia_delta_kgm2", "inertia_scale", "inertia_shift_rad", "eccentricity_rad", "eccentricity_phase_rad",
)  # fmt: skip
#: Nobody's drive clips below this share of the torque that it reports, and no machine has less than LIGHTEST of the
#: inertia that is believed: a fit there would explain the recording away.
LEAST_LIMIT, LIGHTEST = 0.3, 0.02
_KEPT = 400  # coupling torques that are remembered


@dataclass(frozen=True)
class Unknowns:
    """What is fitted: the physics, how late the motion is behind the torque (s), and the periodic phase per run."""

    effects: Effects = field(default_factory=Effects)
    timing_s: float = 0.0
    phases_rad: Mapping[int, float] = field(default_factory=dict)


@dataclass(frozen=True, eq=False)
class _Run:
    """One run with what never changes about it."""

    signals: Signals
    motion: forward.Motion
    spectrum: Spectrum
    low: Array
    torque_nm: Array  # within the band
    late_nm: (
        Array  # (2, n), by how much it changes with the lag of what is reported, and with half its square
    )
    jumps: (
        Array  # (n,) on the compared grid: what a held injection's images make the controller do, of length 1
    )
    valid: NDArray[np.bool_]  # on the compared grid


@dataclass(frozen=True, eq=False)
class Moving:
    """A run on the compared grid; arrays (n,)."""

    motion_time_s: Array
    position_rad: Array
    speed_rad_s: Array
    direction: Array  # −1…1
    band_hz: float


class Residuals:
    """Residuals of one session for any unknowns, quickly: what a change does not touch is remembered."""

    def __init__(self, prepared: Prepared, machine: Machine) -> None:
        self.prepared, self.machine = prepared, machine
        self.belief = forward.believed(machine)
        self.runs = tuple(self._run(signals) for signals in prepared.runs)
        self._hung: dict[tuple[object, ...], Array] = {}
        self._peak_nm = max(float(np.max(np.abs(of.signals.torque_nm))) for of in self.runs)

    def _run(self, signals: Signals) -> _Run:
        spectrum = Spectrum(signals.time_s.size, self.prepared.rate_hz, 3 / self.prepared.band_hz)
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
        return _Run(signals, motion, spectrum, low, torque, late, jumps, valid)

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

    def torque(self, run: int, unknowns: Unknowns) -> Array:
        """Reported torque within the band, (n,) on the full grid; clipped where the unknowns say it was."""
        of, e = self.runs[run], unknowns.effects
        limit = e.torque_limit_nm / e.torque_gain
        if np.max(np.abs(of.signals.torque_nm)) <= limit:
            torque = of.torque_nm
        else:
            torque = of.spectrum.apply(np.clip(of.signals.torque_nm, -limit, limit), of.low)
        t = unknowns.timing_s
        return np.asarray(torque + t * of.late_nm[0] + 0.5 * t**2 * of.late_nm[1]) if t != 0 else torque

    def needed(self, run: int, unknowns: Unknowns) -> Array:
        """Torque that the drive would report, were the belief right, within the band; (n,) on the full grid."""
        of, e = self.runs[run], unknowns.effects
        motion = forward.uncentred(of.motion, e.eccentricity_rad, e.eccentricity_phase_rad)
        torque = self.belief.rotor_inertia * motion.acceleration + self.belief.motor_friction * motion.speed
        torque = torque + self._coupling(run, motion, e)
        torque -= forward.motor_helped(
            e,
            motion,
            of.signals.time_s,
            unknowns.phases_rad.get(run, 0.0),
            of.signals.share,
            self.prepared.smoothing_rad_s,
        )
        gain = of.low
        if e.torque_lag_s != 0:
            gain = gain * (1 + of.spectrum.omega * e.torque_lag_s)
        if unknowns.timing_s != 0:
            gain = gain * np.exp(of.spectrum.omega * unknowns.timing_s)
        return np.asarray(of.spectrum.apply(torque, gain) / e.torque_gain)

    def _coupling(self, run: int, motion: forward.Motion, e: Effects) -> Array:
        key = (run, *(getattr(e, name) for name in _HUNG))
        known = self._hung.get(key)
        if known is None:
            known = forward.coupling_needed(self.belief, e, motion)
            if len(self._hung) > _KEPT * len(self.runs):
                self._hung.clear()
            self._hung[key] = known
        return known

    def residual(self, run: int, unknowns: Unknowns) -> Array:
        """Reported minus needed torque (N·m) on the compared grid, (n,); beyond all bounds where none is possible."""
        if not self._possible(unknowns.effects):
            return np.full(self.runs[run].valid.size, 1e3 * self._peak_nm)
        of = self.runs[run]
        full = self.torque(run, unknowns) - self.needed(run, unknowns)
        compared = full[:: self.prepared.every]
        return np.asarray(compared - of.jumps * (of.jumps[of.valid] @ compared[of.valid]))

    def _possible(self, e: Effects) -> bool:
        """Whether there could be such a machine."""
        lightest = float(np.min(self.belief.inertia_coefficients[3]))
        rotor = self.belief.rotor_inertia if self.belief.rigid else 0.0
        left = rotor + e.inertia_scale * lightest + e.inertia_delta_kgm2
        clipped = e.torque_limit_nm < LEAST_LIMIT * self._peak_nm * e.torque_gain
        return left >= LIGHTEST * (rotor + lightest) and not clipped

    def all(self, runs: Sequence[int], unknowns: Unknowns) -> list[Array]:
        """Residuals of several runs."""
        return [self.residual(run, unknowns) for run in runs]
