"""Curves and formulas of what has no name, beside PySINDy with its whole library: share of the excess taken.

    python benchmarks/explain_formula.py --cases 12 --first 0
    python benchmarks/explain_formula.py --strangers

Sealed sessions of foreign effects, or strangers' machines. Both get the same session, belief and runs; both are judged
by the same likelihood on the same runs kept aside: what is missed there beyond noise (variance) and is no longer. The
peer regresses the torque that the belief misses on the fitted runs. Its library: polynomials of third degree of angle,
speed, acceleration, torque, time in the motion and share of the session, six harmonics of the angle, root, sign and
fall of each of them, and all of that by the direction of motion; STLSQ's threshold is the one that predicts every
third fitted run best from the others. Needs the extra `peers`; nothing in src imports PySINDy.
"""

from __future__ import annotations

import argparse
import tempfile
import time
import warnings
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray
from strangers import STRANGERS, belief_of, session_of

from schwung.drivetrain import load_machine
from schwung.drivetrain.machine import Machine
from schwung.explain.causes.along import Along
from schwung.explain.causes.known import Known
from schwung.explain.publishing.judged import Judged, judged, judged_by
from schwung.explain.publishing.publish import published_of
from schwung.explain.publishing.values import Proof
from schwung.explain.weighing.weigh import Posterior, posterior_of
from schwung.innovations.effect import Effect
from schwung.session import read_session
from schwung.session.model import Session
from schwung_sim.sealed import CaseWishes, draw_case, write_case

Array = NDArray[np.float64]

#: Shares of the torque that is missed (root mean square) below which a term is dropped.
THRESHOLDS = (0.003, 0.01, 0.03, 0.1, 0.3)
_RIDGE, _EVERY = 1e-3, 3


@dataclass(frozen=True)
class Taken:
    """Of one answer: the share taken of what is beyond noise, its formula, and seconds of processor time."""

    share: float
    missed: float
    text: str
    seconds: float


def coordinates(along: Along) -> Array:
    """What the peer may use of a run, each about −1…1, (n, 6)."""
    of = along.ranges
    middle = (of.low_rad + of.high_rad) / 2
    return np.stack(
        [
            2 * (along.angle - middle) / of.span_rad,
            along.speed / of.peak_speed_rad_s,
            along.acceleration / of.peak_acceleration_rad_s2,
            along.torque / of.peak_torque_nm,
            2 * along.motion_time_s / of.longest_s - 1,
            np.full_like(along.speed, 2 * along.share - 1),
        ],
        1,
    )


NAMES = ("θ", "ω", "α", "T", "t", "r")


class Library:
    """PySINDy's libraries, all of them, and their products with the direction of motion."""

    def __init__(self, sample: Array) -> None:
        import pysindy

        root, fall = (lambda x: np.sqrt(np.abs(x))), (lambda x: np.exp(-5 * np.abs(x)))
        custom = pysindy.CustomLibrary(
            library_functions=[lambda x: np.sqrt(x * x), root, fall, lambda x: x * np.abs(x)],
            function_names=[lambda x: f"|{x}|", lambda x: f"√|{x}|", lambda x: f"e^-5|{x}|",
                            lambda x: f"{x}|{x}|"],
        )  # fmt: skip
        smooth = pysindy.PolynomialLibrary(degree=3) + custom
        self.parts = [smooth.fit(sample), pysindy.FourierLibrary(n_frequencies=6).fit(sample[:, :1])]
        names = self.parts[0].get_feature_names(list(NAMES)) + self.parts[1].get_feature_names(["θ"])
        self.names = [*names, *(f"sign ω·{name}" for name in names)]

    def columns(self, along: Along) -> Array:
        """Of a run, (n, p)."""
        x = coordinates(along)
        each = np.concatenate(
            [np.asarray(self.parts[0].transform(x)), np.asarray(self.parts[1].transform(x[:, :1]))], 1
        )
        return np.concatenate([each, each * along.direction[:, None]], 1)


@dataclass(frozen=True, eq=False)
class WithPeer(Known):
    """The belief with the peer's torque on the motor."""

    torque: Any = None  # of a run, (n,)

    def effect(self, along: Along) -> Effect:
        """What is known, and what the peer says."""
        known = super().effect(along)
        motor = known.on_motor if known.on_motor is not None else 0.0
        return replace(known, on_motor=motor + self.torque(along)[:, None])


def peer(outcome: Posterior, machine: Machine, before: Judged) -> Taken:
    """PySINDy's model of what the belief misses."""
    import pysindy

    began = time.process_time()
    missed = judged(outcome, machine, outcome.growth.rests.train)
    alongs = {one.run: outcome.grown.nothing.about.alongs[one.run] for one in missed.runs}
    library = Library(np.concatenate([coordinates(along) for along in alongs.values()]))
    columns = {run: library.columns(along) for run, along in alongs.items()}
    targets = {one.run: one.missed_nm for one in missed.runs}
    runs = list(columns)
    size = float(np.sqrt(np.mean(np.concatenate(list(targets.values())) ** 2)))
    scale = np.sqrt(np.mean(np.concatenate(list(columns.values())) ** 2, axis=0)) + 1e-12

    def fitted(threshold: float, some: list[int]) -> Array:
        matrix = np.concatenate([columns[run] for run in some]) / scale
        target = np.concatenate([targets[run] for run in some])
        optimizer = pysindy.STLSQ(threshold=threshold * size, alpha=_RIDGE * target.size, max_iter=50)
        optimizer.fit(matrix, target[:, None])
        return np.asarray(optimizer.coef_).reshape(-1) / scale

    def left(threshold: float) -> float:
        weights = fitted(threshold, [run for i, run in enumerate(runs) if i % _EVERY])
        aside = [targets[run] - columns[run] @ weights for run in runs[::_EVERY]]
        return float(np.mean(np.concatenate(aside) ** 2))

    weights = fitted(min(THRESHOLDS, key=left), runs)
    bare = outcome.view.known
    fields = {name: getattr(bare, name) for name in ("machine", "effects", "table", "curves", "planes")}
    told = WithPeer(**fields, torque=lambda along: library.columns(along) @ weights)
    after = judged_by(outcome, told, outcome.heldout)
    kept = np.argsort(-np.abs(weights * scale))[: np.count_nonzero(weights)]
    text = " ".join(f"{weights[i]:+.3g}·{library.names[i]}" for i in kept[:4])
    more = f" … {kept.size - 4} more" if kept.size > 4 else ""
    text = text or "nothing"
    share = Proof(outcome.heldout, 0.0, before.missed, after.missed).taken
    return Taken(share, after.missed, text + more, time.process_time() - began)


def ours(session: Session, machine: Machine, outcome: Posterior, began: float) -> Taken:
    """What is published: names, curves, formulas."""
    found = published_of(session, machine, outcome)
    assert found.proof is not None
    names = [f"{one.physics} {one.probability:.2f}" for one in found.names if one.in_file]
    curves = [one.formula or f"a curve over {one.over}" for one in found.curves if one.in_file]
    text = "; ".join([*names, *curves]) or "nothing"
    return Taken(max(found.proof.taken, 0.0), found.proof.after, text, time.process_time() - began)


def compared(name: str, session: Session, machine: Machine) -> tuple[float, float] | None:
    """Both on one session; None where the belief misses nothing."""
    began = time.process_time()
    outcome = posterior_of(session, machine)
    before = judged(outcome, machine, outcome.heldout)
    mine = ours(session, machine, outcome, began)
    theirs = peer(outcome, machine, before)
    print(f"| {name} | {before.missed:.3g} | {mine.share:.0%} | {theirs.share:.0%} | {mine.seconds:.0f} | "
          f"{theirs.seconds:.0f} | {mine.text} | {theirs.text} |", flush=True)  # fmt: skip
    return (mine.share, theirs.share) if before.missed > 1.02 else None


def main() -> None:
    """Command line."""
    warnings.simplefilter("ignore")
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--cases", type=int, default=12)
    parser.add_argument("--first", type=int, default=0, help="seed of the first case")
    parser.add_argument("--strangers", action="store_true", help="other laws, filters and noise instead")
    options = parser.parse_args()
    print("| hidden | missed, σ | ours takes | peer takes | ours, s | peer, s | ours says | peer says |")
    print("|---|---|---|---|---|---|---|---|")
    shares = []
    if options.strangers:
        for stranger in STRANGERS:
            session = session_of(stranger, options.first, every=8, times=(0.25, 0.4))
            shares.append(compared(stranger.name, session, belief_of(stranger)))
    for seed in () if options.strangers else range(options.first, options.first + options.cases):
        case = draw_case(seed, CaseWishes("foreign", "clear"))
        with tempfile.TemporaryDirectory() as folder:
            write_case(case, Path(folder), "0000")
            place = Path(folder) / "sessions" / "0000"
            session, machine = read_session(place / "session.h5"), load_machine(place / "machine.toml")
        shares.append(compared(f"{seed} {', '.join(one.physics for one in case.effects)}", session, machine))
    shown = [pair for pair in shares if pair is not None]
    for which, who in enumerate(("ours", "peer")):
        most = sum(pair[which] >= 0.8 for pair in shown)
        print(f"{who}: 80 % of the excess taken in {most} of {len(shown)}")


if __name__ == "__main__":
    main()
