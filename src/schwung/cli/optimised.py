"""What `schwung optimise` found, as people read it."""

from __future__ import annotations

from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from schwung.api.optimising import Contender, Optimised
    from schwung.cli.console import Terminal


def tell(terminal: Terminal, found: Optimised) -> None:
    """The comparison as people read it."""
    electrical = found.machine.motor.electrical is not None
    head = ["", "ms", "RMS N·m", "peak N·m", "copper", "residual mrad", "breaks"]
    if electrical:
        head.insert(5, "drawn J")
    base = found.reference.merits.copper_n2m2s

    def row(contender: Contender) -> list[str]:
        merits = contender.merits
        cells = [
            contender.name,
            f"{contender.duration_s * 1e3:.1f}",
            f"{merits.rms_torque_nm:.2f}",
            f"{merits.peak_torque_nm:.1f}",
            f"{merits.copper_n2m2s / base:.1%}",
            f"{merits.residual_rad * 1e3:.4f}",
            ", ".join(contender.broken),
        ]
        if merits.drawn_j is not None and merits.drawn_one_way_j is not None:
            drawn = merits.drawn_j if found.task.regeneration else merits.drawn_one_way_j
            cells.insert(5, f"{drawn:.2f}")
        return cells

    terminal.table("Motions, each in its own time", head, [row(c) for c in (found.ours, *found.rivals)])
    terminal.say(
        f"Copper loss [bold]{found.copper_saving:.1%}[/] below the 1/3 trapezoid's in the same time; "
        f"found in {found.stroke.iterations} iterations"
    )
    if found.left_out:
        terminal.say(f"[yellow]Not planned with:[/] {', '.join(found.left_out)}")
