"""A law is the same in every motion; what only one motion shows is not."""

from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from schwung.explain.causes.inexact import alike
from schwung.explain.weighing.data import Data
from schwung.explain.weighing.one_law import law_without_name, one_law
from schwung.explain.weighing.search import Pick
from schwung.explain.weighing.work import Work
from schwung.innovations.statistics import Statistics

SAMPLES, LAW = 300, Pick(1, 1.0)


def odds(
    amounts: list[float],
    motions: int = 3,
    scales: tuple[float, ...] = (1.0,),
    each_run: bool = False,
    shows: tuple[float, ...] = (1.0,) * 6,
    across: list[float] | None = None,
    named: bool = True,
) -> float:
    """Of a column that acts by so much in each of six runs; they repeat some motions, and another column is beside.

    `shows`: how much of the column there is in each run; `across`: amounts of a second column of the law, if any.
    """
    chance = np.random.default_rng(5)
    runs, size = range(len(amounts)), SAMPLES * len(amounts)
    each = [amounts] if across is None else [amounts, across]
    rows = chance.normal(size=(1 + len(each), size))
    rows[1] *= np.repeat(shows, SAMPLES)
    target = 0.2 * rows[0] + chance.normal(size=size)
    for row, own in zip(rows[1:], each, strict=True):
        target += np.repeat(own, SAMPLES) * row
    data: Any = object.__new__(Data)
    motion = [
        SimpleNamespace(motion=SimpleNamespace(model_dump_json=lambda i=i: str(i % motions))) for i in runs
    ]
    data.about = SimpleNamespace(
        stretches=lambda _: [slice(i * SAMPLES, (i + 1) * SAMPLES) for i in runs],
        view=SimpleNamespace(recorded=motion, work=Work()),
    )
    data.train, data.rows, data.target, data.excess = runs, rows, target, 1.0
    data.atoms = [SimpleNamespace(where=slice(0, 1)), SimpleNamespace(where=slice(1, len(rows)))]
    data.at = Statistics.of(rows.T, target).at
    search: Any = SimpleNamespace(
        data=data,
        odds=-3.4,
        candidate=lambda _: SimpleNamespace(scales=scales, deviations=(1.0,) * len(each), each_run=each_run),
    )
    scored: Any = SimpleNamespace(which=np.arange(len(rows)), deviations=np.ones(len(rows)))
    return (one_law if named else law_without_name)(search, scored, LAW)


def test_the_same_in_every_motion_is_a_law() -> None:
    assert odds([0.5] * 6) > 3


@pytest.mark.parametrize("amounts", [[1.0, 0, 0] * 2, [1.0, -1.0, 0] * 2, [0.2, 1.5, 0.7] * 2])
def test_what_each_motion_has_of_its_own_is_none(amounts: list[float]) -> None:
    assert odds(amounts) < -3


def test_what_one_motion_alone_can_show_is_a_law_unless_another_denies_it() -> None:
    """A torque that saturates does so in the fastest motion: that it acts so there by chance is as unlikely as any."""
    assert odds([0.5] * 6, shows=(1.0, 0, 0) * 2) == pytest.approx(3.4, abs=0.3)
    assert odds([0.5, 0, 0] * 2, shows=(1.0, 1.0, 0) * 2) < -3


def test_a_curve_is_a_law_without_a_name_where_other_motions_have_it_and_not_where_they_only_do_not_deny_it() -> (
    None
):
    """A curve takes any form, so that what one motion has of its own has it by no coincidence."""
    assert odds([0.5] * 6, named=False) > 2
    assert odds([0.5] * 6, named=False, shows=(1.0, 0, 0) * 2) < 0.5
    assert odds([0.2, 1.5, 0.7] * 2, named=False) < -3
    assert odds([0.5] * 6, named=False, motions=1) == -np.inf


def test_a_law_is_right_to_a_per_cent_or_so() -> None:
    """However surely each motion's own amount is known."""
    assert odds([30.0, 30.3, 29.7] * 2) > 3
    assert odds([30.0, 60.0, 15.0] * 2) < -3


def test_a_wave_is_right_to_a_per_cent_in_its_phase_as_well() -> None:
    """Of a wave that is all cosine, a phase that is a little off in each motion is a sine that the law has none of."""
    assert odds([30.0] * 6, across=[0.9, -0.4, -0.5] * 2) > 3
    assert odds([30.0] * 6, across=[20.0, -10.0, -10.0] * 2) < -3


@pytest.mark.parametrize("phase", [0.0, 0.7, np.pi / 2])
def test_what_a_wave_may_be_off_by_does_not_depend_on_its_phase(phase: float) -> None:
    sizes = alike(3.0 * np.array([np.cos(phase), np.sin(phase)]), 50.0 * np.eye(2))
    assert sizes == pytest.approx(np.full(2, 3.0 / np.sqrt(2)))


def test_of_coefficients_in_other_units_each_takes_as_large_a_part() -> None:
    """As of play: its gap, and the damping of its contacts, which hardly tells."""
    gram = np.array([[4e10, 0.0], [0.0, 9.0]])
    sizes = alike(np.array([5e-4, 0.1]), gram)
    assert sizes**2 * np.diag(gram) == pytest.approx(np.full(2, (4e10 * 25e-8 + 0.09) / 2))


def test_of_one_motion_nothing_is_known() -> None:
    assert odds([1.0, 0, 0, 0, 0, 0], motions=1) == np.inf


def test_numbers_that_are_each_run_s_own_are_no_law_of_motions() -> None:
    assert odds([1.0, 0, 0] * 2, each_run=True) == np.inf


def test_sizes_of_a_curve_are_weighed_alike() -> None:
    assert odds([0.5] * 6, scales=(1.0, 0.1)) > 3
    assert odds([1.0, 0, 0] * 2, scales=(1.0, 0.1)) < -3


def test_what_does_nothing_along_a_recording_is_off_by_nothing() -> None:
    found = alike(np.array([68.0, 0.0]), np.array([[3e20, 0.0], [0.0, 0.0]]))
    assert found[0] > 0
    assert found[1] == 0
