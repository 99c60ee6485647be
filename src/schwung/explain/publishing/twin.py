"""A simulator as the belief: what the machine that stands in for it misses of it, the simulator does not miss.

The simulator was played along the very runs (`twin`). The torque that the stand-in asks for beyond the simulator's is
taken off the recorded one, so that what is weighed about the stand-in is what the simulator misses.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from schwung.drivetrain.machine import Machine
from schwung.errors import InputError
from schwung.explain.causes.along import ranges_of
from schwung.explain.causes.candidate import NATURAL
from schwung.explain.causes.known import known
from schwung.explain.causes.true_torque import TrueTorque
from schwung.explain.weighing.round import View, at_rest
from schwung.explain.weighing.weigh import STICKING, band_of
from schwung.innovations.likelihood import Noise
from schwung.innovations.signals import picked_signals_of
from schwung.session.model import Session

#: A simulator's angle and speed are followed as closely as this, over their ranges.
_CLOSELY = 1e-6


def as_missed_by(session: Session, machine: Machine, twin: Session) -> Session:
    """The session with the torque that a machine misses of what the simulator misses; `machine`: which stands in.

    Raises InputError where the twin is not run for run, sample for sample.
    """
    if [len(run) for run in twin.runs] != [len(run) for run in session.runs]:
        raise InputError("twin", "has other runs than the recording", "Play it along every run.")
    band = band_of(session)
    runs = tuple(picked_signals_of(run, machine, band) for run in twin.runs)
    of = ranges_of(list(runs), STICKING, band)
    torques = tuple(TrueTorque(run, run.drive.whole_nm) for run in runs)
    view = View(twin.runs, runs, known(machine, of.low_rad, of.high_rad), of, torques, dry_nm=0.0)
    span = max(of.span_rad, 1e-12)
    noise = Noise(NATURAL * of.peak_torque_nm, _CLOSELY * of.peak_speed_rad_s, _CLOSELY * span)
    about = at_rest(view, (), noise)
    asked = [np.asarray(about.passed[number].torque_error_nm) for number in range(len(runs))]
    corrected = (
        replace(run, torque_nm=run.torque_nm - beyond)
        for run, beyond in zip(session.runs, asked, strict=True)
    )
    return replace(session, runs=tuple(corrected))
