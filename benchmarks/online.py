"""How fast is the online estimator, and does it stay exact? Against its limits and against peers, in one run.

    python benchmarks/online.py [MINUTES]

A recording of the paper's machine at 8 kHz with 50 Hz injected, 10 minutes unless said otherwise:

- ours in one block: `OnlineEstimator.block`, compiled; two signals, amplitudes and the inverted two-mass model;
- ours sample by sample, called from Python, as beside a running drive;
- the recursion of the paper's equation 8 in plain Python, one signal, no inversion (over a part, scaled up);
- the same recursion by `scipy.signal.lfilter` as one comb and one resonator, one signal, no inversion;
- the batch `sliding_dft`, one signal, no inversion.

Limits: 1 µs a sample, compiled; 2 s for ten minutes. Errors: largest difference of the torque amplitude from
the batch result over the last second, relative.
"""

from __future__ import annotations

import sys
import time as clock
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from scipy.signal import lfilter

from schwung.drivetrain import paper_machine
from schwung.drivetrain.response import torque_to_speed
from schwung.estimation.online import OnlineEstimator
from schwung.estimation.sdft import sliding_dft
from schwung.motion import Array

RATE_HZ, FREQUENCY_HZ, WINDOW = 8000.0, 50.0, 160
LIMIT_SAMPLE_S, LIMIT_TEN_MINUTES_S = 1e-6, 2.0
PYTHON_SAMPLES = 200_000


@dataclass(frozen=True)
class Result:
    """One way: wall time per sample (s), and the relative error of the last second's torque amplitude."""

    name: str
    per_sample_s: float
    error: float


def signals(samples: int) -> tuple[Array, Array]:
    """Torque and speed of the injection at J_l = 0.11 kg·m² on top of a slow motion, with noise, (n,) each."""
    noise, time = np.random.default_rng(1), np.arange(samples) / RATE_HZ
    turn = np.exp(2j * np.pi * FREQUENCY_HZ * time)
    response = complex(torque_to_speed(paper_machine(), 0.11, FREQUENCY_HZ))
    torque = (40.0 * turn).real + 100.0 * np.sin(np.pi * time) + 0.1 * noise.normal(size=samples)
    speed = (40.0 * response * turn).real + 20.0 * np.cos(np.pi * time) + 0.02 * noise.normal(size=samples)
    return torque, speed


def plain_python(values: list[float]) -> list[float]:
    """Amplitudes by equation 8, as one would write it."""
    ring, state, turn = [0.0] * WINDOW, 0j, complex(np.exp(2j * np.pi / WINDOW))
    amplitudes = []
    for n, value in enumerate(values):
        state = (state - ring[n % WINDOW] + value) * turn
        ring[n % WINDOW] = value
        amplitudes.append(2 * abs(state) / WINDOW)
    return amplitudes


def by_lfilter(values: Array) -> Array:
    """Amplitudes by equation 8 as scipy filters: the comb, then the resonator."""
    comb = values.copy()
    comb[WINDOW:] -= values[:-WINDOW]
    return np.asarray(2 / WINDOW * np.abs(lfilter([1.0], [1.0, -np.exp(2j * np.pi / WINDOW)], comb)))


def _timed(call: Callable[[], Array], repeats: int) -> tuple[Array, float]:
    walls = []
    for _ in range(repeats):
        start = clock.perf_counter()
        values = call()
        walls.append(clock.perf_counter() - start)
    return values, float(np.median(walls))


def measure(minutes: float) -> list[Result]:
    """Ours in one block first, then ours sample by sample, then the peers."""
    samples = round(60 * minutes * RATE_HZ)
    torque, speed = signals(samples)
    time = np.arange(samples) / RATE_HZ
    estimator = OnlineEstimator(paper_machine(), RATE_HZ, FREQUENCY_HZ)
    estimator.block(torque[:10], speed[:10])  # compiled, or loaded from the cache
    few = min(PYTHON_SAMPLES, samples)
    rows = list(zip(torque[:few].tolist(), speed[:few].tolist(), strict=True))

    def in_block() -> Array:
        estimator.reset()
        return estimator.block(torque, speed).torque_amplitude_nm

    def one_by_one() -> Array:
        estimator.reset()
        return np.array([estimator.push(*row).torque_amplitude_nm for row in rows])

    def batch() -> Array:
        return np.abs(sliding_dft(torque, time, RATE_HZ, FREQUENCY_HZ).phasor)

    ways: list[tuple[str, Callable[[], Array], int]] = [
        ("ours, one block, compiled", in_block, 5),
        ("ours, sample by sample from Python", one_by_one, 3),
        ("equation 8 in plain Python, one signal", lambda: np.array(plain_python(torque[:few].tolist())), 3),
        ("equation 8 by scipy.signal.lfilter, one signal", lambda: by_lfilter(torque), 3),
        ("batch sliding_dft, one signal", batch, 3),
    ]
    exact = batch()
    results = []
    for name, call, repeats in ways:
        amplitude, wall = _timed(call, repeats)
        last = slice(max(amplitude.size - round(RATE_HZ), WINDOW), amplitude.size)
        error = float(np.max(np.abs(amplitude[last] / exact[last] - 1)))
        results.append(Result(name, wall / amplitude.size, error))
    return results


def main() -> None:
    minutes = float(sys.argv[1]) if len(sys.argv) > 1 else 10.0
    results = measure(minutes)
    ours = results[0]
    ten_minutes = ours.per_sample_s * 600 * RATE_HZ
    print(f"{minutes:g} min at {RATE_HZ:g} Hz, {FREQUENCY_HZ:g} Hz injected, {WINDOW} samples a window")
    for result in results:
        print(
            f"{result.name:48s} {result.per_sample_s * 1e9:8.0f} ns a sample   "
            f"{result.per_sample_s / ours.per_sample_s:6.1f} ×   error {result.error:.0e}"
        )
    print(f"of the limit of 1 µs a sample:    {ours.per_sample_s / LIMIT_SAMPLE_S:.2f}")
    print(
        f"of the limit of 2 s for 10 min:   {ten_minutes / LIMIT_TEN_MINUTES_S:.2f}   ({ten_minutes:.2f} s)"
    )


if __name__ == "__main__":
    main()
