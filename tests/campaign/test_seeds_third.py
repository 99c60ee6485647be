"""Part of the campaign: 100 to 149 of its seeds."""

from __future__ import annotations

import pytest
from campaign_chunk import problems


@pytest.mark.long
@pytest.mark.parametrize("first", range(100, 150, 10))
def test_nothing_dangerous_follows(first: int) -> None:
    assert problems(range(first, first + 10)) == []
