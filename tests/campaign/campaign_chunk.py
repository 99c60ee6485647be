"""What the files with seeds have in common: xdist shares files, so the seeds lie in several."""

from __future__ import annotations

from campaign_plan import scenario_of
from campaign_session import run


def problems(seeds: range) -> list[str]:
    """Everything that is wrong with these seeds, each with the command that shows it again."""
    found = []
    for seed in seeds:
        outcome = run(scenario_of(seed))
        if outcome.problems:
            command = f"python benchmarks/campaign.py --seeds {seed}:{seed + 1} --show"
            found.append(f"{'; '.join(outcome.problems)}\n  {command}")
    return found
