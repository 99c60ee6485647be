"""What the rivals share: the one tuning rule, the denoised signals to start from, and the label at the end.

**The tuning rule.** Every rival remembers one period of the injected sine, 1/f_est, as the paper's SDFT does:
windows are one period long, and what forgets exponentially keeps 2 % (e⁻⁴) of a sample's weight after one
period, a time constant of a quarter period. Results are labelled by their mean age, which such windows know.
Whatever else a rival needs follows from the session: noise levels from the third differences of the signals,
band limits from f_est, first guesses from the denoised SDFT. Nothing is tuned to a machine or to the truth.

How much hangs upon it, on the paper's machine at 500, 250 and 150 ms: half the time constant changes the
error of the recursive filters by +20 to −40 %, twice the time constant multiplies it by 1.6 to 3.
"""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np

from schwung.errors import InputError
from schwung.estimation.methods import DenoisedMethod, Outcome, Task
from schwung.estimation.sdft import ComplexArray, samples_per_window
from schwung.estimation.values import Denoised, Trace
from schwung.motion import Array

#: Time constants of exponential forgetting in one period of the injected sine.
TIME_CONSTANTS_PER_PERIOD = 4.0
#: Noise taken for granted, as a share of a signal's rms: no filter may believe a signal altogether.
LEAST_NOISE = 1e-6


def started(task: Task, method: str, *, in_time: bool = True) -> Outcome:
    """Denoised signals and the paper's own traces: their checks, labels, strokes and amplitudes are shared.

    `in_time`: the method works in the time domain and has no inversion to choose. Raises InputError as the
    denoised method does, and where the magnitude inversion is asked for in vain.
    """
    if in_time:
        refuse_inversion(task, method)
    return DenoisedMethod().traces(task)


def refuse_inversion(task: Task, method: str) -> None:
    """A method in the time domain has no inversion. Raises InputError where another than the default is asked for."""
    if task.inversion != "complex":
        raise InputError(
            "inversion",
            f'is "{task.inversion}", but method "{method}" works in the time domain',
            "Leave it out.",
        )


def labelled(
    start: Trace,
    pair: Denoised,
    task: Task,
    inertia_kgm2: Array | ComplexArray,
    *,
    age: float,
) -> Trace:
    """A trace of inertias as they come out at each sample, (n,), labelled `age` (s) earlier.

    Valid where the paper's window is: full injection for one period. A complex inertia
    leaves its imaginary part as the check it is; a real one has none (NaN).
    """
    valid = np.isfinite(start.inertia_kgm2) & np.isfinite(inertia_kgm2)
    inertia = np.where(valid, inertia_kgm2.real, np.nan)
    imaginary = np.full_like(inertia, np.nan)
    if np.iscomplexobj(inertia_kgm2):
        imaginary = np.where(valid, inertia_kgm2.imag, np.nan)
    time = pair.time_s - age
    period = samples_per_window(pair.excited.sample_rate_hz, task.frequency_hz)
    variation = np.full_like(inertia, np.nan)
    variation[period:] = inertia[period:] - inertia[:-period]
    assert start.stroke is not None  # the denoised method gives them
    return replace(
        start,
        time_s=time,
        position_rad=np.interp(time, start.time_s, start.position_rad),
        stroke=np.interp(time, start.time_s, start.stroke).round().astype(np.int64),
        inertia_kgm2=inertia,
        imaginary_kgm2=imaginary,
        inertia_variation_kgm2=variation,
        speed_amplitude_rad_s=np.where(valid, start.speed_amplitude_rad_s, np.nan),
        torque_amplitude_nm=np.where(valid, start.torque_amplitude_nm, np.nan),
    )


def memory_s(frequency_hz: float) -> float:
    """Time constant of what forgets exponentially (s)."""
    return 1 / (TIME_CONSTANTS_PER_PERIOD * frequency_hz)


def age_s(sample_rate_hz: float, frequency_hz: float) -> float:
    """Mean age (s) of a sine that is fitted beside a constant over the exponentially forgetting window.

    It is the group delay at f_est of the fit as a filter: more than the time constant, as the fit has to tell the
    sine from the constant and from its own negative frequency, for which it takes older samples.
    """
    memory = memory_s(frequency_hz) * sample_rate_hz
    back = np.arange(int(30 * memory))
    angle = -2 * np.pi * frequency_hz / sample_rate_hz * back
    basis = np.column_stack([np.ones(back.size), np.cos(angle), -np.sin(angle)])
    weighted = basis * np.exp(-back / memory)[:, None]
    _, real, imaginary = np.linalg.solve(basis.T @ weighted, weighted.T)
    response = (real + 1j * imaginary) * np.exp(1j * angle)
    return float(np.real(np.sum(back * response) / np.sum(response))) / sample_rate_hz


def noise_level(values: Array) -> float:
    """Standard deviation of the white part of a signal (n,), from its third differences, by their median.

    Motion and injection, sampled eight times a period or more, leave little in third differences; steps and
    stray samples do not reach a median.
    """
    third = np.abs(np.diff(values, 3))
    white = float(np.median(third)) / 0.6745 / math.sqrt(20.0)
    return max(white, LEAST_NOISE * float(np.sqrt(np.mean(values**2))), 1e-12)
