"""Torques that are currents: a belief and a recording have to be of one kind."""

from __future__ import annotations

from schwung.drivetrain import Machine
from schwung.errors import InputError
from schwung.session.model import Session


def require_alike(session: Session, machine: Machine) -> None:
    """Raises InputError where one of session and machine is in A and the other in N·m."""
    if session.effort == machine.effort:
        return
    if session.effort == "current":
        raise InputError(
            f'machine "{machine.name}"', "is in N·m, the session in A, and how many N·m an ampere makes is unknown",
            'Give the machine in A, with effort = "current" at its top (inertia in A·s²/rad), or import the recording '
            "again with --torque-unit A=N·m per ampere.",
        )  # fmt: skip
    raise InputError(f'machine "{machine.name}"', "is in A, the session in N·m",
                     'Give the machine in N·m, without effort = "current".')  # fmt: skip
