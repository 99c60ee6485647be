"""How long from STOP to the first frame on the bus that stops, while the machine moves: asked of both listeners.

    python3 benchmarks/service_stop_hung.py --times 50

The service runs as `schwung serve` does, on a loopback TCP bus with a simulated drive in a process of its own. Each
time a commissioning is planned and confirmed, and STOP is posted at a random instant of its motions. A second one on
the bus notes when the controlword of a quick stop appears. Three conditions: quiet; the event loop held up for a
second; two threads that compute in Python without a pause beside it. Beside them the longest time that Python's own
collection of garbage has held the interpreter, which everything waits for; --as-loaded leaves it as Python has it.
"""

from __future__ import annotations

import argparse
import asyncio
import gc
import logging
import random
import tempfile
import threading
import time
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import can
import httpx
import numpy as np
import uvicorn

from schwung.cli.demo_bench import demo_bench
from schwung.fieldbus import cia402
from schwung.service.app import make_app
from schwung.service.guard import Guard, own_token
from schwung.service.service import Service
from schwung.service.stop_listener import StopListener, give_way, listen
from schwung.service.values import ENDED, Settings

_RPDO, _SDO = 0x201, 0x601
_CONTROLWORD_SDO = bytes([0x2B, 0x40, 0x60, 0x00])


class Witness:
    """Notes when a quick stop is seen on the bus, from outside."""

    def __init__(self, options: dict[str, Any]) -> None:
        self.bus = can.Bus(ignore_config=True, **options)
        self.seen_s: float | None = None
        self._armed = threading.Event()
        threading.Thread(target=self._watch, daemon=True).start()

    def arm(self) -> None:
        self.seen_s = None
        self._armed.set()

    def _watch(self) -> None:
        while True:
            frame = self.bus.recv(1.0)
            if frame is None or not self._armed.is_set():
                continue
            data = bytes(frame.data)
            by_pdo = frame.arbitration_id == _RPDO and _is_quick_stop(data[:2])
            by_sdo = (
                frame.arbitration_id == _SDO and data[:4] == _CONTROLWORD_SDO and _is_quick_stop(data[4:6])
            )
            if by_pdo or by_sdo:
                self.seen_s = time.monotonic()
                self._armed.clear()


def _is_quick_stop(word: bytes) -> bool:
    return int.from_bytes(word, "little") & 0x8F == cia402.QUICK_STOP


class Server:
    """The application and STOP's listener, in this process."""

    def __init__(self, folder: Path, settings: Settings) -> None:
        self.service = Service(settings).start()
        listening = listen("127.0.0.1", 0, "port")
        port = listening.getsockname()[1]
        guard = Guard(settings, own_token(folder), port)
        self.stopper = StopListener(self.service, guard, "127.0.0.1", 0)
        app = make_app(self.service, guard)

        @app.get("/hang")
        async def hang() -> None:
            time.sleep(1.0)  # on purpose: what a page must never do

        self.loop_server = uvicorn.Server(uvicorn.Config(app, log_config=None))
        serve = self.loop_server.serve(sockets=[listening])
        threading.Thread(target=lambda: asyncio.run(serve), daemon=True).start()
        self.page_url = f"http://127.0.0.1:{port}"
        self.stop_url = f"http://127.0.0.1:{self.stopper.port}/stop"

    def moving(self) -> str:
        """A commissioning that has begun its motions; returns its id."""
        drive = self.service.store.drives()[0].id
        state = self.service.status(drive).state
        away = state is not None and state.position_rad > 0
        stroke = {
            "distance_rad": -3.0 if away else 3.0,
            "duration_s": 0.25,
            "repeats": 20,
            "misses_allowed": 50,
        }
        plan = self.ended(self.service.submit({"kind": "plan", "drive_id": drive, **stroke}, "benchmark").id)
        assert plan.result is not None, plan.error
        confirmed = {key: plan.result[key] for key in ("proposal_id", "digest")}
        run_id = self.service.submit({"kind": "commission", **confirmed}, "benchmark").id
        while "Motion" not in getattr(self.service.run(run_id).progress, "phase", ""):
            if (
                self.service.run(run_id).state in ENDED
            ):  # a busy computer lets the bench's heartbeats go missing
                print(f"again: {(self.service.run(run_id).error or {}).get('text')}", flush=True)
                return self.moving()
            time.sleep(0.005)
        time.sleep(random.uniform(0.0, 0.5))
        return run_id

    def ended(self, run_id: str) -> Any:
        while (run := self.service.run(run_id)).state not in ENDED:
            time.sleep(0.01)
        return run


@contextmanager
def hung_loop(server: Server) -> Iterator[None]:
    """Within, for a second: the event loop of page and API does not turn."""
    asked = threading.Thread(target=lambda: httpx.get(f"{server.page_url}/hang", timeout=5), daemon=True)
    asked.start()
    time.sleep(0.1)
    yield
    asked.join()


@contextmanager
def busy_threads() -> Iterator[None]:
    """Within: two threads compute in pure Python."""
    ending = threading.Event()

    def compute() -> None:
        while not ending.is_set():
            sum(i * i for i in range(1000))

    threads = [threading.Thread(target=compute, daemon=True) for _ in range(2)]
    for thread in threads:
        thread.start()
    yield
    ending.set()


@contextmanager
def nothing() -> Iterator[None]:
    yield


class Pauses:
    """How long each collection of garbage has held the interpreter (ms)."""

    def __init__(self) -> None:
        self.longest_ms = self._began_s = 0.0
        gc.callbacks.append(self._note)

    def _note(self, phase: str, _info: dict[str, int]) -> None:
        now_s = time.monotonic()
        if phase == "start":
            self._began_s = now_s
        else:
            self.longest_ms = max(self.longest_ms, 1e3 * (now_s - self._began_s))


def measure(times: int, as_loaded: bool) -> None:
    logging.getLogger().addHandler(logging.NullHandler())  # as the command line has it
    folder = Path(tempfile.mkdtemp())
    with demo_bench("two-mass", "") as (entry, seed):
        options = entry.options.resolve()
        options.pop("bitrate", None)
        server = Server(folder, Settings(folder, buses=(entry,), drives=(seed,)))
        witness = Witness(options)
        if not as_loaded:
            give_way()
        pauses = Pauses()
        conditions: dict[str, Any] = {
            "quiet": nothing, "event loop hung": lambda: hung_loop(server), "two busy threads": busy_threads,
        }  # fmt: skip
        print(
            f"{'':20s} {'median':>8s} {'p99':>8s} {'worst':>8s}   ms from request to frame, {times} times each"
        )
        for name, condition in conditions.items():
            taken = []
            for _ in range(times):
                run_id = server.moving()
                with condition(), httpx.Client() as client:
                    witness.arm()
                    asked_s = time.monotonic()
                    client.post(server.stop_url, timeout=5).raise_for_status()
                    while witness.seen_s is None:
                        assert time.monotonic() - asked_s < 5, "no quick stop was seen"
                        time.sleep(0.0005)
                    taken.append(1e3 * (witness.seen_s - asked_s))
                assert server.ended(run_id).state == "cancelled"
                server.service.release("benchmark")
            print(
                f"{name:20s} {np.median(taken):8.1f} {np.percentile(taken, 99):8.1f} {max(taken):8.1f}   "
                f"longest collection {pauses.longest_ms:.1f}",
                flush=True,
            )
        server.loop_server.should_exit = True
        server.stopper.close()
        server.service.close()


if __name__ == "__main__":
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--times", type=int, default=50)
    parser.add_argument("--as-loaded", action="store_true")
    given = parser.parse_args()
    measure(given.times, given.as_loaded)
