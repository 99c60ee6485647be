"""Are the bands honest, and does the verdict predict the error? Random machines, profiles, rates and noise.

    python benchmarks/calibration.py --first 20000 --machines 500 --methods multiphase auto auto/2
    python benchmarks/calibration.py --plant stranger --first 300 --machines 160
    python benchmarks/calibration.py --plant stranger --every 2 --first 300 --machines 160
    python benchmarks/calibration.py --plant stranger --every 8 --held 1 --first 720 --machines 60
    python benchmarks/calibration.py --hard --first 9000 --machines 130 --methods denoised multiphase auto
    python benchmarks/calibration.py --hard --plant stranger --first 300 --machines 160

Machines are drawn by seed, by one of two generators: that of the virtual machine room (`drawn.py`, "home") or one that
shares no code with it (`stranger_plant.py`); with --hard most have something that spoils an estimate. Printed per
method: the share of cells whose 95 % band holds the truth, with its 95 % interval over machines, the same by rate,
motion time and filter, or with --hard by what is wrong, and errors and bands relative to the mean inertia. With --hard
besides, what the verdict is worth: hits (bad estimates, relative RMSE above 5 %, not called good) and false alarms
(fine ones, within 2 %, not called good), and both by cause and by verdict. Causes that put a factor on all that the
session holds (torque constant, rotor inertia) are counted apart: no verdict can promise to see them.
"""

from __future__ import annotations

import argparse
import json
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import ProcessPoolExecutor
from dataclasses import asdict, dataclass, replace
from functools import partial
from pathlib import Path

import numpy as np
from drawn import CAUSES, believed, draw, draw_hard, make_session
from estimator_cases import PAIR, Entrant, usual_runs
from stranger_plant import DURATIONS_S, HIDDEN, draw_hidden, draw_stranger, stranger_belief, stranger_session

from schwung.drivetrain.machine import Machine
from schwung.errors import SchwungError
from schwung.estimation import estimate
from schwung.estimation.choice import AUTO
from schwung.estimation.values import Estimate
from schwung.motion import Array
from schwung.session.model import Session

#: Relative RMSE above which an estimate is bad, and up to which it is fine.
BAD, FINE = 0.05, 0.02
#: What puts a factor on torques or inertias and is not seen from within a session.
APART = ("torque constant", "wrong rotor inertia")
VERDICTS = ("good", "doubtful", "unusable")


@dataclass(frozen=True)
class Case:
    """One machine by chance, what was recorded and is believed of it, and what is true."""

    session: Session
    machine: Machine
    truth: Callable[[Array], Array]
    mean_kgm2: float
    cause: str
    rate_hz: float
    motion_s: float
    filter_s: float


def home(seed: int, *, hard: bool = False) -> Case:
    """A machine of the virtual machine room."""
    drawn = draw_hard(seed) if hard else draw(seed)
    return Case(
        make_session(drawn, seed),
        believed(drawn),
        drawn.truth,
        drawn.mean_kgm2,
        drawn.cause,
        drawn.rate_hz,
        drawn.motion.duration_s,
        drawn.settings.speed_filter_s,
    )


def stranger(seed: int, *, hard: bool = False, every: int | None = None, held: float | None = None) -> Case:
    """A machine from another hand; the four motion times take turns. `every`: so many ticks per logged sample. `held`:
    the injection is sent once a sample, and taken up to so many samples later."""
    duration = DURATIONS_S[seed % len(DURATIONS_S)]
    drawn = draw_hidden(seed, duration, every) if hard else draw_stranger(seed, duration, every)
    if held is not None:
        late = np.random.default_rng([seed, 5077]).integers(0, round(held * drawn.every), endpoint=True)
        drawn = replace(drawn, held_late=int(late))
    return Case(
        stranger_session(drawn, seed),
        stranger_belief(drawn),
        drawn.truth,
        drawn.mean_kgm2,
        drawn.cause,
        drawn.rate_hz,
        drawn.duration_s,
        drawn.loop.filter_s,
    )


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
    rate_hz: float
    motion_s: float
    filter_s: float
    relative_std: float = float("nan")  # of the median cell
    mean_z: float = float("nan")  # error over standard deviation, mean over cells: what all cells share
    rms_z: float = float("nan")

    @property
    def alarmed(self) -> bool:
        """The verdict warns."""
        return self.verdict != "good"


#: What machines and recordings are told apart by.
GROUPS: dict[str, Callable[[Outcome], bool]] = {
    "1 kHz": lambda o: o.rate_hz == 1000.0,
    "2 kHz": lambda o: o.rate_hz == 2000.0,
    "4 kHz": lambda o: o.rate_hz == 4000.0,
    "8 kHz": lambda o: o.rate_hz == 8000.0,
    **{f"motion of {1000 * time:g} ms": (lambda o, time=time: o.motion_s == time) for time in DURATIONS_S},
    "motion of 100 to 200 ms": lambda o: o.motion_s < 0.2,
    "motion of 200 to 350 ms": lambda o: 0.2 <= o.motion_s < 0.35,
    "motion of 350 to 500 ms": lambda o: o.motion_s >= 0.35,
    "no speed filter": lambda o: o.filter_s == 0,
    "filter of 50 to 150 µs": lambda o: 0 < o.filter_s < 150e-6,
    "filter of 150 to 400 µs": lambda o: o.filter_s >= 150e-6,
}


def entrant(name: str) -> Entrant:
    """A method with the runs that it is made for; "auto/2" is auto with a reference and one injected run."""
    method, _, pair = name.partition("/")
    return Entrant(method, PAIR if pair else usual_runs(method))


def judge(make: Callable[[int], Case], methods: tuple[str, ...], seed: int) -> list[Outcome]:
    """All methods on one machine; a refusal counts as the verdict "refused"."""
    case = make(seed)
    kind = (case.rate_hz, case.motion_s, case.filter_s)
    outcomes = []
    known: dict[Entrant, Estimate] = {}  # what auto took is what it would have been by name
    for method in sorted(methods, key=lambda name: entrant(name).method != AUTO):
        asked = entrant(method)
        try:
            made = known.get(asked) or estimate(asked.given(case.session), case.machine, method=asked.method)
            known[Entrant(made.method, asked.runs)] = made
        except SchwungError:
            outcomes.append(Outcome(seed, case.cause, method, "", np.nan, np.nan, 0, 0, "refused", *kind))
            continue
        table = made.table
        error = table.inertia_kgm2 - case.truth(table.position_rad)
        std = table.std_kgm2 if table.std_kgm2 is not None else np.zeros_like(error)
        predicted, z = made.trust.predicted_error, error / np.maximum(std, 1e-300)
        outcomes.append(
            Outcome(
                seed,
                case.cause,
                method,
                made.method,
                float(np.sqrt(np.mean(error**2))) / case.mean_kgm2,
                np.nan if predicted is None else predicted,
                int(np.sum(np.abs(error) <= 1.96 * std)),
                error.size,
                made.trust.verdict,
                *kind,
                float(np.median(std)) / case.mean_kgm2,
                float(np.mean(z)),
                float(np.sqrt(np.mean(z**2))),
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


def coverage(of: Sequence[Outcome]) -> str:
    """Share of cells whose 95 % band holds the truth and its 95 % interval over machines, whose cells stand or fall
    together, as one cell."""
    shares = np.array([o.inside / o.cells for o in of if o.cells])
    if shares.size < 2:
        return "–"
    half = 196 * shares.std(ddof=1) / np.sqrt(shares.size)
    mean = 100 * shares.mean()
    return f"{mean:.1f} % ({max(mean - half, 0):.1f} … {min(mean + half, 100):.1f})"


def bands(outcomes: Sequence[Outcome], methods: Sequence[str]) -> Iterator[str]:
    """How often the bands hold the truth: over all, and by what machines and recordings differ in."""
    yield (
        "| method | machines | in the 95 % band | machines with nine cells of ten in it | error, median "
        "| 95th percentile | band (one standard deviation), median | refused |"
    )
    yield "|" + "---|" * 8
    for method in methods:
        every = [o for o in outcomes if o.method == method]
        of = [o for o in every if o.cells]
        rmse = np.array([o.relative_rmse for o in of])
        most = np.mean([o.inside >= 0.9 * o.cells for o in of])
        yield (
            f"| {method} | {len(of)} | {coverage(of)} | {100 * most:.0f} % | {100 * np.median(rmse):.3f} % "
            f"| {100 * np.percentile(rmse, 95):.2f} % | {100 * np.median([o.relative_std for o in of]):.3f} % "
            f"| {len(every) - len(of)} |"
        )
    yield ""
    yield "| of these | machines |" + "".join(f" {method} |" for method in methods)
    yield "|" + "---|" * (2 + len(methods))
    causes = {} if {o.cause for o in outcomes} == {"healthy"} else {o.cause: None for o in outcomes}
    groups = {cause: partial(_caused, cause) for cause in causes} or GROUPS
    for name, chosen in groups.items():
        of = [o for o in outcomes if chosen(o)]
        if not of:
            continue
        cells = [coverage([o for o in of if o.method == method]) for method in methods]
        yield f"| {name} | {len({o.seed for o in of})} |" + "".join(f" {cell} |" for cell in cells)


def _caused(cause: str, outcome: Outcome) -> bool:
    return outcome.cause == cause


def by_cause(outcomes: Sequence[Outcome], methods: Sequence[str]) -> Iterator[str]:
    """Median error, hits and false alarms of each method, by what was wrong."""
    yield "| cause |" + "".join(f" {m}: median error | hits | false alarms |" for m in methods)
    yield "|" + "---|" * (1 + 3 * len(methods))
    for cause in ("healthy", *CAUSES, *HIDDEN):
        if all(o.cause != cause for o in outcomes):
            continue
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
    parser.add_argument(
        "--methods",
        nargs="*",
        default=["denoised", "multiphase", "trajectory", "auto", "auto/2"],
        help="METHOD with all the runs that it is made for, METHOD/2 with a reference and one injected run",
    )
    parser.add_argument(
        "--hard", action="store_true", help="mostly machines with something that spoils an estimate"
    )
    parser.add_argument("--plant", choices=("home", "stranger"), default="home", help="whose machines")
    parser.add_argument("--every", type=int, help="ticks per logged sample of a stranger; else by chance")
    parser.add_argument(
        "--held",
        type=float,
        help="a stranger's injection is sent once a sample, and taken up to so many later",
    )
    parser.add_argument("--workers", type=int, default=2)
    parser.add_argument("--keep", type=Path, help="keep outcomes there, line by line, and go on from them")
    parser.add_argument("--out", type=Path, help="write the tables there, too")
    given = parser.parse_args()
    methods = tuple(given.methods)
    seeds = range(given.first, given.first + given.machines)
    kept = given.keep.read_text().splitlines() if given.keep and given.keep.exists() else []
    outcomes = [o for o in (Outcome(**json.loads(line)) for line in kept) if o.seed in seeds]
    todo = [seed for seed in seeds if seed not in {o.seed for o in outcomes}]
    make = partial(home, hard=given.hard)
    if given.plant == "stranger":
        make = partial(stranger, hard=given.hard, every=given.every, held=given.held)
    with ProcessPoolExecutor(given.workers) as pool:
        made = pool.map(partial(judge, make, methods), todo)
        for number, part in enumerate(made, start=1 + len(seeds) - len(todo)):
            outcomes += part
            if given.keep:
                with given.keep.open("a") as file:
                    file.writelines(json.dumps(asdict(o)) + "\n" for o in part)
            print(f"\r{number} of {given.machines} machines", end="", flush=True)
    if given.hard:
        lines = [
            *bands(outcomes, methods),
            "",
            *summary(outcomes, methods),
            "",
            *by_cause(outcomes, methods),
            "",
            *by_verdict(outcomes, methods),
        ]
    else:
        lines = list(bands(outcomes, methods))
    print("\n\n" + "\n".join(lines))
    if given.out is not None:
        given.out.write_text("\n".join(lines) + "\n", encoding="utf-8")


if __name__ == "__main__":
    main()
