"""One commissioned session, simulated and estimated with the tool's own parts, for the tests of this room."""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cache

import numpy as np

from schwung.drivetrain.inertia import InertiaTable
from schwung.drivetrain.machine import paper_machine
from schwung.drivetrain.simulation import FeedForward, Simulated, simulate
from schwung.estimation import Estimate, estimate
from schwung.motion import Excitation, Motion
from schwung.report.content import ChangeRow, FollowingError, ReportContent, SyncRow
from schwung.session import Run, Session

RATE_HZ = 1000.0
MOTION = Motion(distance_rad=np.pi, duration_s=0.3)
SINE = Excitation(frequency_hz=50.0, amplitude_nm=46.6, ramp_s=0.04, end_s=MOTION.total_s)


@dataclass(frozen=True)
class Row:
    """A preflight check as commissioning makes them."""

    name: str
    severity: str
    text: str
    remedy: str = ""


def _simulated(sine: Excitation | None, feed_forward: FeedForward | None = None) -> Simulated:
    time = MOTION.time(RATE_HZ)
    added = sine.torque(time) if sine else None
    return simulate(paper_machine(), MOTION.demand(time), time, added, feed_forward=feed_forward)


def _run(sine: Excitation | None) -> Run:
    simulated = _simulated(sine)
    return Run(
        role="excited" if sine else "reference",
        repeat=0,
        sample_rate_hz=RATE_HZ,
        time_s=simulated.time_s,
        position_rad=simulated.position_rad,
        speed_rad_s=simulated.speed_rad_s,
        torque_nm=simulated.torque_nm,
        position_demand_rad=simulated.demand_position_rad,
        motion=MOTION,
        excitation=sine,
        name="/run/0001" if sine else "/run/0000",
    )


@cache
def session() -> Session:
    """A reference run and an excited one, from a drive with a hostile name."""
    return Session(
        runs=(_run(None), _run(SINE)),
        created="2025-03-04T05:06:07+00:00",
        source="simulated",
        drive={"identity": {"serial": 7, "name": "<script>alert(1)</script>"}, "modes": ["csp", "pp"]},
    )


@cache
def estimated() -> Estimate:
    """The denoised estimate of that session."""
    return estimate(session(), paper_machine())


def bare() -> ReportContent:
    """Title and session, nothing else."""
    return ReportContent("Bare", session())


@cache
def full() -> ReportContent:
    """Everything that a report can show."""
    machine = paper_machine()
    truth = machine.load_inertia
    assert isinstance(truth, InertiaTable)
    before = _simulated(None, FeedForward(speed_share=1.0))
    after = _simulated(None, FeedForward(speed_share=1.0, inertia=truth))
    return replace(
        bare(),
        title="Press <7> & friends",
        machine=machine,
        estimate=estimated(),
        contrast=estimate(session(), machine, "former"),
        reference=truth,
        reference_label="true <i>inertia</i> at $5 & $6",
        preflight=(
            Row("Bus load", "ok", "38 % at 1 kHz"),
            Row("Peak torque", "stop", "251 N·m against 233 N·m", "Move more <slowly>."),
        ),
        changes=(ChangeRow("0x2302:01 Feed-forward mode", "0", "2", "exported & read back"),),
        following_error=FollowingError(
            before.time_s, before.following_error_rad, after.time_s, after.following_error_rad
        ),
        sync=(SyncRow("/run/0000", "kernel", 1e-3, 11e-6, 38e-6, 1.2e-3),),
        settings={"Mode": "cyclic <position>"},
        notes=("Mind the <gap>.",),
    )
