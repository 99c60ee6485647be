"""When an axis stands, by its positions."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from itertools import count
from math import pi, sin
from types import SimpleNamespace

import pytest

from schwung.clock import SteppedClock
from schwung.fieldbus.braking import Slowing
from schwung.fieldbus.canopen.dialogue import Dialogue
from schwung.fieldbus.cia402 import State

COUNT_RAD = 6e-6  # 2e-4 rad in a step of 5 ms, the slowest that counts as turning, are 33 counts


class Axis(Dialogue):
    """A drive in quick stop, whose positions follow a rule of the step's number."""

    def __init__(self, rule: Callable[[int], int]) -> None:
        self.cyclic = None
        self._monitor = SimpleNamespace(clock=SteppedClock())  # type: ignore[assignment]
        self._steps: Iterator[int] = count()
        self._rule = rule

    def position(self) -> int:
        return self._rule(next(self._steps))

    def state(self) -> State:
        return State.QUICK_STOP_ACTIVE


@pytest.mark.parametrize(
    ("rule", "stands"),
    [
        (lambda step: 7, True),
        (lambda step: 60 * (step % 2), True),  # held, and trembling by 0.4 mrad
        (lambda step: 40 * step, False),  # turning at 0.05 rad/s, and no slower
        (lambda step: round(1000 * sin(0.3 * step)), False),  # swinging by 12 mrad
    ],
)
def test_an_axis_that_trembles_in_its_place_stands(rule: Callable[[int], int], stands: bool) -> None:
    assert Axis(rule).await_standstill(COUNT_RAD, slowing=Slowing()) == stands


@pytest.mark.parametrize(
    ("rule", "stands"),
    [
        (lambda step: 7, True),
        (lambda step: step % 2, True),  # between two counts
        (lambda step: round(0.24 * step), False),  # turning at 0.3 rad/s: four steps without a count
        (lambda step: round(2 * sin(0.2 * step)), False),  # swinging by two counts
    ],
)
@pytest.mark.parametrize("counts", [1000, 360, 60])
def test_of_coarse_counts_it_has_to_stand_for_longer(
    rule: Callable[[int], int], stands: bool, counts: int
) -> None:
    """Of 1000 a turn, one in 15 ms is 0.42 rad/s: an axis that swings in its place was let go of between two."""
    assert Axis(rule).await_standstill(2 * pi / counts, slowing=Slowing()) == stands
