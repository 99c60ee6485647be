"""From the click on STOP to the quick stop on the bus, while a job moves the machine; prints the percentiles.

    python benchmarks/service_stop.py --clicks 300 --within 900

A bench, `schwung serve` and Chromium, each a process of its own, on loopback. The browser stamps the pointer going
down; a further listener on the bus stamps the first controlword 0x0002, both by the same clock. Between the two the
service notes when it heard of it. The aim is 100 ms at the 99th percentile. Beside it, in the same run: the stop by
one HTTP call without a browser, which is what network, service and bus take of it.

Each click stops a commissioning of its own, which has to be planned, begun, and put back after it: that is most of
the time. It tells how far it is, and ends after `--within` seconds with as many clicks as there were.
"""

from __future__ import annotations

import argparse
import logging
import sys
import tempfile
import time
import urllib.request
from dataclasses import dataclass
from datetime import datetime
from pathlib import Path
from typing import Any

import numpy as np

sys.path.insert(0, str(Path(__file__).parents[1] / "tests/service/browser"))

from page_process import Served, browser_process, serving, visiting

_WITHIN_S = 10.0
_TOLD_EVERY = 10
_CALLS_SHARE = 0.2  # of the time, for the calls without a browser


@dataclass(frozen=True)
class Stop:
    """One STOP, by the computer's clock (s)."""

    pressed_s: float
    heard_s: float  # by the service
    stopped_s: float  # the frame on the bus


def main() -> None:
    """Measure and print."""
    logging.getLogger("can").addHandler(logging.NullHandler())  # it tells of frames in two parts
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--clicks", type=int, default=100)
    parser.add_argument("--calls", type=int, default=30)
    parser.add_argument("--within", type=float, default=900.0, metavar="S", help="ends after so long")
    asked = parser.parse_args()
    began = time.monotonic()
    clicks: list[Stop] = []
    calls: list[Stop] = []
    with (
        tempfile.TemporaryDirectory() as folder,
        serving(Path(folder)) as served,
        browser_process() as browser,
    ):
        with visiting(browser, served) as page:
            until = began + (1 - _CALLS_SHARE) * asked.within
            while len(clicks) < asked.clicks and time.monotonic() < until:
                clicks.append(_click(served, page))
                if len(clicks) % _TOLD_EVERY == 0:
                    print(
                        f"{time.monotonic() - began:4.0f} s {_row('click in the page', clicks)}", flush=True
                    )
        while len(calls) < asked.calls and time.monotonic() < began + asked.within:
            calls.append(_call(served))
    print(f"{'':34} {'n':>4} {'50 %':>8} {'90 %':>8} {'99 %':>8} {'largest':>8}   ms")
    for name, stops in (("click in the page", clicks), ("HTTP call, for comparison", calls)):
        if stops:
            print(_row(name + " to quick stop", stops))
            print(_row("  until the service heard of it", [Stop(s.pressed_s, 0, s.heard_s) for s in stops]))
            print(_row("  from then on", [Stop(s.heard_s, 0, s.stopped_s) for s in stops]))


def _row(name: str, stops: list[Stop]) -> str:
    times = 1e3 * np.array([stop.stopped_s - stop.pressed_s for stop in stops])
    shares = np.percentile(times, (50, 90, 99, 100))
    return f"{name:34} {len(stops):4d} " + " ".join(f"{share:8.1f}" for share in shares)


def _click(served: Served, page: Any) -> Stop:
    """One click on a page that shows the live scope of what moves."""
    run = served.begin_motion()
    page.goto(f"{served.url}/commission/{served.drive_id}?run={run['id']}")
    page.locator(".sw-scope canvas").wait_for()
    page.wait_for_timeout(300)  # the scope draws
    served.watch.begin()
    page.click("#stop")
    pressed: float = page.evaluate("window.pressed[0]")
    stopped = _stopped(served)
    stop = Stop(pressed, _heard(served), stopped)
    served.settle()
    return stop


def _call(served: Served) -> Stop:
    served.begin_motion()
    served.watch.begin()
    began = time.time()
    urllib.request.urlopen(
        urllib.request.Request(f"{served.url}/api/stop", b"", method="POST"), timeout=5
    ).close()
    stopped = _stopped(served)
    stop = Stop(began, _heard(served), stopped)
    served.settle()
    return stop


def _heard(served: Served) -> float:
    """When the service noted the STOP."""
    end = time.monotonic() + _WITHIN_S
    while not (told := served.call("GET", "/api/stop"))["stopped"]:
        if time.monotonic() > end:
            raise SystemExit("the service heard of no STOP")
        time.sleep(0.002)
    return datetime.fromisoformat(told["at"]).timestamp()


def _stopped(served: Served) -> float:
    end = time.monotonic() + _WITHIN_S
    while (stopped := served.watch.stopped_s) is None:
        if time.monotonic() > end:
            raise SystemExit("no quick stop came on the bus")
        time.sleep(0.002)
    return stopped


if __name__ == "__main__":
    main()
