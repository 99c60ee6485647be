"""The driver on a bench drive that is set up, started and enabled: what tests of the driver begin with."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from itertools import count
from typing import Any

import can
import numpy as np

from schwung.fieldbus.canopen import CanopenDrive
from schwung.fieldbus.drive import Acquisition, Setpoints
from schwung.fieldbus.profile import load_profile
from schwung_sim.bench import Bench
from schwung_sim.faults import FaultyBus

NODE = 5
_channels = count()


@contextmanager
def bench_and_bus(
    *,
    own_messages: bool = False,
    tool_faults: dict[str, Any] | None = None,
    interface: str = "stepped",
    **bench_options: Any,
) -> Iterator[tuple[Bench, can.BusABC]]:
    """A running bench and a second end of its bus; `tool_faults` make our own adapter a faulty one."""
    channel = f"driver-{next(_channels)}"
    with Bench("two-mass", interface=interface, channel=channel, node_id=NODE, **bench_options) as bench:
        bus: can.BusABC = can.Bus(interface=interface, channel=channel, receive_own_messages=own_messages)
        if tool_faults:
            bus = FaultyBus(bus, **tool_faults)
        try:
            yield bench, bus
        finally:
            bus.shutdown()


@contextmanager
def connected(
    family: str = "schwung-bench", sync: Any = "auto", **options: Any
) -> Iterator[tuple[Bench, CanopenDrive]]:
    """Bench and driver, nothing written yet."""
    with bench_and_bus(**options) as (bench, bus):
        drive = CanopenDrive(bus, NODE, load_profile(family), bit_rate=1_000_000, sync=sync)
        try:
            yield bench, drive
        finally:
            drive.close()


@contextmanager
def enabled(
    rate_hz: float = 1000.0, mode: Any = "csp", **options: Any
) -> Iterator[tuple[Bench, CanopenDrive]]:
    """Bench and driver, in Operation enabled."""
    with connected(**options) as (bench, drive):
        acquisition = Acquisition(mode, rate_hz)
        drive.write(drive.setup(acquisition))
        drive.start(acquisition)
        drive.enable()
        yield bench, drive


def stroke(
    count: int, rate_hz: float = 1000.0, distance_rad: float = 0.5, begin_rad: float = 0.0
) -> Setpoints:
    """A cosine there within half of the time and back, no injection."""
    phase = 2 * np.pi * np.arange(count) / (count - 1)
    return Setpoints(rate_hz, begin_rad + distance_rad * (1 - np.cos(phase)) / 2, np.zeros(count))
