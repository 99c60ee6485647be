"""Part of the campaign: 0 to 49 of its seeds."""

from __future__ import annotations

import pytest
from campaign_chunk import problems


@pytest.mark.parametrize("first", range(0, 50, 10))
def test_nothing_dangerous_follows(first: int) -> None:
    assert problems(range(first, first + 10)) == []
