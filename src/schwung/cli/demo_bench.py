"""The bench that `schwung serve --demo` brings along: a process of its own on a loopback bus, which ends with us."""

from __future__ import annotations

import multiprocessing
import os
import signal
import threading
from collections.abc import Iterator
from contextlib import contextmanager
from multiprocessing.connection import Connection
from typing import Any

from schwung.api.drives import BusOptions
from schwung.cli.demo import BELIEF
from schwung.errors import BusError
from schwung.service.values import BusEntry, DriveSeed

_STARTED_WITHIN_S = 120.0  # the first time its loops are compiled


@contextmanager
def demo_bench(plant: str, conceal: str) -> Iterator[tuple[BusEntry, DriveSeed]]:
    """Within: a simulated drive is on the bus. Raises BusError where it does not start, with its reason."""
    context = multiprocessing.get_context("spawn")
    ours, theirs = context.Pipe()
    process = context.Process(
        target=_be_bench, args=(theirs, plant, conceal), name="schwung demo bench", daemon=True
    )
    process.start()
    theirs.close()
    try:
        try:
            told: Any = ours.recv() if ours.poll(_STARTED_WITHIN_S) else "it does not start"
        except EOFError:
            told = "it ended at once"
        if isinstance(told, str):
            raise BusError("demo bench", told)
        extra = {"host": told["host"], "port": told["port"]}
        options = BusOptions(told["interface"], told["channel"], 1_000_000, extra)
        yield (
            BusEntry("demo", options),
            DriveSeed("Demo axis", "demo", 1, "schwung-bench", BELIEF, "Slider-crank"),
        )
    finally:
        process.terminate()
        process.join(5.0)


def _be_bench(pipe: Connection, plant: str, conceal: str) -> None:
    signal.signal(
        signal.SIGINT, signal.SIG_IGN
    )  # Ctrl-C is for the service: the drive is there until it has stopped it
    threading.Thread(target=_end_with_parent, daemon=True).start()
    from schwung_sim.bench import Bench
    from schwung_sim.errors import BenchError

    try:
        with Bench(plant, conceal=conceal, tcp=("127.0.0.1", 0), node_id=1) as bench:
            pipe.send(bench.tool_options)
            threading.Event().wait()
    except BenchError as error:
        pipe.send(str(error))


def _end_with_parent() -> None:
    parent = multiprocessing.parent_process()
    if parent is not None:
        parent.join()
        os._exit(0)
