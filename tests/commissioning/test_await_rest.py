"""An axis that turns on by itself while it is off is waited for, not started from where it was."""

from __future__ import annotations

from collections.abc import Callable
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from schwung.commissioning import await_rest
from schwung.errors import RefusedError


class Turning:
    """A drive of which only place and time are asked for."""

    def __init__(self, position_rad: Callable[[float], float]) -> None:
        self.now_s, self.position_rad, self.clock = 0.0, position_rad, self

    def now(self) -> float:
        return self.now_s

    def sleep(self, duration_s: float) -> None:
        self.now_s += duration_s

    def state(self) -> Any:
        return SimpleNamespace(position_rad=self.position_rad(self.now_s))


def test_what_stands_is_not_waited_for() -> None:
    drive = Turning(lambda _now: 1.5)
    await_rest(drive)  # type: ignore[arg-type]
    assert drive.now_s < 0.1


def test_what_settles_is_waited_for() -> None:
    drive = Turning(lambda now: 0.3 * float(np.exp(-now / 0.4)))  # 0.01 rad/s after 0.4 ln 75 = 1.7 s
    await_rest(drive)  # type: ignore[arg-type]
    assert 1.7 < drive.now_s < 1.9


def test_what_goes_on_turning_is_refused() -> None:
    with pytest.raises(
        RefusedError, match=r"turns by itself while it is off, at 0\.3 rad/s at least"
    ) as found:
        await_rest(Turning(lambda now: 0.3 * now))  # type: ignore[arg-type]
    assert "brake" in found.value.remedy
