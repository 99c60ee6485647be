"""Limits, proposals and setpoints."""

import numpy as np
import pytest
from commissioning_drive import DeskDrive, believed_machine

from schwung.commissioning import LimitWishes, Plan
from schwung.commissioning.limits import Limits, limits_of
from schwung.commissioning.plan import make_plan, propose_frequency, setpoints_of
from schwung.drivetrain import Machine
from schwung.errors import InputError
from schwung.fieldbus.drive import DriveLimits

NOTHING = DriveLimits(None, None, None, None, None, None, None)


def _plan(**changes: object) -> Plan:
    drive = DeskDrive(believed_machine())
    arguments: dict[str, object] = {"start_position_rad": 0.5, "distance_rad": np.pi, "duration_s": 0.25}
    limits = limits_of(LimitWishes(), drive.limits(), drive.machine)
    return make_plan(drive.machine, limits, **{**arguments, **changes})  # type: ignore[arg-type]  # by name


def test_the_tighter_limit_counts() -> None:
    machine = believed_machine()
    drive = DriveLimits(-10.0, 10.0, 100.0, 500.0, 70.0, 0.5, 0.1)
    limits = limits_of(LimitWishes(position_min_rad=-1.0, speed_max_rad_s=200.0), drive, machine)
    assert limits == Limits(-1.0, 10.0, 100.0, machine.motor.peak_torque_nm, 0.5)


def test_limits_that_nobody_knows_are_all_named() -> None:
    with pytest.raises(InputError, match=r"--min-position, --max-position, --max-speed, --following-error"):
        limits_of(LimitWishes(), NOTHING, believed_machine())


@pytest.mark.parametrize(
    "bad", [(1.0, 1.0, 1.0, 1.0, 1.0), (0.0, 1.0, -1.0, 1.0, 1.0), (0.0, 1.0, 1.0, np.nan, 1.0)]
)
def test_nonsense_limits_are_refused(bad: tuple[float, ...]) -> None:
    with pytest.raises(InputError):
        Limits(*bad)


def test_the_paper_machine_gets_the_papers_50_hz() -> None:
    frequency, why = propose_frequency(believed_machine(0.11), 1000.0)
    assert frequency == 50.0
    assert "76 Hz" in why  # sqrt(24963 / 0.11) / 2 pi


def test_every_proposal_has_whole_samples_per_period_below_the_anti_resonance() -> None:
    for inertia in (0.01, 0.05, 0.2, 1.0):
        for rate in (500.0, 1000.0, 4000.0):
            frequency, _ = propose_frequency(believed_machine(inertia), rate)
            samples = rate / frequency
            assert samples == pytest.approx(round(samples))
            assert samples >= 10
            assert frequency <= np.sqrt(24963 / inertia) / 2 / np.pi


def test_an_unknown_load_inertia_is_asked_for() -> None:
    with pytest.raises(InputError, match=r"rough load\.inertia"):
        propose_frequency(believed_machine(None), 1000.0)


def test_a_rigid_machine_has_a_proposal() -> None:
    machine: Machine = believed_machine().model_copy(update={"coupling": None})
    assert propose_frequency(machine, 1000.0)[0] == 50.0


def test_the_injection_is_at_full_amplitude_two_periods_before_until_after_the_motion() -> None:
    plan = _plan()
    period = 1 / plan.excitation.frequency_hz
    time = np.linspace(plan.motion.start_time_s - 2 * period, plan.motion.end_s + 2 * period, 500)
    assert np.all(plan.excitation.envelope(time) == 1.0)
    assert plan.excitation.envelope(np.array([0.0, plan.motion.total_s])) == pytest.approx([0.0, 0.0])


def test_setpoints_start_and_end_where_the_axis_stands() -> None:
    plan = _plan()
    reference, excited = (setpoints_of(run, plan) for run in plan.runs() if run.repeat == 0)
    assert reference.position_rad[[0, -1]] == pytest.approx([0.5, 0.5])
    assert reference.position_rad.max() == pytest.approx(0.5 + np.pi)
    assert not reference.torque_added_nm.any()
    assert np.abs(excited.torque_added_nm).max() == pytest.approx(0.2 * 233, rel=1e-3)


def test_in_profile_position_the_strokes_go_to_the_drive_as_moves() -> None:
    plan = _plan(mode="pp")
    moves = setpoints_of(next(plan.runs()), plan).moves
    assert moves == plan.acquisition.moves
    assert [move.target_rad for move in moves] == pytest.approx([0.5 + np.pi, 0.5])
    assert moves[0].peak_speed_rad_s == pytest.approx(1.5 * np.pi / 0.25)
    assert _plan().acquisition.moves == ()


def test_references_and_excited_runs_alternate() -> None:
    assert [(run.role, run.repeat) for run in _plan(repeats=2).runs()] == [
        ("reference", 0), ("excited", 0), ("reference", 1), ("excited", 1),
    ]  # fmt: skip


def test_four_phases_are_a_quarter_period_apart_and_need_one_reference() -> None:
    plan = _plan(repeats=2, phases=4)
    runs = list(plan.runs())
    assert [run.role for run in runs] == ["reference"] + 8 * ["excited"]
    assert [run.repeat for run in runs] == [0, 0, 0, 0, 0, 1, 1, 1, 1]
    phases = [run.excitation.phase_rad for run in runs[1:5] if run.excitation]
    assert phases == pytest.approx([0, np.pi / 2, np.pi, 3 * np.pi / 2])
    assert plan.duration_s == pytest.approx(9 * plan.motion.total_s)
    first, *others = (setpoints_of(run, plan).torque_added_nm for run in runs[1:5])
    np.testing.assert_allclose(first + others[1], 0.0, atol=1e-9)
    with pytest.raises(InputError, match="--phases: is 3"):
        _plan(phases=3)


def test_wishes_that_no_motion_can_meet_are_refused() -> None:
    with pytest.raises(InputError, match="samples a period"):
        _plan(frequency_hz=150.0)
    with pytest.raises(InputError, match="PP"):
        _plan(mode="pp", kind="poly5")
    with pytest.raises(InputError, match="repeats"):
        _plan(repeats=0)


@pytest.mark.parametrize(
    ("wish", "place"),
    [
        ({"frequency_hz": 0.0}, "--frequency"),
        ({"frequency_hz": np.nan}, "--frequency"),
        ({"amplitude_nm": -1.0}, "--amplitude"),
        ({"sample_rate_hz": 0.0}, "--rate"),
        ({"duration_s": 0.0}, "--duration"),
        ({"distance_rad": 0.0}, "--distance"),
        ({"distance_rad": np.inf}, "--distance"),
        ({"kind": "bogus"}, "--profile-kind"),
        ({"repeats": 0}, "--repeats"),
    ],
)
def test_nonsense_wishes_are_refused_by_the_name_of_their_option(wish: dict[str, object], place: str) -> None:
    with pytest.raises(InputError) as caught:
        _plan(**wish)
    assert caught.value.place == place


def test_the_drive_is_asked_to_keep_the_limits() -> None:
    plan = _plan()
    guard, limits = plan.acquisition.guard, plan.limits
    assert guard is not None
    assert (guard.position_min_rad, guard.position_max_rad) == (
        limits.position_min_rad,
        limits.position_max_rad,
    )
    assert (guard.torque_max_nm, guard.following_error_rad) == (
        limits.torque_max_nm,
        limits.following_error_rad,
    )


def test_slower_motions_are_mixed_in_and_injected_for_as_long_as_they_last() -> None:
    plan = _plan(duration_s=0.25, also_s=(0.4, 0.6), repeats=2)
    runs = list(plan.runs())
    assert [run.motion.duration_s for run in runs[:6]] == [0.25, 0.25, 0.4, 0.4, 0.6, 0.6]
    assert [run.repeat for run in runs] == [0] * 6 + [1] * 6
    for run in runs:
        if run.excitation is not None:
            assert run.excitation.end_s == pytest.approx(
                run.motion.total_s - 0.5 / run.excitation.frequency_hz
            )
    assert plan.duration_s == pytest.approx(sum(run.motion.total_s for run in runs))


@pytest.mark.parametrize("wishes", [{"also_s": (0.2,)}, {"also_s": (0.4, 0.1), "mode": "pp"}], ids=str)
def test_a_further_motion_time_is_longer(wishes: dict[str, object]) -> None:
    with pytest.raises(InputError, match="--also"):
        _plan(duration_s=0.25, **wishes)
