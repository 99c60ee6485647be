"""A machine whose file says nothing of its controller, with the gains that the drive had when it was recorded."""

from __future__ import annotations

from schwung.drivetrain.gains import with_control
from schwung.drivetrain.machine import Machine
from schwung.errors import InputError
from schwung.session.model import Session


def with_recorded_gains(machine: Machine, session: Session) -> Machine:
    """The machine with the gains that the session's drive had, where the file has none and the session says."""
    recorded = ((session.drive or {}).get("settings") or {}).get("control")
    if machine.control is not None or not isinstance(recorded, dict):
        return machine
    gains = {name: value for name, value in recorded.items() if isinstance(value, float)}
    try:
        return with_control(machine, gains)
    except InputError:
        return machine
