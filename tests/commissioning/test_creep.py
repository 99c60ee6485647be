"""The creep as planned: small, slow, within every limit, and in scale-free steps."""

from __future__ import annotations

import itertools
import math
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from commissioning_drive import CREEP_PLAYS, DeskDrive, Silence, believed_machine

from schwung.commissioning import LimitWishes, ParameterJournal, Plan
from schwung.commissioning.creep import Creep, creep_of
from schwung.commissioning.limits import limits_of
from schwung.commissioning.plan import make_plan
from schwung.commissioning.preflight import preflight
from schwung.commissioning.procedure import record
from schwung.commissioning.survey import survey
from schwung.drivetrain import FeedForward, anti_resonance_hz
from schwung.errors import RefusedError
from schwung.fieldbus.drive import Progress, Recording, Resolution, Setpoints
from schwung.session import read_session

MACHINE = believed_machine()
FINE = Resolution(6e-6, 1e-4, 0.07, 0.07)


def _plan(**changes: Any) -> Plan:
    arguments: dict[str, Any] = {
        "start_position_rad": 0.0,
        "distance_rad": np.pi,
        "duration_s": 0.25,
        **changes,
    }
    return make_plan(MACHINE, limits_of(LimitWishes(), DeskDrive(MACHINE).limits(), MACHINE), **arguments)


def _creep(plan: Plan, resolution: Resolution = FINE) -> Creep:
    creep = creep_of(plan, MACHINE, resolution)
    assert creep is not None
    return creep


@pytest.mark.parametrize("distance", [np.pi, -0.4, 0.02])
def test_it_is_a_few_degrees_at_low_speed_in_the_direction_of_the_stroke(distance: float) -> None:
    plan = _plan(distance_rad=distance)
    creep = _creep(plan)
    for planned in creep.motions(plan):
        assert abs(planned.motion.distance_rad) <= min(math.radians(6), abs(distance) / 2) + 1e-12
        assert planned.motion.distance_rad * distance > 0
        assert planned.motion.peak_speed_rad_s < 0.1 * plan.limits.speed_max_rad_s
    first = next(stage for stage in creep.stages if stage.decisive).planned
    assert abs(first.motion.distance_rad) <= math.radians(2)


def test_it_begins_without_a_motion_and_grows_fourfold() -> None:
    ways = [abs(stage.planned.motion.distance_rad) for stage in _creep(_plan()).stages]
    assert ways[0] == 0
    growing = [way for way in ways if way > 0]
    assert growing == sorted(growing)
    assert growing[0] < math.radians(0.02)
    assert all(later <= 4.01 * way for way, later in itertools.pairwise(growing))


def test_what_is_injected_is_small_in_counts_whatever_a_count_is_believed_to_be_worth() -> None:
    """Where the rated torque is a thousand times what is believed, the torque is, too: but not beyond some per cent."""
    for count in (0.07, 7e-5):
        creep = _creep(_plan(), replace(FINE, torque_nm=count, torque_added_nm=count))
        first = creep.stages[0].planned.excitation
        assert first is not None
        assert first.amplitude_nm <= 100 * count


def test_its_frequency_stays_below_the_anti_resonance_of_three_times_the_load() -> None:
    first = _creep(_plan()).stages[0].planned.excitation
    assert first is not None
    assert first.frequency_hz < 0.5 * float(anti_resonance_hz(MACHINE, 3 * 0.11))
    assert (1000 / first.frequency_hz) == pytest.approx(round(1000 / first.frequency_hz))


def test_its_frequency_is_resolved_by_a_trace_that_is_slower_than_the_setpoints() -> None:
    slow = {"sampling": "trace", "injecting": "generator", "trace_rate_hz": 50.0, "frequency_hz": 4.0}
    for stage in _creep(_plan(mode="pp", duration_s=1.5, **slow)).stages:
        assert stage.planned.excitation is not None
        assert 50.0 / stage.planned.excitation.frequency_hz >= 10 * (1 - 1e-9)


def test_a_drive_that_moves_by_itself_is_not_asked_to_stand_still_nor_to_go_slower_than_it_can() -> None:
    for speed_count in (1e-4, 2 * np.pi / 60):
        stages = _creep(_plan(mode="pp"), replace(FINE, speed_rad_s=speed_count)).stages
        assert min(abs(stage.planned.motion.distance_rad) for stage in stages) > 0
        assert min(stage.planned.motion.peak_speed_rad_s for stage in stages) >= 2 * speed_count * (1 - 1e-6)


def test_without_a_unit_of_torque_there_is_nothing_to_prove() -> None:
    assert creep_of(_plan(), MACHINE, replace(FINE, torque_nm=math.nan)) is None


def test_preflight_says_what_will_be_done_first_and_simulates_it() -> None:
    plan = _plan()
    found = preflight(
        plan, MACHINE, survey(DeskDrive(MACHINE), plan), FeedForward(speed_share=1.0), estimates=False
    )
    (check,) = (c for c in found.checks if c.name == "creep")
    assert "°" in check.text
    assert "before the first stroke" in check.text


class Mistaken(DeskDrive):
    """Reports its torque reversed."""

    def play(self, setpoints: Setpoints, progress: Progress | None = None) -> Recording:
        recording = super().play(setpoints, progress)
        return replace(recording, torque_nm=-recording.torque_nm)


def test_a_refusal_leaves_a_drive_that_is_off_and_as_it_was_and_keeps_what_was_seen(tmp_path: Path) -> None:
    drive, plan = Mistaken(MACHINE), _plan()
    before = dict(drive.objects)
    ready = preflight(plan, MACHINE, survey(drive, plan), FeedForward(speed_share=1.0), estimates=False)
    journal = ParameterJournal(drive, tmp_path / "setup.backup.json", drive.describe())
    with pytest.raises(RefusedError, match="opposite sign") as caught:
        record(drive, plan, ready, session_path=tmp_path / "s.h5", journal=journal, observer=Silence())
    assert caught.value.exit_code == 3
    assert drive.plays < 0  # no run was begun
    assert drive.calls.count("play") < CREEP_PLAYS
    assert drive.calls.index("halt") < drive.calls.index("disable")
    assert drive.objects == before
    session = read_session(tmp_path / "s.h5")
    assert session.runs == ()
    assert session.created.startswith("2000-01-01")  # by the drive's clock
