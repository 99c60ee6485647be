"""J_l(θ) from the ripple around a moving machine: the load's balance of momentum, linearised around the motion.

With (A7), J(θ) ω' + ½J'(θ) ω² = d(Jω)/dt − ½J'ω². A small ripple θ~, ω~ around the motion θ_0, ω_0, α_0 obeys

    C~ − b_l ω~ + T_l' θ~ = d(J ω~)/dt + (½ J'' ω_0² + J' α_0) θ~        J, J', J'', T_l' at θ_0(t)

(δ(Jω) = Jω~ + J'ω_0θ~ and δ(½J'ω²) = J'ω_0ω~ + ½J''ω_0²θ~): J ω~' alone would miss the J' ω_0 ω~ of an inertia
that changes on the way and the position term, 2 % at 100 ms. Coupling torque and load speed come from the motor
side: C~ = T~ − b_r ω_r~ − J_r ω_r~', (b d/dt + k)(ω_r − ω_l)~ = C~'.

Each equation is a Fourier coefficient of that balance over the whole record, divided by jω so that white noise
of the speed stays white: J multiplies the measured signals before anything is averaged, so no window smears it
and no derivative of J ω~ is ever taken of samples. Linear in J's B-spline, so one least-squares solution gives
it, with the roughness that the record's own likelihood asks for (`solve.py`), its covariance, and beside it what
would otherwise spoil it: viscous and dry friction that nobody mentioned, and the delay of torque to speed.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.interpolate import BSpline

from schwung.drivetrain.machine import Machine
from schwung.estimation.ripple import Ripple
from schwung.estimation.sdft import ComplexArray
from schwung.motion import Array

#: The equations' frequencies, shares of the injected one: clear of the motion below; above, up to where J_l may
#: spread the ripple.
BAND = (0.25, 2.5)
#: Signals pass unchanged up to the first share of the injected frequency, and not at all from the second: wider than
#: the band by what a curve that is passed quickly moves the ripple's frequencies.
PASS, STOP = 3.5, 5.5
#: The equations use so many samples per period, as STOP and the curve's own band allow: more say nothing new.
SAMPLES_PER_PERIOD = 16
#: Periods of the injection at both ends of a record that fade in and out: the filter's memory.
FADE_PERIODS = 1.0
#: Signals are not believed to be freer of noise than this share of their strongest coefficient.
ROUNDING = 1e-6
#: Pieces of the spline, in angle.
PIECES = 48


@dataclass(frozen=True, eq=False)
class Basis:
    """Cubic B-splines over the load angle, uniform."""

    low_rad: float
    high_rad: float
    pieces: int = PIECES

    @property
    def size(self) -> int:
        return self.pieces + 3

    def at(self, angle_rad: Array, derivative: int = 0) -> Array:
        """Values or derivatives of all splines, (n, size); angles outside count as the nearest end."""
        step = (self.high_rad - self.low_rad) / self.pieces
        knots = self.low_rad + step * np.arange(-3, self.pieces + 4)
        inside = np.clip(angle_rad, self.low_rad, self.high_rad)
        return np.asarray(BSpline(knots, np.eye(self.size), 3)(inside, nu=derivative))


@dataclass(frozen=True, eq=False)
class LoadSide:
    """Load motion and ripple that follow from the motor's signals, (n,)."""

    angle_rad: Array
    speed_rad_s: Array
    acceleration_rad_s2: Array
    ripple_angle_rad: ComplexArray
    ripple_speed_rad_s: ComplexArray
    driving_torque_nm: ComplexArray  # of the coupling, less the load's viscous friction
    motor_speed_rad_s: ComplexArray  # the ripple's
    # (n, 4) torques per unit: viscous, dry friction, delay (dT~/dt), loss (−d²T~/dt²); (n, 5) where the injection is
    # held: its delay alone, and the controller's
    spoilers: ComplexArray
    spoilers_wind_up: ComplexArray  # what each winds up the coupling by
    spoilers_wind_up_rate: ComplexArray  # its derivative
    noise: Array  # standard deviation of a Fourier coefficient's real part, at `frequencies`
    frequencies: Array
    fade: Array
    step: int  # every so many samples say all there is within the filter's band


@dataclass(frozen=True, eq=False)
class Equations:
    """y = inertia·c + nuisance·p + noise of unit variance, as far as the noise floors tell; real rows."""

    inertia: Array  # (rows, basis.size)
    nuisance: Array  # (rows, 4 or 5), of `spoilers`
    y: Array

    def scaled(self, weight: Array) -> Equations:
        """The same with other weights, (rows,)."""
        column = weight[:, None]
        return Equations(column * self.inertia, column * self.nuisance, weight * self.y)


def load_side(ripple: Ripple, machine: Machine) -> LoadSide:
    """From the motor's signals to the load's, band-limited."""
    rate, n = ripple.sample_rate_hz, ripple.time_s.size
    f = np.fft.fftfreq(n, 1 / rate)
    s = np.asarray(2j * np.pi * f, dtype=np.complex128)
    gain = _low_pass(np.abs(f) / ripple.frequency_hz)
    fade = fade_in_and_out(n, rate, ripple.frequency_hz)

    torque = gain * np.fft.fft(ripple.ripple_torque_nm)
    speed_floor = noise_floor(ripple.ripple_speed_rad_s * fade, rate, ripple.frequency_hz)
    position_floor = noise_floor(ripple.ripple_position_rad * fade, rate, ripple.frequency_hz)
    share = speed_floor / (speed_floor + np.abs(s) ** 2 * position_floor)  # of the angle in the speed
    moved = gain * np.fft.fft(ripple.ripple_position_rad)
    speed = share * s * moved + (1 - share) * gain * np.fft.fft(ripple.ripple_speed_rad_s)

    motor = machine.motor
    coupling = torque - (motor.inertia_kgm2 * s + motor.viscous_friction_nms) * speed
    compliance = _compliance(machine, s)
    wind_up = coupling * compliance
    load_speed = speed - s * wind_up

    smooth_speed = np.fft.ifft(gain * np.fft.fft(ripple.speed_rad_s)).real
    acceleration = np.fft.ifft(s * gain * np.fft.fft(ripple.speed_rad_s)).real
    mean_coupling = (
        ripple.torque_nm - motor.inertia_kgm2 * acceleration - motor.viscous_friction_nms * smooth_speed
    )
    # the load leads and lags the motor by as much as the coupling winds up: its own motion is what turns J_l
    wound_up = gain * compliance * np.fft.fft(mean_coupling)
    lead = np.fft.ifft([wound_up, s * wound_up, s**2 * wound_up], axis=1).real

    held = ripple.held_torque_nm
    delayed = torque if held is None else gain * np.fft.fft(held)
    spoilers = np.column_stack(
        [
            np.fft.ifft(speed),
            np.fft.ifft(gain * np.fft.fft(_friction(ripple, smooth_speed, np.fft.ifft(speed)))),
            np.fft.ifft(s * delayed),
            np.fft.ifft(-(s**2) * torque),
            *([] if held is None else [np.fft.ifft(s * (torque - delayed))]),
        ]
    )
    wound = np.fft.fft(spoilers.T).T * (gain * compliance)[:, None]
    chosen = (f >= BAND[0] * ripple.frequency_hz) & (f <= min(BAND[1] * ripple.frequency_hz, 0.45 * rate))
    torque_floor = noise_floor(ripple.ripple_torque_nm * fade, rate, ripple.frequency_hz)
    kinematic = speed_floor * (1 - share[chosen])
    accelerated = float(np.linalg.norm((s * speed)[chosen]))
    apparent = float(np.linalg.norm(torque[chosen])) / accelerated if accelerated else 0.0  # kg·m²
    return LoadSide(
        angle_rad=ripple.position_rad - lead[0],
        speed_rad_s=smooth_speed - lead[1],
        acceleration_rad_s2=acceleration - lead[2],
        ripple_angle_rad=np.fft.ifft(moved - wind_up),
        ripple_speed_rad_s=np.fft.ifft(load_speed),
        driving_torque_nm=np.fft.ifft(coupling - machine.load.viscous_friction_nms * load_speed),
        motor_speed_rad_s=np.fft.ifft(speed),
        spoilers=spoilers,
        spoilers_wind_up=np.fft.ifft(wound.T).T,
        spoilers_wind_up_rate=np.fft.ifft(s * wound.T).T,
        noise=np.sqrt((torque_floor / np.abs(s[chosen]) ** 2 + kinematic * apparent**2) / 2),
        frequencies=np.asarray(f[chosen]),
        fade=fade,
        step=max(1, int(rate / (SAMPLES_PER_PERIOD * ripple.frequency_hz))),
    )


@dataclass(frozen=True, eq=False)
class _Spectrum:
    """Fourier coefficients of a load side's samples, faded, at its frequencies: of every so many of them, which an FFT
    of the whole record takes as zeros between. A matrix of exponentials grows with the square of the record.
    """

    size: int  # of the record, in samples
    kept: slice
    bins: NDArray[np.int64]
    s: ComplexArray  # (frequencies, 1): jω
    phase: ComplexArray  # (frequencies, 1): of the record's begin
    fade: Array  # (kept, 1)
    rise: Array  # (kept, 1): its derivative

    @classmethod
    def of(cls, load: LoadSide, ripple: Ripple) -> _Spectrum:
        """At the frequencies of the balance, which are the record's own."""
        kept, size = slice(None, None, load.step), ripple.time_s.size
        s = np.asarray(2j * np.pi * load.frequencies[:, None], dtype=np.complex128)
        fade = load.fade[kept]
        return cls(
            size, kept, np.rint(load.frequencies * size / ripple.sample_rate_hz).astype(np.int64), s,
            np.exp(-s * ripple.time_s[0]), fade[:, None],
            np.gradient(fade, load.step / ripple.sample_rate_hz)[:, None],
        )  # fmt: skip

    def over_s(self, torque: ComplexArray, momentum: ComplexArray | None = None) -> ComplexArray:
        """Of ∫ torque dt + momentum, (kept, columns) each; (frequencies, columns). By parts: what is a derivative
        falls on fade and kernel.
        """
        if momentum is None:
            return self._of(self.fade * torque) / self.s
        return self._of(self.fade * torque - self.rise * momentum) / self.s + self._of(self.fade * momentum)

    def _of(self, values: ComplexArray) -> ComplexArray:
        record = np.zeros((values.shape[1], self.size), dtype=np.complex128)
        record[:, self.kept] = values.T
        return np.asarray(np.fft.fft(record)[:, self.bins].T * self.phase)


@dataclass(frozen=True, eq=False)
class Balance:
    """The balance of one ripple at every frequency of the band: all of it that no curve changes."""

    load: LoadSide
    spectrum: _Spectrum
    inertia: Array  # (samples, basis.size): the splines at those that are kept
    turning: Array  # the same: what each spline makes of a ripple of the angle, N·m/rad
    columns: Array  # (rows, basis.size), weighted
    driving: Array  # (rows,)

    @classmethod
    def of(cls, load: LoadSide, ripple: Ripple, basis: Basis) -> Balance:
        """With the splines of `basis`."""
        spectrum = _Spectrum.of(load, ripple)
        kept = spectrum.kept
        inertia, slope, bend = (basis.at(load.angle_rad[kept], order) for order in range(3))
        turning = (
            bend * (load.speed_rad_s[kept] ** 2 / 2)[:, None] + slope * load.acceleration_rad_s2[kept, None]
        )
        columns = spectrum.over_s(
            turning * load.ripple_angle_rad[kept, None], inertia * load.ripple_speed_rad_s[kept, None]
        )
        driving = spectrum.over_s(load.driving_torque_nm[kept, None])
        return cls(load, spectrum, inertia, turning, _real(columns, load), _real(driving, load)[:, 0])

    def equations(self, curve: Array | None = None, pull: Array | None = None) -> Equations:
        """Weighted by the noise.

        `curve`: the spline's coefficients as known so far, (basis.size,). What spoils the motor's torque also spoils
        the load speed that follows from it, by as much as the load is heavy; without a curve that part is left out.
        `pull`: dT_l/dθ along the motion (N·m/rad), (samples,).
        """
        load, spectrum = self.load, self.spectrum
        kept = spectrum.kept
        torque, momentum = load.spoilers[kept], None
        if curve is not None:
            momentum = (self.inertia @ curve)[:, None] * load.spoilers_wind_up_rate[kept]
            torque = torque + (self.turning @ curve)[:, None] * load.spoilers_wind_up[kept]
        driving = self.driving
        if pull is not None and np.any(pull):
            sprung = spectrum.over_s((pull[kept] * load.ripple_angle_rad[kept])[:, None])
            driving = driving + _real(sprung, load)[:, 0]
        return Equations(self.columns, _real(spectrum.over_s(torque, momentum), load), driving)


def _real(values: ComplexArray, load: LoadSide) -> Array:
    """Complex rows over their noise, as real ones: real parts, then imaginary ones."""
    weighted = values / load.noise[:, None]
    return np.vstack([weighted.real, weighted.imag])


def _compliance(machine: Machine, s: ComplexArray) -> ComplexArray:
    """Wind-up per coupling torque, rad/N·m."""
    if machine.coupling is None:
        return np.zeros_like(s)
    return np.asarray(1 / (machine.coupling.damping_nms * s + machine.coupling.stiffness_nm_rad))


def _low_pass(share: Array) -> Array:
    """1 up to PASS, 0 from STOP, a raised cosine between."""
    x = np.clip((share - PASS) / (STOP - PASS), 0.0, 1.0)
    return np.asarray((1 + np.cos(np.pi * x)) / 2)


def fade_in_and_out(n: int, rate: float, frequency_hz: float) -> Array:
    ends = np.minimum(np.arange(n), np.arange(n)[::-1]) / rate * frequency_hz / FADE_PERIODS
    return np.asarray((1 - np.cos(np.pi * np.clip(ends, 0.0, 1.0))) / 2)


def noise_floor(values: ComplexArray, rate: float, frequency_hz: float) -> float:
    """Power of the noise in a Fourier coefficient, from the frequencies above the ripple; never quite 0."""
    f = np.abs(np.fft.fftfreq(values.size, 1 / rate))
    above = (f > min(STOP * frequency_hz, 0.3 * rate)) & (f < min(2 * STOP * frequency_hz, 0.5 * rate))
    power = np.abs(np.fft.fft(values)) ** 2
    found = float(np.median(power[above])) / np.log(2) if above.any() else 0.0
    return max(found, ROUNDING**2 * float(np.max(power)), 1e-200)


def _friction(ripple: Ripple, speed: Array, ripple_speed: ComplexArray) -> ComplexArray:
    """The ripple of sign(ω): as the phases see it."""
    if ripple.real:
        return np.asarray(np.sign(speed + ripple_speed.real) - np.sign(speed), dtype=np.complex128)
    phases = np.array(ripple.phases_rad)
    each = np.sign(speed + np.real(np.exp(1j * phases)[:, None] * ripple_speed))
    return np.asarray(np.exp(-1j * phases) @ each * 2 / phases.size)
