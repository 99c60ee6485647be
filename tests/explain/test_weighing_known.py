"""What a file says that was found does what was found: every law, read back, is known."""

from __future__ import annotations

import numpy as np
import pytest
from strangers import Stranger, belief_of, session_of

from schwung.drivetrain.physics_term import PhysicsTerm
from schwung.explain.causes.along import ranges_of
from schwung.explain.causes.candidate import Candidate
from schwung.explain.causes.known import known
from schwung.explain.causes.true_torque import TrueTorque
from schwung.explain.causes.vocabulary import vocabulary
from schwung.explain.weighing.round import View
from schwung.innovations.signals import picked_signals_of

SPOT = Stranger("tight spot", ("local_friction",), spot=(1.2, 2.0, 0.5))
SIDES = ("on_motor", "on_load", "position", "speed")
#: Laws that change what the filter moves; what each run has of its own: bristles at rest, the phase of a hum.
ELSEWHERE = {
    "backlash", "coupling_damping", "coupling_stiffness", "inertia_profile", "inertia_profile_shift", "load_inertia",
    "motor_inertia", "presliding_friction", "periodic_disturbance",
}  # fmt: skip


@pytest.fixture(scope="module")
def view() -> View:
    """Two runs of a machine, with smoothed states."""
    session, machine = session_of(SPOT, 5, every=8, times=(0.25,)), belief_of(SPOT)
    session = session.__class__(session.runs[:2], session.created, session.source)
    runs = tuple(picked_signals_of(run, machine, 160.0) for run in session.runs)
    of = ranges_of(list(runs), 0.002, 160.0)
    torques = tuple(TrueTorque(run, run.quiet(run.drive.whole_nm)) for run in runs)
    return View(session.runs, runs, known(machine, of.low_rad, of.high_rad), of, torques)


def _every(view: View) -> dict[str, Candidate]:
    return {c.name: c for c in vocabulary(view.ranges, view.known) if c.is_law and c.name not in ELSEWHERE}


def _shape(candidate: Candidate) -> tuple[float, ...]:
    """One of those that are tried; of what is only sought, one within its bounds."""
    if candidate.shapes:
        return candidate.shapes[len(candidate.shapes) // 2]
    return tuple(float(np.sqrt(max(low, 1.0) * high)) for low, high in candidate.bounds)


def test_every_law_that_is_found_is_known_from_a_file(view: View) -> None:
    """A further mass was not: beside the surest name a proof said that its file explained nothing."""
    along, machine, of, unlike = view.alongs(())[0], view.known.machine, view.ranges, []
    every = _every(view)
    assert {"extra_compliance", "torque_saturation", "stribeck_friction", "kinematic_error"} <= set(every)
    for name, candidate in every.items():
        shape, coefficients = _shape(candidate), np.array(candidate.deviations)
        if name == "torque_constant_fade":
            coefficients[2:] = 0.0  # how much warmer than the others each run begins, no file says
        term = PhysicsTerm(name=name, **candidate.keys(coefficients, shape))
        told = known(machine.model_copy(update={"physics": (term,)}), of.low_rad, of.high_rad).effect(along)
        done = candidate.done(along, shape, coefficients)
        for side, wanted, got in zip(SIDES, done.of(np.ones(done.count)), told.of(np.ones(1)), strict=True):
            size = max(_rms(wanted), _rms(got))
            if _rms(wanted - got) > 0.1 * size:
                unlike.append(f"{name}, {side}: {_rms(wanted):.3g} became {_rms(got):.3g}")
    assert not unlike, "\n".join(unlike)


def _rms(values: np.ndarray | float) -> float:
    return float(np.sqrt(np.mean(np.square(values))))
