"""What commissioning says on the terminal."""

from __future__ import annotations

from types import SimpleNamespace
from typing import Any, cast

import numpy as np
import pytest

from schwung.cli.console import Terminal
from schwung.cli.flow import Ending, show_estimate
from schwung.drivetrain import InertiaTable


@pytest.mark.parametrize("shown", [(), ("a torque constant that drops", "friction that falls with speed")])
def test_what_else_the_record_shows_is_said_beside_the_table(
    capsys: pytest.CaptureFixture[str], shown: tuple[str, ...]
) -> None:
    table = InertiaTable(np.array([0.0, 1.0]), np.array([0.1, 0.2]))
    trust = SimpleNamespace(verdict="good", reasons=("all agrees",))
    estimate = SimpleNamespace(table=table, trust=trust, shown=shown)
    done = SimpleNamespace(
        estimate=estimate, session=SimpleNamespace(axis="rotary"), contrast=None, reach=None
    )
    show_estimate(Terminal(), cast(Any, done), Ending())
    said = " ".join("".join(capsys.readouterr()).split())
    assert "0.1000 … 0.2000 kg·m²" in said
    assert all(cause in said for cause in shown)
    assert ("The record shows" in said) == bool(shown)
