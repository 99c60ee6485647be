"""`schwung commission`: plan, preflight, ask, move, estimate, report, and where wanted export."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import Annotated

import typer

from schwung.cli.options import (
    INJECTION,
    Amplitude,
    Bitrate,
    BusOption,
    CanLog,
    Channel,
    DryRun,
    FollowingError,
    Interface,
    Json,
    Machine,
    MaxJitter,
    MaxPosition,
    MaxSpeed,
    MaxTorque,
    MinPosition,
    Misses,
    Node,
    Out,
    Profile,
    Rate,
    Reference,
    Yes,
    connected,
    export_choice,
    one_of,
    quantity,
)
from schwung.errors import InputError

_MOTION = "Motion"


def commission(
    machine: Machine,
    distance: Annotated[
        float | None, quantity("angle", "RAD", "Stroke, signed; e.g. 180deg.", _MOTION, signed=True)
    ] = None,
    duration: Annotated[
        float | None, quantity("time", "S", "Time of one stroke; e.g. 250ms.", _MOTION)
    ] = None,
    plan: Annotated[
        Path | None,
        typer.Option(
            metavar="PLAN",
            help="In place of --distance, --duration and the injection: what schwung explain --next has written, "
            "within its limits.",
            rich_help_panel=_MOTION,
        ),
    ] = None,
    profile_kind: Annotated[
        str, typer.Option(help="third, poly5, scurve or cosine.", rich_help_panel=_MOTION)
    ] = "third",
    also: Annotated[
        list[float] | None,
        quantity(
            "time",
            "S",
            "A further, longer time of the same stroke; repeatable. For `schwung explain`: it tells what follows "
            "speed from what follows place or time, and is kept aside for the proof.",
            _MOTION,
        ),
    ] = None,
    one_way: Annotated[
        bool, typer.Option("--one-way", help="Do not move back after the stroke.", rich_help_panel=_MOTION)
    ] = False,
    mode: Annotated[
        str,
        typer.Option(
            help="csp: setpoints over the bus; pp: the drive's own profile; auto: what the drive can.",
            rich_help_panel=_MOTION,
        ),
    ] = "auto",
    min_position: MinPosition = None,
    max_position: MaxPosition = None,
    max_speed: MaxSpeed = None,
    max_torque: MaxTorque = None,
    following_error: FollowingError = None,
    bode: Annotated[
        Path | None,
        typer.Option(
            metavar="DIR",
            help="What `schwung bode` found: its proposal, its stiffness, damping and motor inertia.",
            rich_help_panel=INJECTION,
        ),
    ] = None,
    frequency: Annotated[float | None, quantity("frequency", "HZ", "Injected frequency.", INJECTION)] = None,
    amplitude: Amplitude = None,
    rate: Rate = 1000.0,
    repeats: Annotated[
        int, typer.Option(min=1, help="How often everything is made.", rich_help_panel=INJECTION)
    ] = 2,
    phases: Annotated[
        int,
        typer.Option(
            help="1: each excited motion beside one without injection; 4: four excited motions, the injection "
            "shifted by a quarter period each: several times more accurate, and for faster motions.",
            rich_help_panel=INJECTION,
        ),
    ] = 1,
    sampling: Annotated[
        str,
        typer.Option(
            help="sync: TPDOs on every SYNC; trace: the drive's own trace buffer, read out after each motion; "
            "auto: what drive and bus can.",
            rich_help_panel=INJECTION,
        ),
    ] = "auto",
    injection: Annotated[
        str,
        typer.Option(
            help="setpoints: a torque offset with every SYNC; generator: the drive's own sine; "
            "auto: what drive and bus can.",
            rich_help_panel=INJECTION,
        ),
    ] = "auto",
    trace_rate: Annotated[
        float | None,
        quantity("frequency", "HZ", "Rate of the trace; default: as fast as it holds the motion.", INJECTION),
    ] = None,
    max_jitter: MaxJitter = None,
    misses: Misses = 3,
    export: Annotated[
        str | None,
        typer.Option(
            metavar="FORM",
            help="Write the result into the drive, unless unusable: table, harmonics, mean, max or at=ANGLE; host: "
            "write nothing, play the torque beside the setpoints.",
        ),
    ] = None,
    store: Annotated[bool, typer.Option(help="Save an export in the drive's memory (1010).")] = True,
    reference: Reference = None,
    until_explained: Annotated[
        bool,
        typer.Option(
            "--until-explained",
            help="Go on with the motions that best tell apart what the recording leaves confused, until one answer has "
            "95 % or the budget is spent; no estimate, no export.",
        ),
    ] = False,
    budget: Annotated[
        int, typer.Option(help="Further motions for --until-explained, at most; an experiment takes two.")
    ] = 12,
    out: Out = None,
    dry_run: DryRun = False,
    yes: Yes = False,
    interface: Interface = None,
    channel: Channel = None,
    bitrate: Bitrate = None,
    bus: BusOption = None,
    can_log: CanLog = None,
    node: Node = 1,
    profile: Profile = None,
    json_output: Json = False,
) -> None:
    """Measure the load inertia over angle on the running machine.

    Moves from where the axis stands, first without and then with an injected torque. Nothing moves before the
    motion was simulated within all limits and you said yes.

    [bold]Examples[/]

      schwung commission -m machine.toml --distance 180deg --duration 250ms -i socketcan -c can0 -n 3 --dry-run

      schwung commission -m machine.toml --distance 180deg --duration 250ms -i socketcan -c can0 -n 3 --export table

      schwung commission -m machine.toml --distance 1.2 --duration 0.4 --min-position -0.1 --max-position 1.4 -y

      schwung commission -m machine.toml --distance 180deg --duration 150ms --bode schwung-20260101-120000 --phases 4

      schwung commission -m machine.toml --distance 180deg --duration 250ms --also 400ms -i socketcan -c can0 -n 3

      schwung commission -m machine.toml --distance 180deg --duration 250ms --sampling trace --injection generator

      schwung commission -m measured.toml --distance 180deg --duration 250ms --until-explained --budget 8

      schwung commission -m measured.toml --plan next.json
    """  # fmt: skip
    from schwung import LimitWishes, Wishes, load_machine
    from schwung.api.choices import MAX_JITTER_SHARE, InjectionChoice, ModeChoice, SamplingChoice
    from schwung.api.folders import planned_folder
    from schwung.api.reports import standard_of
    from schwung.api.responses import with_bode
    from schwung.cli.console import Terminal
    from schwung.cli.flow import Ending, commission_and_show, finish

    if until_explained:
        from schwung.api.experiments import require_budget
        from schwung.cli.next_motion import until_explained_and_show

        require_budget(budget)
    if until_explained and export:
        raise InputError(
            "--export", "belongs to an estimate", "Leave out --until-explained, or export later."
        )
    terminal = Terminal(json_output)
    believed = load_machine(machine)
    choice = export_choice(export) if export else None
    limits = LimitWishes(min_position, max_position, max_speed, max_torque, following_error)
    if plan is not None:
        from schwung.api.experiments import read_plan, tighter

        _alone(distance, duration, frequency, amplitude, bode, also)
        wanted = read_plan(plan)
        wanted = replace(wanted, limits=tighter(wanted.limits, limits))
    else:
        wanted = Wishes(
            distance_rad=_needed("--distance", distance),
            duration_s=_needed("--duration", duration),
            limits=limits,
            kind=profile_kind,
            returns=not one_way,
            sample_rate_hz=rate,
            frequency_hz=frequency,
            amplitude_nm=amplitude,
            repeats=repeats,
            phases=phases,
            also_s=tuple(also or ()),
        )
    wishes = replace(
        wanted,
        mode=one_of("--mode", mode, ModeChoice),
        sampling=one_of("--sampling", sampling, SamplingChoice),
        injecting=one_of("--injection", injection, InjectionChoice),
        trace_rate_hz=trace_rate,
        max_jitter_share=MAX_JITTER_SHARE if max_jitter is None else max_jitter * wanted.sample_rate_hz,
        misses_allowed=misses,
    )
    if bode is not None:
        told = with_bode(bode, wishes, believed)
        wishes, believed = told.wishes, told.machine
    ending = Ending(choice, store, standard_of(believed, reference))
    folder = planned_folder(out)
    with connected(interface, channel, bitrate, bus, node, profile, can_log) as connection:

        def agreed(question: str) -> bool:
            return yes or terminal.ask(question)

        if until_explained:
            result = until_explained_and_show(
                connection, believed, wishes, folder, terminal, agreed, budget, dry_run
            )
        else:
            result = commission_and_show(
                connection, believed, wishes, folder, terminal, agreed, ending, dry_run
            )
    finish(terminal, result)


def _needed(option: str, value: float | None) -> float:
    """Raise InputError where neither the option nor a plan says it."""
    if value is None:
        raise InputError(option, "is missing", "Give it, or --plan with what `schwung explain --next` wrote.")
    return value


def _alone(*given: object) -> None:
    """Raise InputError where a plan is not the only one to say which motion is made."""
    if any(value is not None for value in given):
        raise InputError(
            "--plan",
            "says stroke, time and injection already",
            "Leave out --distance, --duration, --also, --frequency, --amplitude and --bode.",
        )
