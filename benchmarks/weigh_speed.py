"""How long does weighing take? Sessions of 24 runs × 5000 samples, beside the former explanation.

    python benchmarks/weigh_speed.py [--only friction] [--rate 2000] [--alone] [--profile]

The motions of benchmarks/explain_speed.py, recorded longer; what they conceal has a name or none. Of each session the
processor seconds of `weigh`, of `explain`, and their ratio; a short session before pays for compiling. `--profile` says
where `weigh` spends them.
"""

from __future__ import annotations

import argparse
import cProfile
import pstats
import time
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field

from explain_speed import session

from schwung.drivetrain.machine import Machine
from schwung.explain.explain import explain
from schwung.explain.weighing.values import Weighed
from schwung.explain.weighing.weigh import weigh
from schwung.session.model import Session

SAMPLES, SHORT = 5000, 1200
#: Processor seconds allowed: where one name is the answer, where everything is tried, and in no case more.
LIMIT_S, WIDE_LIMIT_S, WORST_S = 20.0, 40.0, 90.0
#: Functions of the profile that are printed.
SHOWN = 30


@dataclass(frozen=True)
class Concealed:
    """What a session hides, and the processor seconds that it may take."""

    named: str = ""
    foreign: Mapping[str, Mapping[str, float]] = field(default_factory=dict)
    limit_s: float = LIMIT_S


SESSIONS = {
    "nothing": Concealed(),
    "friction": Concealed("coulomb_friction"),
    "two": Concealed("load_inertia,cogging"),
    "play": Concealed("backlash", limit_s=WIDE_LIMIT_S),
    "presliding": Concealed(
        foreign={"dahl_presliding": {"torque_nm": 6.0, "stiffness_nm_rad": 8.0}}, limit_s=WIDE_LIMIT_S
    ),
    "foreign": Concealed(
        foreign={"hysteretic_coupling": {"torque_nm": 20.0, "stiffness_nm_rad": 6e3}}, limit_s=WIDE_LIMIT_S
    ),
}


def spent(what: Callable[[], object]) -> float:
    """Processor seconds."""
    began = time.process_time()
    what()
    return time.process_time() - began


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
    """Record, weigh and explain every session."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--only", choices=tuple(SESSIONS))
    parser.add_argument("--rate", type=float, default=4000.0, help="samples a second")
    parser.add_argument("--samples", type=int, default=SAMPLES, help="of each run")
    parser.add_argument("--alone", action="store_true", help="without the former explanation")
    parser.add_argument("--profile", action="store_true")
    options = parser.parse_args()
    short = session("", samples=SHORT, rate_hz=1000.0)
    weigh(*short)
    if not options.alone:
        explain(*short)
    for name in [options.only] if options.only else SESSIONS:
        hidden = SESSIONS[name]
        recorded, machine = session(
            hidden.named, samples=options.samples, rate_hz=options.rate, foreign=hidden.foreign
        )
        if options.profile:
            profiled(recorded, machine)
            continue
        answers: list[Weighed] = []
        mine = spent(lambda: answers.append(weigh(recorded, machine)))  # noqa: B023  (called at once)
        line = f"{name:11}{mine:6.1f} s of {hidden.limit_s:.0f} s"
        if not options.alone:
            former = spent(lambda: explain(recorded, machine))  # noqa: B023
            line += f", formerly {former:6.1f} s, ratio {mine / former:.2f}"
        print(f"{line}: {told(answers[0])}", flush=True)


if __name__ == "__main__":
    main()
