"""Every estimator on the same recordings: machines × motion times × what real life adds.

    python benchmarks/estimators.py --quick               the essence, some minutes
    python benchmarks/estimators.py --out docs            everything; writes estimators.md and estimators.png

The recordings come from the virtual machine room, which shares no code with the estimators; what real life adds
(friction, gravity, play, delay, …) is not told to them. Error is over the angles of each table, against the true
inertia; "95 %" is the 95th percentile of its magnitude, "band" the share of cells whose 95 % band holds the truth.
"""

from __future__ import annotations

import argparse
import itertools
import time
from collections.abc import Callable, Iterator
from concurrent.futures import ProcessPoolExecutor
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from schwung.drivetrain import Control, Coupling, Load, Machine, Motor
from schwung.errors import SchwungError
from schwung.estimation import estimate
from schwung.estimation.methods import METHODS
from schwung.motion import Excitation, Motion
from schwung.session import Run, Session
from schwung_sim.drives.axis import AxisSettings, ServoAxis
from schwung_sim.plants import TICK_S, Profile, TwoMassPlant, parse_conceal
from schwung_sim.recording import Noise, play

Array = NDArray[np.float64]
FREQUENCY_HZ, AMPLITUDE_NM, PEAK_NM = 50.0, 46.6, 233.0
PHASES = (0.0, np.pi / 2, np.pi, 3 * np.pi / 2)


def _payload_step(angle: Array) -> Array:
    """A payload picked up half-way: 0.08 to 0.14 kg·m² within 0.2 rad."""
    return 0.11 + 0.03 * np.tanh((angle - 1.57) / 0.1)


MACHINES: dict[str, Callable[[], Profile]] = {
    "constant": lambda: Profile.constant(0.11),
    "slider-crank": lambda: TwoMassPlant(inertia="slider-crank").inertia,
    "four-bar": lambda: TwoMassPlant(inertia="four-bar").inertia,
    "payload step": lambda: Profile.of_pairs(
        np.linspace(-0.5, 3.7, 400), _payload_step(np.linspace(-0.5, 3.7, 400))
    ),
}


@dataclass(frozen=True)
class Condition:
    """What real life adds."""

    conceal: str = ""
    rate_hz: float = 4000.0
    noise: Noise = field(default_factory=Noise)
    clip: float | None = None  # torque limit as a share of what the motion would take


CONDITIONS = {
    "clean": Condition(),
    "friction": Condition("stribeck_friction"),
    "gravity": Condition("load_torque"),
    "backlash": Condition("backlash"),
    "0.5 ms delay": Condition("measurement_delay=0.0005"),
    "12-bit speed": Condition(noise=Noise(0.02, 0.1, 2 * 60.0 / 4096)),
    "1 kHz": Condition(rate_hz=1000.0),
    "8 kHz": Condition(rate_hz=8000.0),
    "clipped": Condition(clip=0.8),
}
DURATIONS_S = (0.5, 0.3, 0.25, 0.2, 0.15, 0.1, 0.08)


@dataclass(frozen=True)
class Case:
    """One session to be made and estimated by everybody."""

    machine: str
    duration_s: float
    condition: str
    seed: int = 0


@dataclass(frozen=True)
class Score:
    """What one method made of one case; NaN errors where it refused."""

    case: Case
    method: str
    rmse: float
    p95: float
    band: float
    us_per_sample: float


def make_session(case: Case) -> tuple[Session, Profile]:
    """A reference and four excited runs (the first with phase 0), recorded on the virtual axis."""
    condition = CONDITIONS[case.condition]
    motion = Motion(distance_rad=np.pi, duration_s=case.duration_s, start_time_s=0.12, dwell_s=0.1)
    inertia = MACHINES[case.machine]()
    limit = PEAK_NM
    if condition.clip is not None:
        free = [_record(case, condition, motion, inertia, phase, 1e4) for phase in (None, 0.0)]
        limit = condition.clip * max(float(np.max(np.abs(run.torque_nm))) for run in free)
    runs = [_record(case, condition, motion, inertia, phase, limit) for phase in (None, *PHASES)]
    return Session(tuple(runs), created="2026-01-01T00:00:00", source="benchmark"), inertia


def _record(
    case: Case, condition: Condition, motion: Motion, inertia: Profile, phase: float | None, limit_nm: float
) -> Run:
    plant = TwoMassPlant(inertia=inertia, concealed=parse_conceal(condition.conceal), seed=case.seed)
    axis = ServoAxis(plant, AxisSettings(torque_limit_nm=limit_nm), seed=case.seed)
    instants = motion.time(1 / TICK_S)
    excitation = None
    added = np.zeros_like(instants)
    if phase is not None:
        excitation = Excitation(
            frequency_hz=FREQUENCY_HZ,
            amplitude_nm=AMPLITUDE_NM,
            phase_rad=phase,
            ramp_s=0.04,
            end_s=motion.total_s,
        )
        added = excitation.torque(instants)
    every = round(1 / (condition.rate_hz * TICK_S))
    number = 0 if phase is None else 1 + PHASES.index(phase)
    made = play(
        axis, motion.demand(instants).position_rad, added, every, condition.noise, 100 * case.seed + number
    )
    return Run(
        role="reference" if excitation is None else "excited", repeat=0, sample_rate_hz=condition.rate_hz,
        time_s=made.time_s, position_rad=made.position_rad, speed_rad_s=made.speed_rad_s, torque_nm=made.torque_nm,
        position_demand_rad=made.position_demand_rad, torque_added_nm=made.torque_added_nm, motion=motion,
        excitation=excitation, name=f"{case.machine}, {case.condition}, run {number}",
    )  # fmt: skip


def believed() -> Machine:
    """Motor, coupling and gains as they are; the load a guess."""
    settings = AxisSettings()
    return Machine(
        name="benchmark",
        motor=Motor(inertia_kgm2=0.012, viscous_friction_nms=0.2, peak_torque_nm=PEAK_NM),
        coupling=Coupling(stiffness_nm_rad=24963.0, damping_nms=8.62),
        load=Load(viscous_friction_nms=0.1, inertia_kgm2=0.11),
        control=Control(
            position_gain_per_s=settings.position_gain_1_s,
            speed_gain_nms=settings.speed_gain_nms_rad,
            speed_integral_time_s=settings.speed_integral_time_s,
            sample_rate_hz=1 / TICK_S,
        ),
    )


def _for_method(session: Session, method: str) -> Session:
    """The runs that a method asks for: one injected phase for all but those that are made for several."""
    if method in ("multiphase", "trajectory", "auto"):
        return session
    return Session(session.runs[:2], session.created, session.source)


def score(case: Case, methods: tuple[str, ...]) -> list[Score]:
    """All methods on one case."""
    session, inertia = make_session(case)
    scores = []
    for method in methods:
        given = _for_method(session, method)
        samples = sum(len(run) for run in given.runs)
        started = time.perf_counter()
        try:
            table = estimate(given, believed(), method=method).table
        except SchwungError:
            scores.append(Score(case, method, np.nan, np.nan, np.nan, np.nan))
            continue
        spent = 1e6 * (time.perf_counter() - started) / samples
        error = table.inertia_kgm2 - inertia.at(table.position_rad)
        band = np.nan
        if table.std_kgm2 is not None:
            band = float(np.mean(np.abs(error) <= 1.96 * table.std_kgm2))
        scores.append(
            Score(
                case,
                method,
                float(np.sqrt(np.mean(error**2))),
                float(np.percentile(np.abs(error), 95)),
                band,
                spent,
            )
        )
    return scores


def cases(quick: bool) -> Iterator[Case]:
    """Every machine, motion time and condition; `quick`: the slider-crank in the clean, and one motion time."""
    durations = (0.5, 0.25, 0.15, 0.1) if quick else DURATIONS_S
    for machine, duration, condition in itertools.product(MACHINES, durations, CONDITIONS):
        if not quick or (machine == "slider-crank" and (condition == "clean" or duration == 0.25)):
            yield Case(machine, duration, condition)


def _cell(scores: list[Score], quantity: str) -> str:
    values = np.array([getattr(s, quantity) for s in scores])
    if not np.isfinite(values).any():
        return "–"
    refused = int(np.sum(~np.isfinite(values)))
    text = f"{np.nanmedian(values):.2g}" if quantity != "band" else f"{100 * np.nanmean(values):.0f} %"
    return text + (f" ({refused} refused)" if refused else "")


def tables(scores: list[Score], methods: tuple[str, ...]) -> str:
    """Markdown: error over motion times in the clean, error over conditions, and what it costs."""
    durations = sorted({s.case.duration_s for s in scores}, reverse=True)
    conditions = [c for c in CONDITIONS if any(s.case.condition == c for s in _at(scores, 0.25))]
    clean = [s for s in scores if s.case.condition == "clean"]
    lines = ["", "Median RMSE (kg·m²) over machines, nothing added, by motion time:", ""]
    lines += _grid(methods, [(f"{1e3 * d:g} ms", _at(clean, d)) for d in durations], "rmse")
    titles = {
        "rmse": "Median RMSE (kg·m²)",
        "p95": "Median 95 % error (kg·m²)",
        "band": "Cells whose 95 % band holds the truth",
    }
    for quantity, title in titles.items():
        lines += ["", f"{title} over machines at 250 ms, by what is added:", ""]
        columns = [(c, [s for s in _at(scores, 0.25) if s.case.condition == c]) for c in conditions]
        lines += _grid(methods, columns, quantity)
    lines += ["", "Microseconds a sample, median:", ""]
    lines += _grid(methods, [("µs", scores)], "us_per_sample")
    return "\n".join(lines)


def _at(scores: list[Score], duration_s: float) -> list[Score]:
    return [s for s in scores if s.case.duration_s == duration_s]


def _grid(methods: tuple[str, ...], columns: list[tuple[str, list[Score]]], quantity: str) -> list[str]:
    rows = ["| method | " + " | ".join(name for name, _ in columns) + " |", "|---" * (len(columns) + 1) + "|"]
    for method in methods:
        cells = [_cell([s for s in scores if s.method == method], quantity) for _, scores in columns]
        rows.append(f"| {method} | " + " | ".join(cells) + " |")
    return rows


def picture(scores: list[Score], methods: tuple[str, ...], path: Path) -> None:
    """Median RMSE over motion time, one line a method."""
    from matplotlib.figure import Figure  # noqa: PLC0415  # only where a picture is wanted

    figure = Figure(figsize=(9, 5.5), layout="constrained")
    axes = figure.add_subplot()
    durations = sorted({s.case.duration_s for s in scores})
    for method in methods:
        medians = [
            np.nanmedian([np.nan, *(s.rmse for s in scores if s.method == method and s.case.duration_s == d
                                    and s.case.condition == "clean")])
            for d in durations
        ]  # fmt: skip
        ours = method in ("multiphase", "trajectory")
        axes.plot(1e3 * np.array(durations), medians, "o-", lw=2.5 if ours else 1.2, ms=4, label=method)
    axes.set(xscale="log", yscale="log", xlabel="motion time, ms", ylabel="median RMSE over machines, kg·m²")
    axes.set_xticks([1e3 * d for d in durations], [f"{1e3 * d:g}" for d in durations])
    axes.minorticks_off()
    axes.grid(alpha=0.3)
    axes.legend(ncols=2, fontsize=8, frameon=False)
    figure.savefig(path, dpi=110)


def main() -> None:
    """Make, estimate, print, and write where asked."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--quick", action="store_true")
    parser.add_argument("--methods", nargs="*", default=sorted(METHODS))
    parser.add_argument("--out", type=Path, help="folder for estimators.md and estimators.png")
    given = parser.parse_args()
    methods = tuple(given.methods)
    todo = list(cases(given.quick))
    scores: list[Score] = []
    with ProcessPoolExecutor(2) as pool:
        for number, part in enumerate(pool.map(score, todo, itertools.repeat(methods)), start=1):
            scores += part
            print(f"\r{number} of {len(todo)} sessions", end="", flush=True)
    print()
    text = tables(scores, methods)
    print(text)
    if given.out is not None:
        head = (
            "# Estimators compared\n\nWritten by `python benchmarks/estimators.py --out docs`.\n\n"
            "![RMSE over motion time](estimators.png)\n"
        )
        (given.out / "estimators.md").write_text(head + text + "\n", encoding="utf-8")
        picture(scores, methods, given.out / "estimators.png")


if __name__ == "__main__":
    main()
