"""Candidates within limits, plans as files, and the procedure that goes on until one answer is sure."""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest
from commissioning_drive import CREEP_PLAYS, DeskDrive, Silence, believed_machine

from schwung.commissioning import LimitWishes, Prepared, Wishes, experiments, until_explained
from schwung.commissioning.experiments import Experiment, Setting, faint, injections, strokes, told_apart
from schwung.commissioning.limits import Limits, limits_of, tighter
from schwung.commissioning.plan import make_plan
from schwung.commissioning.plan_file import read_plan, write_plan
from schwung.commissioning.preflight import preflight
from schwung.commissioning.survey import survey
from schwung.commissioning.until_explained import UntilExplained, record_until_explained
from schwung.drivetrain import FeedForward, InertiaTable
from schwung.errors import InputError, InterruptedByUser, NodeLostError, RefusedError
from schwung.explain.weighing.experiment import Gain, Rival, Rivals
from schwung.explain.weighing.values import Named, Parameter, Timing, Unnamed, Weighed
from schwung.innovations.likelihood import Noise
from schwung.session import Run, read_session

WISHES = Wishes(distance_rad=np.pi, duration_s=0.25, repeats=1)
WIDE = Limits(-0.5, 4.0, 60.0, 233.0, 0.5)
FORWARD = FeedForward(speed_share=1.0)


def setting(limits: Limits = WIDE) -> Setting:
    return Setting(WISHES, limits, 0.0, believed_machine(), feed_forward=FORWARD)


class Telling:
    """Rivals to whom slow motions tell most."""

    settled, best = False, 0.55
    rivals = (Rival(("stribeck_friction",), 0.55), Rival(("local_friction",), 0.45))

    def gain(self, runs: tuple[Run, ...]) -> Gain:
        assert runs[0].motion is not None
        return Gain(0.1 * runs[0].motion.duration_s, 0.9)


def test_every_candidate_keeps_the_limits() -> None:
    made = [(w, setting().played(w)) for w in strokes(setting())]
    kept = [(w, runs) for w, runs in made if runs is not None]
    assert 5 < len(kept) < len(made)  # some would break them
    for _, runs in kept:
        for run in runs:
            assert run.position_rad.min() >= WIDE.position_min_rad
            assert run.position_rad.max() <= WIDE.position_max_rad
            assert np.abs(run.speed_rad_s).max() <= WIDE.speed_max_rad_s
            assert np.abs(run.torque_nm).max() <= WIDE.torque_max_nm


def test_strokes_use_the_room_that_there_is_and_differ() -> None:
    wide = Setting(WISHES, replace(WIDE, position_min_rad=-9.0), 0.0, believed_machine())
    distances = {w.distance_rad for w in strokes(wide)}
    assert min(distances) < -8.0
    assert all(abs(a - b) > 0.1 for a in distances for b in distances if a != b)


def test_strokes_stay_where_the_belief_knows_the_inertia() -> None:
    machine = believed_machine()
    table = InertiaTable(np.linspace(0.01, 1.5, 5), np.full(5, 0.11))
    load = machine.load.model_copy(update={"inertia_kgm2": None, "inertia_table": table})
    known = replace(setting(), machine=machine.model_copy(update={"load": load}))
    known = replace(known, done=replace(WISHES, distance_rad=1.0))
    distances = {w.distance_rad for w in strokes(known)}
    assert 1.0 in distances  # the session's own
    assert max(distances) <= 1.5
    assert min(distances) >= 0.0  # though the limits leave room below


def test_the_motion_that_tells_most_comes_first_with_its_best_injection() -> None:
    found = experiments.next_experiments(Telling(), setting())  # type: ignore[arg-type]  # what is asked of it
    assert [e.gain.information for e in found] == sorted((e.gain.information for e in found), reverse=True)
    assert found[0].wishes.duration_s == 2.0  # eight times as slow is the slowest
    assert found[0].sentence == "stribeck_friction 0.55 / local_friction 0.45 → expected 0.90"


def test_where_all_limits_are_tiny_there_is_no_motion() -> None:
    tiny = Limits(-1e-3, 1e-3, 1e-3, 1e-3, 1e-6)
    assert experiments.next_experiments(Telling(), setting(tiny)) == []  # type: ignore[arg-type]


def test_where_nothing_is_confused_none_is_looked_for() -> None:
    one = Rivals(None, (Rival(("cogging",), 1.0),), np.ones((1, 1)), (), ())  # type: ignore[arg-type]
    assert experiments.next_experiments(one, setting()) == []


def test_injections_stay_beside_the_sessions() -> None:
    every = list(injections(setting(), WISHES))
    assert {e.frequency_hz for e in every} == {25.0, 50.0, 75.0}
    assert max(e.amplitude_nm or 0 for e in every) == pytest.approx(0.4 * WIDE.torque_max_nm)


def test_what_is_common_is_told_beside() -> None:
    both = Rival(("cogging", "load_inertia"), 0.7), Rival(("load_inertia",), 0.3)
    assert told_apart(both) == "cogging 0.70 / nothing more 0.30 (beside load_inertia)"
    assert told_apart((Rival((), 1.0),)) == "nothing 1.00"


def _weighed(names: dict[str, float], unnamed: float = 0.0) -> Weighed:
    named = tuple(Named(name, p, {}) for name, p in names.items())
    curves = (Unnamed("position", unnamed, 0.4),) if unnamed else ()
    return Weighed(named, curves, Noise(1.0, 1.0, 1.0), 1.0, Timing(Parameter(0.0, 0.0, 0.0), "speed", 1.0))


@pytest.mark.parametrize(
    ("likeliest", "names", "unnamed", "said"),
    [
        (("cogging",), {"cogging": 0.97}, 0.9, ""),
        (
            ("cogging",),
            {"cogging": 0.4},
            0.9,
            "cogging stands out from what no name describes with 0.40 only",
        ),
        ((), {}, 0.0, ""),
        ((), {}, 0.9, "what follows position has no name, and is there with 0.90"),
    ],
)
def test_an_answer_that_leads_is_none_beside_what_it_leaves(
    likeliest: tuple[str, ...], names: dict[str, float], unnamed: float, said: str
) -> None:
    assert faint(_weighed(names, unnamed), (Rival(likeliest, 0.99),)) == said


def test_a_plan_survives_its_file(tmp_path: Path) -> None:
    wishes = replace(WISHES, frequency_hz=40.0, amplitude_nm=9.0, because=("a / b",))
    write_plan(tmp_path / "next.json", "crank", wishes, WIDE, 0.25)
    assert read_plan(tmp_path / "next.json") == replace(
        wishes, limits=LimitWishes(**vars(WIDE)), start_rad=0.25
    )


@pytest.mark.parametrize(
    ("change", "word"),
    [
        ({"duration_s": -1.0}, "duration_s"),
        ({"distance_rad": "far"}, "distance_rad"),
        ({"version": 2}, "version"),
        ({"format": "schwung-motion"}, "format"),
        ({"speed": 3}, "speed"),
        ({"limits": {"torque_max_nm": 0}}, "torque_max_nm"),
    ],
)
def test_what_is_no_plan_is_told_by_its_key(tmp_path: Path, change: dict[str, object], word: str) -> None:
    path = tmp_path / "next.json"
    write_plan(path, "crank", WISHES, WIDE, 0.0)
    path.write_text(json.dumps(json.loads(path.read_text()) | change))
    with pytest.raises(InputError, match=word):
        read_plan(path)


@pytest.mark.parametrize("text", ["", "{", "[]", "\x00"])
def test_rubbish_is_no_plan(tmp_path: Path, text: str) -> None:
    (tmp_path / "next.json").write_text(text)
    with pytest.raises(InputError, match=r"next\.json"):
        read_plan(tmp_path / "next.json")
    with pytest.raises(InputError, match="cannot be read"):
        read_plan(tmp_path / "not there.json")


def test_of_two_limits_the_tighter_holds() -> None:
    both = tighter(LimitWishes(-1.0, 2.0, None, 5.0), LimitWishes(-2.0, 1.0, 3.0, None))
    assert both == LimitWishes(-1.0, 1.0, 3.0, 5.0, None)


# ── until it is explained ────────────────────────────────────────────────────────────────────────────────────────


@pytest.fixture
def drive() -> DeskDrive:
    return DeskDrive(believed_machine())


def prepared_for(drive: DeskDrive, wishes: Wishes = WISHES) -> Prepared:
    limits = limits_of(wishes.limits, drive.limits(), drive.machine)
    plan = make_plan(
        drive.machine, limits, start_position_rad=0.0, distance_rad=wishes.distance_rad,
        duration_s=wishes.duration_s, repeats=wishes.repeats, frequency_hz=wishes.frequency_hz,
        amplitude_nm=wishes.amplitude_nm,
    )  # fmt: skip
    seen = survey(drive, plan)
    ready = preflight(plan, drive.machine, seen, FORWARD, estimates=False)
    return Prepared(plan, drive.machine, seen, ready, FORWARD, wishes)


@pytest.fixture
def weighing(monkeypatch: pytest.MonkeyPatch) -> list[float]:
    """What each weighing says of the likeliest answer; the last for all that follow."""
    says = [0.5]
    weighed = iter(range(100))

    def rivals(_posterior: object) -> SimpleNamespace:
        p = says[min(next(weighed), len(says) - 1)]
        return SimpleNamespace(best=p, settled=False, rivals=(Rival(("a",), p), Rival(("b",), 1 - p)))

    def experiment(found: SimpleNamespace, where: Setting) -> list[Experiment]:
        slow = replace(where.done, duration_s=0.5)
        fast = replace(where.done, duration_s=0.01)  # breaks every limit: preflight refuses it
        return [Experiment(w, Gain(0.5, 0.9), found.rivals) for w in (fast, slow)]

    monkeypatch.setattr(
        until_explained,
        "posterior_of",
        lambda *_, **_named: SimpleNamespace(told=SimpleNamespace(probability=lambda name: 0.98)),
    )
    monkeypatch.setattr(until_explained, "Rivals", SimpleNamespace(of=rivals))
    monkeypatch.setattr(until_explained, "next_experiments", experiment)
    monkeypatch.setattr(
        until_explained, "prepare", lambda drive, profile, machine, wishes: prepared_for(drive, wishes)
    )
    return says


def explained(drive: DeskDrive, out: Path, **options: object) -> UntilExplained:
    return record_until_explained(drive, None, prepared_for(drive), out, Silence(), **options)  # type: ignore[arg-type]


def test_it_ends_where_one_answer_is_sure(drive: DeskDrive, weighing: list[float], tmp_path: Path) -> None:
    weighing[:] = [0.5, 0.7, 0.96]
    found = explained(drive, tmp_path)
    assert found.sure
    assert found.ended == "one answer has 95 %"
    assert [step.after[0].probability for step in found.steps] == [0.7, 0.96]
    session = read_session(tmp_path / "session.h5")
    assert [run.repeat for run in session.runs] == [0, 0, 0, 0, 1, 1]  # the same motion twice: repeats
    assert drive.calls.count("enable") == drive.calls.count("disable") == 3
    assert drive.plays == 6 + 2 * CREEP_PLAYS  # a creep before each


def test_an_answer_that_hardly_stands_out_from_what_has_no_name_is_not_sure(
    drive: DeskDrive, weighing: list[float], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    weighing[:] = [0.99]
    told = SimpleNamespace(told=SimpleNamespace(probability=lambda name: 0.7))
    monkeypatch.setattr(until_explained, "posterior_of", lambda *_, **_named: told)
    found = explained(drive, tmp_path)
    assert not found.sure
    assert found.ended == "one answer leads, but a stands out from what no name describes with 0.70 only"


def test_it_ends_where_the_budget_is_spent(drive: DeskDrive, weighing: list[float], tmp_path: Path) -> None:
    found = explained(drive, tmp_path, budget=3)
    assert not found.sure
    assert found.ended == "the budget of 3 motions is spent"
    assert len(found.steps) == 1


def test_a_budget_of_one_is_refused_before_anything_moves(drive: DeskDrive, tmp_path: Path) -> None:
    with pytest.raises(InputError, match="--budget"):
        explained(drive, tmp_path, budget=1)
    assert drive.calls == []
    assert not list(tmp_path.iterdir())


def test_a_no_to_the_next_motion_keeps_what_there_is(
    drive: DeskDrive, weighing: list[float], tmp_path: Path
) -> None:
    found = explained(drive, tmp_path, agreed=lambda prepared, experiment: False)
    assert found.ended == "you said no to the next motion"
    assert len(read_session(found.session_path).runs) == 2


@pytest.mark.parametrize(
    ("error", "becomes"),
    [(NodeLostError("node 3", "is gone"), NodeLostError), (KeyboardInterrupt(), InterruptedByUser)],
)
def test_a_drive_lost_in_the_middle_is_stopped_and_all_before_is_kept(
    drive: DeskDrive,
    weighing: list[float],
    tmp_path: Path,
    error: BaseException,
    becomes: type[BaseException],
) -> None:
    def fails(number: int) -> None:
        if number == 2 + CREEP_PLAYS + 1:  # the second motion of the first experiment
            raise error

    drive.before_play = fails
    with pytest.raises(becomes) as caught:
        explained(drive, tmp_path)
    assert "3 motions in all" in " ".join(caught.value.__notes__)
    assert len(read_session(tmp_path / "session.h5").runs) == 3
    assert "halt" in drive.calls
    assert drive.calls.count("disable") == drive.calls.count("enable")


def test_ctrl_c_while_weighing_is_told_and_nothing_moves(
    drive: DeskDrive, weighing: list[float], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def interrupted(*_: object, **_named: object) -> None:
        raise KeyboardInterrupt

    monkeypatch.setattr(until_explained, "posterior_of", interrupted)
    with pytest.raises(InterruptedByUser, match="nothing was moving; 2 motions"):
        explained(drive, tmp_path)
    assert drive.calls.count("disable") == drive.calls.count("enable")
    assert len(read_session(tmp_path / "session.h5").runs) == 2


def test_where_preflight_refuses_every_experiment_it_says_why(
    drive: DeskDrive, weighing: list[float], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def experiment(found: SimpleNamespace, where: Setting) -> list[Experiment]:
        return [Experiment(replace(where.done, duration_s=0.01), Gain(0.5, 0.9), found.rivals)]

    monkeypatch.setattr(until_explained, "next_experiments", experiment)
    with pytest.raises(RefusedError, match="preflight"):
        explained(drive, tmp_path)
    assert len(read_session(tmp_path / "session.h5").runs) == 2
