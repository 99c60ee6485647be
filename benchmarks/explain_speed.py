"""How long does an explanation take? A session of 24 runs × 4000 samples with two concealed effects, against 60 s.

    python benchmarks/explain_speed.py [CONCEAL]

The session is benchmarks/long_session.py's, whose machine conceals a load inertia and a cogging, or what CONCEAL
says. Wall
and processor time are printed per stage; the first of two goes pays for compiled code that is not on the disk yet.
"""

from __future__ import annotations

import sys
import time as clock

from long_session import RATE_HZ, session

from schwung.explain.explain import explain

LIMIT_S = 60.0
CONCEALED = "load_inertia,cogging"


class Stages:
    """Wall and processor time since the last stage was announced."""

    def __init__(self) -> None:
        self.first = self.last = (clock.perf_counter(), clock.process_time())
        self.name = ""

    def tell(self, text: str, share: float) -> None:
        """As `explain` calls its progress."""
        now = (clock.perf_counter(), clock.process_time())
        if self.name and (text != self.name or share >= 1):
            print(
                f"  {self.name[:32]:32s} {now[0] - self.last[0]:6.1f} s {now[1] - self.last[1]:6.1f} s of processor"
            )
        if text != self.name:
            self.name, self.last = text, now


def main() -> None:
    """Record, explain twice, and compare with the limit."""
    recorded, machine = session(sys.argv[1] if len(sys.argv) > 1 else CONCEALED)
    print(f"{len(recorded.runs)} runs × {len(recorded.runs[0])} samples at {RATE_HZ:g} Hz")
    for which in ("first", "second"):
        stages = Stages()
        result = explain(recorded, machine, progress=stages.tell)
        wall, processor = clock.perf_counter() - stages.first[0], clock.process_time() - stages.first[1]
        print(
            f"{which} go: {wall:.1f} s, {processor:.1f} s of processor (limit {LIMIT_S:g} s): {result.verdict}"
        )
        for finding in result.findings:
            print(f"    {finding.physics}: {finding.text}")


if __name__ == "__main__":
    main()
