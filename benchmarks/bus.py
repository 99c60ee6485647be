"""How fast a SYNC-clocked bench runs at 1 kHz in one process, and whether a sample gets lost.

    python benchmarks/bus.py                 one minute of bus time with the two-mass machine
    python benchmarks/bus.py --seconds 600   ten minutes

The limit that it is held against is real time: 1000 SYNCs per second. Tool and drive are two threads that take turns,
so one core serves them better than two: it is measured both ways where the system can pin a process.
"""

from __future__ import annotations

import argparse
import os
import time

import numpy as np

from schwung.fieldbus.canopen import BusOptions, CanopenDrive, open_bus
from schwung.fieldbus.drive import Acquisition, Setpoints
from schwung.fieldbus.profile import load_profile
from schwung_sim.bench import Bench

RATE_HZ = 1000.0
CHUNK_S = 10.0


def measure(plant: str, seconds: float) -> None:
    """Play a slow sine for so much bus time and print ratio and losses."""
    profile = load_profile("schwung-bench")
    acquisition = Acquisition("csp", RATE_HZ)
    with Bench(plant, channel=f"benchmark-{plant}", node_id=1):
        bus = open_bus(BusOptions("stepped", f"benchmark-{plant}", 1_000_000))
        drive = CanopenDrive(bus, 1, profile, bit_rate=1_000_000)
        before = drive.setup(acquisition)
        drive.write(before)
        drive.start(acquisition)
        drive.enable()
        ratios, samples, lost = [], 0, 0
        for _ in range(max(1, round(seconds / CHUNK_S))):
            instants = np.arange(int(CHUNK_S * RATE_HZ)) / RATE_HZ
            position = 0.5 * (1 - np.cos(2 * np.pi * instants / CHUNK_S))
            started = time.perf_counter()
            recording = drive.play(Setpoints(RATE_HZ, position, np.zeros_like(position)))
            ratios.append(CHUNK_S / (time.perf_counter() - started))
            samples += recording.position_rad.size
            lost += recording.lost.size
        drive.disable()
        drive.stop()
        drive.close()
        bus.shutdown()
    print(
        f"{plant:13s} {samples / RATE_HZ:6.0f} s of bus time: {np.median(ratios):.1f} times real time "
        f"(slowest 10 s: {min(ratios):.1f}), {samples} samples, {lost} lost"
    )


if __name__ == "__main__":
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--seconds", type=float, default=60.0, help="bus time")
    parser.add_argument("--plant", nargs="*", default=["two-mass", "slider-crank"])
    given = parser.parse_args()
    for name in given.plant:
        measure(name, given.seconds)
    if hasattr(os, "sched_setaffinity"):
        os.sched_setaffinity(0, {max(os.sched_getaffinity(0))})
        print("on one core:")
        for name in given.plant:
            measure(name, given.seconds)
