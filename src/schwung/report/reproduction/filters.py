"""Figures 4 to 6: what the sliding DFT lets through, and what denoising takes away before it."""

from __future__ import annotations

import numpy as np
from matplotlib.axes import Axes
from matplotlib.collections import QuadMesh
from scipy.signal import ShortTimeFFT
from scipy.signal.windows import hann

from schwung.estimation.rivals.gdft import half_period_phasor
from schwung.estimation.sdft import ComplexArray, sliding_dft
from schwung.estimation.values import Denoised
from schwung.motion import Array
from schwung.report.colours import ESTIMATE, EXCITED, FORMER, PLAIN, Colour
from schwung.report.reproduction.experiments import RATE_HZ, Case, result_of
from schwung.report.reproduction.layout import (
    Reproduced,
    draw_estimate,
    draw_truth,
    legend,
    panels,
)
from schwung.report.style import DASHED, curve, in_style, key, new_figure

# --------------------------------------------------------------------------------------- figure 4: the filter


def sdft_gain(frequency_hz: Array, pass_hz: float) -> Array:
    """|G(f)| of (10), one-sided, N = f_s/f whole: |sin(πNx)/(N sin(πx))|, x = (f − f_est)/f_s."""
    samples = round(RATE_HZ / pass_hz)
    turn = np.pi * (frequency_hz - pass_hz) / RATE_HZ
    with np.errstate(invalid="ignore", divide="ignore"):
        gain = np.abs(np.sin(samples * turn) / (samples * np.sin(turn)))
    return np.where(np.abs(turn) < 1e-12, 1.0, gain)


def measured_gain(frequency_hz: float, pass_hz: float, *, half_period: bool = False) -> float:
    """What our own filter makes of a complex sine of amplitude 1: a real and an imaginary one, put together."""
    time = np.arange(round(3 * RATE_HZ / pass_hz)) / RATE_HZ
    turn = np.exp(2j * np.pi * frequency_hz * time)

    def phasor(values: Array) -> ComplexArray:
        if half_period:
            return half_period_phasor(values, time, RATE_HZ, pass_hz)
        return sliding_dft(values, time, RATE_HZ, pass_hz).phasor

    return float(np.abs(phasor(turn.real)[-1] + 1j * phasor(turn.imag)[-1]) / 2)


@in_style
def figure_4() -> Reproduced:
    """SDFT magnitude response at 50 and 100 Hz, and the GDFT's."""
    figure = new_figure(3.8)
    axes = figure.axes[0]
    frequency = np.linspace(0, 400, 1601)
    for pass_hz, colour in ((50.0, ESTIMATE), (100.0, EXCITED)):
        curve(axes, frequency, sdft_gain(frequency, pass_hz), colour, label=f"SDFT, {pass_hz:.0f} Hz, (10)")
        at = np.arange(0, 401, 12.5)
        gains = [measured_gain(f, pass_hz) for f in at]
        axes.plot(at, gains, ".", color=colour.light, markersize=5)
    generalised = [measured_gain(f, 50.0, half_period=True) for f in frequency[::8]]
    axes.plot(
        frequency[::8], generalised, color=FORMER.light, linewidth=1.0, linestyle=DASHED, label="GDFT, 50 Hz"
    )
    axes.set_title("Gain of the filter; dots: ours, measured with sines")
    axes.set_xlabel("frequency, Hz")
    axes.set_ylim(0, 1.05)
    key(axes)
    leak = max(measured_gain(f, 50.0) for f in (0.0, 100.0, 150.0, 200.0, 300.0))
    half = measured_gain(25.0, 50.0)
    dc, second = (measured_gain(f, 50.0, half_period=True) for f in (0.0, 100.0))
    return Reproduced(
        title="Figure 4: what the SDFT lets through",
        paper="gain 1 at f_est = 50 or 100 Hz; only DC and the other multiples of f_est are taken out whole, what lies "
        "between leaks through the lobes.",
        here=f"gain {measured_gain(50.0, 50.0):.6f} and {measured_gain(100.0, 100.0):.6f} at f_est, at most "
        f"{max(leak, 1e-16):.0e} at DC and the other multiples; {half:.2f} at 25 Hz, halfway to DC, by our filter.",
        difference="none: the dots are our filter, the curves equation (10). The generalised DFT (m = 4, l = ±1) "
        f"answers in half a period, but passes DC with {dc:.2f} and 100 Hz with {second:.2f}: it is no filter for "
        "signals that still hold the motion.",
        figure=figure,
    )


# -------------------------------------------------------------------------- figure 5: former against denoised

FIGURE_5 = Case(duration_s=0.2, share=0.5)


@in_style
def figure_5() -> Reproduced:
    """Former against denoised at 200 ms with half the peak torque."""
    former, ours = result_of(FIGURE_5, "former"), result_of(FIGURE_5)
    pair = ours.estimate.denoised[0]
    drawn = panels(7.6, ("ae", "bf", "cg", "dh"), (1, 1, 1, 1.25))
    run, plain = pair.excited, pair.reference
    columns = (("a", "torque", "N·m"), ("e", "speed", "rad/s"))
    for top, quantity, unit in columns:
        excited, reference, left = (
            getattr(source, _FIELD[quantity]) for source in (run, plain, pair)
        )  # each (n,)
        middle, bottom = chr(ord(top) + 1), chr(ord(top) + 2)
        curve(drawn[top], run.time_s, excited, EXCITED, label="with T_add", width=0.9)
        curve(drawn[top], plain.time_s, reference, PLAIN, label="without", width=1.4)
        drawn[top].set_title(f"{top}  Motor {quantity}, {unit}")
        highest = 1.1 * max(
            _filtered(drawn[middle], run.time_s, excited, FORMER),
            _filtered(drawn[bottom], run.time_s, left, ESTIMATE),
        )
        drawn[middle].set_title(f"{middle}  Through the SDFT, former, {unit}")
        drawn[bottom].set_title(f"{bottom}  Through the SDFT, denoised first, {unit}")
        for name in (middle, bottom):
            drawn[name].set_ylim(-highest, highest)
        drawn.same_x(top + middle + bottom, "time, s")
        drawn[bottom].set_xlim(FIGURE_5.start_s - 0.06, FIGURE_5.start_s + FIGURE_5.duration_s + 0.1)
        key(drawn[top])
    for name, result, colour, words in (("d", former, FORMER, "former"), ("h", ours, ESTIMATE, "denoised")):
        draw_truth(drawn[name])
        draw_estimate(drawn[name], result, colour, words, width=1.6)
        drawn[name].set_ylim(0, 0.3)
        drawn[name].set_title(f"{name}  Load inertia, {words}, kg·m²")
        drawn[name].set_xlabel("load angle, rad")
        legend(drawn[name])
    return Reproduced(
        title="Figure 5: former against denoised, 200 ms, |T_add| 50 % of T_max",
        paper="the former method fails at 200 ms, the denoised one gives a good estimate; what is left comes from the "
        "filter's dynamics and the machine's non-linearity.",
        here=f"former {former.errors}; denoised {ours.errors}.",
        difference="the paper does not say which profile it used; this is the 1/3 profile. With the polynomial of "
        "Figure 6 and half the peak torque injected, our machine clips at 233 N·m for some milliseconds.",
        figure=drawn.figure,
    )


_FIELD = {"torque": "torque_nm", "speed": "speed_rad_s"}


def _filtered(axes: Axes, time_s: Array, values: Array, colour: Colour) -> float:
    """Draw the signal that the SDFT lets through, (9), and its amplitude, 2|X|/N; the largest amplitude."""
    phasor = sliding_dft(values, time_s, RATE_HZ, FIGURE_5.frequency_hz).phasor
    turn = np.exp(2j * np.pi * FIGURE_5.frequency_hz * time_s)
    known = np.isfinite(phasor)
    curve(axes, time_s[known], (phasor * turn).real[known], colour, width=0.8, alpha=0.6)
    curve(axes, time_s[known], np.abs(phasor)[known], colour, width=1.8)
    return float(np.max(np.abs(phasor[known])))


# ---------------------------------------------------------------------------------- figure 6: spectrograms

FIGURE_6 = Case(duration_s=0.2, kind="poly5", start_s=1.0)
SPECTRUM_WINDOW_S = 0.08
QUIETEST_DB, LOUDEST_DB = 0.0, 45.0
#: Below the line's own leakage in that window: what is here is motion.
MOTION_HZ = (5.0, 20.0)


@in_style
def figure_6() -> Reproduced:
    """Spectrograms of the torque: as it is, through the SDFT, denoised, denoised and through the SDFT."""
    pair = result_of(FIGURE_6).estimate.denoised[0]
    time, total, left = pair.time_s, pair.excited.torque_nm, pair.torque_nm
    drawn = panels(5.6, ("ab", "cd"))
    shown = (
        ("a", "Motor torque", total),
        ("b", "Motor torque through the SDFT", _passed(pair, total)),
        ("c", "Denoised torque", left),
        ("d", "Denoised torque through the SDFT", _passed(pair, left)),
    )
    image = None
    for name, title, values in shown:
        image = _spectrogram(drawn[name], time, values)
        drawn[name].set_title(f"{name}  {title}")
    for name in "cd":
        drawn[name].set_xlabel("time, s")
    for name in "ac":
        drawn[name].set_ylabel("frequency, Hz")
    assert image is not None
    bar = drawn.figure.colorbar(image, ax=list(drawn.axes.values()), shrink=0.8, pad=0.02)
    bar.set_label("amplitude, dB of 1 N·m")
    bar.outline.set_visible(False)
    beside = {name: _beside(pair, values) for name, _, values in shown}
    return Reproduced(
        title="Figure 6: spectrograms of the torque, 200 ms, fifth-order polynomial",
        paper="(a) a steady 50 Hz line and the motion between 1 and 1.2 s; (b) the SDFT alone leaves much of the "
        "motion; (c), (d) with the motion subtracted, little is left but the line.",
        here="during the motion, largest amplitude between 5 and 20 Hz: (a) "
        f"{beside['a']:.0f}, (b) {beside['b']:.0f}, (c) {beside['c']:.1f}, (d) {beside['d']:.1f} N·m, beside "
        f"{FIGURE_6.excitation.amplitude_nm:.0f} N·m injected.",
        difference="the paper gives no amplitude for this figure; 20 % of T_max here.",
        figure=drawn.figure,
    )


def _passed(pair: Denoised, values: Array) -> Array:
    """What the SDFT lets through, (9); 0 before it has a window."""
    phasor = sliding_dft(values, pair.time_s, RATE_HZ, FIGURE_6.frequency_hz).phasor
    turn = np.exp(2j * np.pi * FIGURE_6.frequency_hz * pair.time_s)
    return np.asarray(np.nan_to_num((phasor * turn).real))


def _transform() -> ShortTimeFFT:
    window = hann(round(SPECTRUM_WINDOW_S * RATE_HZ), sym=False)
    return ShortTimeFFT(window, hop=16, fs=RATE_HZ, mfft=8192, scale_to="magnitude")


def _spectrogram(axes: Axes, time_s: Array, values: Array) -> QuadMesh:
    """Amplitude of a sine (twice the two-sided magnitude) in dB over time and frequency."""
    transform = _transform()
    amplitude = 2 * np.abs(transform.stft(values))
    at, frequency = time_s[0] + transform.t(values.size), transform.f
    columns = (at > FIGURE_6.start_s - 0.15) & (at < FIGURE_6.start_s + FIGURE_6.duration_s + 0.15)
    rows = frequency <= 150
    level = 20 * np.log10(np.maximum(amplitude[np.ix_(rows, columns)], 1e-6))
    axes.grid(False)
    return axes.pcolormesh(
        at[columns],
        frequency[rows],
        level,
        cmap="viridis",
        vmin=QUIETEST_DB,
        vmax=LOUDEST_DB,
        rasterized=True,
    )


def _beside(pair: Denoised, values: Array) -> float:
    """Largest amplitude (N·m) between 5 and 20 Hz while the axis moves: motion that is still there."""
    transform = _transform()
    amplitude = 2 * np.abs(transform.stft(values))
    at, frequency = pair.time_s[0] + transform.t(values.size), transform.f
    columns = (at > FIGURE_6.start_s) & (at < FIGURE_6.start_s + FIGURE_6.duration_s)
    rows = (frequency >= MOTION_HZ[0]) & (frequency <= MOTION_HZ[1])
    return float(np.max(amplitude[np.ix_(rows, columns)]))
