"""Are the bands honest, and does the verdict predict the error? Random machines, profiles, rates and noise.

    python benchmarks/calibration.py --machines 500
    python benchmarks/calibration.py --hard --machines 240 --out docs/trust.md

Machines are drawn by seed (`drawn.py`); with --hard four of five have something that spoils an estimate. Printed per
method: error relative to the mean inertia, share of cells whose 95 % band holds the truth, and what the verdict is
worth: hits (bad estimates, relative RMSE above 5 %, not called good) and false alarms (fine ones, within 2 %, not
called good). With --hard also by cause and by verdict. Causes that put a factor on all that the session holds (torque
constant, rotor inertia) are counted apart: no verdict can promise to see them.
"""

from __future__ import annotations

import argparse
import itertools
from collections.abc import Iterator, Sequence
from concurrent.futures import ProcessPoolExecutor
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from drawn import CAUSES, believed, draw, draw_hard, make_session
from estimators import _for_method

from schwung.errors import SchwungError
from schwung.estimation import estimate

#: Relative RMSE above which an estimate is bad, and up to which it is fine.
BAD, FINE = 0.05, 0.02
#: What puts a factor on torques or inertias and is not seen from within a session.
APART = ("torque constant", "wrong rotor inertia")
VERDICTS = ("good", "doubtful", "unusable")


@dataclass(frozen=True)
class Outcome:
    """What one method made of one machine."""

    seed: int
    cause: str
    method: str
    taken: str  # the method that "auto" took
    relative_rmse: float
    predicted: float
    inside: int
    cells: int
    verdict: str

    @property
    def alarmed(self) -> bool:
        """The verdict warns."""
        return self.verdict != "good"


def judge(seed: int, methods: tuple[str, ...], hard: bool = False) -> list[Outcome]:
    """All methods on one machine; a refusal counts as the verdict "refused"."""
    drawn = draw_hard(seed) if hard else draw(seed)
    session, machine = make_session(drawn, seed), believed(drawn)
    outcomes = []
    for method in methods:
        try:
            made = estimate(_for_method(session, method), machine, method=method)
        except SchwungError:
            outcomes.append(Outcome(seed, drawn.cause, method, "", np.nan, np.nan, 0, 0, "refused"))
            continue
        table = made.table
        error = table.inertia_kgm2 - drawn.truth(table.position_rad)
        std = table.std_kgm2 if table.std_kgm2 is not None else np.zeros_like(error)
        predicted = made.trust.predicted_error
        outcomes.append(
            Outcome(
                seed,
                drawn.cause,
                method,
                made.method,
                float(np.sqrt(np.mean(error**2))) / drawn.mean_kgm2,
                np.nan if predicted is None else predicted,
                int(np.sum(np.abs(error) <= 1.96 * std)),
                error.size,
                made.trust.verdict,
            )
        )
    return outcomes


def rates(of: Sequence[Outcome]) -> str:
    """Hits and false alarms, as two cells."""
    bad = [o.alarmed for o in of if o.relative_rmse > BAD]
    fine = [o.alarmed for o in of if o.relative_rmse <= FINE]
    return f"{sum(bad)} of {len(bad)} | {sum(fine)} of {len(fine)}"


def summary(outcomes: Sequence[Outcome], methods: Sequence[str]) -> Iterator[str]:
    """One line per method."""
    yield (
        "| method | relative RMSE, median | 95th percentile | in the 95 % band | error within twice the predicted one "
        "| refused | hits | false alarms | apart: hits | false alarms |"
    )
    yield "|" + "---|" * 10
    for method in methods:
        every = [o for o in outcomes if o.method == method]
        of = [o for o in every if o.verdict != "refused"]
        rmse = np.array([o.relative_rmse for o in of])
        inside = sum(o.inside for o in of) / max(sum(o.cells for o in of), 1)
        seen, apart = ([o for o in of if (o.cause in APART) == which] for which in (False, True))
        foretold = np.mean([o.relative_rmse <= 2 * o.predicted for o in seen])
        yield (
            f"| {method} | {100 * np.median(rmse):.3f} % | {100 * np.percentile(rmse, 95):.2f} % "
            f"| {100 * inside:.1f} % | {100 * foretold:.0f} % | {len(every) - len(of)} | {rates(seen)} "
            f"| {rates(apart)} |"
        )


def by_cause(outcomes: Sequence[Outcome], methods: Sequence[str]) -> Iterator[str]:
    """Median error, hits and false alarms of each method, by what was wrong."""
    yield "| cause |" + "".join(f" {m}: median error | hits | false alarms |" for m in methods)
    yield "|" + "---|" * (1 + 3 * len(methods))
    for cause in ("healthy", *CAUSES):
        cells = []
        for method in methods:
            of = [o for o in outcomes if (o.cause, o.method) == (cause, method) and o.verdict != "refused"]
            median = f"{100 * np.median([o.relative_rmse for o in of]):.2f} %" if of else "–"
            cells.append(f" {median} | {rates(of)} |")
        yield f"| {cause} |" + "".join(cells)


def by_verdict(outcomes: Sequence[Outcome], methods: Sequence[str]) -> Iterator[str]:
    """Median and 95th percentile of the error under each verdict."""
    yield "| method |" + "".join(f" {v}: number | median error | 95 % error |" for v in VERDICTS)
    yield "|" + "---|" * (1 + 3 * len(VERDICTS))
    for method in methods:
        cells = []
        for verdict in VERDICTS:
            rmse = [100 * o.relative_rmse for o in outcomes if (o.method, o.verdict) == (method, verdict)]
            cells.append(
                f" {len(rmse)} | {np.median(rmse):.2f} % | {np.percentile(rmse, 95):.2f} % |"
                if rmse
                else " 0 | – | – |"
            )
        yield f"| {method} |" + "".join(cells)


def main() -> None:
    """Draw, estimate, count, print."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--machines", type=int, default=100)
    parser.add_argument("--first", type=int, default=0, help="first seed")
    parser.add_argument("--methods", nargs="*", default=["denoised", "multiphase", "trajectory", "auto"])
    parser.add_argument(
        "--hard", action="store_true", help="mostly machines with something that spoils an estimate"
    )
    parser.add_argument("--workers", type=int, default=2)
    parser.add_argument("--out", type=Path, help="write the tables there, too")
    given = parser.parse_args()
    methods = tuple(given.methods)
    outcomes: list[Outcome] = []
    with ProcessPoolExecutor(given.workers) as pool:
        seeds = range(given.first, given.first + given.machines)
        made = pool.map(judge, seeds, itertools.repeat(methods), itertools.repeat(given.hard))
        for number, part in enumerate(made, start=1):
            outcomes += part
            print(f"\r{number} of {given.machines} machines", end="", flush=True)
    lines = list(summary(outcomes, methods))
    if given.hard:
        lines += ["", *by_cause(outcomes, methods), "", *by_verdict(outcomes, methods)]
    print("\n\n" + "\n".join(lines))
    if given.out is not None:
        given.out.write_text("\n".join(lines) + "\n", encoding="utf-8")


if __name__ == "__main__":
    main()
