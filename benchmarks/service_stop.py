"""From the click on STOP to the quick stop on the bus, while a job moves the machine; prints the percentiles.

A bench, `schwung serve` and Chromium, each a process of its own, on loopback. The browser stamps the pointer going
down; a further listener on the bus stamps the first controlword 0x0002, both by the same clock. The aim is 100 ms at
the 99th percentile. Beside it, in the same run: the stop by one HTTP call without a browser, which is what network,
service and bus take of it.
"""

from __future__ import annotations

import argparse
import sys
import tempfile
import time
import urllib.request
from pathlib import Path

import numpy as np

sys.path.insert(0, str(Path(__file__).parents[1] / "tests/service/browser"))

from page_process import Served, browser_process, serving, visiting

_WITHIN_S = 10.0


def main() -> None:
    """Measure and print."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--clicks", type=int, default=100)
    parser.add_argument("--calls", type=int, default=30)
    asked = parser.parse_args()
    with (
        tempfile.TemporaryDirectory() as folder,
        serving(Path(folder)) as served,
        browser_process() as browser,
    ):
        clicks = [_click(served, browser) for _ in range(asked.clicks)]
        calls = [_call(served) for _ in range(asked.calls)]
    print(f"{'from':34} {'n':>4} {'50 %':>8} {'90 %':>8} {'99 %':>8} {'largest':>8}   ms")
    for name, times in (("click in the page", clicks), ("HTTP call, for comparison", calls)):
        if times:
            shares = np.percentile(1e3 * np.array(times), (50, 90, 99, 100))
            print(
                f"{name + ' to quick stop':34} {len(times):4d} "
                + " ".join(f"{share:8.1f}" for share in shares)
            )


def _click(served: Served, browser: object) -> float:
    """Seconds from the pointer going down to the frame, on a page that shows the live scope of what moves."""
    run = served.begin_motion()
    with visiting(browser, served) as page:
        page.goto(f"{served.url}/commission/{served.drive_id}?run={run['id']}")
        page.locator(".sw-scope canvas").wait_for()
        page.wait_for_timeout(300)  # the scope draws
        served.watch.begin()
        page.click("#stop")
        pressed: float = page.evaluate("window.pressed[0]")
        stopped = _stopped(served)
    served.settle()
    return stopped - pressed


def _call(served: Served) -> float:
    served.begin_motion()
    served.watch.begin()
    began = time.time()
    urllib.request.urlopen(
        urllib.request.Request(f"{served.url}/api/stop", b"", method="POST"), timeout=5
    ).close()
    stopped = _stopped(served)
    served.settle()
    return stopped - began


def _stopped(served: Served) -> float:
    end = time.monotonic() + _WITHIN_S
    while (stopped := served.watch.stopped_s) is None:
        if time.monotonic() > end:
            raise SystemExit("no quick stop came on the bus")
        time.sleep(0.002)
    return stopped


if __name__ == "__main__":
    main()
