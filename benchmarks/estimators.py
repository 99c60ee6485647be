"""Every estimator on the same recordings: machines × motion times × what real life adds.

    python benchmarks/estimators.py --quick               the essence, a minute or two
    python benchmarks/estimators.py --out docs            everything; writes estimators.md, .csv and .png
    python benchmarks/estimators.py --out docs --no-run   the page again, from what is kept

Error is over the angles of each table, against the true inertia; "95 %" is the 95th percentile of its magnitude,
"band" the share of cells whose 95 % band holds the truth. Sessions and scores are kept in a cache folder: after a
change, only the methods whose code changed are computed again.
"""

from __future__ import annotations

import argparse
import os
import sys
import time
from collections.abc import Iterator
from concurrent.futures import ProcessPoolExecutor
from concurrent.futures import as_completed as completed
from dataclasses import asdict
from multiprocessing import get_context
from pathlib import Path
from typing import Any

import numpy as np
from estimator_cache import Kept, fingerprint, method_fingerprint
from estimator_cases import (
    BOUND,
    CLEAN,
    CONDITIONS,
    MACHINES,
    PHASES,
    SLIDER_CRANK,
    USUAL_S,
    Case,
    Entrant,
    believed,
    cases,
    entrants,
    known,
    session_of,
    usual_runs,
)
from estimator_score import Score

from schwung.errors import SchwungError
from schwung.estimation import estimate
from schwung.estimation.bound import cramer_rao
from schwung.estimation.methods import METHODS, Method
from schwung.innovations.likelihood import Noise
from schwung.session import Session

__all__ = ["PHASES", "Score", "main", "score"]

OURS = ("multiphase", "trajectory")
CACHE = Path(os.environ.get("XDG_CACHE_HOME", Path.home() / ".cache")) / "schwung" / "benchmark"
#: What the drive adds to the recordings' own noise: a speed from counts of the angle, and the angle's counts.
_COUNTED_RAD_S, _COUNT_RAD = 0.012, 2 * np.pi / 2**20


class _Timed:
    """A method with a watch on its own part."""

    def __init__(self, method: Method) -> None:
        self._method = method
        self.spent_s = 0.0

    def __getattr__(self, name: str) -> Any:
        return getattr(self._method, name)

    def traces(self, task: Any) -> Any:
        started = time.process_time()
        try:
            return self._method.traces(task)
        finally:
            self.spent_s = time.process_time() - started


def score(case: Case, entered: tuple[Entrant, ...], folder: Path) -> list[Score]:
    """All who entered for one case."""
    session = session_of(case, folder)
    return [_score(case, entrant, entrant.given(session), folder) for entrant in entered]


def _score(case: Case, entrant: Entrant, session: Session, folder: Path) -> Score:
    head = {**asdict(case), **asdict(entrant)}
    condition = CONDITIONS[case.condition]
    machine = believed(session, condition.clip is not None)
    if entrant.method == BOUND:
        least = cramer_rao(session, known(session, machine, case.inertia), noise=noise_of(case.condition))
        return Score(**head, rmse=least.rms_kgm2)
    watch = _Timed(METHODS[entrant.method])
    METHODS[entrant.method] = watch
    started = time.process_time()
    try:
        table = estimate(session, machine, method=entrant.method).table
    except SchwungError as refusal:
        return Score(
            **head, refused=str(refusal).replace(f"{folder}{os.sep}", "")
        )  # nobody's path in a table
    finally:
        whole = time.process_time() - started
        METHODS[entrant.method] = watch._method
    error = np.abs(table.inertia_kgm2 - case.inertia.at(table.position_rad))
    samples = sum(len(run) for run in session.runs)
    inside = np.nan if table.std_kgm2 is None else float(np.mean(error <= 1.96 * table.std_kgm2))
    return Score(
        **head,
        rmse=float(np.sqrt(np.mean(error**2))),
        median=float(np.median(error)),
        p95=float(np.percentile(error, 95)),
        band=inside,
        covered=float(np.ptp(np.clip(table.position_rad, 0.0, np.pi)) / np.pi),
        method_us=1e6 * watch.spent_s / samples,
        whole_us=1e6 * whole / samples,
        moving_s=sum(case.motion.total_s for _ in session.runs),
    )


def noise_of(condition: str) -> Noise:
    """What it was made of, the drive's own part counted."""
    made = CONDITIONS[condition].noise
    speed = np.hypot(np.hypot(made.speed_rad_s, _COUNTED_RAD_S), made.speed_count_rad_s / np.sqrt(12))
    return Noise(made.torque_nm, float(speed), _COUNT_RAD / np.sqrt(12))


def _for_method(session: Session, method: str) -> Session:
    """The runs that a method is made for."""
    return Entrant(method, usual_runs(method)).given(session)


def _states(methods: tuple[str, ...], folder: Path) -> dict[str, Kept]:
    """Where each method's scores are kept."""
    recorded = fingerprint("estimator_cases")
    kept = {}
    for method in (*methods, BOUND):
        module = "schwung.estimation.bound" if method == BOUND else type(METHODS[method]).__module__
        kept[method] = Kept(folder, method, f"{method_fingerprint(module)}-{recorded}")
    return kept


def compute(methods: tuple[str, ...], todo: list[Case], folder: Path, workers: int, run: bool) -> list[Score]:
    """What is kept, and with `run` the rest of what was asked for; kept case by case, so that it may be stopped."""
    kept = _states(methods, folder)
    scores = [Score(**row) for store in kept.values() for row in store.rows()]
    todo = sorted(
        todo, key=lambda case: case.condition != CLEAN and case.duration_s != USUAL_S
    )  # the page's first
    wanted = set(todo)
    scores = [s for s in scores if s.case in wanted]
    done = {(s.case, s.entrant) for s in scores}
    missing = {
        case: tuple(e for e in entrants(case, methods) if (case, e) not in done) for case in todo if run
    }
    missing = {case: entered for case, entered in missing.items() if entered}
    if not missing:
        return scores
    sessions = folder / f"sessions-{fingerprint('estimator_cases')}"
    sessions.mkdir(parents=True, exist_ok=True)
    # one thread each: a worker is a processor; read by numpy when it is first loaded, in a new process
    os.environ.update(OPENBLAS_NUM_THREADS="1", OMP_NUM_THREADS="1", MKL_NUM_THREADS="1")
    whole, began, through = sum(map(_effort, missing.items())), time.monotonic(), 0.0
    with ProcessPoolExecutor(workers, mp_context=get_context("spawn")) as pool:
        futures = {pool.submit(score, case, entered, sessions): case for case, entered in missing.items()}
        for number, future in enumerate(completed(futures), start=1):
            made = future.result()
            for one in made:
                kept[one.method].add([asdict(one)])
            scores += made
            case = futures[future]
            through += _effort((case, missing[case]))
            left = (time.monotonic() - began) * (whole / through - 1)
            print(
                f"\r{number} of {len(missing)} sessions, {left / 60:.0f} min left  ",
                end="",
                file=sys.stderr,
                flush=True,
            )
    print(file=sys.stderr)
    return scores


def _effort(item: tuple[Case, tuple[Entrant, ...]]) -> float:
    """How long a case takes, roughly, in any unit: the trajectory fit and the bound take most."""
    case, entered = item
    samples = CONDITIONS[case.condition].rate_hz * case.motion.total_s
    heavy = sum(e.runs for e in entered if e.method in ("trajectory", BOUND))
    return samples * (heavy + 0.1 * len(entered))


def _show(scores: list[Score], methods: tuple[str, ...]) -> Iterator[str]:
    """The essence for a terminal: median RMSE by motion time and by condition, usual runs."""
    usual = [s for s in scores if s.runs == usual_runs(s.method)]
    clean, by_time = [s for s in usual if s.condition == CLEAN], "clean, by motion time in s"
    at_usual, by_condition = [s for s in usual if s.duration_s == USUAL_S], "at 250 ms, by what is added"
    for rows, name, title in ((clean, "duration_s", by_time), (at_usual, "condition", by_condition)):
        columns = list(dict.fromkeys(getattr(s, name) for s in rows))
        yield f"\nMedian RMSE over machines, 1e-3 kg·m², {title}"
        yield " " * 22 + "".join(f"{column!s:>13}" for column in columns)
        for method in (*methods, BOUND):
            values = [[s.rmse for s in rows if s.method == method and getattr(s, name) == c] for c in columns]
            cells = (1e3 * np.nanmedian(v) if np.isfinite(v).any() else np.nan for v in values)
            yield f"{method:22}" + "".join(f"{cell:13.3g}" for cell in cells)
    yield from _near(usual)


def _near(usual: list[Score]) -> Iterator[str]:
    """How near ours come to the bound on the Table 1 machine."""
    least = {s.case: s.rmse for s in usual if s.method == BOUND and s.machine == SLIDER_CRANK}
    for condition in (CLEAN, "clipped"):
        times = sorted({case.duration_s for case in least if case.condition == condition}, reverse=True)
        if not times:
            continue
        yield f"\nTable 1 machine, RMSE over the Cramér-Rao bound of the same runs, {condition}, by motion time in s"
        yield " " * 22 + "".join(f"{time!s:>13}" for time in times)
        for method in OURS:
            ratios = [
                [s.rmse / least[s.case] for s in usual if s.method == method and s.case in least
                 and (s.condition, s.duration_s) == (condition, time)]
                for time in times
            ]  # fmt: skip
            cells = (float(np.sqrt(np.mean(np.square(of)))) if of else np.nan for of in ratios)
            yield f"{method:22}" + "".join(f"{cell:13.3g}" for cell in cells)


def main() -> None:
    """Make, estimate, print, and write where asked."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--quick", action="store_true")
    parser.add_argument("--methods", nargs="*", default=sorted(METHODS), choices=sorted(METHODS))
    parser.add_argument("--machines", nargs="*", default=list(MACHINES), choices=list(MACHINES))
    parser.add_argument(
        "--seeds", type=int, default=1, help="sessions per machine, motion time and condition"
    )
    parser.add_argument("--workers", type=int, default=2)
    parser.add_argument("--cache", type=Path, default=CACHE, help="folder that keeps sessions and scores")
    parser.add_argument("--no-run", action="store_true", help="take what is kept, compute nothing")
    parser.add_argument(
        "--out", type=Path, help="folder for estimators.md, estimators.csv and estimators.png"
    )
    given = parser.parse_args()
    methods = tuple(given.methods)
    todo = [case for case in cases(given.quick, given.seeds) if case.machine in given.machines]
    scores = compute(methods, todo, given.cache, given.workers, not given.no_run)
    print("\n".join(_show(scores, methods)))
    if given.out is not None:
        from estimator_page import write_page  # only where a picture is wanted

        write_page(scores, given.out)


if __name__ == "__main__":
    main()
