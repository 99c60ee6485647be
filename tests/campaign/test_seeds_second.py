"""Part of the campaign: 50 to 99 of its seeds."""

from __future__ import annotations

import pytest
from campaign_chunk import problems


@pytest.mark.long
@pytest.mark.parametrize("first", range(50, 100, 10))
def test_nothing_dangerous_follows(first: int) -> None:
    assert problems(range(first, first + 10)) == []
