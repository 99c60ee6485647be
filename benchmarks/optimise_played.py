"""The best motion through the whole bus chain: saving measured against promised, wrong tables, named physics.

    python benchmarks/optimise_played.py            some two minutes
    python benchmarks/optimise_played.py --docs     the same, and docs/optimise-played.png

Every machine is commissioned first: what is optimised with is the table that was measured. Reference and optimised
motion are played in turn, three times; the reference gets the torque that a drive makes of that table.
"""

from __future__ import annotations

import io
import shutil
import sys
import tempfile
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from itertools import count
from pathlib import Path
from typing import Any

import numpy as np
from rich.console import Console

from optimise import markdown
from schwung import (
    Connection,
    InertiaTable,
    LimitWishes,
    Machine,
    Wishes,
    connect,
    load_machine,
    read_session,
)
from schwung.api.computing import explain
from schwung.api.optimising import MotionLimits, Playing, Task
from schwung.cli.console import Terminal
from schwung.cli.demo import BELIEF
from schwung.cli.flow import Ending, commission_and_show
from schwung.cli.playing import play_and_show
from schwung_sim.bench import Bench

STROKE_RAD = np.pi
#: What hides in the plant of the last table: gravity on a crank, and dry friction that holds it where it starts.
CONCEALED = "load_torque:amplitude_nm=20:phase_rad=0.1,coulomb_friction=4"
_channels = count()


@dataclass(frozen=True)
class Room:
    """A bench drive, connected, and a folder."""

    connection: Connection
    folder: Path

    def commission(self, **wishes: Any) -> Machine:
        """Measure; the machine as measured."""
        file = self.folder / "machine.toml"
        file.write_text(BELIEF, encoding="utf-8")
        commission_and_show(
            self.connection, load_machine(file),
            Wishes(distance_rad=STROKE_RAD, duration_s=0.25, **wishes), self.folder, silent(),
            confirm=lambda _question: True, ending=Ending(),
        )  # fmt: skip
        return load_machine(self.folder / "measured.toml")

    def play(self, machine: Machine, duration_s: float, against: str = "third") -> dict[str, Any]:
        """Optimise and play; the machine-readable result."""
        out = self.folder / f"played-{next(_channels)}"
        task = Task(0.0, STROKE_RAD, MotionLimits(machine.motor.peak_torque_nm), duration_s=duration_s)
        return play_and_show(
            self.connection, machine, task, LimitWishes(),
            Playing(against, rivals=False), out, silent(), confirm=lambda _question: True,
        ) | {"out": out}  # fmt: skip


@contextmanager
def room(plant: str, conceal: str = "", seed: int = 0) -> Iterator[Room]:
    """A machine room in this process."""
    channel = f"optimise-{next(_channels)}"
    with (
        tempfile.TemporaryDirectory() as folder,
        Bench(plant, conceal=conceal, seed=seed, channel=channel, node_id=1),
        connect("stepped", channel, bitrate=1_000_000, profile="schwung-bench") as connection,
    ):
        yield Room(connection, Path(folder))


def silent() -> Terminal:
    """A terminal that nobody reads."""
    terminal = Terminal(json_output=True)
    terminal.console = Console(file=io.StringIO())
    return terminal


def scaled(machine: Machine, factor: float) -> Machine:
    """The machine with all its load inertia so many times what was measured."""
    table = machine.load.inertia_table
    assert table is not None
    wrong = InertiaTable(table.position_rad, factor * table.inertia_kgm2, table.std_kgm2)
    return machine.model_copy(update={"load": machine.load.model_copy(update={"inertia_table": wrong})})


def percent(played: dict[str, Any], name: str) -> str:
    """Measured and promised saving of one merit."""
    found = played[name]
    if found["saving"] is None:
        return "–"
    half = found["saving"]["half"]
    return f"{found['saving']['mean']:.1%} ± {half:.2%} ({found['predicted_saving']:.1%})"


def multi_body(keep: Path | None) -> None:
    """MuJoCo's slider-crank: durations, and tables that are wrong."""
    print("## Played on the multi-body slider-crank, from the measured table: measured (promised)\n")
    rows = []
    with room("slider-crank") as made:
        machine = made.commission()
        for duration, against in (
            (0.5, "third"),
            (0.25, "third"),
            (0.2, "third"),
            (0.15, "third"),
            (0.12, "scurve"),
        ):
            result = made.play(machine, duration, against)
            played = result["played"]
            rows.append([
                f"{duration * 1e3:.0f}", against, percent(played, "copper_n2m2s"), percent(played, "mechanical_j"),
                percent(played, "peak_torque_nm"),
                f"{played['peak_following_rad']['reference']['mean'] * 1e3:.2f} → "
                f"{played['peak_following_rad']['optimised']['mean'] * 1e3:.2f}",
                f"{played['settling_s']['reference']['mean'] * 1e3:.0f} → "
                f"{played['settling_s']['optimised']['mean'] * 1e3:.0f}",
            ])  # fmt: skip
            if keep is not None and duration == 0.25:
                shutil.copy(result["out"] / "played.png", keep / "optimise-played.png")
        head = (
            "ms", "against", "copper saved", "energy put in saved", "peak torque saved", "following error mrad",
            "settling ms",
        )  # fmt: skip
        markdown(head, rows)
        print("## The same with a table that is wrong throughout, 250 ms\n")
        rows = []
        for factor in (1.0, 0.9, 1.1):
            played = made.play(scaled(machine, factor), 0.25)["played"]
            copper = played["copper_n2m2s"]
            rows.append([
                f"{factor - 1:+.0%}", f"{copper['optimised']['mean']:.1f}", percent(played, "copper_n2m2s"),
                f"{played['peak_following_rad']['optimised']['mean'] * 1e3:.2f}",
                f"{played['settling_s']['optimised']['mean'] * 1e3:.0f}",
            ])  # fmt: skip
        markdown(
            ("table", "copper N²m²s, measured", "copper saved", "following error mrad", "settling ms"), rows
        )


def named_physics() -> None:
    """A machine with gravity and dry friction, optimised with what `explain` made of it, and without."""
    print(f"## With physics that `explain` has named, and without: {CONCEALED}\n")
    rows = []
    with room("two-mass", CONCEALED) as made:
        measured = made.commission(also_s=(0.4,), phases=4)
        session = read_session(made.folder / "session.h5")
        learned = explain(session, measured).machine
        print("named:", ", ".join(term.name for term in learned.physics) or "nothing", "\n")
        for duration in (0.4, 0.25):
            for name, machine in (("measured", measured), ("measured and named", learned)):
                played = made.play(machine, duration)["played"]
                copper = played["copper_n2m2s"]
                rows.append([
                    f"{duration * 1e3:.0f}", name, f"{copper['optimised']['mean']:.1f}",
                    f"{copper['predicted_optimised']:.1f}", percent(played, "copper_n2m2s"),
                    f"{played['peak_following_rad']['optimised']['mean'] * 1e3:.2f}",
                ])  # fmt: skip
    markdown(("ms", "machine", "copper N²m²s", "promised", "copper saved", "following error mrad"), rows)


def main() -> None:
    multi_body(Path(__file__).parent.parent / "docs" if "--docs" in sys.argv else None)
    named_physics()


if __name__ == "__main__":
    main()
