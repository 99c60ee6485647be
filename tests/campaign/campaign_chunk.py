"""What the files with seeds have in common: xdist shares files, so the seeds lie in several."""

from __future__ import annotations

from functools import cache

from campaign_session import Outcome, run, scenario_of


@cache
def outcome_of(seed: int, bus: str) -> Outcome:
    """What comes of a seed, played once in a process."""
    return run(scenario_of(seed, bus))


def problems(seeds: range, bus: str = "canopen") -> list[str]:
    """Everything that is wrong with these seeds, each with the command that shows it again."""
    found = []
    for seed in seeds:
        outcome = outcome_of(seed, bus)
        if outcome.problems:
            command = f"python benchmarks/campaign.py --bus {bus} --seeds {seed}:{seed + 1} --show"
            found.append(f"{'; '.join(outcome.problems)}\n  {command}")
    return found
