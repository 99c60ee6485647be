"""How long a trace of 20 kB takes to be read over SDO, segmented and by block, from a drive that answers after 1 ms.

    python benchmarks/sdo.py                       20 kB, 1 ms, and the ratios, which shall be 3 at the least
    python benchmarks/sdo.py --bytes 115200 --turn-around 0.002

Both transfers go through the same client, bus and bench drive, one after the other; the bytes are compared. Twice: on
a stepped bus of 1 Mbit/s, in simulated time, which is what a real bus would take but for stuffed bits; and on a bus
that has no bit rate, with threads and by the wall's clock, where nothing but answers is waited for. Beside it stands
what the frames and the turn-around take at 1 Mbit/s with worst-case stuffing.
"""

from __future__ import annotations

import argparse
import math

from schwung.fieldbus.canopen import BusOptions, open_bus
from schwung.fieldbus.canopen.block import SEGMENTS
from schwung.fieldbus.canopen.link import Link
from schwung.fieldbus.canopen.sdo import SdoChannel
from schwung.fieldbus.canopen.transfer import SEGMENT_BYTES
from schwung.fieldbus.drive import Parameter
from schwung_sim.bench import Bench

FRAME_S = 135e-6  # 8 bytes at 1 Mbit/s, stuffed as badly as can be
USER_DATA = Parameter(0x2010, 0, "DOMAIN", "User data")
AT_LEAST = 3.0


def on_the_wire(size: int, turn_around_s: float) -> tuple[float, float]:
    """Seconds that the frames and the waiting take: segmented, by block."""
    segments = math.ceil(size / SEGMENT_BYTES)
    blocks = math.ceil(segments / SEGMENTS)
    exchange = 2 * FRAME_S + turn_around_s
    return (segments + 1) * exchange, 2 * exchange + blocks * (FRAME_S + turn_around_s) + segments * FRAME_S


def measure(interface: str, size: int, turn_around_s: float) -> float:
    """Read `size` bytes both ways, print the times by the bus's own clock (s), and return their ratio."""
    content = bytes((7 * i + i // 256) % 251 for i in range(size))
    with Bench(
        "two-mass",
        interface=interface,
        channel="benchmark-sdo",
        node_id=1,
        faults=f"turn-around={turn_around_s}",
    ) as bench:
        bench.servo.dictionary.values[USER_DATA.index << 8] = content
        bus = open_bus(BusOptions(interface, "benchmark-sdo", 1_000_000))
        link = Link(bus)
        sdo = SdoChannel(link, 1, timeout_s=1.0)
        took = {}
        for name, block in (("segmented", False), ("block", True)):
            started = link.clock.now()
            data = sdo.upload(USER_DATA, block=block)
            took[name] = link.clock.now() - started
            if data != content:
                raise SystemExit(f"{name}: {len(data)} bytes came, and not the right ones")
        sdo.close()
        link.close()
        bus.shutdown()
    ratio = took["segmented"] / took["block"]
    by_segments, by_block = on_the_wire(size, turn_around_s)
    print(f"{size} bytes, {turn_around_s * 1e3:g} ms turn-around, {interface} bus")
    print(f"  segmented {took['segmented']:7.3f} s measured, {by_segments:7.3f} s by the frames at 1 Mbit/s")
    print(f"  block     {took['block']:7.3f} s measured, {by_block:7.3f} s by the frames at 1 Mbit/s")
    print(f"  ratio     {ratio:7.1f}            {by_segments / by_block:9.1f}")
    return ratio


if __name__ == "__main__":
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--bytes", type=int, default=20_000)
    parser.add_argument("--turn-around", type=float, default=1e-3, help="seconds")
    given = parser.parse_args()
    if min(measure(on, given.bytes, given.turn_around) for on in ("stepped", "virtual")) < AT_LEAST:
        raise SystemExit(f"a ratio is below {AT_LEAST:g}")
