"""Physics that the trajectory fit takes up where the record shows it, on a plant that shares no formula with it."""

import re
import sys
from dataclasses import replace
from functools import cache
from pathlib import Path

import numpy as np
import pytest

from schwung.drivetrain.machine import Machine
from schwung.estimation import Estimate, estimate
from schwung.estimation.left_out import ALIKE, LEFT_OUT, shown
from schwung.estimation.trajectory_fit import fit
from schwung.session import Session

sys.path.append(str(Path(__file__).parents[2] / "benchmarks"))
from stranger_plant import HIDDEN, Stranger, draw_stranger, stranger_belief, stranger_session

#: Machines of which the motion takes much of the torque.
SEED, DURATION_S, EVERY = 61, 0.25, 4


def hiding(**shaft: float) -> Stranger:
    stranger = draw_stranger(SEED, DURATION_S, EVERY)
    return replace(stranger, shaft=replace(stranger.shaft, **shaft))


@cache
def recorded(cause: str) -> tuple[Stranger, Session, Machine]:
    """A motion without and with injection."""
    known = {"drop": {"drop": 0.08}, "loss": {"loss": 0.04}, "nothing": {}}
    if cause in known:
        stranger = hiding(**known[cause])
    else:
        stranger = draw_stranger(SEED, DURATION_S, EVERY)
        stranger = replace(stranger, shaft=HIDDEN[cause](stranger, np.random.default_rng(SEED)))
    return stranger, stranger_session(stranger, SEED), stranger_belief(stranger)


def off(found: Estimate, stranger: Stranger) -> float:
    """Relative error, root mean square."""
    error = found.table.inertia_kgm2 - stranger.truth(found.table.position_rad)
    return float(np.sqrt(np.mean(error**2))) / stranger.mean_kgm2


@pytest.mark.long
@pytest.mark.parametrize(("cause", "key", "value"), [("drop", 1, 0.08), ("loss", 2, 0.04)])
def test_what_the_record_shows_no_longer_passes_for_inertia(cause: str, key: int, value: float) -> None:
    stranger, session, machine = recorded(cause)
    plain = fit(session.runs, machine, without=True)
    grid = np.linspace(plain.model.layout.basis.low_rad, plain.model.layout.basis.high_rad, 64)
    truth = stranger.truth(grid)
    without = np.sqrt(np.mean((plain.inertia_at(grid)[0] - truth) ** 2)) / stranger.mean_kgm2
    found = estimate(session, machine, "trajectory")
    assert off(found, stranger) < 0.2 * without
    inside = np.abs(found.table.inertia_kgm2 - stranger.truth(found.table.position_rad))
    assert np.mean(inside < 1.96 * found.table.std_kgm2) > 0.9
    assert found.shown == (LEFT_OUT[key].kind,)
    (said,) = (note for note in found.notes if "beside the inertia" in note)
    number = re.search(f"{LEFT_OUT[key].words} ([0-9.]+) ±", said)
    assert number is not None
    assert float(number[1]) == pytest.approx(value, rel=0.15)


def test_where_nothing_is_left_out_nothing_is_fitted() -> None:
    stranger, session, machine = recorded("nothing")
    found = estimate(session, machine, "trajectory")
    assert found.shown == ()
    assert off(found, stranger) < 5e-4


@pytest.mark.long
def test_what_takes_a_part_of_play_is_none_of_it() -> None:
    """With a gap the machine is not linear over the ripple, and any of them takes something of that."""
    _, session, machine = recorded("play")
    assert estimate(session, machine, "trajectory").shown == ()


@pytest.mark.long
def test_the_method_that_knows_of_it_is_taken() -> None:
    stranger, session, machine = recorded("drop")
    found = estimate(session, machine)
    assert found.method == "trajectory"
    assert any("the record shows a torque constant that drops" in note for note in found.notes)
    assert off(found, stranger) < 0.3 * off(estimate(session, machine, "denoised"), stranger)


def test_a_score_says_which_column_is_missing_from_a_regression() -> None:
    chance = np.random.default_rng(3)
    design = chance.standard_normal((400, 5))
    design[:, 4] += design[:, 0]
    precision = np.diag([1e-6, 1e-6, 1.0, 1.0, 1.0])
    for missing in (3, 4, None):
        y = design[:, :2] @ [1.0, -2.0] + chance.standard_normal(400)
        if missing is not None:
            y += 0.5 * design[:, missing]
        fitted = np.array([0, 1])
        at = np.linalg.lstsq(design[:, fitted], y, rcond=None)[0]
        rest = y - design[:, fitted] @ at
        scores = (design * rest[:, None]).reshape(40, 10, 5).sum(1)
        assert shown(design.T @ design, scores.sum(0), scores, precision, fitted, [2, 3, 4]) == missing


def test_all_of_a_kind_are_alike() -> None:
    assert all(i in alike and all(ALIKE[j] == alike for j in alike) for i, alike in enumerate(ALIKE))
