"""How long does an explanation take? Sessions of 24 runs × 5000 samples, against what is allowed.

    python benchmarks/explain_speed.py [--only friction] [--profile]

What has a plain answer is recorded on benchmarks/strangers.py's machine (six motion times, every second of 8000 ticks a
second), the rest with the motions and long rests of benchmarks/long_session.py. Of each session the processor seconds
of `weigh`, and the most memory until then; a short session before pays for compiling. `--profile` says where it spends
the seconds.
"""

from __future__ import annotations

import argparse
import cProfile
import pstats
import resource
import time
from collections.abc import Callable, Mapping

from long_session import session
from strangers import STRANGERS, Stranger, belief_of, session_of

from schwung.drivetrain.machine import Machine
from schwung.explain.weighing.values import Weighed
from schwung.explain.weighing.weigh import weigh
from schwung.session.model import Session

SAMPLES, SHORT = 5000, 1200
#: Processor seconds allowed: where one name is the answer, where everything is tried, and in no case more.
LIMIT_S, WIDE_LIMIT_S, WORST_S = 20.0, 40.0, 90.0
#: Functions of the profile that are printed.
SHOWN = 30


#: Motion times (s) of strangers' sessions: with rests 4440 to 5720 samples, 5000 in the middle.
TIMES_S = (0.37, 0.4, 0.43, 0.46, 0.49, 0.53)


def stranger(hidden: Stranger) -> tuple[Session, Machine]:
    """On the machine that shares no formula with the tool."""
    return session_of(hidden, 0, times=TIMES_S), belief_of(hidden)


def rested(conceal: str, **foreign: Mapping[str, float]) -> tuple[Session, Machine]:
    """On the virtual machine room's, with long rests; `foreign` has no name."""
    return session(conceal, samples=SAMPLES, foreign=foreign)


#: What each session hides, and the processor seconds that it may take.
SESSIONS: Mapping[str, tuple[Callable[[], tuple[Session, Machine]], float]] = {
    "nothing": (lambda: stranger(STRANGERS[0]), LIMIT_S),
    "friction": (
        lambda: stranger(Stranger("dry friction", ("coulomb_friction",), (0.8, 0.0, 0.0, 0.0))),
        LIMIT_S,
    ),
    "inertia": (lambda: stranger(STRANGERS[6]), LIMIT_S),
    "two": (lambda: rested("load_inertia,cogging"), WIDE_LIMIT_S),
    "play": (lambda: rested("backlash"), WIDE_LIMIT_S),
    "presliding": (
        lambda: rested("", dahl_presliding={"torque_nm": 6.0, "stiffness_nm_rad": 8.0}),
        WIDE_LIMIT_S,
    ),
    "foreign": (
        lambda: rested("", hysteretic_coupling={"torque_nm": 20.0, "stiffness_nm_rad": 6e3}),
        WIDE_LIMIT_S,
    ),
}


def told(found: Weighed) -> str:
    """Names and curves that are likely, and what was noted."""
    names = [f"{one.name} {one.probability:.2f}" for one in found.names if one.probability >= 0.05]
    curves = [f"[{one.coordinate}] {one.probability:.2f}" for one in found.unnamed if one.probability >= 0.05]
    return ", ".join([*names, *curves, *found.notes]) or "(nothing)"


def profiled(recorded: Session, machine: Machine) -> None:
    """Print what takes most of the time by itself, and with all that it calls."""
    profile = cProfile.Profile(time.process_time)
    profile.runcall(weigh, recorded, machine)
    for order in ("tottime", "cumulative"):
        pstats.Stats(profile).sort_stats(order).print_stats(SHOWN)


def main() -> None:
    """Record and weigh every session."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--only", choices=tuple(SESSIONS))
    parser.add_argument("--profile", action="store_true")
    options = parser.parse_args()
    short = session("", samples=SHORT, rate_hz=1000.0)
    weigh(*short)
    for name in [options.only] if options.only else SESSIONS:
        recording, limit = SESSIONS[name]
        recorded, machine = recording()
        if options.profile:
            profiled(recorded, machine)
            continue
        began = time.process_time()
        found = weigh(recorded, machine)
        took, most = time.process_time() - began, resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 2**20
        print(f"{name:11}{took:6.1f} s of {limit:.0f} s, {most:.1f} GiB: {told(found)}", flush=True)


if __name__ == "__main__":
    main()
