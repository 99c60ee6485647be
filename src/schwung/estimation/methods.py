"""How traces of inertia are made from a session: one class per method, found by name.

A further method is one file with one class that fulfils `Method`, and one call of `register`; everything
behind it (table, band, trust, report, export) then works as for these two.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from schwung.drivetrain.inertia import InertiaTable
from schwung.drivetrain.machine import Machine
from schwung.errors import InputError
from schwung.estimation.denoise import denoise
from schwung.estimation.fit import NOTHING, CurveFit, Nuisance
from schwung.estimation.inversion import invert_complex, invert_magnitude
from schwung.estimation.sdft import ComplexArray, Spectrum, sliding_dft
from schwung.estimation.values import Denoised, Inversion, Trace
from schwung.motion import Array
from schwung.session.model import Run, Session

#: A window counts when the injection has at least this share of its full amplitude all through it.
FULL_AMPLITUDE = 0.999
#: The injected part as recorded may be so much below the rest of the run before a window is left out.
RECORDED_AMPLITUDE = 0.95
#: Amplitudes must stand so many standard deviations above the noise, in the median over the run.
MIN_SIGNAL_TO_NOISE = 5.0
#: Relative difference up to which two frequencies count as one.
FREQUENCY_TOLERANCE = 1e-4


@dataclass(frozen=True)
class Task:
    """What a method is asked for."""

    session: Session
    excited: tuple[Run, ...]  # the runs of the session with this frequency
    machine: Machine
    frequency_hz: float
    inversion: Inversion
    recorded: Session | None = None  # as recorded, before `sampling.prepared`; None: the same
    points: int | None = None  # of a table that the method makes itself; None: its default
    start: InertiaTable | None = None  # a curve that is near already: where a search may begin


@dataclass(frozen=True)
class Suitability:
    """How well a method suits a session: the highest score is taken, the reason is told."""

    score: float
    reason: str


@dataclass(frozen=True)
class Outcome:
    """What a method answers: traces, from which the table is made, or a table of its own (with its band).

    The denoised signals come along where a method makes them; the checks of linearity look at those.
    `windowed`: each value stands for one period and rests on superposition, so that a changing inertia and a
    clipped torque spoil it; False: it comes from a model of the whole record, whose band says what is known.
    `fit`, `machine`, `missed` and `stiffer` are evidence for the verdict, where a method has it.
    """

    traces: tuple[Trace, ...] = ()
    denoised: tuple[Denoised, ...] = ()
    notes: tuple[str, ...] = ()
    table: InertiaTable | None = None
    windowed: bool = True
    fit: CurveFit | None = None  # of the ripple's balance, where the table is that fit's
    machine: Machine | None = None  # as found beside the inertia; None: as believed
    missed: float | None = None  # rms torque that the model misses beyond noise, over the rms torque
    misses: bool = False  # whether that is so much that it leaves physics out
    stiffer: Nuisance = NOTHING  # how far the stiffness found is from the file's, relative
    shown: tuple[int, ...] = ()  # what of `LEFT_OUT` was found beside the inertia


class Method(Protocol):
    """One way to get from a session to traces of inertia. Raises InputError where the session does not do."""

    @property
    def name(self) -> str: ...

    @property
    def needs_reference(self) -> bool:
        """Whether it takes runs without injection besides the excited ones."""
        ...

    def traces(self, task: Task) -> Outcome: ...


METHODS: dict[str, Method] = {}


def register(method: Method) -> None:
    """Make a method known by its name."""
    METHODS[method.name] = method


def method_named(name: str) -> Method:
    """Look a method up. Raises InputError that lists what there is."""
    if name not in METHODS:
        raise InputError("method", f'there is no "{name}"', f"Use one of: {', '.join(sorted(METHODS))}.")
    return METHODS[name]


class DenoisedMethod:
    """The paper's new method: the motion is subtracted before the sliding DFT."""

    name = "denoised"
    needs_reference = True

    def suits(self, task: Task) -> Suitability | None:
        """Wherever there are references."""
        if not task.session.references:
            return None
        return Suitability(1.0, "a reference run takes the motion out")

    def traces(self, task: Task) -> Outcome:
        """Denoise (11), transform (8), invert, label."""
        pairs = denoise(task.session, task.excited)
        traces = []
        for pair in pairs:
            signals = _Signals(
                pair.excited, pair.time_s, pair.reference, pair.position_rad, pair.speed_rad_s, pair.torque_nm
            )
            _check_strength(signals, task.frequency_hz)
            trace = _trace(signals, task)
            _check_physical(signals, trace, task)
            traces.append(trace)
        return Outcome(tuple(traces), pairs)


class FormerMethod:
    """The paper's baseline [24]: the sliding DFT of the excited run as it is; wants slow motion."""

    name = "former"
    needs_reference = False

    def suits(self, task: Task) -> Suitability | None:
        """Always, for want of a better one."""
        return Suitability(0.0, "there is neither a reference run nor a full set of injection phases")

    def traces(self, task: Task) -> Outcome:
        """Transform (8), invert, label. The ripple in the position is averaged over the period."""
        traces = []
        for run in task.excited:
            position = sliding_dft(run.position_rad, run.time_s, run.sample_rate_hz, task.frequency_hz)
            half = position.window // 2
            path = np.concatenate([position.mean[half:], np.full(half, np.nan)])  # mean, back in its middle
            path = np.where(np.isfinite(path), path, run.position_rad)
            traces.append(_trace(_Signals(run, run.time_s, run, path, run.speed_rad_s, run.torque_nm), task))
        return Outcome(tuple(traces))


register(DenoisedMethod())
register(FormerMethod())


@dataclass(frozen=True, eq=False)
class _Signals:
    """Signals of one excited run that hold the sine, and the run whose motion labels them."""

    run: Run
    time_s: Array
    mover: Run  # whose torque and speed wind up the coupling
    position_rad: Array
    speed_rad_s: Array
    torque_nm: Array

    def spectrum(self, values: Array, frequency_hz: float) -> Spectrum:
        return sliding_dft(values, self.time_s, self.run.sample_rate_hz, frequency_hz)


def _trace(signals: _Signals, task: Task) -> Trace:
    """Spectra, inversion and label of one run."""
    frequency, machine = task.frequency_hz, task.machine
    torque = signals.spectrum(signals.torque_nm, frequency)
    speed = signals.spectrum(signals.speed_rad_s, frequency)
    usable = _full_windows(signals, torque.window, frequency)
    if not usable.any():
        raise InputError(
            signals.run.name or "excited run",
            f"the injection never has its full amplitude for one whole period of {frequency:g} Hz",
            "Inject for longer, or ramp faster.",
        )
    inertia = invert_complex(machine, frequency, torque.phasor, speed.phasor)
    imaginary = inertia.imag
    real = inertia.real
    if task.inversion == "magnitude":
        real = invert_magnitude(machine, frequency, torque.phasor, speed.phasor)
    real = np.where(usable, real, np.nan)
    variation = np.full_like(real, np.nan)
    variation[torque.window :] = real[torque.window :] - real[: -torque.window]
    # Half a period back (N/2 samples), as the paper has it. The middle of N samples is (N−1)/2 back; the
    # other half sample errs on the right side: the estimate of a changing J lags a little further, by 0.5
    # to 1 ms on the paper's machine at 50 Hz.
    middle = signals.time_s - 0.5 / frequency
    return Trace(
        time_s=middle,
        position_rad=np.interp(middle, signals.time_s, signals.position_rad) - _wind_up(signals, task),
        inertia_kgm2=real,
        imaginary_kgm2=np.where(usable, imaginary, np.nan),
        inertia_variation_kgm2=variation,
        speed_amplitude_rad_s=np.where(usable, np.abs(speed.phasor), np.nan),
        torque_amplitude_nm=np.where(usable, np.abs(torque.phasor), np.nan),
        stroke=strokes_of(signals.run, signals.time_s, signals.position_rad, middle),
        name=signals.run.name,
    )


def _full_windows(signals: _Signals, window: int, frequency_hz: float) -> NDArray[np.bool_]:
    """True at samples whose whole window has the full injection, (n,); a ramp would tell wrong amplitudes."""
    run = signals.run
    assert run.excitation is not None  # guaranteed by Run
    n = signals.time_s.size
    full = run.excitation.envelope(signals.time_s) >= FULL_AMPLITUDE
    usable = np.zeros(n, dtype=bool)
    usable[window - 1 :] = np.convolve(full, np.ones(window), "valid") > window - 0.5
    if run.torque_added_nm is not None and np.any(run.torque_added_nm):
        recorded = np.abs(signals.spectrum(run.torque_added_nm[:n], frequency_hz).phasor)
        if usable.any():
            usable &= recorded >= RECORDED_AMPLITUDE * np.nanquantile(recorded[usable], 0.9)
    return usable


def _wind_up(signals: _Signals, task: Task) -> Array:
    """How far the motor leads the load, (n,): shaft torque over stiffness, both averaged over the window."""
    coupling, motor = task.machine.coupling, task.machine.motor
    if coupling is None:
        return np.zeros(signals.time_s.size)
    n = signals.time_s.size
    torque = signals.spectrum(signals.mover.torque_nm[:n], task.frequency_hz)
    speed = signals.mover.speed_rad_s[:n]
    mean_speed = signals.spectrum(speed, task.frequency_hz).mean
    acceleration = np.full(n, np.nan)
    span = torque.window - 1
    acceleration[span:] = (speed[span:] - speed[:-span]) * signals.run.sample_rate_hz / span
    shaft = torque.mean - motor.inertia_kgm2 * acceleration - motor.viscous_friction_nms * mean_speed
    return np.nan_to_num(shaft / coupling.stiffness_nm_rad)


def strokes_of(run: Run, time_s: Array, position_rad: Array, at_s: Array) -> NDArray[np.int64]:
    """The stroke of the run at each instant of `at_s`, (n,): divided midway in the rests, or where the path
    `position_rad` over `time_s` turns round.
    """
    motion = run.motion
    if motion is not None:
        starts = np.array(motion.stroke_starts_s[1:])
        return np.asarray(np.searchsorted(starts - motion.dwell_s / 2, at_s, side="right"), dtype=np.int64)
    speed = np.gradient(position_rad, time_s)
    direction = np.where(np.abs(speed) > 0.05 * np.max(np.abs(speed)), np.sign(speed), 0.0)
    moving = np.flatnonzero(direction)
    if moving.size == 0:
        return np.zeros(at_s.size, dtype=np.int64)
    last = np.searchsorted(moving, np.arange(time_s.size), side="right") - 1
    held = direction[moving[np.maximum(last, 0)]]
    turns = np.concatenate([[0], np.cumsum(np.diff(held) != 0)])
    return np.asarray(np.interp(at_s, time_s, turns).round(), dtype=np.int64)


def _check_strength(signals: _Signals, frequency_hz: float) -> None:
    """The sine must stand clear of the noise in both signals."""
    for quantity, unit, values in (
        ("speed", "rad/s", signals.speed_rad_s),
        ("torque", "N·m", signals.torque_nm),
    ):
        spectrum = signals.spectrum(values, frequency_hz)
        usable = _full_windows(signals, spectrum.window, frequency_hz)
        if not usable.any():
            return  # said more to the point where the trace is made
        amplitude = np.abs(spectrum.phasor[usable])
        noise = spectrum.residual[usable] * np.sqrt(2 / spectrum.window)
        if np.median(amplitude) <= MIN_SIGNAL_TO_NOISE * np.median(noise) or np.median(amplitude) == 0:
            raise InputError(
                signals.run.name or "excited run",
                f"the injected sine is too weak: {quantity} swings by {np.median(amplitude):.2g} {unit} at "
                f"{frequency_hz:g} Hz, with {np.median(noise):.2g} {unit} of noise in that amplitude",
                "Raise the amplitude, lower the frequency, or see whether the drive applies the injection.",
            )


def _check_physical(signals: _Signals, trace: Trace, task: Task) -> None:
    """Most samples must give a positive inertia; else torque and speed do not belong together. Say why."""
    torque = signals.spectrum(signals.torque_nm, task.frequency_hz).phasor
    speed = signals.spectrum(signals.speed_rad_s, task.frequency_hz).phasor
    usable = np.isfinite(trace.speed_amplitude_rad_s)

    def share(candidate: ComplexArray) -> float:
        inertia = invert_complex(task.machine, task.frequency_hz, candidate[usable], speed[usable])
        return float(np.mean((inertia.real > 0) & (np.abs(inertia.imag) < inertia.real)))

    if share(torque) > 0.5:
        return
    assert signals.run.excitation is not None  # guaranteed by Run
    injected = signals.run.torque_added_nm
    if injected is None or not np.any(injected):
        injected = signals.run.excitation.torque(signals.time_s)
    added = signals.spectrum(injected[: signals.time_s.size], task.frequency_hz).phasor
    if share(-torque) > 0.9:
        why = "with the torque's sign reversed they would be positive"
        remedy = "Correct the sign of torque (or of speed and position) in the recording or the profile."
    elif share(torque + added) > 0.9:
        why = "the reported torque seems to leave the injected part out"
        remedy = "Record the total motor torque, or add torque_added to torque."
    else:
        why = "torque and speed do not fit this machine"
        remedy = "Check rotor inertia, stiffness, units and the signals' delay."
    raise InputError(
        signals.run.name or "excited run",
        f"{100 * (1 - share(torque)):.0f} % of the inertias come out negative or mostly imaginary; {why}",
        remedy,
    )


def frequencies_of(excited: Sequence[Run]) -> tuple[float, ...]:
    """The different injected frequencies (Hz), rising; nearly equal ones count once."""
    found: list[float] = []
    for value in sorted(run.excitation.frequency_hz for run in excited if run.excitation):
        if not found or value / found[-1] - 1 >= FREQUENCY_TOLERANCE:
            found.append(value)
    return tuple(found)


def excited_at(session: Session, frequency_hz: float | None) -> tuple[tuple[Run, ...], float]:
    """The excited runs at one frequency (Hz), and that frequency; None: all of them, and the lowest.

    Raises InputError where there is none.
    """
    if not session.excited:
        raise InputError("session", "has no excited run, a motion with the injected sine", "Record one.")
    found = frequencies_of(session.excited)
    listed = ", ".join(f"{value:g}" for value in found)
    if frequency_hz is None:
        return session.excited, found[0]
    if not frequency_hz > 0:
        raise InputError("frequency", f"is {frequency_hz} Hz", f"Choose among {listed} Hz.")
    chosen = tuple(
        run
        for run in session.excited
        if run.excitation and abs(run.excitation.frequency_hz / frequency_hz - 1) < FREQUENCY_TOLERANCE
    )
    if not chosen:
        raise InputError(
            "session", f"has no run excited at {frequency_hz:g} Hz", f"Choose among {listed} Hz."
        )
    return chosen, frequency_hz
