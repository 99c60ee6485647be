"""Sealed sessions: repeatable, as strong as asked, valid files, and nothing in them that tells what they hide."""

import json
from dataclasses import replace
from pathlib import Path

import h5py
import numpy as np
import pytest

from schwung.drivetrain import load_machine
from schwung.motion import Excitation, Motion
from schwung.session import read_session
from schwung_sim.drives.axis import ServoAxis
from schwung_sim.errors import BenchError
from schwung_sim.plants import TICK_S, TwoMassPlant
from schwung_sim.plants.foreign import FOREIGN
from schwung_sim.sealed import (
    FOREIGN_NAMES,
    LABELS,
    NAMES,
    CaseWishes,
    SealedCase,
    draw_case,
    read_labels,
    write_case,
)
from schwung_sim.sealed.cases import ControlBelief
from schwung_sim.sealed.foreign import draw_foreign
from schwung_sim.sealed.hiding import make_plant
from schwung_sim.sealed.machines import SignalNoise
from schwung_sim.sealed.strength import PlayedRun, floor_nm, play_runs, residual_rms

#: A round of two: one of its seeds hides the one, the other the other.
ROUND = CaseWishes(among=("torque_offset", "viscous_friction"))


@pytest.fixture(scope="module")
def drawn_round() -> dict[str, SealedCase]:
    """By what they hide."""
    return {made.effects[0].physics: made for made in (draw_case(seed, ROUND) for seed in range(2))}


@pytest.fixture(scope="module")
def case(drawn_round: dict[str, SealedCase]) -> SealedCase:
    """A session that hides a torque offset."""
    return drawn_round["torque_offset"]


@pytest.mark.long
def test_the_same_seed_draws_the_same_session_and_another_seed_another(
    case: SealedCase, drawn_round: dict[str, SealedCase], tmp_path: Path
) -> None:
    again = draw_case(case.seed, ROUND)
    for folder, made in (("one", case), ("two", again)):
        write_case(made, tmp_path / folder, "0000")
    files = ("sessions/0000/session.h5", "sessions/0000/machine.toml", LABELS)
    assert all((tmp_path / "one" / f).read_bytes() == (tmp_path / "two" / f).read_bytes() for f in files)
    assert drawn_round["viscous_friction"].drawn.drive != case.drawn.drive


def test_the_belief_about_the_gains_changes_nothing_but_the_belief(case: SealedCase, tmp_path: Path) -> None:
    beliefs: tuple[ControlBelief, ...] = ("given", "none", "wrong")
    for control in beliefs:
        write_case(replace(case, wishes=replace(case.wishes, control=control)), tmp_path / control, "0000")
    sessions = [(tmp_path / c / "sessions/0000/session.h5").read_bytes() for c in ("given", "none", "wrong")]
    assert sessions[0] == sessions[1] == sessions[2]
    given, none, wrong = (
        load_machine(tmp_path / c / "sessions/0000/machine.toml") for c in ("given", "none", "wrong")
    )
    assert none.control is None
    assert given.control is not None
    assert wrong.control is not None
    assert given.control.speed_gain_nms == case.drawn.settings.speed_gain_nms_rad
    assert not 1 / 1.29 < wrong.control.speed_gain_nms / given.control.speed_gain_nms < 1.29


def test_a_session_is_valid_and_says_what_was_played(case: SealedCase, tmp_path: Path) -> None:
    write_case(case, tmp_path, "0000")
    session = read_session(tmp_path / "sessions/0000/session.h5")
    machine = load_machine(tmp_path / "sessions/0000/machine.toml")
    assert len(session.runs) == len(case.drawn.runs)
    assert len(session.references) >= 4
    assert len(session.excited) >= 4
    for run in session.runs:
        assert isinstance(run.motion, Motion)
        assert run.position_demand_rad is not None
        assert run.torque_added_nm is not None
        assert run.position_demand_rad == pytest.approx(run.motion.demand(run.time_s).position_rad, abs=1e-9)
        if run.role == "excited":
            assert isinstance(run.excitation, Excitation)
            assert run.torque_added_nm == pytest.approx(run.excitation.torque(run.time_s), abs=1e-9)
        else:
            assert not np.any(run.torque_added_nm)
    drive = case.drawn.drive
    assert machine.motor.inertia_kgm2 == drive.rotor_inertia_kgm2
    assert machine.coupling is not None
    assert machine.coupling.stiffness_nm_rad == drive.stiffness_nm_rad
    angles = case.drawn.angles_rad()
    assert machine.load_inertia_at(angles) == pytest.approx(case.drawn.profile.at(angles), rel=1e-4)


def test_the_label_is_apart_and_nothing_else_tells_it(
    drawn_round: dict[str, SealedCase], tmp_path: Path
) -> None:
    cases = drawn_round["viscous_friction"], draw_case(1, CaseWishes(among=("cogging",)))
    for number, made in enumerate(cases):
        write_case(made, tmp_path, f"{number:04d}")
    told = set()
    for number in range(2):
        folder = tmp_path / f"sessions/{number:04d}"
        text = (folder / "machine.toml").read_text(encoding="utf-8")
        assert "physics" not in text
        with h5py.File(folder / "session.h5") as file:
            names: list[str] = []
            file.visit(names.append)
            keys = {key for name in names for key in file[name].attrs} | set(file.attrs)
            told.add((frozenset(keys), file.attrs["source"], file.attrs["created"]))
        raw = (folder / "session.h5").read_bytes()
        assert not any(name.encode() in raw for name in (*NAMES, *FOREIGN_NAMES) if name != "torque_offset")
    assert len(told) == 1  # the two sessions' attributes are alike
    labels = read_labels(tmp_path)
    assert [label["effects"][0]["physics"] for label in labels] == ["viscous_friction", "cogging"]
    assert sorted(p.name for p in (tmp_path / "sessions/0000").iterdir()) in (
        ["inertia.csv", "machine.toml", "session.h5"],
        ["machine.toml", "session.h5"],
    )
    assert json.dumps(labels)  # plain data


@pytest.mark.parametrize("name", ["backlash", "encoder_eccentricity"])  # on the load, and of what is read
def test_strengths_are_as_asked(name: str) -> None:
    weak = draw_case(2, CaseWishes(level="weak", among=(name,)))
    assert weak.effects[0].strength == pytest.approx(3.0, rel=0.05)
    assert weak.strength == pytest.approx(3.0, rel=0.25)  # over all runs, not just those that set it
    silent = play_runs(weak.drawn, TwoMassPlant(weak.drawn.drive, weak.drawn.profile, seed=2), 2)
    assert residual_rms(weak.drawn, silent) < 1.5 * weak.floor_nm  # what the encoder's counts leave


def test_a_constant_torque_is_its_own_residual(case: SealedCase) -> None:
    """Exact: the machine needs that torque more, wherever it moves."""
    hidden = case.effects[0]
    torque = hidden.parameters["torque_nm"]
    assert isinstance(torque, float)
    assert hidden.strength * case.floor_nm == pytest.approx(abs(torque), rel=0.03)


def test_the_floor_is_what_the_noise_leaves() -> None:
    """With the speed known without noise, only the torque's noise is left: its share within 200 Hz."""
    drawn = draw_case(0, CaseWishes("none")).drawn
    settings = replace(drawn.settings, encoder_counts=2**40)
    noise = replace(drawn.noise, position_rad=0.0, speed_rad_s=1e-12, torque_nm=0.1)
    quiet = replace(drawn, settings=settings, noise=noise)
    assert floor_nm(quiet) == pytest.approx(0.1 * np.sqrt(2 * 200.0 / drawn.rate_hz), rel=0.01)
    assert floor_nm(drawn) > floor_nm(replace(drawn, noise=replace(drawn.noise, torque_nm=0.0)))


def test_each_seed_of_a_round_hides_another_effect(drawn_round: dict[str, SealedCase]) -> None:
    assert set(drawn_round) == set(ROUND.among)


def test_effects_that_are_one_with_other_numbers_are_not_hidden_together() -> None:
    with pytest.raises(BenchError, match="do not go together"):
        draw_case(0, CaseWishes("two", among=("coulomb_friction", "stribeck_friction")))
    both = draw_case(
        0, CaseWishes("two", among=("coulomb_friction", "stribeck_friction", "viscous_friction"))
    )
    assert "viscous_friction" in {effect.physics for effect in both.effects}
    assert both.strength > max(effect.strength for effect in both.effects) / 2


def test_unknown_effects_are_refused() -> None:
    with pytest.raises(BenchError, match="hides no magic"):
        draw_case(0, CaseWishes(among=("magic",)))
    with pytest.raises(BenchError, match="hides no dahl_presliding"):
        draw_case(0, CaseWishes(among=("dahl_presliding",)))


@pytest.mark.long
def test_a_foreign_effect_is_as_strong_as_asked_beyond_its_best_likeness() -> None:
    made = draw_case(0, CaseWishes("foreign", "weak", ("thermal_fade",)))
    hidden = made.effects[0]
    assert hidden.strength == pytest.approx(3.0, rel=0.05)
    assert hidden.likeness == "torque_constant"
    assert made.strength > 3.0  # with what a wrong torque constant would explain


@pytest.mark.parametrize("name", FOREIGN_NAMES)
def test_a_foreign_effect_changes_how_the_machine_moves(case: SealedCase, name: str) -> None:
    drawn = case.drawn
    shaken = next(i for i, run in enumerate(drawn.runs) if run.injection)  # of the shortest motion time
    shape = draw_foreign(np.random.default_rng(1), drawn, name)
    plain, moved = (
        play_runs(drawn, make_plant(drawn, effects, 0), 0, [shaken])[0].rows
        for effects in ({}, {name: shape.at(0.5 * shape.highest)})
    )
    count = 2 * np.pi / drawn.settings.encoder_counts
    assert np.max(np.abs(moved[:, 0] - plain[:, 0])) > 10 * count
    assert residual_rms(drawn, [PlayedRun(shaken, moved)]) > 3 * residual_rms(
        drawn, [PlayedRun(shaken, plain)]
    )


def test_foreign_physics_that_does_nothing_changes_nothing() -> None:
    """Switched on with an effect of zero size the plant moves as without, to the last bit."""
    drawn = draw_case(0, CaseWishes("none")).drawn
    zero = {"torque_ripple": {"share": 0.0, "order": 3.0, "phase_rad": 0.0}}
    for index in (0, len(drawn.runs) - 1):
        plain = play_runs(drawn, make_plant(drawn, {}, 0), 0, [index])[0].rows
        assert np.array_equal(play_runs(drawn, make_plant(drawn, zero, 0), 0, [index])[0].rows, plain)


def test_dahl_friction_gives_back_what_it_stored() -> None:
    """Exact: from rest over a small angle x it is F_c (1 − exp(−σ x / F_c)); the axis is moved by hand."""
    foreign = {"dahl_presliding": {"torque_nm": 2.0, "stiffness_nm_rad": 50.0}}
    plant = TwoMassPlant(foreign=foreign)
    for _ in range(400):
        plant.step(3.0)
    travelled = plant.motor_rad
    assert travelled > 0.01
    wanted = 2.0 * (1 - np.exp(-50.0 * travelled / 2.0))
    assert float(plant.state["dahl_nm"][0]) == pytest.approx(wanted, rel=0.01)


def test_foreign_effects_have_all_their_keys_or_are_refused() -> None:
    assert set(FOREIGN) == set(FOREIGN_NAMES)
    with pytest.raises(BenchError, match="does not exist"):
        TwoMassPlant(foreign={"dahl_presliding": {"torque_nm": 1.0}})


def test_a_session_is_played_as_tick_by_tick(case: SealedCase) -> None:
    """The compiled loop against the axis commanded from outside, one tick after the other."""
    drawn = replace(case.drawn, noise=SignalNoise(0.0, 0.0, 0.0))
    run = drawn.runs[-1]
    axis = ServoAxis(TwoMassPlant(drawn.drive, drawn.profile, seed=5), drawn.settings, 5)
    axis.energise(True)
    rest = np.zeros(round(run.pause_s / TICK_S))
    targets = np.concatenate([rest, run.stroke.demand_rad()])
    added = np.concatenate([rest, run.torque_added_nm()])
    rows = []
    for target, torque in zip(targets, added, strict=True):
        axis.set_target(float(target), TICK_S)
        axis.set_torque_offset(float(torque))
        axis.advance(TICK_S)
        rows.append((axis.position_rad, axis.speed_rad_s, axis.torque_nm))
    plant = TwoMassPlant(drawn.drive, drawn.profile, seed=5)
    played = play_runs(drawn, plant, 5, [len(drawn.runs) - 1])[0]
    assert np.array_equal(played.rows, np.array(rows)[rest.size :])
