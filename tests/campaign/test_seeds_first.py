"""Part of the campaign: 0 to 49 of its seeds."""

from __future__ import annotations

import pytest
from campaign_chunk import outcome_of, problems
from campaign_session import scenario_of


@pytest.mark.parametrize("first", range(0, 50, 10))
def test_nothing_dangerous_follows(first: int) -> None:
    assert problems(range(first, first + 10)) == []


def test_most_of_what_is_drawn_befalls() -> None:
    """Most incidents are in sessions that get that far."""
    befell = sum(len(outcome_of(seed, "canopen").happened) for seed in range(20))
    assert befell > 0.6 * sum(len(scenario_of(seed).incidents) for seed in range(20))
