"""Hours of bus time of commissioning after commissioning in one service: does anything grow, is any run lost?

    python benchmarks/service_soak.py --hours 8

Service, real driver and procedure stand before the bench on one stepped clock, so that eight hours of the bus take
about as long as they have to be computed: every second of them the bench has stepped through, SYNC by SYNC. Asked for
is what an engineer asks for, in rounds: the frequency response of the machine, each sweep often (most of the bus time),
then commissionings with what it proposes, each with its estimate, its report, and the table written into the drive.
After every commissioning, when nothing is under way, it counts

    memory      resident (VmRSS) of this process; beside it the largest process that estimates, which is replaced
                after some works and therefore told, not judged
    objects     that Python's collector knows, after a collection: finds a leak long before memory shows it
    handles     open file descriptors
    threads     and processes

and at the end compares the second quarter with the last one: the first is for whatever is loaded or filled once. Ends
with exit code 1 where something grows, where a run is not done, or where one is not in the store with all its files.
"""

from __future__ import annotations

import argparse
import os

os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")

import contextlib
import gc
import json
import resource
import sys
import tempfile
import threading
import time
from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass
from pathlib import Path
from statistics import median
from typing import Any

import numpy as np
from scipy.stats import theilslopes

from schwung.cli.demo import BELIEF
from schwung.fieldbus.canopen import BusOptions
from schwung.service.service import Service
from schwung.service.values import ENDED, BusEntry, DriveSeed, RunView, Settings
from schwung_sim.bench import Bench

#: Of memory, what the allocator and the collector leave to chance from run to run.
SLACK_SHARE = 0.02
#: Objects per run that no leak of a run's own values would stay below: one sample's worth.
SLACK_OBJECTS = 20.0

#: What every finished run of a kind has to have in the store.
FILES = {
    "bode": {"session.h5", "bode.json", "report.html"},
    "commission": {"session.h5", "estimate.json", "inertia.csv", "report.html"},
    "export": set[str](),
}


@dataclass(frozen=True)
class Count:
    """What there was when a run had ended."""

    bus_s: float
    memory_mb: float
    objects: int
    handles: int
    threads: int
    processes: int
    worker_mb: float = 0.0
    runs: int = 0  # stored so far, of all kinds


class SoakError(Exception):
    """Something grows, or is lost."""


def soak(
    folder: Path,
    bus_hours: float,
    *,
    repeats: int = 2,
    commissionings: int = 5,
    response_repeats: int = 50,
    sample_rate_hz: float = 1000.0,
    runs: int | None = None,
    within_s: float = float("inf"),
    tell: bool = True,
) -> list[Count]:
    """Commission until so much bus time has passed (or so often as `runs`, or `within_s` by the wall).

    commissionings: after each frequency response, which is measured `response_repeats` times (0: never).

    Raises SoakError for a run that is not done, and for one that the store has lost.
    """
    counts: list[Count] = []
    began, used_s = time.monotonic(), _processors_s()
    with Bench("two-mass", channel="soak", node_id=1) as bench:
        settings = Settings(
            folder,
            (BusEntry("bench", BusOptions("stepped", "soak", 1_000_000)),),
            (DriveSeed("axis", "bench", 1, "schwung-bench", BELIEF, "Slider-crank"),),
            poll_s=0.0,
        )
        clock = bench.bus.clock
        with Service(settings) as service:
            desk = Desk(service, service.store.drives()[0].id, sample_rate_hz)
            response: str | None = None
            while (
                clock.now() < 3600 * bus_hours
                and (runs is None or len(counts) < runs)
                and time.monotonic() - began < within_s
            ):
                if response_repeats and len(counts) % commissionings == 0:
                    response = desk.respond(response_repeats)
                desk.commission(repeats, response)
                counts.append(_count(clock.now(), len(desk.finished)))
                if tell:
                    _show(counts, bus_hours, time.monotonic() - began, _processors_s() - used_s)
            desk.require_kept()
    return counts


class Desk:
    """Who asks the service, and remembers what was told as done."""

    def __init__(self, service: Service, drive_id: str, sample_rate_hz: float) -> None:
        self.service, self.drive_id, self.sample_rate_hz = service, drive_id, sample_rate_hz
        self.finished: list[tuple[str, str]] = []  # id and kind: results of our own would add up

    def respond(self, repeats: int) -> str:
        """Measure the frequency response; returns the run's id."""
        asked = {"angles_rad": [0.0, 1.0, 2.0, 3.0], "repeats": repeats, "sample_rate_hz": 500.0}
        return self._confirmed("propose_bode", "bode", asked).id

    def commission(self, repeats: int, response: str | None) -> None:
        """Commission, with what the frequency response proposes where there is one, and export the table."""
        stroke = {"distance_rad": 3.14, "duration_s": 0.25, "repeats": repeats}
        asked = {**stroke, "sample_rate_hz": self.sample_rate_hz, "bode_run_id": response}
        run = self._confirmed("plan", "commission", asked)
        assert run.result is not None
        self._confirmed("propose_export", "export", {"estimate_id": run.result["estimate_id"]})

    def _confirmed(self, proposing: str, kind: str, asked: Mapping[str, Any]) -> RunView:
        made = self._ended({"kind": proposing, "drive_id": self.drive_id, **asked}).result
        assert made is not None
        return self._ended({"kind": kind, "proposal_id": made["proposal_id"], "digest": made["digest"]})

    def _ended(self, asked: Mapping[str, Any]) -> RunView:
        run_id = self.service.submit(asked, "soak").id
        while (run := self.service.run(run_id)).state not in ENDED:
            time.sleep(0.01)
        if run.state != "done":
            raise SoakError(f"run {run_id} ({run.kind}) is {run.state}: {run.error}")
        self.finished.append((run.id, run.kind))
        return run

    def require_kept(self) -> None:
        """Raise SoakError where a run is not in the store with its files, or the trail is broken."""
        store, trail = self.service.store, self.service.trail
        for run_id, kind in self.finished:
            kept = store.run(run_id)
            files = {file.name: file.id for file in store.files(run_id)}
            if kept.state != "done" or not FILES.get(kind, set()) <= set(files):
                raise SoakError(f"run {run_id} ({kind}) is {kept.state} in the store, with {sorted(files)}")
            for file_id in files.values():
                store.file_path(file_id, check=True)
        if trail.verify() is not None:
            raise SoakError(f"the trail is broken: {trail.verify()}")


def _count(bus_s: float, runs: int) -> Count:
    gc.collect()
    workers = _children()
    return Count(
        bus_s, _resident_mb("self"), len(gc.get_objects()), len(os.listdir("/proc/self/fd")),
        threading.active_count(), len(workers), max((_resident_mb(one) for one in workers), default=0.0), runs,
    )  # fmt: skip


def _resident_mb(process: str) -> float:
    try:
        status = Path(f"/proc/{process}/status").read_text(encoding="utf-8").splitlines()
    except OSError:  # it has ended meanwhile
        return 0.0
    return sum(float(line.split()[1]) for line in status if line.startswith("VmRSS")) / 1024


def _children() -> list[str]:
    found: list[str] = []
    for task in Path("/proc/self/task").iterdir():
        with contextlib.suppress(OSError):  # the thread has ended meanwhile
            found += (task / "children").read_text(encoding="utf-8").split()
    return found


def _processors_s() -> float:
    """What this process and those that it has and had have used (s)."""
    used = 0.0
    for whose in (resource.RUSAGE_SELF, resource.RUSAGE_CHILDREN):
        usage = resource.getrusage(whose)
        used += usage.ru_utime + usage.ru_stime
    for child in _children():
        with contextlib.suppress(OSError):
            words = Path(f"/proc/{child}/stat").read_text(encoding="utf-8").rpartition(")")[2].split()
            used += sum(int(word) for word in words[11:13]) / os.sysconf("SC_CLK_TCK")
    return used


def _show(counts: Sequence[Count], hours: float, took_s: float, used_s: float) -> None:
    last = counts[-1]
    print(
        f"{last.runs:6d} runs {last.bus_s / 3600:6.2f} of {hours:g} h, {last.bus_s / took_s:5.2f} times the wall, "
        f"{last.bus_s / used_s:5.2f} times the processor  {last.memory_mb:7.1f} MB  {last.objects:8d} objects  "
        f"{last.handles:3d} handles  {last.threads:3d} threads  {last.processes:2d} processes of "
        f"{last.worker_mb:.0f} MB",
        flush=True,
    )


def grown(counts: Sequence[Count]) -> list[str]:
    """What is more in the last quarter than in the second: one sentence each."""
    quarter = max(len(counts) // 4, 1)
    before, after = counts[quarter : 2 * quarter], counts[-quarter:]
    if not before:
        return [f"{len(counts)} runs are too few to see anything grow"]
    apart = max(after[0].runs - before[0].runs, 1)
    found = []
    for name in ("handles", "threads", "processes"):
        was, now = (max(getattr(one, name) for one in part) for part in (before, after))
        if now > was:
            found.append(f"{name}: {was} have become {now}")
    was, now = (median(one.objects for one in part) for part in (before, after))
    if now - was > SLACK_OBJECTS * apart:
        found.append(f"objects: {was:.0f} have become {now:.0f}, {(now - was) / apart:.1f} a run")
    was, now = (median(one.memory_mb for one in part) for part in (before, after))
    if now > (1 + SLACK_SHARE) * was:
        found.append(
            f"memory: {was:.1f} MB have become {now:.1f} MB, {1024 * (now - was) / apart:.1f} kB a run"
        )
    return found


def slope(counts: Sequence[Count]) -> float:
    """By how much memory grows with each commissioning (kB) after the first quarter: the median of all pairs' slopes
    (Theil and Sen), which single steps of the allocator do not bend."""
    kept = counts[len(counts) // 4 :]
    memory = np.array([one.memory_mb for one in kept])
    return 1024 * float(theilslopes(memory)[0]) if memory.size > 1 else 0.0


def main() -> None:
    """Run the benchmark from the command line."""
    parser = argparse.ArgumentParser(description=__doc__.partition("\n")[0])
    parser.add_argument("--hours", type=float, default=8.0, help="of bus time")
    parser.add_argument("--repeats", type=int, default=2, help="of each motion in a commissioning")
    parser.add_argument("--commissionings", type=int, default=5, help="after each frequency response")
    parser.add_argument(
        "--response-repeats", type=int, default=50, help="of each sweep of a frequency response; 0: without"
    )
    parser.add_argument("--within", type=float, default=float("inf"), metavar="S", help="ends after so long")
    parser.add_argument("--folder", type=Path, help="keeps the store; default: a temporary one")
    parser.add_argument("--json", type=Path, help="every count")
    given = parser.parse_args()
    began, used_s = time.monotonic(), _processors_s()
    with tempfile.TemporaryDirectory() as temporary:
        try:
            counts = soak(
                given.folder or Path(temporary), given.hours, repeats=given.repeats,
                commissionings=given.commissionings, response_repeats=given.response_repeats, within_s=given.within,
            )  # fmt: skip
        except SoakError as error:
            sys.exit(str(error))
    if given.json:
        given.json.write_text(json.dumps([asdict(count) for count in counts], indent=1))
    took_s = time.monotonic() - began
    first, last = counts[min(len(counts) // 4, len(counts) - 1)], counts[-1]
    print(
        f"{last.runs} runs, {len(counts)} commissionings among them, {last.bus_s / 3600:.2f} h of bus time in "
        f"{took_s / 60:.1f} min, {(_processors_s() - used_s) / 60:.1f} min of processor: none lost"
    )
    print(
        f"after a quarter, at the end: {first.memory_mb:.1f}, {last.memory_mb:.1f} MB; {first.objects}, {last.objects} "
        f"objects; {first.handles}, {last.handles} handles; {first.threads}, {last.threads} threads; "
        f"{slope(counts):+.2f} kB per commissioning"
    )
    found = grown(counts)
    if found:
        sys.exit("\n".join(["It grows.", *found]))
    print("Neither memory nor objects, handles, threads or processes have grown.")


if __name__ == "__main__":
    main()
