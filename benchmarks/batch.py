"""How much faster a batch is than one session after the other: the same sessions, the same results.

    python benchmarks/batch.py --sessions 200 --jobs 2

Sessions of the virtual machine room (slider-crank, reference and four phases, each with noise of its own) are
estimated in this process, one by one, as `schwung estimate` does it; then by `schwung.batch` with workers of its own.
Every table has to be the same, bit by bit. Prints both times, the ratio of their rates with the workers' start counted
and without it (the one by one has no start: its libraries are loaded), and what a second call takes.
"""

from __future__ import annotations

import argparse
import os

os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")  # as the command line has it

import json
import tempfile
import time
from pathlib import Path

from estimator_cases import CLEAN, SLIDER_CRANK, Case, believed, session_of

from schwung.batch import Results, Wish, items_of, run_batch
from schwung.batch.archive import key_of
from schwung.batch.work import carry_out
from schwung.drivetrain import write_machine

WISH = Wish("estimate")


def archive(folder: Path, sessions: int) -> None:
    """Make the sessions, each in a folder of its own with the machine file beside it; those that are there stay."""
    for seed in range(sessions):
        place = folder / f"{seed:04d}"
        place.mkdir(parents=True, exist_ok=True)
        recorded = session_of(Case(SLIDER_CRANK, 0.25, CLEAN, seed), place)
        if not (place / "machine.toml").exists():
            write_machine(believed(recorded, clipped=False), place / "machine.toml")


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
        archive(folder, given.sessions)
        items = items_of([str(folder)], None)[: given.sessions]
        keys = [key_of(item, WISH) for item in items]
        carry_out(items[0], WISH, keys[0])  # what is compiled is compiled, or read from its cache
        began = time.perf_counter()
        alone = [carry_out(item, WISH, key) for item, key in zip(items, keys, strict=True)]
        alone_s = time.perf_counter() - began
        results = Results(Path(temporary) / "results")
        results.folder.mkdir()
        began = time.perf_counter()
        told: list[tuple[str, float]] = []
        run_batch(
            items, WISH, results, jobs=given.jobs,
            progress=lambda text, _share: told.append((text, time.perf_counter())),
        )  # fmt: skip
        batch_s = time.perf_counter() - began
        start_s = next(at_s for text, at_s in told if text.startswith("Sessions, 0 ")) - began
        began = time.perf_counter()
        again = run_batch(items, WISH, results, jobs=given.jobs)
        again_s = time.perf_counter() - began
        for key, outcome in zip(keys, alone, strict=True):
            kept = results.find(key)
            assert kept is not None
            assert kept.document == outcome.document, key
    n = len(items)
    print(f"{n} sessions, {given.jobs} processes of one thread on {os.cpu_count()} processors")
    print(f"one by one    {alone_s:8.2f} s  {n / alone_s:6.2f} sessions/s")
    print(f"batch         {batch_s:8.2f} s  {n / batch_s:6.2f} sessions/s, workers' start included")
    print(f"              {alone_s / batch_s:8.2f} times the rate; the same tables, bit by bit")
    print(f"of it start   {start_s:8.2f} s  without it {alone_s / (batch_s - start_s):.2f} times the rate")
    print(f"second call   {again_s:8.2f} s, {again.found} were there already")
    if given.json:
        found = {
            "sessions": n,
            "jobs": given.jobs,
            "one_by_one_s": alone_s,
            "batch_s": batch_s,
            "start_s": start_s,
            "second_s": again_s,
        }
        given.json.write_text(json.dumps(found, indent=2))


if __name__ == "__main__":
    main()
