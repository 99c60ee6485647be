"""What a machine file can say: causes are written, read back, and what was read is what is meant."""

from __future__ import annotations

import tempfile
from collections.abc import Sequence
from pathlib import Path

from schwung.drivetrain.machine import Machine, load_machine, write_machine
from schwung.errors import InputError
from schwung.explain.causes.known import known
from schwung.explain.publishing.learned import Found, learned


def sayable(
    machine: Machine,
    found: Sequence[Found],
    over: Sequence[str],
    visited_rad: tuple[float, float] = (0.0, 0.0),
) -> tuple[tuple[int, ...], tuple[str, ...]]:
    """Which causes a file of the machine can hold together, and a note for each other one; `over`: their coordinates.

    Where the belief misses nearly all, a curve may be fitted that is no machine, at an angle between `visited_rad`.
    """
    kept, notes = tuple[int, ...](), list[str]()
    for number, coordinate in enumerate(over):
        try:
            known(read_back(learned(machine, [found[i] for i in (*kept, number)])), *visited_rad)
        except InputError as error:
            why = f"it {error.problem}"
            notes.append(f"what depends on {coordinate} is modelled, but machine.toml cannot say it: {why}")
        else:
            kept = (*kept, number)
    return kept, tuple(notes)


def read_back(machine: Machine) -> Machine:
    """The machine as its file says it."""
    with tempfile.TemporaryDirectory(prefix="schwung-") as folder:
        path = Path(folder) / "machine.toml"
        write_machine(machine, path)
        return load_machine(path)
