"""What `schwung optimise` is worth: all rivals on the paper's machine, a lower bound, pick-and-place, the fastest.

    python benchmarks/optimise.py            tables, some five minutes
    python benchmarks/optimise.py --docs     the same, and the pictures of docs/optimise.md

What is played through the bus is `optimise_played.py`'s. The mechanisms are those of `sim/`, whose load inertia the
optimiser gets as a table. Copper is ∫T² dt, counted until the load is at rest; motions of rivals are the motor's.
"""

from __future__ import annotations

import subprocess
import sys
import time
from collections.abc import Callable, Iterable, Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np

from schwung.drivetrain import InertiaTable, Machine, paper_machine
from schwung.motion import Motion
from schwung.optimise.comparison import (
    STANDARD,
    Comparison,
    Contender,
    contender,
    contenders,
    follow_shares,
    model_for,
    optimise,
)
from schwung.optimise.dynamics import follow, follow_demand, merits_of, sampled
from schwung.optimise.rivals import chebyshev_stroke, shaped_demand, toppra_stroke
from schwung.optimise.solve import best_stroke
from schwung.optimise.values import MotionLimits, Stroke, Task
from schwung.report.optimised import angle_figure, motion_figure, shown_of
from schwung.report.style import to_png
from schwung_sim.plants.profile import four_bar, slider_crank

DURATIONS_S = (0.5, 0.3, 0.25, 0.2, 0.15, 0.1)
#: Of the stroke of 180°, as the paper's.
STROKE_RAD = np.pi
TORQUE_NM = 233.0
#: Chebyshev coefficients that the genetic algorithm is given at the most, to see what it takes to come near.
MORE_FREE = 11
#: How much of our own time it is given, one start after the other.
MORE_TIME = 100.0


def task(duration_s: float | None, **changes: object) -> Task:
    """The paper's stroke."""
    return Task(0.0, STROKE_RAD, MotionLimits(TORQUE_NM), duration_s=duration_s, **changes)  # type: ignore[arg-type]


def with_inertia(machine: Machine, curve: Callable[[np.ndarray], np.ndarray], distance_rad: float) -> Machine:
    """The paper's drive before another mechanism."""
    angle = np.linspace(-0.05, distance_rad + 0.05, 181)
    load = machine.load.model_copy(
        update={"inertia_table": InertiaTable(angle, curve(angle)), "inertia_kgm2": None}
    )
    return machine.model_copy(update={"load": load})


def copper_of(machine: Machine, stroke: Stroke) -> float:
    """Of a stroke, by the second integrator."""
    return merits_of(machine, follow(machine, stroke.motion(), stroke.start_rad)).copper_n2m2s


def lower_bound(machine: Machine, wanted: Task, stroke: Stroke) -> float:
    """The least copper on a ten times finer grid, from three starts."""
    fine = 10 * (stroke.share.size - 1)
    starts = [None, stroke, best_stroke(machine, replace(wanted, weights={"vibration": 1.0}))]
    return min(copper_of(machine, best_stroke(machine, wanted, fine, start)) for start in starts)


def timed(call: Callable[[], object], repeats: int = 3) -> float:
    """Shortest of a few (s)."""
    walls = []
    for _ in range(repeats):
        begin = time.perf_counter()
        call()
        walls.append(time.perf_counter() - begin)
    return min(walls)


def markdown(head: Sequence[str], rows: Iterable[Sequence[str]]) -> None:
    """Print a table."""
    print("| " + " | ".join(head) + " |")
    print("|" + "---|" * len(head))
    for row in rows:
        print("| " + " | ".join(row) + " |")
    print()


def row_of(c: Contender, base: float) -> list[str]:
    """A contender in a table."""
    m = c.merits
    return [
        c.name, f"{m.copper_n2m2s:.4g}", f"{m.copper_n2m2s / base:.1%}", f"{m.mechanical_j:.4g}",
        f"{m.rms_torque_nm:.4g}", f"{m.peak_torque_nm:.4g}", f"{m.residual_rad * 1e3:.4f}", ", ".join(c.broken),
    ]  # fmt: skip


HEAD = ("", "copper N²m²s", "of 1/3", "put in J", "RMS N·m", "peak N·m", "residual mrad", "breaks")


def paper_table(machine: Machine) -> list[Comparison]:
    """All rivals at all durations, and the bound."""
    print("## The paper's machine (Table 1; load inertia inferred), 180°, 233 N·m\n")
    made, summary = [], []
    for duration in DURATIONS_S:
        found = optimise(machine, task(duration))
        made.append(found)
        base, ours = found.reference.merits.copper_n2m2s, found.ours.merits.copper_n2m2s
        if duration in (0.25, 0.1):
            print(f"{duration * 1e3:.0f} ms:\n")
            markdown(HEAD, [row_of(c, base) for c in (found.ours, *found.rivals)])
        bound = lower_bound(machine, task(duration), found.stroke)
        best = min(found.rivals, key=lambda c: c.merits.copper_n2m2s)
        worst = [c.name for c in found.rivals if c.merits.copper_n2m2s < ours]
        model = model_for(machine, task(duration), duration)
        genetic = timed(lambda d=duration, m=model: chebyshev_stroke(m, task(d), d), 1)  # type: ignore[misc]
        wall = timed(lambda d=duration: best_stroke(machine, task(d)))  # type: ignore[misc]
        residual = found.reference.merits.residual_rad / found.ours.merits.residual_rad
        summary.append([
            f"{duration * 1e3:.0f}", f"{ours:.4g}", f"{1 - ours / base:.1%}", f"{ours / bound - 1:+.2%}",
            f"{best.name}: {best.merits.copper_n2m2s / ours - 1:+.1%}", ", ".join(worst) or "none",
            f"{wall:.2f}", f"{genetic:.2f}", f"{residual:.0f}",
        ])  # fmt: skip
    markdown(
        ("ms", "copper N²m²s", "below 1/3", "above the bound", "best rival", "rivals below ours", "ours s",
         "genetic s", "residual of 1/3 over ours"), summary,
    )  # fmt: skip
    return made


def genetic_effort(machine: Machine) -> None:
    """How near the genetic algorithm comes in a hundred times our time: one start after the other, the best of them."""
    print("## The genetic algorithm in a hundred times our time (100 ms, judged on the flexible machine)\n")
    wanted = task(0.1)
    model = model_for(machine, wanted, 0.1)
    ours = copper_of(machine, best_stroke(machine, wanted))
    wall = timed(lambda: best_stroke(machine, wanted))
    rows = []
    for free in (3, 5, 8, MORE_FREE):
        begin, coppers, nearest = time.perf_counter(), [], 0.0
        while not coppers or time.perf_counter() - begin < MORE_TIME * wall:
            found = chebyshev_stroke(model, wanted, 0.1, seed=len(coppers), free=free)
            judged = merits_of(machine, follow_shares(machine, wanted, 0.1, found.shares))
            coppers.append(judged.copper_n2m2s)
            if judged.copper_n2m2s == min(coppers):
                nearest, peak = time.perf_counter() - begin, judged.peak_torque_nm
        rows.append([
            str(free), str(len(coppers)), f"{coppers[0] / ours - 1:+.1%}", f"{min(coppers) / ours - 1:+.1%}",
            f"{peak:.0f}", f"{nearest / wall:.0f}", f"{(time.perf_counter() - begin) / wall:.0f}",
        ])  # fmt: skip
    markdown(
        ("free coefficients", "starts", "copper of the first above ours", "of the best", "its peak N·m",
         "best after, times ours", "given, times ours"), rows,
    )  # fmt: skip


def cold_start() -> None:
    """A fresh process, compiled code cached: until the stroke is there."""
    code = (
        "from schwung.drivetrain import paper_machine; from schwung.optimise.solve import best_stroke; "
        "from schwung.optimise.values import MotionLimits, Task; "
        "best_stroke(paper_machine(), Task(0.0, 3.141592653589793, MotionLimits(233.0), duration_s={}))"
    )
    print("## Cold start: a fresh Python until the motion is found, s\n")
    rows = []
    for duration in DURATIONS_S:
        command = [sys.executable, "-c", code.format(duration)]
        rows.append(
            [f"{duration * 1e3:.0f}", f"{timed(lambda c=command: subprocess.run(c, check=True)):.2f}"]
        )
    markdown(("ms", "s"), rows)


def pick_and_place(machine: Machine) -> None:
    """Mechanisms whose inertia varies as 1 : 10."""
    print("## Pick-and-place, inertia 1 : 10, 300 ms, side by side with the published 62.9 %\n")
    light = 0.02
    angle = np.linspace(0.0, STROKE_RAD, 2001)

    def ten_fold(curve: Callable[..., np.ndarray]) -> Callable[[np.ndarray], np.ndarray]:
        bare = curve(angle, 0.0, 1.0)
        swing = 9.0 / (float(bare.max()) - 10.0 * float(bare.min())) if bare.max() > 10 * bare.min() else 0.0
        return lambda x: light * (1.0 + swing * (curve(x, 0.0, 1.0) - 0.0) - swing * float(bare.min()))

    rows = []
    for name, curve in (("slider-crank", slider_crank), ("four-bar", four_bar)):
        inertia = ten_fold(curve)
        values = inertia(angle)
        built = with_inertia(machine, inertia, STROKE_RAD)
        found = optimise(built, task(0.3), rivals=False)
        by_name = {c.name: c.merits for c in found.rivals}
        ours = found.ours.merits
        cells = [name, f"1 : {values.max() / values.min():.1f}"]
        for rival in ("1/3 trapezoid", "fifth-order polynomial", "S-curve"):
            copper = 1 - ours.copper_n2m2s / by_name[rival].copper_n2m2s
            cells.append(f"{copper:.1%} ({1 - ours.mechanical_j / by_name[rival].mechanical_j:.1%})")
        rows.append(cells)
    markdown(
        (
            "mechanism",
            "inertia",
            "copper (energy put in) below 1/3",
            "below the polynomial",
            "below the S-curve",
        ),
        rows,
    )


def fastest(machine: Machine) -> None:
    """Against TOPP-RA: on a stiff plant without viscous friction, which it cannot know, and on the flexible one."""
    print("## The fastest under 233 N·m\n")
    motor = machine.motor.model_copy(update={"viscous_friction_nms": 0.0})
    load = machine.load.model_copy(update={"viscous_friction_nms": 0.0})
    stiff = machine.model_copy(update={"coupling": None, "motor": motor, "load": load})
    theirs = toppra_stroke(model_for(stiff, task(None), 0.08), task(None))
    ours = best_stroke(stiff, task(None))
    flexible = best_stroke(machine, task(None))
    judged = contender(machine, task(None), "ours", follow(machine, flexible.motion(), 0.0))
    ra = next(c for c in contenders(machine, task(None), flexible.duration_s) if c.name == "TOPP-RA")
    rows = [
        ["stiff, no viscous friction", f"{ours.duration_s * 1e3:.2f}", f"{theirs.duration_s * 1e3:.2f}",
         f"{ours.duration_s / theirs.duration_s - 1:+.2%}", "", ""],
        ["flexible", f"{judged.duration_s * 1e3:.2f}", f"{ra.duration_s * 1e3:.2f}", "",
         f"{judged.merits.peak_torque_nm:.1f}", f"{ra.merits.peak_torque_nm:.1f}"],
    ]  # fmt: skip
    markdown(("plant", "ours ms", "TOPP-RA ms", "", "ours: peak N·m", "TOPP-RA: peak N·m"), rows)


def other_than_believed(machine: Machine) -> None:
    """Residual vibration on machines that differ from the one planned with."""
    print("## Residual of the load (mrad) where the machine is another than believed, 100 ms\n")
    wanted = task(0.1)
    table, coupling, model = machine.load.inertia_table, machine.coupling, model_for(machine, wanted, 0.1)
    assert table is not None
    assert coupling is not None
    ours = {
        "least copper": best_stroke(machine, wanted),
        "least copper, jerk below 1e6 rad/s³": best_stroke(
            machine, replace(wanted, limits=MotionLimits(TORQUE_NM, jerk_max_rad_s3=1e6))
        ),
        "copper=1,vibration=1": best_stroke(
            machine, replace(wanted, weights={"copper": 1.0, "vibration": 1.0})
        ),
        "least vibration": best_stroke(machine, replace(wanted, weights={"vibration": 1.0})),
    }
    cases = [(1.0, 1.0), (0.9, 1.0), (0.8, 1.0), (1.0, 1.1), (1.0, 0.9)]
    machines = []
    for stiffness, inertia in cases:
        load = machine.load.model_copy(
            update={"inertia_table": InertiaTable(table.position_rad, inertia * table.inertia_kgm2)}
        )
        shaft = coupling.model_copy(update={"stiffness_nm_rad": stiffness * coupling.stiffness_nm_rad})
        machines.append(machine.model_copy(update={"load": load, "coupling": shaft}))
    rows = []
    for name, stroke in ours.items():
        made = [merits_of(other, follow(other, stroke.motion(), 0.0)) for other in machines]
        rows.append([name, f"{made[0].copper_n2m2s:.4g}", *(f"{m.residual_rad * 1e3:.4f}" for m in made)])
    for kind in ("third", "poly5", "scurve"):
        motion = Motion(kind=kind, distance_rad=STROKE_RAD, duration_s=0.1)
        made = [merits_of(other, follow(other, motion, 0.0)) for other in machines]
        rows.append(
            [STANDARD[kind], f"{made[0].copper_n2m2s:.4g}", *(f"{m.residual_rad * 1e3:.4f}" for m in made)]
        )
    for shaper in ("zv", "zvd"):
        made = []
        for other in machines:
            demand = shaped_demand(model, shaper, STROKE_RAD, 0.1, STROKE_RAD, sampled(other, 0.1))
            assert demand is not None
            made.append(merits_of(other, follow_demand(other, demand, 0.1, 0.0)))
        rows.append(
            [shaper.upper(), f"{made[0].copper_n2m2s:.4g}", *(f"{m.residual_rad * 1e3:.4f}" for m in made)]
        )
    head = ["", "copper N²m²s"]
    for stiffness, inertia in cases:
        parts = [f"k {stiffness - 1:+.0%}"] * (stiffness != 1) + [f"J {inertia - 1:+.0%}"] * (inertia != 1)
        head.append(" ".join(parts) or "as believed")
    markdown(head, rows)


def pictures(found: Comparison, machine: Machine, folder: Path) -> None:
    """The pictures of docs/optimise.md that need no bus."""
    ours, reference = (shown_of(c.name, c.followed) for c in (found.ours, found.reference))
    angle = np.linspace(0.0, STROKE_RAD, 400)
    (folder / "optimise-motion.png").write_bytes(to_png(motion_figure(ours, reference, TORQUE_NM)))
    figure = angle_figure(ours, reference, angle, machine.load_inertia_at(angle))
    (folder / "optimise-angle.png").write_bytes(to_png(figure))


def main() -> None:
    machine = paper_machine()
    follow(
        machine, Motion(distance_rad=1.0, duration_s=0.1), 0.0
    )  # compiled, or loaded from the cache, from here on
    made = paper_table(machine)
    cold_start()
    genetic_effort(machine)
    pick_and_place(machine)
    fastest(machine)
    other_than_believed(machine)
    if "--docs" in sys.argv:
        pictures(made[-1], machine, Path(__file__).parent.parent / "docs")


if __name__ == "__main__":
    main()
