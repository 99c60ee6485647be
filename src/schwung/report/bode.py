"""The page about a frequency response: what was fitted, how surely, and what to inject."""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field
from html import escape
from pathlib import Path

from schwung.drivetrain import Machine
from schwung.estimation.bode_values import BodeFit, Fitted
from schwung.estimation.proposal import Proposal
from schwung.report.figures_bode import bode_figure, proposal_figure
from schwung.report.html import bullets, drawn_figure, page, rows_table, section, write_page
from schwung.report.pictures import Picture
from schwung.report.style import to_png
from schwung.session import Session


@dataclass(frozen=True, eq=False)
class BodeContent:
    """Everything that the page shows."""

    title: str
    session: Session
    fit: BodeFit
    believed: Machine | None = None
    proposal: Proposal | None = None
    checks: Sequence[tuple[str, str, str, str]] = field(default=())  # severity, name, text, remedy


def write_bode_report(content: BodeContent, path: Path) -> Path:
    """Write the page to `path` and its main picture as `bode.png` beside it.

    Raises InputError where they cannot be written.
    """
    write_page(render_bode(content), path)
    path.with_name("bode.png").write_bytes(to_png(bode_figure(content.fit)))
    return path


def render_bode(content: BodeContent) -> str:
    """The whole page as text."""
    fit, session = content.fit, content.session
    facts = (session.created.replace("T", " ", 1), session.source)
    line = " · ".join(escape(fact) for fact in facts if fact)
    caption = (
        "Circles: measured, with one standard deviation; lines: two masses, fitted to all angles at once. "
        + ("Delay and the images of the held injection are taken out. " if _was_held(fit) else "")
        + "Crosses were not fitted."
    )
    head = ("", "Fitted", "± (95 %)", "Believed", "")
    angles = ("Angle", "Load inertia, kg·m²", "± (95 %)", "Anti-resonance, Hz", "Resonance, Hz")
    parts = [
        f"<header><h1>{escape(content.title)}</h1><p>{line}</p></header>",
        drawn_figure(Picture("bode", "Frequency response", caption, bode_figure(fit))),
        section("Load inertia at each angle", rows_table(angles, angle_rows(fit))),
        section("Drive train", rows_table(head, list(parameter_rows(fit, content.believed)))),
        section("What to mind", bullets(fit.notes)),
        _proposed(content.proposal),
        section("Preflight", rows_table(("Result", "Check", "Found", "Remedy"), content.checks, marked=True)),
        "<footer>Written by Schwung. This file needs nothing else: keep it, mail it, print it.</footer>",
    ]
    return page(content.title, [part for part in parts if part])


def _was_held(fit: BodeFit) -> bool:
    return any(response.hold_s for response in fit.responses)


def _proposed(proposal: Proposal | None) -> str:
    if proposal is None:
        return ""
    caption = "Noise and model from this recording; blur is what a window of one period makes of the motion."
    figure = drawn_figure(Picture("proposal", "Expected error", caption, proposal_figure(proposal)))
    title = f"Inject {proposal.best.amplitude_nm:.3g} N·m at {proposal.best.frequency_hz:.4g} Hz"
    return section(title, bullets(proposal.reasons) + figure)


def angle_rows(fit: BodeFit) -> list[tuple[str, str, str, str, str]]:
    """Angle, J_l, half of its 95 % interval, anti-resonance, resonance: as text."""
    rows = []
    for angle in fit.angles:
        position = f"{angle.position_rad:.4g} rad ({math.degrees(angle.position_rad):.4g}°)"
        rows.append(
            (
                position,
                f"{angle.inertia.value:.5g}",
                f"{angle.inertia.half_width:.2g}",
                _with_interval(angle.anti_resonance),
                _with_interval(angle.resonance),
            )
        )
    return rows


def _with_interval(fitted: Fitted | None) -> str:
    return "" if fitted is None else f"{fitted.value:.4g} ± {fitted.half_width:.2g}"


def parameter_rows(fit: BodeFit, believed: Machine | None) -> Iterator[tuple[str, str, str, str, str]]:
    """Name with unit, value, half of its 95 % interval, belief, remark: as text."""
    beliefs = _beliefs(believed) if believed is not None else {}
    rows = (
        ("motor inertia, kg·m²", fit.rotor),
        ("stiffness, N·m/rad", fit.stiffness),
        ("damping, N·m·s/rad", fit.damping),
        ("motor friction, N·m·s/rad", fit.rotor_friction),
        ("load friction, N·m·s/rad", fit.load_friction),
    )
    for name, fitted in rows:
        if fitted is not None:
            yield (
                name,
                f"{fitted.value:.5g}",
                f"{fitted.half_width:.2g}",
                f"{beliefs[name]:.5g}" if name in beliefs else "",
                _remark(name, fitted),
            )
    yield "reporting delay, µs", f"{fit.delay.value * 1e6:.1f}", f"{fit.delay.half_width * 1e6:.1f}", "", ""


def _remark(name: str, fitted: Fitted) -> str:
    if not fitted.determined:
        return "not determined: the belief is kept"
    return "of a small vibration: the belief is kept" if "friction" in name else ""


def _beliefs(machine: Machine) -> dict[str, float]:
    """The believed values by the names of the rows."""
    found = {
        "motor inertia, kg·m²": machine.motor.inertia_kgm2,
        "motor friction, N·m·s/rad": machine.motor.viscous_friction_nms,
        "load friction, N·m·s/rad": machine.load.viscous_friction_nms,
    }
    if machine.coupling is not None:
        found["stiffness, N·m/rad"] = machine.coupling.stiffness_nm_rad
        found["damping, N·m·s/rad"] = machine.coupling.damping_nms
    return found
