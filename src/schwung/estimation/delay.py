"""The delay between torque and speed, found in the record and removed.

A delay τ turns the phase of the ripple by ωτ. So does friction, and so does an inertia that changes: only the
fit of the whole curve (`fit.py`), with J_l(θ) and frictions free, tells them apart. Where the speed lags behind
the angle of the same drive, that part is seen by comparing the two. What remains is the angle's lag behind the
torque. Angles label the result, so they keep the time: the speed is moved forward to them, the torque back.

What delays also takes off: a lag of first order τ leaves 1 − ½(ωτ)² of an amplitude, a pure delay all of it, and
0.1 ms at 70 Hz is worth 0.1 % of the inertia. What the speed lost against the angle is measured. The torque has
nothing to be compared with: `reporting.py` weighs what it may have lost, and as the angle must be seen as the torque
is, it is given that loss too.

Of an injection that a bus holds, the torque is known as sent; the controller's share is as reported. Each has a delay
of its own then: the ripple tells the injection's, the motion the controller's (`report.py`).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from scipy.interpolate import CubicSpline

from schwung.drivetrain.machine import Machine
from schwung.errors import InputError
from schwung.estimation.balance import STOP, fade_in_and_out, noise_floor
from schwung.estimation.denoise import denoise
from schwung.estimation.fit import NOTHING, Nuisance, fit_curve
from schwung.estimation.report import controller_lag, expected, speed_lag
from schwung.estimation.reporting import Losses, Seen, losses
from schwung.estimation.ripple import (
    CONTROLLER_STD,
    Ripple,
    injection_of,
    phase_groups,
    ripple_of_pair,
    ripple_of_phases,
)
from schwung.innovations.low_pass import low_passed
from schwung.innovations.signals import LAGS, LOSS_STD
from schwung.motion import Array
from schwung.session.model import Run, Session

#: A delay is removed when it turns the ripple by more than this (rad), and stands clear of its own uncertainty.
MIN_PHASE_RAD = 0.01
#: More than this is no delay but a wrong signal.
MAX_PHASE_RAD = 1.0
ROUNDS = 5
#: Speed and angle are compared this far about the injected frequency, as a share of it.
ABOUT = 0.25
#: Attribute of a run: the losses γ of torque and speed (s²) that were made even, and up to which frequency (Hz).
LOSSES = "losses_made_even"
#: And what its speed's samples held of the corners of a held torque (rad/s), as recorded, (n,).
CORNERS = "speed_at_corners_rad_s"
#: The iteration has settled within this share of a sample.
SETTLED_SAMPLES = 1e-3

NO_LOSSES = Losses(NOTHING, NOTHING, 0.0)


@dataclass(frozen=True)
class Delay:
    """How far speed and angle lag behind the torque, s; positive: they come later."""

    angle: Nuisance  # of the angle behind the torque
    speed: Nuisance  # of the speed behind the angle
    frequency_hz: float
    losses: Losses = NO_LOSSES  # of the speed against the angle, of the torque against the one that acts
    bare_kgm2: float = np.inf  # the inertia that follows a held torque's corners
    share: float = 0.0  # of the speed in what is known of the motion, against the angle
    controller: Nuisance | None = (
        None  # of what is reported of the controller's torque, where injections are held
    )

    @property
    def loss_std_s2(self) -> float:
        """How far it is unknown what the motion lost against the torque."""
        return float(np.hypot(self.losses.torque_s2.std, self.share * self.losses.speed_s2.std))

    @property
    def torque_to_speed(self) -> Nuisance:
        """The whole delay of speed behind torque."""
        return Nuisance(self.angle.value + self.speed.value, float(np.hypot(self.angle.std, self.speed.std)))

    @property
    def significant(self) -> bool:
        """Whether one of the two is worth removing."""
        parts = (self.angle, self.speed)
        return self.controller is not None or any(_worth_removing(part, self.frequency_hz) for part in parts)

    @property
    def text(self) -> str:
        """One sentence for the notes."""
        if self.controller is not None:
            late = f"{self.controller.value * 1e3:.3f} ± {2 * self.controller.std * 1e3:.2g} ms late"
            return f"The drive reports the controller's torque {late}, as the motion tells; it was brought forward."
        whole, speed = self.torque_to_speed, round(self.speed.value * 1e3, 3)
        order = "after" if whole.value > 0 else "ahead of"
        text = f"The speed is reported {abs(whole.value) * 1e3:.3f} ± {2 * whole.std * 1e3:.2g} ms {order} the torque"
        return text + (f", {speed:.3f} ms behind the angle; removed." if speed else "; removed.")


def _worth_removing(part: Nuisance, frequency_hz: float) -> bool:
    return part.clear and 2 * np.pi * frequency_hz * abs(part.value) > MIN_PHASE_RAD


def find_delay(session: Session, excited: Sequence[Run], machine: Machine) -> Delay | None:
    """The delay of these runs; None where neither phases nor references take the motion out of them, or where
    torque and speed do not belong to one machine at all.

    Raises InputError where the runs do not align.
    """
    ripples = _ripples(session, excited)
    if not ripples:
        return None
    lag = _mean_lag([_speed_behind_angle(ripple) for ripple in ripples])
    held = any(ripple.held_torque_nm is not None for ripple in ripples)
    lagging = _worth_removing(lag.delay_s, ripples[0].frequency_hz)
    # else the torque would be moved to make up for a chance
    speed = lag.delay_s if lagging else Nuisance(0.0, lag.delay_s.std)
    found = 0.0
    settled = SETTLED_SAMPLES / ripples[0].sample_rate_hz
    controller = _before(session, ripples)
    prior = controller
    for _ in range(ROUNDS):
        late = 0.0 if controller is None else controller.value
        moved = [_moved(ripple, torque_s=found, speed_s=speed.value, controller_s=late) for ripple in ripples]
        fit = fit_curve(moved, machine)
        further = fit.delay_s
        found += further.value
        if controller is not None and prior is not None:
            left = controller_lag(fit, machine, Nuisance(prior.value - late, prior.std))
            controller = Nuisance(late + left.value, left.std)
            late = left.value
        if abs(further.value) < settled and abs(late) < settled:
            break
    if not fit.physical or 2 * np.pi * ripples[0].frequency_hz * abs(found) > MAX_PHASE_RAD:
        return None
    angle = Nuisance(found, further.std)
    bare = machine.motor.inertia_kgm2
    if machine.coupling is None:
        bare += float(np.mean(fit.solution.coefficients))
    taken = NO_LOSSES
    if not held or (lagging and speed.value > 0):
        seen = Seen(lag.delay_s, lag.loss_s2, Nuisance(-found, further.std), _met(ripples) / bare)
        period = 1 / machine.control.sample_rate_hz if machine.control else None
        taken = losses(seen, period, 1 / ripples[0].sample_rate_hz, held=held)
        if not abs(taken.speed_s2.value) > taken.speed_s2.std:  # as of a speed too coarse to be compared
            taken = replace(taken, speed_s2=replace(taken.speed_s2, value=0.0))
    return Delay(angle, speed, ripples[0].frequency_hz, taken, bare, lag.share, controller)


def _met(ripples: Sequence[Ripple]) -> float:
    """The inertia that the injection meets at the motor (kg·m²): the torque in phase with the acceleration."""
    moved = turned = 0.0
    for ripple in ripples:
        f = np.fft.fftfreq(ripple.time_s.size, 1 / ripple.sample_rate_hz)
        chosen = np.abs(f / ripple.frequency_hz - 1) < ABOUT
        accelerated = -((2 * np.pi * f[chosen]) ** 2) * np.fft.fft(ripple.ripple_position_rad)[chosen]
        moved += float(np.real(np.vdot(accelerated, np.fft.fft(ripple.ripple_torque_nm)[chosen])))
        turned += float(np.real(np.vdot(accelerated, accelerated)))
    return moved / max(turned, 1e-300)


def without_delay(session: Session, delay: Delay) -> Session:
    """The session with speed and torque of every run brought to the angle's time."""
    return replace(session, runs=tuple(_run_without(run, delay) for run in session.runs))


def _run_without(run: Run, delay: Delay) -> Run:
    time, rate, torque = run.time_s, run.sample_rate_hz, delay.losses.torque_s2
    highest = STOP * delay.frequency_hz
    added = run.torque_added_nm
    extra: dict[str, Any] = {}
    # a delay that is no more than chance is left to the fit, where it costs least
    late = delay.angle.value if _worth_removing(delay.angle, delay.frequency_hz) else 0.0
    if delay.controller is None:
        driving = _shifted(run.torque_nm, time, late)
    else:
        held = injection_of(run)
        driving = _shifted(held, time, late) + _shifted(run.torque_nm - held, time, -delay.controller.value)
        added = None if added is None else _shifted(added, time, late)
        extra = {CONTROLLER_STD: delay.controller.std}
    speed, loss = _shifted(run.speed_rad_s, time, -delay.speed.value), delay.losses.speed_s2
    if delay.losses.corner_s2:
        edge = 2 * highest / rate
        smooth = low_passed(driving, edge, 4) if edge < 1 else driving
        corners = delay.losses.corner_s2 / delay.bare_kgm2 * np.gradient(smooth, 1 / rate)
        speed, extra = speed - corners, {**extra, CORNERS: _shifted(corners, time, delay.speed.value)}
    return replace(
        run,
        position_rad=_lessened(run.position_rad, rate, torque.value, highest),
        speed_rad_s=_lessened(speed, rate, torque.value - loss.value, highest),
        torque_nm=driving,
        torque_added_nm=added,
        extra={
            **run.extra,
            **extra,
            LOSS_STD: delay.loss_std_s2,
            LOSSES: (torque.value, loss.value, highest),
            LAGS: ((delay.angle.value, delay.speed.value), (delay.angle.std, delay.speed.std)),
        },
    )


def amplitudes_restored(recorded: Session, ready: Session) -> Session:
    """The session as recorded, its lags kept and told, but torque and speed with the amplitude that filters took off
    them, as far as `delay_removed` found any and said so in the runs of `ready`, the same in number and order.
    """

    def one(run: Run, made: Run) -> Run:
        if LOSSES not in made.extra:
            return run
        torque, speed, highest = made.extra[LOSSES]
        return replace(
            run,
            torque_nm=_lessened(run.torque_nm, run.sample_rate_hz, -torque, highest),
            speed_rad_s=_lessened(
                run.speed_rad_s - made.extra.get(CORNERS, 0.0), run.sample_rate_hz, -speed, highest
            ),
            extra={**run.extra, **{key: made.extra[key] for key in (LOSS_STD, LAGS) if key in made.extra}},
        )

    return replace(recorded, runs=tuple(one(*both) for both in zip(recorded.runs, ready.runs, strict=True)))


def _lessened(values: Array, rate: float, loss_s2: float, highest_hz: float) -> Array:
    """The signal as after a loss of γω² (a gain where γ is negative), without lag; no more from `highest_hz` on."""
    if loss_s2 == 0:
        return values
    n = values.size  # odd reflections about both ends, so that neither jumps
    padded = np.concatenate([2 * values[0] - values[:0:-1], values, 2 * values[-1] - values[-2::-1]])
    omega = 2 * np.pi * np.minimum(np.fft.rfftfreq(padded.size, 1 / rate), highest_hz)
    gain = 1 / (1 + loss_s2 * omega**2) if loss_s2 > 0 else 1 - loss_s2 * omega**2
    return np.asarray(np.fft.irfft(gain * np.fft.rfft(padded), padded.size)[n - 1 : 2 * n - 1])


def _shifted(values: Array, time: Array, later_s: float) -> Array:
    """The signal, later by so much; held at its ends."""
    if later_s == 0:
        return values
    return np.asarray(CubicSpline(time, values)(np.clip(time - later_s, time[0], time[-1])))


def _ripples(session: Session, excited: Sequence[Run]) -> list[Ripple]:
    groups = phase_groups(excited)
    if groups:
        return [ripple_of_phases(group) for group in groups]
    if not session.references:
        return []
    return [ripple_of_pair(pair) for pair in denoise(session, excited)]


def _before(session: Session, ripples: Sequence[Ripple]) -> Nuisance | None:
    """What the lag of the controller's torque may be before the motion is asked; None where no injection is held."""
    if all(ripple.held_torque_nm is None for ripple in ripples):
        return None
    return expected(speed_lag(session.runs, ripples[0].frequency_hz), ripples[0].sample_rate_hz)


def _moved(ripple: Ripple, *, torque_s: float, speed_s: float, controller_s: float) -> Ripple:
    """The ripple with its torque later (of a held injection: that, and the controller's share earlier) and its speed
    earlier, by their spectra; ends fade.
    """
    f = np.fft.fftfreq(ripple.time_s.size, 1 / ripple.sample_rate_hz)
    back, forward = np.exp(-2j * np.pi * f * torque_s), np.exp(2j * np.pi * f * speed_s)
    torque, held = back * np.fft.fft(ripple.ripple_torque_nm), ripple.held_torque_nm
    if held is not None:
        sent = np.fft.fft(held)
        earlier = np.exp(2j * np.pi * f * controller_s)
        torque = back * sent + earlier * (np.fft.fft(ripple.ripple_torque_nm) - sent)
        held, torque_s = np.fft.ifft(back * sent), -controller_s
    return replace(
        ripple,
        held_torque_nm=held,
        torque_nm=_shifted(ripple.torque_nm, ripple.time_s, torque_s),
        speed_rad_s=_shifted(ripple.speed_rad_s, ripple.time_s, -speed_s),
        ripple_torque_nm=np.fft.ifft(torque),
        ripple_speed_rad_s=np.fft.ifft(forward * np.fft.fft(ripple.ripple_speed_rad_s)),
    )


@dataclass(frozen=True)
class _Lag:
    """How the speed follows the angle's derivative: later, and less by γω²."""

    delay_s: Nuisance
    loss_s2: Nuisance
    share: float  # of the speed in what is known of the motion


def _speed_behind_angle(ripple: Ripple) -> _Lag:
    """Ω(f) = jωΘ(f) e^{−jωτ} (1 − γω²) about the injected frequency, least squares; both sides are noisy."""
    rate, frequency = ripple.sample_rate_hz, ripple.frequency_hz
    fade = fade_in_and_out(ripple.time_s.size, rate, frequency)
    f = np.fft.fftfreq(fade.size, 1 / rate)
    chosen = np.abs(f / frequency - 1) < ABOUT
    omega = 2 * np.pi * f[chosen]
    speed = np.fft.fft(ripple.ripple_speed_rad_s * fade)[chosen]
    # of the derivative, faded: the fade's own slope is no speed
    moved = 1j * omega * np.fft.fft(ripple.ripple_position_rad * fade)[chosen]
    moved -= np.fft.fft(ripple.ripple_position_rad * np.gradient(fade, 1 / rate))[chosen]
    of_speed = noise_floor(ripple.ripple_speed_rad_s * fade, rate, frequency)
    of_angle = omega**2 * noise_floor(ripple.ripple_position_rad * fade, rate, frequency)
    noise = of_speed + of_angle
    share = float(np.mean(of_angle / noise))
    delay = 0.0
    for _ in range(ROUNDS):
        model = moved * np.exp(-1j * omega * delay)
        # the product of two signals with noises of their own holds none of either's power
        signal = np.real(np.conj(model) * speed)
        information = float(np.sum(omega**2 * signal / noise))
        if not information > 0:
            return _Lag(Nuisance(0.0, np.inf), Nuisance(0.0, np.inf), share)
        delay -= float(np.sum(omega * np.imag(np.conj(model) * speed) / noise)) / information
    model = moved * np.exp(-1j * omega * delay)
    signal = np.maximum(np.real(np.conj(model) * speed), 0.0)
    curvature = max(float(np.sum(omega**4 * signal / noise)), 1e-300)
    missing = np.abs(model) ** 2 - of_angle - np.real(np.conj(model) * speed)
    loss = float(np.sum(omega**2 * missing / noise)) / curvature
    # a speed that a drive filters or rounds is not off by noise alone: no better than the misfit says
    misfit = max(float(np.mean(np.abs(speed - model * (1 - loss * omega**2)) ** 2 / noise)), 1.0)
    scatter = misfit * (signal * noise + of_speed * of_angle) / noise**2 / 2
    return _Lag(
        Nuisance(delay, float(np.sqrt(np.sum(omega**2 * scatter))) / information),
        Nuisance(loss, float(np.sqrt(np.sum(omega**4 * scatter))) / curvature),
        share,
    )


def _mean_lag(lags: Sequence[_Lag]) -> _Lag:
    share = float(np.mean([lag.share for lag in lags]))
    return _Lag(_mean([lag.delay_s for lag in lags]), _mean([lag.loss_s2 for lag in lags]), share)


def _mean(parts: Sequence[Nuisance]) -> Nuisance:
    """Mean by inverse variance."""
    weight = np.array([1 / max(part.std, 1e-15) ** 2 for part in parts])
    if not np.any(weight > 0):
        return Nuisance(0.0, np.inf)
    value = float(weight @ [part.value for part in parts] / weight.sum())
    return Nuisance(value, float(1 / np.sqrt(weight.sum())))


def delay_removed(
    session: Session, excited: Sequence[Run], machine: Machine
) -> tuple[Session, tuple[str, ...]]:
    """The session without its delay where that is significant, and the note that says so.

    Where the delay cannot be found (runs that do not align, a ripple lost in noise), the session as it is: the
    method says what is wrong with it.
    """
    try:
        delay = find_delay(session, excited, machine)
    except (InputError, np.linalg.LinAlgError):
        return session, ()
    if delay is None:
        return session, ()
    return without_delay(session, delay), (delay.text,) if delay.significant else ()
