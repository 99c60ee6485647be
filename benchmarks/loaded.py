"""`schwung demo` on a computer that has no time for it: does it come to its end, and always to the same bytes?

    python benchmarks/loaded.py --times 10

Four processes keep the processors busy; they and the demo itself are stopped and continued at random, for 0.1 to 1.3 s.
Every run has to end with exit code 0, and session.h5 and inertia.csv have to be those of the first.
"""

from __future__ import annotations

import argparse
import hashlib
import os
import random
import signal
import subprocess
import sys
import tempfile
import time
from pathlib import Path

BUSY = 4
STALL_S = (0.1, 1.3)
APART_S = (0.1, 1.0)  # between two stalls of one process
FILES = ("session.h5", "inertia.csv")


class Stalls:
    """Stops and continues processes, each at its own instants."""

    def __init__(self, processes: list[subprocess.Popen[bytes]], seed: int) -> None:
        self._luck = random.Random(seed)
        self._due = {
            process: (time.monotonic() + self._luck.uniform(*APART_S), False) for process in processes
        }
        self.count = 0

    def poll(self) -> None:
        """Do what is due."""
        now = time.monotonic()
        for process, (due, stopped) in self._due.items():
            if now < due or process.poll() is not None:
                continue
            os.kill(process.pid, signal.SIGCONT if stopped else signal.SIGSTOP)
            self.count += not stopped
            self._due[process] = (now + self._luck.uniform(*(APART_S if stopped else STALL_S)), not stopped)


def run(
    folder: Path, options: list[str], seed: int, busy: list[subprocess.Popen[bytes]]
) -> tuple[int, float, int]:
    """One demo under load: its exit code, how long it took (s), how often it was stopped."""
    command = [sys.executable, "-m", "schwung", "demo", "--out", str(folder), *options]
    began = time.monotonic()
    with (folder.parent / f"{folder.name}.log").open("wb") as log:
        demo = subprocess.Popen(command, stdout=log, stderr=log)
        others, own = Stalls(busy, seed), Stalls([demo], seed + 1)
        while demo.poll() is None:
            others.poll()
            own.poll()
            time.sleep(0.01)
    if demo.returncode:
        print(Path(log.name).read_text(encoding="utf-8")[-1000:])
    return demo.returncode, time.monotonic() - began, own.count


def main(times: int, options: list[str]) -> int:
    """Run the demo so often; returns how often it failed or gave other bytes."""
    busy = [subprocess.Popen([sys.executable, "-c", "while True: pass"]) for _ in range(BUSY)]
    wrong, first = 0, ""
    try:
        with tempfile.TemporaryDirectory() as folder:
            for number in range(times):
                out = Path(folder) / f"run{number}"
                code, took, stalls = run(out, options, 1000 * number, busy)
                digest = hashlib.sha256()
                for name in FILES:
                    digest.update((out / name).read_bytes() if (out / name).exists() else b"missing")
                told = digest.hexdigest()[:16]
                first = first or told
                wrong += code != 0 or told != first
                print(
                    f"run {number + 1}: exit {code}, {took:.1f} s, stopped {stalls} times, bytes {told}",
                    flush=True,
                )
    finally:
        for process in busy:
            process.kill()
            process.wait()
    print(f"{times - wrong} of {times} runs ended well, with the same bytes in {' and '.join(FILES)}")
    return wrong


if __name__ == "__main__":
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--times", type=int, default=10)
    parser.add_argument("options", nargs="*", help="further options of `schwung demo`, after --")
    given = parser.parse_args()
    sys.exit(main(given.times, given.options) > 0)
