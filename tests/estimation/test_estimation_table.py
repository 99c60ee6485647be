"""From traces to a table: the grid, the band, and the samples that are left out."""

import numpy as np
import pytest

from schwung.errors import InputError
from schwung.estimation import estimate
from schwung.estimation.methods import METHODS, Outcome, method_named, register
from schwung.estimation.table import combine
from schwung.estimation.values import Trace


def trace_of(angle, inertia, imaginary=None, stroke=None):
    angle = np.asarray(angle, dtype=float)
    ones = np.ones_like(angle)
    return Trace(
        time_s=np.arange(angle.size) / 1000,
        position_rad=angle,
        inertia_kgm2=np.asarray(inertia, dtype=float),
        imaginary_kgm2=0 * ones if imaginary is None else np.asarray(imaginary, dtype=float),
        inertia_variation_kgm2=0 * ones,
        speed_amplitude_rad_s=ones,
        torque_amplitude_nm=ones,
        stroke=stroke,
    )


ANGLE = np.linspace(0.0, 2.0, 300)


def test_a_straight_line_is_kept_however_uneven_the_samples():
    """Local straight lines reproduce one exactly; bin means would not."""
    uneven = 2 * np.sort(np.random.default_rng(0).beta(0.5, 0.5, size=400))
    table = combine([trace_of(uneven, 0.1 + 0.03 * uneven)], [20], 21).table
    inner = slice(1, -1)
    np.testing.assert_allclose(table.inertia_kgm2[inner], (0.1 + 0.03 * table.position_rad)[inner], rtol=1e-9)
    np.testing.assert_allclose(table.inertia_kgm2, 0.1 + 0.03 * table.position_rad, rtol=0.02)


def test_standstill_at_the_end_does_not_pull_its_neighbours():
    """Hundreds of samples at one angle weigh there and nowhere else."""
    angle = np.concatenate([np.zeros(500), ANGLE])
    table = combine([trace_of(angle, 0.1 + 0.03 * angle)], [20], 21).table
    expected = 0.1 + 0.03 * table.position_rad
    np.testing.assert_allclose(table.inertia_kgm2[1:-1], expected[1:-1], rtol=1e-9)
    np.testing.assert_allclose(table.inertia_kgm2[0], expected[0], rtol=2e-4)


def test_opposite_directions_average_and_their_difference_is_in_the_band():
    up, down = trace_of(ANGLE, 0.1 + 0 * ANGLE), trace_of(ANGLE[::-1], 0.12 + 0 * ANGLE)
    table = combine([up, down], [20, 20], 11).table
    np.testing.assert_allclose(table.inertia_kgm2, 0.11)
    np.testing.assert_allclose(table.std_kgm2, 0.01, rtol=1e-6)


def test_strokes_of_one_run_are_told_apart():
    angle = np.concatenate([ANGLE, ANGLE[::-1]])
    stroke = np.repeat([0, 1], ANGLE.size)
    inertia = np.where(stroke == 0, 0.1, 0.12)
    np.testing.assert_allclose(
        combine([trace_of(angle, inertia, stroke=stroke)], [20], 11).table.std_kgm2, 0.01
    )


def test_of_two_that_differ_none_is_believed_more():
    """One is free of noise to rounding, the other not: half their distance is what is known of either."""
    noisy = trace_of(ANGLE[::-1], 0.12 + 1e-9 * np.cos(9 * ANGLE))
    table = combine([trace_of(ANGLE, 0.1 + 0 * ANGLE), noisy], [20, 20], 11).table
    np.testing.assert_allclose(table.inertia_kgm2, 0.11, rtol=1e-3)


def test_a_bad_repeat_weighs_next_to_nothing_and_good_ones_alike():
    rng = np.random.default_rng(2)
    angle = np.linspace(0.0, 2.0, 3000)
    good = [trace_of(angle, 0.1 + 1e-4 * rng.normal(size=angle.size)) for _ in range(4)]
    bad = trace_of(angle, 0.13 + 3e-3 * rng.normal(size=angle.size))
    table = combine([*good, bad], [20] * 5, 21).table
    assert np.max(np.abs(table.inertia_kgm2 - 0.1)) < 2e-4  # a plain mean would be off by 6e-3
    alone = combine(good, [20] * 4, 21).table
    assert np.mean(table.std_kgm2) < 2 * np.mean(alone.std_kgm2)


def test_repeats_of_one_way_do_not_outweigh_the_way_back():
    """Friction adds on the way there what it takes off on the way back."""
    there = [trace_of(ANGLE, 0.11 + 0 * ANGLE, stroke=np.zeros(ANGLE.size, dtype=int)) for _ in range(3)]
    back = trace_of(ANGLE[::-1], 0.09 + 0 * ANGLE, stroke=np.ones(ANGLE.size, dtype=int))
    table = combine([*there, back], [20] * 4, 11).table
    np.testing.assert_allclose(table.inertia_kgm2, 0.1, rtol=1e-9)


def test_a_bend_that_a_window_cannot_resolve_is_in_the_band():
    """Mean of a cosine over a window of 100 samples: (1 − sin(x)/x) of it is lost, x half the window in rad."""
    angle = np.linspace(0.0, 12.0, 3000)
    table = combine([trace_of(angle, 0.1 + 0.03 * np.cos(3 * angle))], [100], 200).table
    x = 3 * 50 * (angle[1] - angle[0])
    lost = (1 - np.sin(x) / x) * 0.03 * np.sqrt(0.5)
    assert np.sqrt(np.mean(table.std_kgm2[10:-10] ** 2)) == pytest.approx(lost, rel=0.25)


def test_imaginary_part_widens_the_band():
    table = combine([trace_of(ANGLE, 0.1 + 0 * ANGLE, imaginary=0.004 + 0 * ANGLE)], [20], 11).table
    np.testing.assert_allclose(table.std_kgm2, 0.004)


def test_noise_within_a_stroke_counts_each_period_once():
    """300 samples of white noise, 20 per window: 15 independent values, not 300."""
    noise = 0.01 * np.random.default_rng(1).normal(size=20_000)
    angle = np.linspace(0.0, 2.0, noise.size)
    std = {window: np.mean(combine([trace_of(angle, 0.1 + noise)], [window], 11).table.std_kgm2)
           for window in (20, 80)}  # fmt: skip
    assert std[80] == pytest.approx(2 * std[20], rel=0.01)


def test_negative_and_missing_samples_are_left_out_and_said():
    inertia = 0.1 + 0 * ANGLE
    inertia[:3], inertia[50] = np.nan, -0.4
    combined = combine([trace_of(ANGLE, inertia)], [20], 11)
    np.testing.assert_allclose(combined.table.inertia_kgm2, 0.1)
    assert combined.table.position_rad[0] == ANGLE[3]
    assert combined.notes == ("1 of 297 samples gave a negative inertia and were dropped.",)


def test_angles_that_no_stroke_visited_are_left_out():
    """Two strokes with a gap between them."""
    near, far = np.linspace(0.0, 0.5, 200), np.linspace(1.5, 2.0, 200)
    combined = combine([trace_of(near, 0.1 + 0 * near), trace_of(far, 0.2 + 0 * far)], [20, 20], 21)
    assert not np.any((combined.table.position_rad > 0.65) & (combined.table.position_rad < 1.35))
    assert "left out" in combined.notes[0]


def test_fast_strokes_leave_no_holes():
    """Samples further apart than the grid: the kernel widens."""
    sparse = np.linspace(0.0, 2.0, 12)
    combined = combine([trace_of(sparse, 0.1 + 0.03 * sparse)], [20], 64)
    assert combined.table.position_rad.size == 64
    assert combined.notes == ()


def test_nothing_left():
    for inertia in (np.nan + ANGLE, -1 + 0 * ANGLE):
        with pytest.raises(InputError, match="no angle range"):
            combine([trace_of(ANGLE, inertia)], [20])
    with pytest.raises(InputError, match="no angle range"):
        combine([trace_of(0 * ANGLE, 0.1 + 0 * ANGLE)], [20])


def test_a_further_method_plugs_in_by_name(fast, machine):
    """One class and one call; table, band and trust come with it."""

    class Constant:
        name = "constant"
        needs_reference = False

        def traces(self, task):
            run = task.excited[0]
            return Outcome((trace_of(run.position_rad, 0.1 + 0 * run.position_rad),), notes=("a guess",))

    register(Constant())
    try:
        result = estimate(fast, machine, "constant")
        assert method_named("constant").name == "constant"
    finally:
        del METHODS["constant"]
    np.testing.assert_allclose(result.table.inertia_kgm2, 0.1)
    assert (result.method, result.notes) == ("constant", ("a guess",))
