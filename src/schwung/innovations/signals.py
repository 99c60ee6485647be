"""A run as the innovations model takes it: the torque between samples, and the states believed."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
from numpy.lib.stride_tricks import sliding_window_view
from scipy.interpolate import CubicSpline

from schwung.drivetrain.machine import Machine
from schwung.innovations.held import Held
from schwung.innovations.low_pass import low_passed
from schwung.innovations.splines import bends, interpolated, slopes
from schwung.motion import Array
from schwung.session.model import Run

#: Attribute of a run: the standard deviation (s²) of how far it is unknown what a filter took off torque and speed.
LOSS_STD = "torque_loss_std_s2"
#: And what is known already of two lags: of the angle behind the torque and of the speed behind the angle (s), and
#: their standard deviations.
LAGS = "lags_s"
#: Bands above this share of the highest frequency are not worth a filter.
WIDEST = 0.8
#: Samples that say all there is: so many per period of the band's end, and of the rotor's swing against the coupling,
#: and while a piece of the curve goes by at top speed: a step takes its inertia from its middle.
PER_BAND, PER_SWING, PER_PIECE = 11.0, 4.0, 2.0
#: Smallest error of the angle that is believed, over the visited range.
FINEST = 1e-9
#: Half the length of the filter before samples are left out, in the remaining ones; β of its taps' Kaiser window.
_HALF, _TAPS = 6, 6.0
SHORTEST = 60  # fewer samples than this are not worth a filter


#: Weights that guess a sample by its neighbours' cubic; what misses by more than so many times the usual is sharp.
_GUESS, _SHARP = np.array([-1.0, 4.0, 0.0, 4.0, -1.0]) / 6, 3.0


#: What is worked out of a run's signals and does not depend on its states.
_STATELESS = ("load_nm", "unmoved_rad2", "_injected")
#: So many times of a held injection's are kept.
_TIMES = 4


@dataclass(frozen=True, eq=False)
class Between:
    """Torque over each step (N·m), and what a second of either delay adds to it; (n − 1,) each."""

    start_nm: Array
    end_nm: Array
    bulge_nm: Array  # height of a parabola over the straight line from start to end
    by_delay: Array
    by_controller_delay: Array


@dataclass(frozen=True, eq=False)
class Drive:
    """The torque of one run, between its samples."""

    time_s: Array
    smooth: CubicSpline  # all of it, or the controller's part where the injection is held
    held: Held
    every: int = 1  # of so many recorded samples one is taken

    @cached_property
    def injected_nm(self) -> Array:
        """The held injection as a curve through the middles of its steps, at the samples, (n,)."""
        return self.held.curve(0.0)

    @property
    def recorded_nm(self) -> Array:
        """All of it but the held injection, at all samples that were recorded."""
        return np.asarray(self.smooth(self.smooth.x))

    @cached_property
    def smooth_nm(self) -> Array:
        """The same at the samples, (n,)."""
        return self._at_samples(self.recorded_nm)

    def asked(self, law: Callable[[Array], Array], filter_s: float) -> Array:
        """What a law makes of the torque that was asked for, before a filter delayed it by so much, at the samples.

        It is asked of each recorded one, so that a corner stays where it is.
        """
        whole = self.recorded_nm if self.every > 1 else self.whole_nm
        return self._at_samples(law(whole + filter_s * self._rate))

    @cached_property
    def _rate(self) -> Array:
        """Of all of the torque at every recorded sample, from those that are taken (N·m/s)."""
        within = np.clip(self.smooth.x, self.time_s[0], self.time_s[-1])
        return np.asarray(CubicSpline(self.time_s, self.whole_nm)(within, 1))

    def _at_samples(self, values: Array) -> Array:
        """Of values at all that were recorded; passed through a filter, where more were."""
        if self.every < 2:
            return np.asarray(values)
        return np.convolve(values, _taps(self.every), "valid")[:: self.every]

    @cached_property
    def sharp_nm2(self) -> Array:
        """Variance (N·m)² of the torque between samples where it bends too sharply for them to tell, (n,).

        A cubic between every other sample misses a corner by so much; between all of them by half of that. Noise, and
        what is smooth, are missed alike everywhere. Where the torque was sampled several times in a step, it is missed
        in one part of it.
        """
        reported = self.recorded_nm
        if reported.size < 2 * _GUESS.size:
            return np.zeros_like(self.time_s)
        missed = np.zeros_like(reported)
        missed[2:-2] = np.convolve(reported, _GUESS, "valid") - reported[2:-2]
        usual = 1.4826 * float(np.median(np.abs(missed[2:-2])))
        sharp = np.where(np.abs(missed) > _SHARP * usual, missed**2 - usual**2, 0.0) / 4
        every, first = self.every, _HALF * self.every if self.every > 1 else 0
        around = sliding_window_view(np.pad(sharp, every, "edge"), 2 * every + 1)
        return np.asarray(np.max(around[first::every][: self.time_s.size], axis=1)) / every**2

    @cached_property
    def whole_nm(self) -> Array:
        """All of the torque at the samples, (n,)."""
        return np.asarray(self.smooth_nm + self.injected_nm)

    @cached_property
    def undelayed(self) -> Between:
        """The torque between samples as it was sampled.

        Where it was sampled several times in a step, the parabola that has its moments: at a step's ends alone it would
        be as rough as the one sample there.
        """
        if self.every < 2:
            return self.between(0.0, 0.0)
        step = float(self.time_s[1] - self.time_s[0])
        parts, weights = np.polynomial.legendre.leggauss(2)  # of each piece of the spline
        places = (np.arange(self.every)[:, None] + (parts + 1) / 2).reshape(-1) / self.every
        torque = self.smooth(self.time_s[:-1, None] + step * places)
        even = np.tile(weights, self.every) / (2 * self.every)
        across = 2 * places - 1
        mean, tilt, bend = (torque @ (even * each) for each in (
            np.ones_like(across), 3 * across, 5 * (3 * across**2 - 1) / 2))  # fmt: skip
        late = np.zeros_like(mean)
        return Between(mean - tilt + bend, mean + tilt + bend, -1.5 * bend, late, late)

    def within_steps(self, true_nm: Array) -> Between:
        """The same, bent within a step as the torque without its noise (n,) is: what noise bends there between samples
        acts on no machine, and is no torque that was reported at one. Where several samples are in a step, their mean
        counts; where the torque is sharp, only they say how.
        """
        raw, noise, step = self.undelayed, self.whole_nm - true_nm, float(self.time_s[1] - self.time_s[0])
        soft = np.maximum(self.sharp_nm2[1:], self.sharp_nm2[:-1]) == 0
        if self.every < 2:
            return replace(raw, bulge_nm=raw.bulge_nm - np.where(soft, bends(noise, step), 0.0))
        bulge = bends(true_nm, step)
        ends = true_nm[:-1], true_nm[1:]
        further = (raw.start_nm + raw.end_nm - ends[0] - ends[1]) / 2 + 2 / 3 * (raw.bulge_nm - bulge)
        return replace(
            raw,
            start_nm=np.where(soft, ends[0] + further, raw.start_nm),
            end_nm=np.where(soft, ends[1] + further, raw.end_nm),
            bulge_nm=np.where(soft, bulge, raw.bulge_nm),
        )

    def taken(self, late_s: float, whole: Between) -> Between:
        """The torque over the steps where the drive takes a held injection so much later than it was sent; `whole`:
        where it takes it at once."""
        if late_s == 0 or not self.held.is_any:
            return whole
        start, end, bulge = (self.held.over_steps(late_s) - self.held.over_steps(0.0)).T
        return replace(
            whole,
            start_nm=whole.start_nm + start,
            end_nm=whole.end_nm + end,
            bulge_nm=whole.bulge_nm + bulge,
        )

    def between(self, delay_s: float, controller_delay_s: float) -> Between:
        """Torque between samples, delayed, with its true mean over each step."""
        step = float(self.time_s[1] - self.time_s[0])
        at = np.clip(self.time_s - delay_s - controller_delay_s, self.time_s[0], self.time_s[-1])
        value = self.smooth(at)
        rise = np.diff(value)
        area = np.diff(self.smooth.antiderivative()(at))
        mean = area / np.maximum(np.diff(at), 1e-12)
        bulge = np.where(np.diff(at) > 0, 1.5 * (mean - (value[1:] + value[:-1]) / 2), 0.0)
        first, last, height = self.held.over_steps(delay_s).T
        ends = value[:-1] + first, value[1:] + last
        jump = self.held.changes(delay_s)[1]
        return Between(*ends, bulge + height, -(rise + jump) / step, -rise / step)


@dataclass(frozen=True, eq=False)
class Signals:
    """One run, and the latest belief of its states (n, s)."""

    time_s: Array
    step_s: float
    position_rad: Array
    speed_rad_s: Array
    drive: Drive
    states: Array
    rigid: bool
    band_hz: float  # within which the motion and the injection lie
    count_rad: float = 0.0  # of the encoder; 0 where the angle is not counted
    loss_std_s2: float = 0.0  # how far it is unknown what a filter took off torque and speed
    speed_measured: bool = (
        True  # if not, it was derived from the angle, whose errors it has, or there is none
    )

    def about(self, states: Array) -> Signals:
        """With another belief of the states (n, s); what does not depend on them is not worked out again."""
        other = replace(self, states=states)
        other.__dict__.update({name: self.__dict__[name] for name in _STATELESS if name in self.__dict__})
        return other

    @cached_property
    def unmoved_rad2(self) -> Array:
        """What the variance of the angle's error is more where its count stays, (n,): a motion of less than a count
        does not show, however often it is sampled, so that all samples of one stay tell what one does."""
        if not self.count_rad:
            return np.zeros_like(self.position_rad)
        stays = np.flatnonzero(np.diff(self.position_rad) != 0)
        lengths = np.diff(np.concatenate([[-1], stays, [self.position_rad.size - 1]]))
        return np.asarray(np.repeat(lengths - 1, lengths) * self.count_rad**2 / 12)

    @property
    def load_angle_rad(self) -> Array:
        return self.position_rad if self.rigid else self.states[:, 0] - self.states[:, 2]

    @property
    def load_speed_rad_s(self) -> Array:
        return np.asarray(self.states[:, 1 if self.rigid else 3])

    @cached_property
    def load_nm(self) -> Array:
        """How large the reported torque is within the band, (n,)."""
        held = np.append(self.drive.held.torque_nm, self.drive.held.torque_nm[-1:])
        return np.abs(self.quiet(self.drive.smooth_nm) + held)

    def injected(self, late_s: float) -> tuple[Array, Array, Array]:
        """A held injection taken so much later, within the band, and its two derivatives, at the samples, (n,) each."""
        kept = self._injected
        if late_s not in kept:
            whole = self.quiet(self.drive.held.curve(late_s))
            rate = slopes(whole, self.step_s)
            if len(kept) >= _TIMES:
                kept.pop(next(iter(kept)))
            kept[late_s] = whole, rate, slopes(self.quiet(rate), self.step_s)
        return kept[late_s]

    @cached_property
    def _injected(self) -> dict[float, tuple[Array, Array, Array]]:
        return {}

    def quiet(self, values: Array) -> Array:
        """Signals (n, …) without what lies above the band, without lag."""
        edge = 2 * self.band_hz * self.step_s
        return values if edge >= WIDEST or values.shape[0] <= SHORTEST else low_passed(values, edge, 4)

    def speed_at(self, delay_s: float, derivative: int = 0) -> Array:
        """The believed motor speed `delay_s` before each sample, or its derivative, (n,)."""
        then = np.clip(self.time_s - delay_s, self.time_s[0], self.time_s[-1])
        return interpolated(self.states[:, 1], self.time_s[0], self.step_s, then, derivative)

    @cached_property
    def rates(self) -> Array:
        """By how much the believed angle and speed and the reported torque change within a second, in the band,
        (n, 3)."""
        changing = np.column_stack([self.states[:, 1], self.drive.smooth_nm])
        return np.column_stack([self.states[:, 1], slopes(self.quiet(changing), self.step_s)])

    @cached_property
    def load_acceleration(self) -> Array:
        """Of the believed load within the band, (n,), rad/s²."""
        return slopes(self.quiet(self.load_speed_rad_s), self.step_s)


def picked_signals_of(recorded: Run, machine: Machine, band_hz: float) -> Signals:
    """A recorded run made ready of which only every so manieth sample is taken, each as it was recorded.

    A filter passes what is linear: of a contact that closes it makes a motion that no machine has. The torque between
    the samples that are taken is that of all.
    """
    every = _spare(recorded, machine, band_hz, 0.0)
    whole = signals_of(recorded, machine, band_hz)
    if every < 2:
        return whole
    edge = _HALF * every
    picks = slice(edge, len(recorded) - edge, every)
    time_s = whole.time_s[picks]
    return replace(
        whole,
        time_s=time_s,
        step_s=every * whole.step_s,
        position_rad=whole.position_rad[picks],
        speed_rad_s=whole.speed_rad_s[picks],
        drive=Drive(time_s, whole.drive.smooth, Held(time_s, np.zeros(time_s.size - 1)), every),
        states=whole.states[picks],
    )


def signals_of(recorded: Run, machine: Machine, band_hz: float, pieces_hz: float | None = None) -> Signals:
    """A recorded run made ready; where the injection is held, the torque is a staircase plus the controller's.

    `pieces_hz`: of the curve to be fitted, passed by in a second; if given, no more samples than needed (`thinned`).
    """
    run = recorded if pieces_hz is None else thinned(recorded, machine, band_hz, pieces_hz)
    held, smooth = np.zeros(len(run) - 1), run.torque_nm
    if run.is_held and run.torque_added_nm is not None:
        held, smooth = run.torque_added_nm[1:], run.torque_nm - run.torque_added_nm
    position, rigid = run.position_rad, machine.coupling is None
    speed = (
        CubicSpline(run.time_s, position).derivative()(run.time_s) if np.ptp(run.speed_rad_s) == 0 else None
    )
    speed = run.speed_rad_s if speed is None else speed
    states = [position, speed] if rigid else [position, speed, np.zeros_like(speed), speed]
    return Signals(
        time_s=run.time_s,
        step_s=1 / run.sample_rate_hz,
        position_rad=position,
        speed_rad_s=run.speed_rad_s,
        drive=Drive(run.time_s, CubicSpline(run.time_s, smooth), Held(run.time_s, held)),
        states=np.column_stack(states),
        rigid=rigid,
        band_hz=band_hz,
        count_rad=count_of(recorded.position_rad),
        loss_std_s2=float(run.extra.get(LOSS_STD, 0.0)),
    )


def count_of(values: Array) -> float:
    """What one count of a signal is, in its unit; 0 where it is not counted."""
    moves = np.abs(np.diff(values))
    moves = moves[moves > FINEST * float(np.ptp(values))]
    if moves.size == 0:
        return 0.0
    counts = moves / moves.min()
    return float(moves.min()) if float(np.median(np.abs(counts - np.round(counts)))) < 0.02 else 0.0


def thinned(run: Run, machine: Machine, band_hz: float, pieces_hz: float) -> Run:
    """The run with no more samples than motion, injection, the coupling's swing and the curve's pieces need.

    All signals pass one filter without lag, which the machine's balance passes as a whole; white noise stays white, and
    its density in the band what it was. Runs with a held injection stay as they are: their steps matter.
    """
    every = _spare(run, machine, band_hz, pieces_hz)
    if every < 2:
        return run
    half = _HALF * every
    taps = _taps(every)

    def thin(values: Array) -> Array:
        return np.convolve(values, taps, "valid")[::every]

    return replace(
        run,
        sample_rate_hz=run.sample_rate_hz / every,
        time_s=run.time_s[half:-half:every],
        position_rad=thin(run.position_rad),
        speed_rad_s=thin(run.speed_rad_s),
        torque_nm=thin(run.torque_nm),
        torque_added_nm=None,
        position_demand_rad=None,
    )


def _spare(run: Run, machine: Machine, band_hz: float, pieces_hz: float) -> int:
    """Of how many samples one is enough for motion, injection, the coupling's swing and the curve's pieces."""
    swing = machine.coupling.stiffness_nm_rad / machine.motor.inertia_kgm2 if machine.coupling else 0.0
    needed = max(PER_BAND * band_hz, PER_SWING * np.sqrt(swing) / (2 * np.pi), PER_PIECE * pieces_hz)
    every = int(run.sample_rate_hz / needed)
    return 1 if run.is_held or len(run) < (SHORTEST + 2 * _HALF) * every else every


def _taps(every: int) -> Array:
    """Of the filter before all but every so manieth sample are left out."""
    half = _HALF * every
    taps = np.sinc(np.arange(-half, half + 1) / every) * np.kaiser(2 * half + 1, _TAPS)
    return np.asarray(taps / taps.sum())


def load_angle_range(runs: Sequence[Signals], machine: Machine) -> tuple[float, float]:
    """Lowest and highest load angle (rad) of all runs, the coupling's wind-up C/k counted.

    A motor that turns round at 5000 rad/s² lets the load swing on by tens of mrad: where the inertia bends, this is
    worth a part in a hundred of it.
    """
    angles = [run.position_rad - _wind_up(run, machine) for run in runs]
    return min(float(a.min()) for a in angles), max(float(a.max()) for a in angles)


def _wind_up(run: Signals, machine: Machine) -> Array:
    """Of the coupling (rad), as the motor's balance tells it without knowing the load."""
    if machine.coupling is None:
        return np.zeros_like(run.position_rad)
    torque, speed = run.drive.smooth_nm, run.quiet(run.states[:, 1])
    accelerated = np.gradient(speed, run.step_s)
    driving = torque - machine.motor.inertia_kgm2 * accelerated - machine.motor.viscous_friction_nms * speed
    return run.quiet(driving) / machine.coupling.stiffness_nm_rad
