"""Frequency responses at standstill: planned, measured, fitted, and what they propose."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

from schwung.api.values import Machine, machine_shown
from schwung.commissioning import Wishes
from schwung.commissioning.bode import PreparedBode, measure_bode, prepare_bode
from schwung.commissioning.bode_excitation import BodeWishes
from schwung.commissioning.bode_result import BODE_FILE, FORMAT, VERSION, read_bode
from schwung.drivetrain import Machine as BelievedMachine
from schwung.estimation.bode import fit_bode
from schwung.estimation.bode_values import BodeFit
from schwung.estimation.proposal import Proposal, Stroke, propose
from schwung.estimation.response import measured_responses
from schwung.session import Session as RecordedSession
from schwung.session.gains import with_recorded_gains

__all__ = [
    "BODE_FILE",
    "FORMAT",
    "VERSION",
    "BelievedMachine",
    "BodeFit",
    "BodeUse",
    "BodeWishes",
    "PreparedBode",
    "Proposal",
    "RecordedSession",
    "Stroke",
    "fit_bode",
    "measure_bode",
    "measured_responses",
    "prepare_bode",
    "propose",
    "read_bode",
    "with_bode",
    "with_recorded_gains",
]


@dataclass(frozen=True)
class BodeUse:
    """What a frequency response has told."""

    wishes: Wishes
    machine: Machine


def with_bode(folder: Path, wishes: Wishes, machine: Machine) -> BodeUse:
    """Wishes and belief with what `schwung bode` has found: its proposal; stiffness, damping and motor inertia.

    Raises InputError where the folder holds no such result.
    """
    measured = read_bode(folder)
    return BodeUse(measured.wishes(wishes), machine_shown(measured.machine(machine)))
