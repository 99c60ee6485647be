"""A session of one motion: what it has of its own is told, and is neither a name, nor in the machine, nor its scale."""

from dataclasses import replace
from types import SimpleNamespace
from typing import cast

import numpy as np
import pytest
from strangers import Stranger, belief_of, session_of

from schwung.drivetrain import Machine
from schwung.explain.publishing.publish import publish
from schwung.explain.weighing.repeated import motions_of
from schwung.explain.weighing.sets import absent
from schwung.explain.weighing.weigh import posterior_of
from schwung.session.model import Run, Session

DRY_NM = 0.8
DRY = Stranger("dry friction", ("coulomb_friction",), (DRY_NM, 0.0, 0.0, 0.0))


def recorded() -> tuple[Session, Machine]:
    return session_of(DRY, 5, every=8, times=(0.25,)), belief_of(DRY)


def with_its_own(session: Session) -> Session:
    """The same with torque over the time that follows nothing else, in every run alike."""
    random = np.random.default_rng(3)
    frequencies, phases = random.uniform(8.0, 24.0, 12), random.uniform(0.0, 6.0, 12)

    def own(run: Run) -> Run:
        wave = np.sin(2 * np.pi * frequencies * run.time_s[:, None] + phases).sum(axis=1)
        return replace(run, torque_nm=run.torque_nm + 0.015 * wave)

    return replace(session, runs=tuple(own(run) for run in session.runs))


def test_imported_runs_that_repeat_a_motion_are_one_motion() -> None:
    def run(same: str | None) -> Run:
        return cast(Run, SimpleNamespace(motion=None, extra={} if same is None else {"same_motion": same}))

    assert motions_of([run("a"), run("b"), run("a"), run(None), run(None)]) == [[0, 2], [1], [3], [4]]


@pytest.mark.long
def test_what_one_motion_has_of_its_own_is_told_and_in_no_file() -> None:
    session, machine = recorded()
    found = publish(with_its_own(session), machine)
    (own,) = (curve for curve in found.curves if curve.over == "time in motion")
    assert own.probability > 0.9
    assert not own.in_file
    assert {name.physics: name.probability > 0.5 for name in found.names} == {"coulomb_friction": True}
    assert [term.name for term in found.machine.physics] == ["coulomb_friction"]
    assert found.machine.physics[0].parameters["torque_nm"] == pytest.approx(DRY_NM, rel=0.05)
    assert any("all runs repeat one motion" in note for note in found.notes)


@pytest.mark.long
def test_what_is_missed_is_no_part_of_the_torque_that_drives() -> None:
    """About a belief without it, friction is missed; a scale of the torque is not to take it from both sides."""
    session, machine = recorded()
    outcome = posterior_of(session, machine)
    growth = outcome.growth
    usual = [absent(growth.rests.candidates[i]) for i in growth.always]
    about = growth.rests.settled(outcome.view, usual).about
    every = about.view.alongs(about.members)
    for along in (every[number] for number in growth.rests.train):
        ahead = along.direction * along.moves
        reported = float(np.sum(along.run.quiet(along.run.drive.whole_nm) * ahead) / np.sum(ahead**2))
        driving = float(np.sum(along.torque * ahead) / np.sum(ahead**2))
        assert reported - driving == pytest.approx(DRY_NM, rel=0.1)
