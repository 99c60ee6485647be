"""How often `schwung explain` is right, and whether its probabilities hold: sealed sessions, or strangers' machines.

    python benchmarks/explain_rates.py --kind single --cases 24 --first 0
    python benchmarks/explain_rates.py --strangers
    python benchmarks/explain_rates.py --kind two --first 100 --cases 24 --tally sessions.jsonl
    python benchmarks/explain_rates.py --kind three --first 640000 --cases 6 --share 0.25
    python benchmarks/explain_rates.py --read sessions.jsonl --picture docs/reliability.png

Sealed sessions are drawn as benchmarks/explain.py draws them, and explained as `schwung explain` does. Of each: the
first name and whether it is right, wrong names with more than one half, whether the first coordinate that the mismatch
follows is right, how many intervals of 95 % hold their number (benchmarks/explain_truth.py), how many sessions have
80 % of the excess on held-out motion taken, with a name or without, and seconds of processor time. Where the vocabulary
has a word for a foreign effect, that word is right. `--tally` adds a line for each answer to a file; `--read` prints
rates and the calibration of the probabilities, with intervals (benchmarks/explain_tally.py), `--picture` draws them
(benchmarks/reliability.py). `--share` gives a session that share of the work that it may cost: what is
told of a search that ends before all was tried has to be true as well.
"""

from __future__ import annotations

import argparse
import tempfile
import time
import traceback
from collections.abc import Mapping
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

from explain_score import score_document
from explain_tally import Told, printed, read_tally, write_tally
from explain_truth import WORDS
from reliability import write_reliability
from strangers import STRANGERS, belief_of, judged, session_of

from schwung.drivetrain import load_machine
from schwung.drivetrain.machine import Machine
from schwung.explain.publishing.publish import publish
from schwung.explain.weighing.work import MOST, Work
from schwung.session import read_session
from schwung.session.model import Session
from schwung_sim.sealed import CaseWishes, draw_case, read_labels, write_case

KINDS = ("single", "weak", "gross", "two", "three", "none", "foreign")


@dataclass(frozen=True)
class Answer:
    """Names and curves with probabilities, what else was said, and how long it took."""

    names: dict[str, float]
    curves: dict[str, float]
    said: str
    seconds: float
    taken: float = 0.0  # share of the excess on held-out motion
    document: Mapping[str, Any] | None = None  # explanation.json; None: it failed


def answered(session: Session, machine: Machine, share: float) -> Answer:
    """By so much of the usual work, whatever goes wrong."""
    began = time.process_time()
    try:
        found = publish(session, machine, work=Work(share * MOST))
    except Exception as error:  # the benchmark counts whatever goes wrong, says where, and goes on
        traceback.print_exc()
        return Answer({"failed": 1.0}, {}, f"failed: {error!r}"[:120], time.process_time() - began)
    proof = f"held out {found.proof.before:.2f} to {found.proof.after:.2f} σ" if found.proof else "no proof"
    return Answer(
        {one.physics: one.probability for one in found.names},
        {one.coordinate: one.probability for one in reversed(found.curves)},
        f"excess {found.excess:.1f}, {proof}",
        time.process_time() - began,
        found.proof.taken if found.proof else 0.0,
        found.to_json(),
    )


def line(answer: Answer) -> str:
    """One answer in words."""
    names = ", ".join(f"{name} {p:.2f}" for name, p in answer.names.items() if p >= 0.05) or "(nothing)"
    curves = ", ".join(f"{name} {p:.2f}" for name, p in answer.curves.items() if p >= 0.05)
    return f"{names}{f'; unnamed: {curves}' if curves else ''} [{answer.said}, {answer.seconds:.0f} s]"


def sealed(options: argparse.Namespace) -> None:
    """Sealed sessions of a kind."""
    level = options.kind if options.kind in ("weak", "gross") else "clear"
    kind = "single" if options.kind in ("weak", "gross") else options.kind
    every = []
    for seed in range(options.first, options.first + options.cases):
        case = draw_case(seed, CaseWishes(kind, level, tuple(filter(None, options.effects.split(",")))))
        with tempfile.TemporaryDirectory() as folder:
            write_case(case, Path(folder), "0000")
            place = Path(folder) / "sessions" / "0000"
            session, machine = read_session(place / "session.h5"), load_machine(place / "machine.toml")
            (label,) = read_labels(Path(folder))
        truth = tuple(sorted({WORDS.get(effect.physics, effect.physics) for effect in case.effects}))
        print(f"{seed} {kind} {', '.join(truth) or 'nothing'}", flush=True)
        answer = answered(session, machine, options.share)
        told = Told(options.kind, seed, truth, answer.names, answer.taken, answer.seconds, answer.said)
        if answer.document is not None:
            score = score_document(label, answer.document, answer.seconds)
            held = [one for *_, one in score.parameters if one is not None]
            told = replace(told, placed=score.coordinate_right, held=(sum(held), len(held)))
        if options.tally:
            write_tally(options.tally, told)
        print(f"    {'right' if told.right else 'WRONG'} {line(answer)}", flush=True)
        every.append(told)
    print(printed(every))


def strangers(options: argparse.Namespace) -> None:
    """Machines with other laws, filters and noise."""
    words = []
    for number, stranger in enumerate(STRANGERS):
        if options.effects and options.effects not in stranger.name:
            continue
        session, machine = session_of(stranger, seed=options.first + number), belief_of(stranger)
        print(stranger.name, flush=True)
        answer = answered(session, machine, options.share)
        failed = answer.said.startswith("failed")
        words.append("failed" if failed else judged(stranger, answer.names, answer.curves))
        print(f"    {words[-1]} {line(answer)}", flush=True)
    print(", ".join(f"{words.count(word)} {word}" for word in sorted(set(words))))


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
    parser.add_argument("--share", type=float, default=1.0, help="of the work that a session may cost")
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
