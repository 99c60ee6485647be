"""How fast bench and tool run at 1 kHz in one process, by simulated time, and whether a sample gets lost.

    python benchmarks/bus.py                 one minute of bus time with each machine
    python benchmarks/bus.py --seconds 600   ten minutes

The limit that it is held against is real time: 1000 SYNCs per second.
"""

from __future__ import annotations

import argparse
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
