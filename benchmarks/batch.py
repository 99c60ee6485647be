"""How much faster a batch is than one session after the other: the same sessions, the same results.

    python benchmarks/batch.py --sessions 200 --jobs 2

Sessions of the virtual machine room (slider-crank, reference and four phases, each with noise of its own) are
estimated in this process, one by one, and each result kept, its libraries loaded and warm; then by
`schwung.batch` with workers of its own, their start counted. Every table has to be the same, bit by bit.

Beside it in the same run, what this computer gives at best: as many processes, each with its share of the sessions
in a plain loop, loaded and warm before the clock starts. Two processors that share a core or their memory do not
double anybody's rate. Processor seconds are those of all processes of a way together: they also tell on a computer
that has other work.
"""

from __future__ import annotations

import argparse
import os

os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")  # as the command line has it

import json
import multiprocessing
import tempfile
import time
from collections.abc import Sequence
from dataclasses import asdict, dataclass
from multiprocessing.synchronize import Barrier
from pathlib import Path

from schwung.batch import Results, Wish, items_of, run_batch
from schwung.batch.archive import Item, key_of
from schwung.batch.work import Outcome, carry_out

WISH = Wish("estimate")


@dataclass(frozen=True)
class Taken:
    """What a way to do all sessions took."""

    wall_s: float
    processors_s: float


def make(folder: Path, seeds: Sequence[int]) -> None:
    """Make sessions, each in a folder of its own with the machine file beside it; those that are there stay."""
    from estimator_cases import CLEAN, SLIDER_CRANK, Case, believed, session_of  # no worker's

    from schwung.drivetrain import write_machine

    for seed in seeds:
        place = folder / f"{seed:04d}"
        if (place / "machine.toml").exists():
            continue
        place.mkdir(parents=True, exist_ok=True)
        recorded = session_of(Case(SLIDER_CRANK, 0.25, CLEAN, seed), place)
        write_machine(believed(recorded, clipped=False), place / "machine.toml")


def archive(folder: Path, sessions: int, jobs: int) -> None:
    """Make all of them."""
    context = multiprocessing.get_context("spawn")
    makers = [context.Process(target=make, args=(folder, range(n, sessions, jobs))) for n in range(jobs)]
    for maker in makers:
        maker.start()
    for maker in makers:
        maker.join()
        assert maker.exitcode == 0


def loop(items: Sequence[Item], keys: Sequence[str], results: Results) -> list[Outcome]:
    """One after the other, each kept as soon as it is there, as a batch and `schwung estimate` do."""
    outcomes = []
    for item, key in zip(items, keys, strict=True):
        outcomes.append(carry_out(item, WISH, key))
        results.keep(key, outcomes[-1])
    return outcomes


def looping(
    items: Sequence[Item], keys: Sequence[str], results: Results, begin: Barrier, end: Barrier
) -> None:
    """The life of a process that does its share between two barriers."""
    loop(items[:1], keys[:1], results)
    begin.wait()
    loop(items, keys, results)
    end.wait()


def at_best(items: Sequence[Item], keys: Sequence[str], jobs: int, results: Results) -> Taken:
    """Plain loops side by side, without anything that hands out work."""
    context = multiprocessing.get_context("spawn")
    begin, end = context.Barrier(jobs + 1), context.Barrier(jobs + 1)
    loops = [
        context.Process(target=looping, args=(items[n::jobs], keys[n::jobs], results, begin, end))
        for n in range(jobs)
    ]
    for one in loops:
        one.start()
    begin.wait()
    began, used = time.perf_counter(), processors_s()
    end.wait()
    taken = Taken(time.perf_counter() - began, processors_s() - used)
    for one in loops:
        one.join()
    return taken


def processors_s() -> float:
    """What this process and all below it have used so far (s); of those that have ended, what their parents know."""
    parents, used = {}, {}
    for folder in Path("/proc").iterdir():
        if folder.name.isdigit():
            try:
                words = (folder / "stat").read_text().rpartition(")")[2].split()
            except OSError:
                continue  # it has ended meanwhile
            parents[int(folder.name)] = int(words[1])
            used[int(folder.name)] = sum(int(word) for word in words[11:15])
    ours = {os.getpid()}
    while more := {child for child, parent in parents.items() if parent in ours} - ours:
        ours |= more
    return sum(used.get(one, 0) for one in ours) / os.sysconf("SC_CLK_TCK")


def main() -> None:
    """Run the benchmark from the command line."""
    parser = argparse.ArgumentParser(description=__doc__.partition("\n")[0])
    parser.add_argument("--sessions", type=int, default=200)
    parser.add_argument("--jobs", type=int, default=2)
    parser.add_argument("--folder", type=Path, help="keeps the sessions for another time")
    parser.add_argument("--json", type=Path)
    given = parser.parse_args()
    with tempfile.TemporaryDirectory() as temporary:
        folder = given.folder or Path(temporary) / "archive"
        archive(folder, given.sessions, given.jobs)
        items = items_of([str(folder)], None)[: given.sessions]
        keys = [key_of(item, WISH) for item in items]
        of_loop, of_loops, results = (Results(Path(temporary) / name) for name in ("loop", "loops", "batch"))
        for one in (of_loop, of_loops, results):
            one.folder.mkdir()
        loop(items[:1], keys[:1], of_loop)  # what is compiled is compiled, or read from its cache
        began, used = time.perf_counter(), processors_s()
        outcomes = loop(items, keys, of_loop)
        alone = Taken(time.perf_counter() - began, processors_s() - used)
        best = at_best(items, keys, given.jobs, of_loops)

        told: list[tuple[str, float, float]] = []
        began, used = time.perf_counter(), processors_s()
        run_batch(
            items, WISH, results, jobs=given.jobs,
            progress=lambda text, _: told.append((text, time.perf_counter() - began, processors_s()))
            if text.startswith(("Sessions, 0 ", f"Sessions, {len(items)} "))
            else None,
        )  # fmt: skip
        batch = Taken(time.perf_counter() - began, told[-1][2] - used)  # the workers, while they are there
        start_s = told[0][1]
        began = time.perf_counter()
        again = run_batch(items, WISH, results, jobs=given.jobs)
        again_s = time.perf_counter() - began
        for key, outcome in zip(keys, outcomes, strict=True):
            kept = results.find(key)
            assert kept is not None
            assert kept.document == outcome.document, key
    n = len(items)
    print(f"{n} sessions, {given.jobs} processes of one thread on {os.cpu_count()} processors")
    print(f"{'':22} {'wall':>8} {'rate':>14} {'':>12} {'processors':>12}")
    for name, taken in (("one by one", alone), ("batch", batch), ("plain loops at once", best)):
        print(
            f"{name:22} {taken.wall_s:6.2f} s {n / taken.wall_s:6.2f} sess./s {alone.wall_s / taken.wall_s:6.2f} times "
            f"{taken.processors_s:9.2f} s, {taken.processors_s / alone.processors_s:.2f} times"
        )
    print(f"of batch, until its workers were ready: {start_s:.2f} s; the same tables, bit by bit")
    print(f"second call: {again_s:.2f} s, {again.found} were there already")
    if given.json:
        found = {
            "sessions": n, "jobs": given.jobs, "one_by_one": asdict(alone), "batch": asdict(batch),
            "at_best": asdict(best), "start_s": start_s, "second_s": again_s,
        }  # fmt: skip
        given.json.write_text(json.dumps(found, indent=2))


if __name__ == "__main__":
    main()
