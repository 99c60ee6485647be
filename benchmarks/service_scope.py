"""What the live scope costs at 1 kHz samples: pictures a second, processor time of each, and how far it is behind.

    python benchmarks/service_scope.py --seconds 60

The service with its pages and Chromium are processes of their own; instead of a drive, samples of a made-up motion
come at 1 kHz by the wall clock, so that a computer that is too busy for a motion can still be measured. The page goes
by the same clock: at each picture the newest sample shown is held against it. Processor time is all that the
processes used meanwhile, divided by the pictures; beside it, what they take without samples.

Prints every tenth of the time what it has counted, and compares memory of the service, of all of the browser, and
of the page's own objects after a collection: the last third against the middle one. Exit code 1 where it grows, or
where in half of the parts fewer pictures than `--least` a second were drawn.
"""

from __future__ import annotations

import argparse
import os

os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")

import json
import multiprocessing
import sys
import tempfile
import threading
import time
from collections.abc import Iterable
from dataclasses import asdict, dataclass
from multiprocessing.connection import Connection
from pathlib import Path
from statistics import median
from typing import Any

import numpy as np

sys.path.insert(0, str(Path(__file__).parents[1] / "tests/service/browser"))

RATE_HZ = 1000.0
#: Of the memory, what a collector leaves to chance.
SLACK_SHARE, SLACK_MB = 0.05, 2.0
#: Every picture: how long the page's own code took, and how old the newest sample is.
WATCH = """
(began_s) => {
  const seen = window.seen = { pictures: 0, busy_ms: 0, lags_s: [] };
  const draw = window.Schwung.Panels.prototype.draw;
  window.Schwung.Panels.prototype.draw = function () {
    const from = performance.now();
    draw.call(this);
    seen.pictures += 1;
    seen.busy_ms += performance.now() - from;
    const x = this.options.panels[0].series[0].x;
    if (x.length) seen.lags_s.push(Date.now() / 1000 - began_s - x[x.length - 1]);
  };
}
"""
TAKE = """
() => {
  const seen = window.seen, taken = { pictures: seen.pictures, busy_ms: seen.busy_ms, lags_s: seen.lags_s };
  seen.pictures = seen.busy_ms = 0; seen.lags_s = [];
  return taken;
}
"""


@dataclass(frozen=True)
class Part:
    """A part of the time."""

    seconds: float
    pictures: int
    code_ms: float  # the page's own code, per picture
    browser_ms: float  # all processes of the browser, per picture
    service_ms: float
    lag_median_s: float
    lag_99_s: float
    service_mb: float
    browser_mb: float
    objects_mb: float  # the page's own


def serve(folder: Path, told: Connection) -> None:
    """The life of the service's process: pages, and samples when they are asked for."""
    import uvicorn  # the browser's process needs none of this

    from schwung.cli.demo import BELIEF
    from schwung.fieldbus.canopen import BusOptions
    from schwung.service.app import make_app
    from schwung.service.guard import Guard, own_token
    from schwung.service.pages import mount_pages
    from schwung.service.service import Service
    from schwung.service.stop_listener import listen
    from schwung.service.values import BusEntry, DriveSeed, Settings

    settings = Settings(
        folder,
        (BusEntry("none", BusOptions("stepped", "nobody", 1_000_000)),),
        (DriveSeed("axis", "none", 1, "schwung-bench", BELIEF, "Slider-crank"),),
        poll_s=0.0,
    )
    with Service(settings) as service:
        listening = listen("127.0.0.1", 0, "port")
        port = listening.getsockname()[1]
        guard = Guard(settings, own_token(folder), port)
        app = make_app(service, guard)
        mount_pages(app, service, guard, None)
        server = uvicorn.Server(uvicorn.Config(app, log_config=None))
        drive_id = service.store.drives()[0].id
        told.send({"url": f"http://127.0.0.1:{port}", "token": own_token(folder), "drive_id": drive_id})

        def wait() -> None:
            told.recv()
            play(service.live.scope(drive_id), told)
            server.should_exit = True

        threading.Thread(target=wait, daemon=True).start()
        server.run(sockets=[listening])


def play(scope: Any, told: Connection) -> None:
    """Samples as a driver hands them out, until somebody says that it is enough."""
    from schwung.fieldbus.drive import LiveSamples
    from schwung.service.live import PERIOD_S

    began_s, rows, luck = time.time(), 0, np.random.default_rng(1)
    told.send(began_s - 0.05)  # the scope's time begins after a gap
    while not told.poll():
        time.sleep(PERIOD_S)
        count = int((time.time() - began_s) * RATE_HZ) - rows
        time_s = (rows + np.arange(count)) / RATE_HZ
        rows += count
        position = 1.57 * (1 - np.cos(2 * np.pi * time_s))
        torque = (
            3 * np.sin(4 * np.pi * time_s) + np.sin(2 * np.pi * 60 * time_s) + luck.normal(0, 0.05, count)
        )
        speed = np.gradient(position, time_s) if count > 1 else 0 * time_s
        error = 1e-3 * np.sin(8 * np.pi * time_s) + luck.normal(0, 1e-5, count)
        scope.append(LiveSamples(1, time_s, position - error, speed, torque, position, 0 * time_s))


def measure(seconds: float, scale: float, width: int) -> list[Part]:
    """Look for so long; prints each part."""
    from page_process import Served, browser_process, visiting

    context = multiprocessing.get_context("spawn")
    ours, theirs = context.Pipe()
    parts: list[Part] = []
    with tempfile.TemporaryDirectory() as folder:
        service = context.Process(target=serve, args=(Path(folder), theirs), daemon=True)
        service.start()
        told = ours.recv()
        served = Served(told["url"], told["token"], told["drive_id"], None)
        look = {"viewport": {"width": width, "height": 900}, "device_scale_factor": scale}
        with browser_process() as browser, visiting(browser, served, **look) as page:
            page.goto(f"{served.url}/drive/{served.drive_id}")
            page.locator(".sw-scope canvas").wait_for()
            page.wait_for_timeout(1000)
            tools = page.context.new_cdp_session(page)
            tools.send("Performance.enable")
            idle = [processors_s(ids) for ids in (_browser_of(os.getpid(), service.pid), [service.pid])]
            page.wait_for_timeout(3000)
            for name, ids, before in zip(
                ("browser", "service"),
                (_browser_of(os.getpid(), service.pid), [service.pid]),
                idle,
                strict=True,
            ):
                print(
                    f"without samples the {name} takes {(processors_s(ids) - before) / 3:.1%} of a processor"
                )
            ours.send("play")
            page.evaluate(WATCH, ours.recv())
            page.wait_for_timeout(2000)
            for _ in range(10):
                parts.append(_part(page, tools, service.pid, seconds / 10))
                print(_row(parts[-1]), flush=True)
        ours.send("enough")
        service.join(10)
        service.kill()
    return parts


def _part(page: Any, tools: Any, service: int, seconds: float) -> Part:
    page.evaluate(TAKE)
    browser = _browser_of(os.getpid(), service)
    before, began = (processors_s(browser), processors_s([service])), time.monotonic()
    page.wait_for_timeout(1000 * seconds)
    taken, took_s = page.evaluate(TAKE), time.monotonic() - began
    used = (processors_s(browser) - before[0], processors_s([service]) - before[1])
    tools.send("HeapProfiler.collectGarbage")
    heap = {one["name"]: one["value"] for one in tools.send("Performance.getMetrics")["metrics"]}[
        "JSHeapUsedSize"
    ]
    pictures = max(taken["pictures"], 1)
    lags = np.array(taken["lags_s"] or [np.nan])
    return Part(
        took_s, taken["pictures"], taken["busy_ms"] / pictures, 1e3 * used[0] / pictures, 1e3 * used[1] / pictures,
        float(np.median(lags)), float(np.percentile(lags, 99)), memory_mb([service]), memory_mb(browser), heap / 1e6,
    )  # fmt: skip


def _row(part: Part) -> str:
    return (
        f"{part.pictures / part.seconds:5.1f} pictures/s  ms each: page's code {part.code_ms:5.2f}, browser "
        f"{part.browser_ms:6.2f}, service {part.service_ms:5.2f}  behind {1e3 * part.lag_median_s:4.0f} ms, 99 % "
        f"{1e3 * part.lag_99_s:4.0f} ms  MB: {part.service_mb:.1f} {part.browser_mb:.0f} {part.objects_mb:.2f}"
    )


def _browser_of(ours: int, service: int) -> list[int]:
    """All processes of the browser: whatever is below us and not the service."""
    parents: dict[int, int] = {}
    for folder in Path("/proc").iterdir():
        if folder.name.isdigit():
            try:
                parents[int(folder.name)] = int((folder / "stat").read_text().rpartition(")")[2].split()[1])
            except OSError:
                continue
    found = {ours}
    while (
        more := {child for child, parent in parents.items() if parent in found and child != service} - found
    ):
        found |= more
    return sorted(found - {ours})


def processors_s(ids: Iterable[int | None]) -> float:
    """Processor time of processes so far (s)."""
    return sum(sum(map(int, _stat(one)[11:13])) for one in ids) / os.sysconf("SC_CLK_TCK")


def memory_mb(ids: Iterable[int | None]) -> float:
    """Resident memory of processes (MB)."""
    return sum(int(_stat(one)[21]) for one in ids) * os.sysconf("SC_PAGE_SIZE") / 1e6


def _stat(process: int | None) -> list[str]:
    try:
        return Path(f"/proc/{process}/stat").read_text(encoding="utf-8").rpartition(")")[2].split()
    except OSError:  # it has ended
        return ["0"] * 50


def grown(parts: list[Part]) -> list[str]:
    """What is more in the last third than in the middle one: one sentence each."""
    third, found = len(parts) // 3, []
    for name in ("service_mb", "browser_mb", "objects_mb"):
        was, now = (
            median(getattr(one, name) for one in some) for some in (parts[third:-third], parts[-third:])
        )
        if now - was > max(SLACK_SHARE * was, SLACK_MB):
            found.append(f"{name.removesuffix('_mb')}: {was:.1f} MB have become {now:.1f} MB")
    return found


def main() -> None:
    """Run the benchmark from the command line."""
    parser = argparse.ArgumentParser(description=__doc__.partition("\n")[0])
    parser.add_argument("--seconds", type=float, default=60.0)
    parser.add_argument("--scale", type=float, default=1.0, help="device pixels per pixel: 2 for a tablet")
    parser.add_argument("--width", type=int, default=1280, help="of the window")
    parser.add_argument("--least", type=float, default=29.0, help="pictures per second, on a quiet computer")
    parser.add_argument("--json", type=Path)
    given = parser.parse_args()
    parts = measure(given.seconds, given.scale, given.width)
    if given.json:
        given.json.write_text(json.dumps([asdict(part) for part in parts], indent=1))
    if found := grown(parts):
        sys.exit("\n".join(["It grows.", *found]))
    print("Neither service, browser nor page has grown.")
    drawn = median(part.pictures / part.seconds for part in parts)
    print(f"{drawn:.1f} pictures a second in the median part")
    if drawn < given.least:
        sys.exit(f"That is less than {given.least:g}.")


if __name__ == "__main__":
    main()
