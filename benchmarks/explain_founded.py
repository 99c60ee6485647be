"""The former explanation and the one by evidence, side by side, on sealed sessions or on strangers' machines.

    python benchmarks/explain_founded.py --kind single --cases 24 --first 0
    python benchmarks/explain_founded.py --strangers
    python benchmarks/explain_founded.py --kind two --first 100 --cases 24 --only weighed --tally sessions.jsonl
    python benchmarks/explain_founded.py --read sessions.jsonl --picture docs/reliability.png

Sealed sessions are drawn as benchmarks/explain.py draws them. Of each: the first name and whether it is right, wrong
names (the former tells all it names; the other those with more than one half), how many sessions have 80 % of the
excess on held-out motion taken, with a name or without, and seconds of processor time. A foreign effect has no name in
the former's vocabulary; where the new one's has a word for it, that word is right. `--tally` adds a line for each
answer to a file; `--read` prints both ways' rates and the calibration of the new one's probabilities, with intervals
(benchmarks/explain_tally.py), `--picture` draws them (benchmarks/reliability.py).
"""

from __future__ import annotations

import argparse
import tempfile
import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path

from explain_tally import Told, printed, read_tally, write_tally
from explain_truth import WORDS
from reliability import write_reliability
from strangers import STRANGERS, belief_of, judged, session_of

from schwung.drivetrain import load_machine
from schwung.drivetrain.machine import Machine
from schwung.explain.explain import explain
from schwung.explain.weighing.values import Proof
from schwung.explain.weighing.weigh import weigh
from schwung.session import read_session
from schwung.session.model import Session
from schwung_sim.sealed import CaseWishes, draw_case, write_case

KINDS = ("single", "weak", "gross", "two", "three", "none", "foreign")
LIKELY, MOST_OF_IT = 0.5, 0.8


@dataclass(frozen=True)
class Answer:
    """Names with probabilities (the former's are 1), curves, what else was said, and how long it took."""

    names: dict[str, float]
    curves: dict[str, float]
    said: str
    seconds: float
    taken: float = 0.0  # share of the excess on held-out motion

    @property
    def likely(self) -> list[str]:
        """Names with more than one half, the first first."""
        return [name for name, p in self.names.items() if p > LIKELY]


def former(session: Session, machine: Machine) -> Answer:
    """By `explain`."""
    began = time.process_time()
    found = explain(session, machine)
    names = dict.fromkeys((finding.physics for finding in found.findings), 1.0)
    seconds, floor = time.process_time() - began, found.noise_floor.torque_nm
    missed = (each.torque_rmse_nm / floor for each in (found.fit.before, found.fit.after))
    proof = Proof(found.fit.heldout_runs, 0.0, *missed)
    return Answer(names, {}, found.verdict, seconds, proof.taken)


def founded(session: Session, machine: Machine) -> Answer:
    """By `weigh`."""
    began = time.process_time()
    found = weigh(session, machine)
    proof = f"held out {found.proof.before:.2f} to {found.proof.after:.2f} σ" if found.proof else "no proof"
    return Answer(
        {one.name: one.probability for one in found.names},
        {one.coordinate: one.probability for one in reversed(found.unnamed)},
        f"excess {found.excess:.1f}, {proof}",
        time.process_time() - began,
        found.proof.taken if found.proof else 0.0,
    )


def asked(way: Callable[[Session, Machine], Answer], session: Session, machine: Machine) -> Answer:
    """An answer, whatever goes wrong."""
    try:
        return way(session, machine)
    except Exception as error:  # the benchmark counts whatever goes wrong and goes on
        return Answer({}, {}, f"failed: {error!r}"[:120], 0.0)


def line(answer: Answer) -> str:
    """One answer in words."""
    names = ", ".join(f"{name} {p:.2f}" for name, p in answer.names.items() if p >= 0.05) or "(nothing)"
    curves = ", ".join(f"{name} {p:.2f}" for name, p in answer.curves.items() if p >= 0.05)
    return f"{names}{f'; unnamed: {curves}' if curves else ''} [{answer.said}, {answer.seconds:.0f} s]"


def sealed(options: argparse.Namespace) -> None:
    """Sealed sessions of a kind."""
    level = options.kind if options.kind in ("weak", "gross") else "clear"
    kind = "single" if options.kind in ("weak", "gross") else options.kind
    ways = {"former": former, "weighed": founded}
    if options.only:
        ways = {options.only: ways[options.only]}
    right, all_named, wrong, seconds, taken = ({name: [] for name in ways} for _ in range(5))  # type: ignore[var-annotated]
    for seed in range(options.first, options.first + options.cases):
        case = draw_case(seed, CaseWishes(kind, level, tuple(filter(None, options.effects.split(",")))))
        with tempfile.TemporaryDirectory() as folder:
            write_case(case, Path(folder), "0000")
            place = Path(folder) / "sessions" / "0000"
            session, machine = read_session(place / "session.h5"), load_machine(place / "machine.toml")
        truth = {WORDS.get(effect.physics, effect.physics) for effect in case.effects}
        named = truth if kind != "foreign" else set()
        print(f"{seed} {kind} {', '.join(sorted(truth)) or 'nothing'}", flush=True)
        for name, way in ways.items():
            answer = asked(way, session, machine)
            first = answer.likely[0] if answer.likely else ""
            stray = set(answer.likely) - truth
            right[name].append(first in named if named else not stray)
            all_named[name].append(named <= set(answer.likely))
            wrong[name].append(bool(stray))
            taken[name].append(answer.taken >= MOST_OF_IT)
            seconds[name].append(answer.seconds)
            if options.tally:
                hidden = tuple(sorted(truth))
                each = (answer.names, answer.taken, answer.seconds, answer.said, name)
                write_tally(options.tally, Told(options.kind, seed, hidden, *each))
            print(f"    {name:8}{'right' if right[name][-1] else 'WRONG'} {line(answer)}", flush=True)
    for name in ways:
        count = len(right[name])
        print(
            f"{name:8} right name first (or rightly none) {sum(right[name])}/{count}, all named "
            f"{sum(all_named[name])}/{count}, a wrong name with p > {LIKELY} {sum(wrong[name])}/{count}, "
            f"{MOST_OF_IT:.0%} of the excess taken {sum(taken[name])}/{count}, "
            f"{_median(seconds[name]):.0f} s of processor time, worst {max(seconds[name]):.0f} s"
        )


def _median(values: Sequence[float]) -> float:
    return sorted(values)[len(values) // 2]


def strangers(options: argparse.Namespace) -> None:
    """Machines with other laws, filters and noise."""
    ways = {"former": former, "weighed": founded}
    if options.only:
        ways = {options.only: ways[options.only]}
    score: dict[str, list[str]] = {name: [] for name in ways}
    for number, stranger in enumerate(STRANGERS):
        if options.effects and options.effects not in stranger.name:
            continue
        session, machine = session_of(stranger, seed=options.first + number), belief_of(stranger)
        print(stranger.name, flush=True)
        for name, way in ways.items():
            answer = asked(way, session, machine)
            score[name].append(
                "failed"
                if answer.said.startswith("failed")
                else judged(stranger, answer.names, answer.curves)
            )
            print(f"    {name:8}{score[name][-1]} {line(answer)}", flush=True)
    for name, words in score.items():
        print(name, ", ".join(f"{words.count(word)} {word}" for word in sorted(set(words))))


def main() -> None:
    """Command line."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--kind", choices=KINDS, default="single")
    parser.add_argument("--cases", type=int, default=24)
    parser.add_argument("--first", type=int, default=0, help="seed of the first case")
    parser.add_argument(
        "--effects",
        default="",
        help="names to hide, separated by commas (a stranger's: part of it); default: all",
    )
    parser.add_argument("--strangers", action="store_true", help="other laws, filters and noise instead")
    parser.add_argument("--only", choices=("former", "weighed"), help="one of the two")
    parser.add_argument("--tally", type=Path, help="file to which every answer is added")
    parser.add_argument("--read", type=Path, help="print such a file instead")
    parser.add_argument("--picture", type=Path, help="with --read: its reliability diagram, a PNG")
    options = parser.parse_args()
    if options.picture and not options.read:
        parser.error("--picture draws a tally: give it with --read")
    if options.read:
        read = read_tally(options.read)
        print(printed(read))
        if options.picture:
            write_reliability(read, options.picture)
        return
    (strangers if options.strangers else sealed)(options)


if __name__ == "__main__":
    main()
