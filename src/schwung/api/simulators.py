"""A machine as a model of other simulators: FMU, Modelica, MATLAB; and their FMU as the belief."""

from __future__ import annotations

import os
from collections.abc import Callable
from dataclasses import dataclass, replace

from schwung import drivetrain
from schwung import session as recording
from schwung.api.explaining import Explanation, explanation_shown
from schwung.api.values import Machine, machine_shown
from schwung.explain.publishing.publish import publish
from schwung.session.gains import with_recorded_gains
from schwung.simulators.belief import FmuBelief, fmu_belief
from schwung.simulators.fmu import check_fmi, write_fmu
from schwung.simulators.matlab import write_matlab
from schwung.simulators.modelica import write_modelica

__all__ = [
    "ExplainedAgainst",
    "check_fmi",
    "explain_against",
    "write_fmu",
    "write_matlab",
    "write_modelica",
]

#: The share of the time that goes into playing and measuring the FMU.
_MEASURING = 0.5


@dataclass(frozen=True)
class ExplainedAgainst:
    """What an FMU leaves out of a recording, and the machine that was measured of the FMU and stands in for it."""

    explanation: Explanation
    stand_in: Machine


def explain_against(
    session: recording.Session,
    fmu: str | os.PathLike[str],
    mapped: str | os.PathLike[str],
    *,
    progress: Callable[[str, float], None] | None = None,
) -> ExplainedAgainst:
    """Say how probable it is that an FMU leaves each physics out, as `explain` does for a machine file.

    Args:
        session: as `read_session` gives it; arrays (n,), rad, rad/s, N·m.
        fmu: FMI 2.0 or 3.0, co-simulation or model exchange; it is played in a process of its own.
        mapped: map.toml, which of its variables are torque and motion, with units and signs.
        progress: told what is being done and the share that is done of all, 0…1.

    Raises InputError where FMU, map or session are not what they should be, or the FMU fails.
    """
    tell = progress or (lambda _text, _share: None)
    belief, stand_in = _measured(session, fmu, mapped, tell)
    found = publish(session, stand_in, twin=belief.twin, progress=_then(tell))
    found = replace(found, notes=(*found.notes, *belief.notes))
    return ExplainedAgainst(explanation_shown(found), machine_shown(stand_in))


def _measured(
    session: recording.Session,
    fmu: str | os.PathLike[str],
    mapped: str | os.PathLike[str],
    tell: Callable[[str, float], None],
) -> tuple[FmuBelief, drivetrain.Machine]:
    """The FMU along the session, and the machine that stands in for it, with the recorded gains."""
    belief = fmu_belief(
        session,
        os.fspath(fmu),
        os.fspath(mapped),
        progress=lambda text, share: tell(text, _MEASURING * share),
    )
    return belief, with_recorded_gains(belief.machine, session)


def _then(tell: Callable[[str, float], None]) -> Callable[[str, float], None]:
    """Progress of what comes after the measuring."""
    return lambda text, share: tell(text, _MEASURING + (1 - _MEASURING) * share)
