"""Part of the campaign: the first of its seeds on Modbus."""

from __future__ import annotations

import pytest
from campaign_chunk import problems


@pytest.mark.parametrize("first", range(0, 40, 10))
def test_nothing_dangerous_follows(first: int) -> None:
    assert problems(range(first, first + 10), "modbus") == []
