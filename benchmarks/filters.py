"""How long does Kalman's filter take for a sample? Number by number, in registers, against arrays of the same size.

    python benchmarks/filters.py [--samples 2500]

One run of a two-mass machine at 1 kHz. `schwung explain` filters every run some hundred times.
"""

from __future__ import annotations

import argparse
import time
from collections.abc import Callable
from typing import Any

import numpy as np

from schwung.innovations import kalman
from schwung.innovations.steps import Steps
from schwung.innovations.values import Shaft, System

#: Of each the best of so many.
TIMES = 20


def system_of(samples: int) -> System:
    """A shaft that swings, and what is measured of it: nothing but noise."""
    chance, steps = np.random.default_rng(0), samples - 1
    shaft = Shaft(0.01, 0.02, 0.01, 5000.0, 0.5, rigid=False)
    made = Steps.of(shaft, np.full(steps, 0.02), 1e-3, slopes=False)
    transition, forcing = np.zeros((steps, 5, 5)), np.zeros((steps, 5))
    transition[:, :4, :4], transition[:, :4, 4] = made.transition, -made.inputs[:, :, 0]
    forcing[:, :4] = made.inputs[:, :, 0] * np.sin(np.arange(steps) / 50)[:, None]
    return System(
        transition, forcing, np.column_stack([-made.inputs[:, :, 2], np.ones(steps)]),
        np.full(steps, 0.01), np.tile([0.0, 0.0, 1e-3], (steps, 1)), chance.normal(size=(samples, 2)) * [1e-6, 1e-2],
        np.tile([1e-12, 1e-4], (samples, 1)), np.zeros(5), np.array([1e-3, 0.1, 1e-3, 0.1, 0.1]),
        np.zeros((steps, 5)), np.zeros((steps, 2, 5)),
    )  # fmt: skip


def seconds(asked: Callable[[System], Any], system: System) -> float:
    """The best time of the processor, once it is compiled."""
    asked(system)
    took = []
    for _ in range(TIMES):
        began = time.process_time()
        asked(system)
        took.append(time.process_time() - began)
    return min(took)


def main() -> None:
    """Print nanoseconds a sample."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--samples", type=int, default=2500)
    system = system_of(parser.parse_args().samples)
    for what, quick, plain in (
        ("filter", kalman.filtered, kalman.filter_of(5)),
        ("likelihood alone", kalman.deviance, kalman.deviance_of(5)),
    ):
        one, other = (seconds(asked, system) / len(system.measured) * 1e9 for asked in (quick, plain))
        print(
            f"{what:17} {one:4.0f} ns a sample, {other / one:.1f} times less than by arrays ({other:.0f} ns)"
        )


if __name__ == "__main__":
    main()
