"""The fault campaign: thousands of commissionings, each with something that goes wrong, and a monitor over them.

    python benchmarks/campaign.py                              1000 seeds on two cores
    python benchmarks/campaign.py --seeds 0:10000 --jobs 4
    python benchmarks/campaign.py --seeds 4711:4712 --show     one of them, with its frames
    python benchmarks/campaign.py --bus modbus                 the other bus
    python benchmarks/campaign.py --defect no-consumer         a defect put back on purpose: which seed finds it

A seed draws the way of commissioning and one to three incidents (schwung_sim/campaign/draw.py), at whatever frame or
instant of the session. Time is stepped: the same seed gives the same frames. What must never be seen is in
schwung_sim/campaign/monitor.py; beside that the tool has to end in time and with one clear sentence, recordings have
to be readable, and parameters as before, or a backup there that `restore` brings them back with.
"""

from __future__ import annotations

import argparse
import math
import multiprocessing
import sys
import time
from collections import Counter
from collections.abc import Iterable, Iterator
from concurrent.futures import ProcessPoolExecutor
from functools import partial

from campaign_defects import DEFECTS
from campaign_session import Outcome, kind_of, run, scenario_of

_SHOWN = 30  # frames before the end of a log


def outcome_of(seed: int, bus: str) -> Outcome:
    """Play one seed; what breaks the campaign itself is a problem of that seed."""
    try:
        return run(scenario_of(seed, bus))
    except Exception as error:
        return Outcome(scenario_of(seed, bus), [f"the campaign itself: {type(error).__name__}: {error}"])


def outcomes(seeds: Iterable[int], jobs: int, bus: str, defect: str = "") -> Iterator[Outcome]:
    """Play seeds one after another, in so many processes; in the order of the seeds."""
    if jobs == 1:
        _put_back(defect)
        yield from (outcome_of(seed, bus) for seed in seeds)
        return
    context = multiprocessing.get_context("spawn")
    pool = ProcessPoolExecutor(jobs, context, _put_back, (defect,))
    try:
        yield from pool.map(partial(outcome_of, bus=bus), seeds, chunksize=4)
    finally:
        pool.shutdown(cancel_futures=True)


def _put_back(defect: str) -> None:
    if defect:
        DEFECTS[defect]()


def wilson(hits: int, total: int) -> tuple[float, float]:
    """95 % interval of a share (Wilson 1927)."""
    if not total:
        return 0.0, 1.0
    z, p = 1.959964, hits / total
    middle, spread = p + z * z / (2 * total), z * math.sqrt(p * (1 - p) / total + z * z / (4 * total * total))
    return max((middle - spread) / (1 + z * z / total), 0.0), (middle + spread) / (1 + z * z / total)


def tell(outcome: Outcome) -> None:
    """What went wrong with a seed, and the command that shows it again."""
    seed = outcome.scenario.seed
    print(f"seed {seed}: {'; '.join(outcome.problems)}")
    print(f"    {kind_of(outcome.scenario)}")
    for what in outcome.happened:
        print(f"    {what}")
    print(f"    the tool ended: {outcome.ended} {outcome.told}")
    bus = "" if outcome.scenario.bus == "canopen" else f" --bus {outcome.scenario.bus}"
    print(f"    python benchmarks/campaign.py{bus} --seeds {seed}:{seed + 1} --show", flush=True)


def show(seed: int, bus: str) -> int:
    """Play one seed and print everything about it."""
    scenario = scenario_of(seed, bus)
    for incident in scenario.incidents:
        print(f"drawn: {incident}")
    outcome = run(scenario, show=True)
    print(f"{outcome.frames} frames, digest {outcome.digest:08x}, {outcome.simulated_s:.3f} s simulated")
    tell(outcome)
    instants = [float(p.split(" s,")[0]) for p in outcome.problems if " s," in p[:20]]
    around = [line for line in outcome.log if not instants or abs(float(line.split()[0]) - instants[0]) < 0.1]
    print("\n".join(around if instants else around[-_SHOWN:]))
    return bool(outcome.problems)


def seeds_of(text: str) -> tuple[int, int]:
    """The first seed and the one beyond the last, of "first:beyond"."""
    first, _, beyond = text.partition(":")
    if not (first.isdigit() and beyond.isdigit() and int(first) < int(beyond)):
        raise argparse.ArgumentTypeError(f'"{text}" is not two seeds: give FIRST:BEYOND, as 0:1000')
    return int(first), int(beyond)


def main() -> int:
    """See the module."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--seeds", type=seeds_of, default="0:1000", metavar="FIRST:BEYOND")
    parser.add_argument("--bus", default="canopen", choices=["canopen", "modbus"])
    parser.add_argument("--jobs", type=int, default=2)
    parser.add_argument("--minutes", type=float, default=math.inf, help="no further seeds after so long")
    parser.add_argument("--show", action="store_true", help="the first seed, at length")
    parser.add_argument(
        "--defect", default="", choices=["", *DEFECTS], help="put back first; ends when it is found"
    )
    given = parser.parse_args()
    first, beyond = given.seeds
    if given.show:
        _put_back(given.defect)
        return show(first, given.bus)
    began, failed, total, simulated = time.perf_counter(), 0, 0, 0.0
    kinds: Counter[str] = Counter()
    ends: Counter[str] = Counter()
    rules: Counter[str] = Counter()
    for outcome in outcomes(range(first, beyond), given.jobs, given.bus, given.defect):
        total += 1
        simulated += outcome.simulated_s
        kinds.update(told.split()[2] for told in outcome.happened)
        ends[outcome.ended] += 1
        if outcome.problems:
            failed += 1
            rules.update(p.split(":")[0].split(", ")[-1] for p in outcome.problems)
            tell(outcome)
            if given.defect and not any(o.problems for o in outcomes([outcome.scenario.seed], 2, given.bus)):
                print(f"{given.defect}: found by seed {outcome.scenario.seed}, which is sound without it")
                return 0
        if time.perf_counter() - began > 60 * given.minutes:
            break
    took = time.perf_counter() - began
    low, high = wilson(failed, total)
    print(
        f"{total} seeds in {took:.0f} s ({took * given.jobs / max(total, 1):.3f} s each), {simulated:.0f} s simulated"
    )
    for title, counter in (("befell", kinds), ("the tool ended", ends), ("violated", rules)):
        print(f"{title}: {', '.join(f'{name} {n}' for name, n in counter.most_common()) or 'nothing'}")
    print(f"violations: {failed} of {total} seeds (95 % interval {low:.2%} to {high:.2%})")
    return bool(failed)


if __name__ == "__main__":
    sys.exit(main())
