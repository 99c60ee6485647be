"""Hours of bus time of commissioning after commissioning in one service: does anything grow, is any run lost?

    python benchmarks/service_soak.py --hours 8

Service, real driver and procedure stand before the bench on one stepped clock, so that eight hours of the bus take
about as long as they have to be computed. After every run, when nothing is under way, it counts

    memory      resident (VmRSS) of this process; of the processes that estimate, the largest
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

import gc
import json
import sys
import tempfile
import threading
import time
from collections.abc import Sequence
from dataclasses import asdict, dataclass
from pathlib import Path
from statistics import median

from schwung.cli.demo import BELIEF
from schwung.fieldbus.canopen import BusOptions
from schwung.service.service import Service
from schwung.service.values import ENDED, BusEntry, DriveSeed, RunView, Settings
from schwung_sim.bench import Bench

#: Of memory, what the allocator and the collector leave to chance from run to run.
SLACK_SHARE = 0.02
#: Objects per run that no leak of a run's own values would stay below: one sample's worth.
SLACK_OBJECTS = 20.0


@dataclass(frozen=True)
class Count:
    """What there was when a run had ended."""

    bus_s: float
    memory_mb: float
    objects: int
    handles: int
    threads: int
    processes: int


class SoakError(Exception):
    """Something grows, or is lost."""


def soak(
    folder: Path,
    bus_hours: float,
    *,
    repeats: int = 2,
    runs: int | None = None,
    within_s: float = float("inf"),
    tell: bool = True,
) -> list[Count]:
    """Commission until so much bus time has passed (or so many `runs`, or `within_s` by the wall).

    Raises SoakError for a run that is not done, and for one that the store has lost.
    """
    counts: list[Count] = []
    finished: list[str] = []
    began = time.monotonic()
    with Bench("two-mass", channel="soak", node_id=1) as bench:
        settings = Settings(
            folder,
            (BusEntry("bench", BusOptions("stepped", "soak", 1_000_000)),),
            (DriveSeed("axis", "bench", 1, "schwung-bench", BELIEF, "Slider-crank"),),
            poll_s=0.0,
        )
        clock = bench.bus.clock
        with Service(settings) as service:
            drive_id = service.store.drives()[0].id
            while (
                clock.now() < 3600 * bus_hours
                and (runs is None or len(counts) < runs)
                and time.monotonic() - began < within_s
            ):
                finished.append(_commission(service, drive_id, repeats).id)
                counts.append(_count(clock.now()))
                if tell:
                    _show(counts, bus_hours, time.monotonic() - began)
            kept = {run.id for run in service.store.runs(state="done", limit=10 * len(finished) + 10)}
            for run_id in finished:
                files = {file.name for file in service.store.files(run_id)}
                if run_id not in kept or not {"session.h5", "estimate.json"} <= files:
                    raise SoakError(f"run {run_id} is not in the store with its files ({sorted(files)})")
            if service.trail.verify() is not None:
                raise SoakError(f"the trail is broken: {service.trail.verify()}")
    return counts


def _commission(service: Service, drive_id: str, repeats: int) -> RunView:
    asked = {
        "kind": "plan",
        "drive_id": drive_id,
        "distance_rad": 3.14,
        "duration_s": 0.25,
        "repeats": repeats,
    }
    made = _ended(service, service.submit(asked, "soak").id).result
    assert made is not None
    confirmed = {"kind": "commission", "proposal_id": made["proposal_id"], "digest": made["digest"]}
    return _ended(service, service.submit(confirmed, "soak").id)


def _ended(service: Service, run_id: str) -> RunView:
    while (run := service.run(run_id)).state not in ENDED:
        time.sleep(0.005)
    if run.state != "done":
        raise SoakError(f"run {run_id} ({run.kind}) is {run.state}: {run.error}")
    return run


def _count(bus_s: float) -> Count:
    gc.collect()
    status = Path("/proc/self/status").read_text(encoding="utf-8")
    memory = float(next(line for line in status.splitlines() if line.startswith("VmRSS")).split()[1])
    children = [child for task in Path("/proc/self/task").iterdir() for child in _children(task)]
    return Count(
        bus_s, memory / 1024, len(gc.get_objects()), len(os.listdir("/proc/self/fd")), threading.active_count(),
        len(children),
    )  # fmt: skip


def _children(task: Path) -> list[str]:
    try:
        return (task / "children").read_text().split()
    except OSError:  # the thread has ended meanwhile
        return []


def _show(counts: Sequence[Count], hours: float, took_s: float) -> None:
    last = counts[-1]
    print(
        f"{len(counts):6d} runs {last.bus_s / 3600:6.2f} of {hours:g} h, {last.bus_s / took_s:.2f} times the wall  "
        f"{last.memory_mb:7.1f} MB  {last.objects:8d} objects  {last.handles:3d} handles  {last.threads:3d} threads  "
        f"{last.processes:2d} processes",
        flush=True,
    )


def grown(counts: Sequence[Count]) -> list[str]:
    """What is more in the last quarter than in the second: one sentence each."""
    quarter = max(len(counts) // 4, 1)
    before, after = counts[quarter : 2 * quarter], counts[-quarter:]
    if not before:
        return [f"{len(counts)} runs are too few to see anything grow"]
    apart = len(counts) - 2 * quarter  # runs from the middle of the one to the middle of the other, nearly
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


def main() -> None:
    """Run the benchmark from the command line."""
    parser = argparse.ArgumentParser(description=__doc__.partition("\n")[0])
    parser.add_argument("--hours", type=float, default=8.0, help="of bus time")
    parser.add_argument("--repeats", type=int, default=2, help="of each motion in a commissioning")
    parser.add_argument("--within", type=float, default=float("inf"), metavar="S", help="ends after so long")
    parser.add_argument("--folder", type=Path, help="keeps the store; default: a temporary one")
    parser.add_argument("--json", type=Path, help="every count")
    given = parser.parse_args()
    began = time.monotonic()
    with tempfile.TemporaryDirectory() as temporary:
        try:
            counts = soak(
                given.folder or Path(temporary), given.hours, repeats=given.repeats, within_s=given.within
            )
        except SoakError as error:
            sys.exit(str(error))
    if given.json:
        given.json.write_text(json.dumps([asdict(count) for count in counts], indent=1))
    took_s = time.monotonic() - began
    print(
        f"{len(counts)} commissionings, {counts[-1].bus_s / 3600:.2f} h of bus time in {took_s / 60:.1f} min: none lost"
    )
    found = grown(counts)
    if found:
        sys.exit("\n".join(["It grows.", *found]))
    print("Neither memory nor objects, handles, threads or processes have grown.")


if __name__ == "__main__":
    main()
