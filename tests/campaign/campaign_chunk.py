"""What the files with seeds have in common: xdist shares files, so the seeds lie in several."""

from __future__ import annotations

from campaign_session import run, scenario_of


def problems(seeds: range, bus: str = "canopen") -> list[str]:
    """Everything that is wrong with these seeds, each with the command that shows it again."""
    found = []
    for seed in seeds:
        outcome = run(scenario_of(seed, bus))
        if outcome.problems:
            command = f"python benchmarks/campaign.py --bus {bus} --seeds {seed}:{seed + 1} --show"
            found.append(f"{'; '.join(outcome.problems)}\n  {command}")
    return found
