"""`schwung demo`: a simulated slider-crank behind a simulated drive, commissioned end to end in one process."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from schwung.cli.options import CanLog, Json, bus_options, measured, require_plant

#: What an engineer would know before the measurement: motor and coupling from the data sheets, a guess of the load.
BELIEF = """\
# What is believed about the demo's machine before it is measured: data sheets, and a guess of the load inertia.
name = "Slider-crank"

[motor]
inertia = 0.012
viscous_friction = 0.2
peak_torque = 233.0

[coupling]
stiffness = 24963.0
damping = 8.62

[load]
viscous_friction = 0.1
inertia = 0.11
"""


def demo(
    out: Annotated[
        Path | None, typer.Option(help="Folder for session, table, report; default: schwung-<time>.")
    ] = None,
    duration: Annotated[
        float, typer.Option(parser=measured("time"), metavar="S", help="Time of one stroke.")
    ] = 0.25,
    plant: Annotated[str, typer.Option(help="slider-crank (MuJoCo) or two-mass.")] = "slider-crank",
    conceal: Annotated[str, typer.Option(metavar="NAME=VALUE,…", help="Physics to hide in the plant.")] = "",
    seed: Annotated[int, typer.Option(help="Everything random follows from it.")] = 0,
    optimise: Annotated[
        bool,
        typer.Option(
            "--optimise",
            help="Instead of an export: find the best motion with the measured table, and play it.",
        ),
    ] = False,
    can_log: CanLog = None,
    json_output: Json = False,
) -> None:
    """Commission a simulated drive on a virtual CAN bus: scan, plan, preflight, motions, estimate, export, report.

    The very driver and procedure that move a real machine; only the bus is virtual. The result is compared with
    the inertia that follows from the simulated machine's masses.

    [bold]Examples[/]

      schwung demo

      schwung demo --out first-look --duration 200ms --json

      schwung demo --optimise
    """  # fmt: skip
    import math

    import numpy as np

    from schwung import InertiaTable, LimitWishes, Wishes, connect, load_machine, write_inertia
    from schwung.api.choices import ExportChoice
    from schwung.api.folders import make_folder, planned_folder
    from schwung.api.reports import Standard
    from schwung.cli.console import Terminal
    from schwung.cli.flow import Ending, commission_and_show, finish
    from schwung.files import replace_file

    require_plant("schwung demo", plant)
    if optimise:
        from schwung.api.optimising import MotionLimits, Playing, Task, require_optimiser
        from schwung.cli.playing import play_and_show

        require_optimiser()
    from schwung_sim.bench import Bench

    terminal = Terminal(json_output)
    options = bus_options("stepped", "demo", 1_000_000, None, can_log)
    folder = planned_folder(out)
    machine_file = folder / "machine.toml"
    with (
        Bench(plant, conceal=conceal, seed=seed, channel="demo", node_id=1) as bench,
        connect(options, profile="schwung-bench") as connection,
    ):
        make_folder(folder)
        replace_file(machine_file, BELIEF)
        terminal.say(f"A simulated {plant} on a virtual CAN bus; the machine file is {machine_file}")
        angles = np.linspace(0.0, math.pi, 181)
        truth = InertiaTable(angles, bench.plant.true_inertia(angles))
        write_inertia(truth, folder / "true_inertia.csv")
        result = commission_and_show(
            connection,
            load_machine(machine_file),
            Wishes(distance_rad=math.pi, duration_s=duration),
            folder,
            terminal,
            confirm=lambda _question: True,
            ending=Ending(None if optimise else ExportChoice("table"), True, Standard(truth, "true inertia")),
        )
        if optimise:
            measured_machine = load_machine(folder / "measured.toml")
            torque = measured_machine.motor.peak_torque_nm
            result["optimised"] = play_and_show(
                connection,
                measured_machine,
                Task(0.0, math.pi, MotionLimits(torque), duration_s=duration),
                LimitWishes(),
                Playing(),
                folder / "optimised",
                terminal,
                confirm=lambda _question: True,
            )
    finish(terminal, result)
