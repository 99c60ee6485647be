"""Sessions of the virtual machine room that conceal physics, as short as what is asked of them allows."""

from __future__ import annotations

from collections import Counter
from dataclasses import replace
from pathlib import Path
from typing import Any

from schwung.drivetrain import load_machine
from schwung.drivetrain.machine import Machine
from schwung.session import Session, read_session
from schwung_sim.sealed import CaseWishes, draw_case, read_labels, write_case


def drawn(folder: Path, seed: int, each: int = 1, **wishes: Any) -> tuple[Session, Machine, dict[str, Any]]:
    """A recorded session, the belief, and what it conceals.

    each: so many runs of each motion time, without and with injection; a sealed case has up to four. The search's work
    grows with them, what there is to be named does not.
    """
    write_case(draw_case(seed, CaseWishes(**wishes)), folder, "0000")
    place = folder / "sessions" / "0000"
    (label,) = read_labels(folder)
    session = read_session(place / "session.h5")
    return fewer(session, each), load_machine(place / "machine.toml"), dict(label)


def fewer(session: Session, each: int) -> Session:
    """The first runs of each motion time and role."""
    seen: Counter[tuple[str, float]] = Counter()
    runs = []
    for run in session.runs:
        assert run.motion is not None
        seen[run.role, run.motion.duration_s] += 1
        if seen[run.role, run.motion.duration_s] <= each:
            runs.append(run)
    return replace(session, runs=tuple(runs))
