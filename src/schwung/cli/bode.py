"""`schwung bode`: frequency responses at standstill, the drive train fitted to them, and what to inject."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

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
    Node,
    Out,
    Profile,
    Rate,
    Yes,
    bus_options,
    measured,
    quantity,
)

if TYPE_CHECKING:
    from schwung.api.responses import (
        BelievedMachine,
        BodeFit,
        BodeWishes,
        PreparedBode,
        Proposal,
        RecordedSession,
        Stroke,
    )
    from schwung.cli.console import Terminal

_MOTION = "The motion to propose for"
#: A machine that is measured at several angles is assumed to move between the outer ones in so long (s).
_USUAL_STROKE_S = 0.25


def bode(
    machine: Machine,
    angles: Annotated[
        str | None,
        typer.Option(metavar="LIST", help="Where to measure, drive coordinates; e.g. 0,90deg,180deg."),
    ] = None,
    session: Annotated[
        Path | None,
        typer.Option(metavar="FILE", help="Fit a recorded session again; nothing moves."),
    ] = None,
    waveform: Annotated[
        str,
        typer.Option(help="multisine: all frequencies at once; sine: one by one.", rich_help_panel=INJECTION),
    ] = "multisine",
    amplitude: Amplitude = None,
    lowest: Annotated[float | None, quantity("frequency", "HZ", "Lowest frequency.", INJECTION)] = None,
    highest: Annotated[
        float | None, quantity("frequency", "HZ", "Highest; at most 0.4 of the SYNC rate.", INJECTION)
    ] = None,
    periods: Annotated[int, typer.Option(min=2, help="Periods of each run.", rich_help_panel=INJECTION)] = 4,
    repeats: Annotated[int, typer.Option(min=1, help="Runs at each angle.", rich_help_panel=INJECTION)] = 2,
    rate: Rate = 1000.0,
    max_jitter: MaxJitter = None,
    min_position: MinPosition = None,
    max_position: MaxPosition = None,
    max_speed: MaxSpeed = None,
    max_torque: MaxTorque = None,
    following_error: FollowingError = None,
    distance: Annotated[
        float | None,
        quantity("angle", "RAD", "Its stroke; default: between the outer angles.", _MOTION, signed=True),
    ] = None,
    duration: Annotated[float, quantity("time", "S", "Its time.", _MOTION)] = _USUAL_STROKE_S,
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
    """Measure the response from torque to speed at standstill, and fit motor inertia, stiffness, damping, load inertia.

    Moves slowly to each angle and injects there. Nothing moves before it was simulated within all limits and you said
    yes. Ends with a proposal of frequency and amplitude, which `schwung commission --bode FOLDER` takes together with
    what was fitted, and a machine.toml as fitted.

    [bold]Examples[/]

      schwung bode -m machine.toml --angles 0,90deg,180deg -i socketcan -c can0 -n 3

      schwung bode -m machine.toml --angles 0.2,1.4 --waveform sine --duration 150ms --dry-run

      schwung bode -m machine.toml --session schwung-20260101-120000/session.h5 --json
    """  # fmt: skip
    from schwung import LimitWishes, connect, load_machine
    from schwung.api.choices import MAX_JITTER_SHARE
    from schwung.api.folders import planned_folder
    from schwung.api.responses import BodeWishes
    from schwung.cli.console import Terminal
    from schwung.errors import InputError

    terminal, believed = Terminal(json_output), load_machine(machine)
    if (angles is None) == (session is None):
        raise InputError("--angles", "and --session: one of them is needed", "Give --angles to measure.")
    if session is not None:
        _offline(terminal, believed, session, out, distance, duration)
        return
    if waveform not in ("multisine", "sine"):
        raise InputError("--waveform", f'is "{waveform}"', "Use multisine or sine.")
    wishes = BodeWishes(
        angles_rad=parse_angles(angles or ""),
        limits=LimitWishes(min_position, max_position, max_speed, max_torque, following_error),
        waveform="sine" if waveform == "sine" else "multisine",
        amplitude_nm=amplitude,
        lowest_hz=lowest,
        highest_hz=highest,
        periods=periods,
        repeats=repeats,
        sample_rate_hz=rate,
        max_jitter_share=MAX_JITTER_SHARE if max_jitter is None else max_jitter * rate,
    )
    folder = planned_folder(out)
    options = bus_options(interface, channel, bitrate, bus, can_log)
    with connect(options, node=node, profile=profile) as opened:
        terminal.result(
            measure_and_show(
                opened.drive, opened.profile, believed, wishes, folder, terminal,
                confirm=lambda question: yes or terminal.ask(question),
                motion=(distance, duration), dry_run=dry_run,
            )
        )  # fmt: skip


def parse_angles(text: str) -> tuple[float, ...]:
    """ "0,90deg,180deg" in rad. Raises InputError where one of them is no angle."""
    from schwung.errors import InputError

    try:
        angle = measured("angle", signed=True)
        return tuple(angle(part) for part in text.split(",") if part.strip())
    except typer.BadParameter as error:
        raise InputError("--angles", str(error).rstrip("."), "Write for instance 0,90deg,180deg.") from None


def measure_and_show(
    drive: Any,
    profile: Any,
    believed: BelievedMachine,
    wishes: BodeWishes,
    folder: Path,
    terminal: Terminal,
    confirm: Any,
    motion: tuple[float | None, float],
    dry_run: bool,
) -> dict[str, Any]:
    """Plan, ask, measure, show; returns the machine-readable result.

    Raises RefusedError where preflight or the user say no, and what the procedure raises.
    """
    from schwung.api.folders import make_folder
    from schwung.api.responses import measure_bode, prepare_bode
    from schwung.cli.console import observing
    from schwung.errors import RefusedError

    prepared = prepare_bode(drive, profile, believed, wishes)
    _show_plan(terminal, prepared, wishes)
    checks = [vars(check) for check in prepared.preflight.checks]
    prepared.preflight.require()
    if dry_run:
        terminal.say("Dry run: nothing was changed, nothing moved.")
        return {"preflight": checks}
    if not confirm("The machine will move. Is it clear?"):
        raise RefusedError("bode", "you said no", "Nothing was changed, nothing moved.")
    make_folder(folder)
    with observing(terminal) as observer:
        done = measure_bode(drive, prepared, folder, observer, wishes.max_jitter_share)
    limit = prepared.plan.limits.torque_max_nm
    rows = [(c.severity, c.name, c.text, c.remedy) for c in prepared.preflight.checks]
    shown = _show(terminal, done.session, done.fit, prepared.machine, folder, limit, motion, rows)
    return {"preflight": checks} | shown


def _offline(
    terminal: Terminal,
    believed: BelievedMachine,
    path: Path,
    out: Path | None,
    distance: float | None,
    duration: float,
) -> None:
    from schwung import read_session
    from schwung.api.folders import output_folder
    from schwung.api.responses import fit_bode, measured_responses, with_recorded_gains

    session = read_session(path)
    believed = with_recorded_gains(believed, session)
    fit = fit_bode(measured_responses(session), believed)
    folder = output_folder(out)
    motion = (distance, duration)
    terminal.result(_show(terminal, session, fit, believed, folder, None, motion, ()))


def _show_plan(terminal: Terminal, prepared: PreparedBode, wishes: BodeWishes) -> None:
    limits = prepared.plan.limits
    terminal.table(
        "Plan",
        ("", ""),
        (
            ("angles", ", ".join(f"{angle:.4g}" for angle in wishes.angles_rad) + " rad, slowly, and back"),
            ("recording", f"{len(prepared.runs)} runs at {wishes.sample_rate_hz:g} Hz, "
                          f"{prepared.duration_s:.1f} s of bus time"),
            ("limits", f"{limits.position_min_rad:.4g} … {limits.position_max_rad:.4g} rad, "
                       f"{limits.speed_max_rad_s:.4g} rad/s, {limits.torque_max_nm:.4g} N·m, "
                       f"following error {limits.following_error_rad:.3g} rad"),
            *(("injection", reason) for reason in prepared.plan.reasons),
        ),
    )  # fmt: skip
    terminal.checks((c.name, c.severity, c.text, c.remedy) for c in prepared.preflight.checks)


def _show(
    terminal: Terminal,
    session: RecordedSession,
    fit: BodeFit,
    believed: BelievedMachine,
    folder: Path,
    torque_max_nm: float | None,
    motion: tuple[float | None, float],
    checks: Any,
) -> dict[str, Any]:
    """Tables, proposal, files; returns the machine-readable result."""
    from schwung import write_machine
    from schwung.api.reports import BodeContent, angle_rows, parameter_rows, write_bode_report
    from schwung.api.responses import BODE_FILE, FORMAT, VERSION
    from schwung.files import json_text, replace_file

    terminal.table(
        "Load inertia at each angle",
        ("angle", "J_l, kg·m²", "± (95 %)", "anti-resonance, Hz", "resonance, Hz"),
        angle_rows(fit),
    )
    terminal.table("Drive train", ("", "fitted", "± (95 %)", "believed", ""), parameter_rows(fit, believed))
    for note in fit.notes:
        terminal.say(f"[cyan]i[/] {note}")
    found = fit.machine(believed)
    stroke = _stroke(fit, *motion)
    proposal = _proposal(terminal, fit, found, torque_max_nm, stroke)
    write_machine(found, folder / "machine.toml")
    title = f"{believed.name}: frequency response at standstill"
    write_bode_report(BodeContent(title, session, fit, believed, proposal, checks), folder / "report.html")
    files = {name: str(folder / name) for name in ("machine.toml", "report.html", "bode.png")}
    proposed = proposal and proposal.to_json() | {"stroke": stroke and vars(stroke)}
    head = {"format": FORMAT, "version": VERSION}
    result = head | fit.to_json() | {"proposal": proposed, "files": files}
    replace_file(folder / BODE_FILE, json_text(result))
    terminal.say(f"To use all of it: [bold]schwung commission --bode {folder} …[/]")
    terminal.say(
        f"Machine as fitted: [bold]{files['machine.toml']}[/]  Report: [bold]{files['report.html']}[/]"
    )
    return result


def _stroke(fit: BodeFit, distance: float | None, duration: float) -> Stroke | None:
    """The motion to propose for: as given, or between the outer angles; None where there is one angle only."""
    from schwung.api.responses import Stroke

    span = fit.angles[-1].position_rad - fit.angles[0].position_rad
    way = distance if distance is not None else span
    return Stroke(way, duration) if way else None


def _proposal(
    terminal: Terminal,
    fit: BodeFit,
    machine: BelievedMachine,
    torque_max_nm: float | None,
    stroke: Stroke | None,
) -> Proposal | None:
    """The proposal in words; None where the gains are not known, which is said."""
    from schwung.api.responses import propose

    if machine.control is None:
        terminal.say(
            "[cyan]i[/] No proposal: the controller's gains are not known. Give \\[control] in the machine file."
        )
        return None
    proposal = propose(fit, machine, fit.responses[0].sample_rate_hz, torque_max_nm, stroke)
    best = proposal.best
    terminal.say(
        f"Proposal: [bold]--frequency {best.frequency_hz:.6g} --amplitude {best.amplitude_nm:.3g}[/]"
        + (f" for {stroke.distance_rad:.4g} rad in {stroke.duration_s * 1e3:g} ms" if stroke else "")
    )
    for reason in proposal.reasons:
        terminal.say(f"  · {reason}")
    phased = proposal.in_phases
    terminal.say(
        f"With four phases: [bold]--phases 4 --frequency {phased.frequency_hz:.6g} --amplitude "
        f"{phased.amplitude_nm:.3g}[/], expected error {phased.sharp_kgm2:.2g} kg·m²: no window blurs the curve"
    )
    return proposal
