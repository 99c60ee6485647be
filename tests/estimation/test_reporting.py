"""What a drive's ticks, filters and late reports take off amplitudes; and bands on machines from another hand."""

import sys
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from schwung.estimation import estimate
from schwung.estimation.fit import Nuisance
from schwung.estimation.reach import reach_of
from schwung.estimation.reporting import Seen, losses

sys.path.append(str(Path(__file__).parents[2] / "benchmarks"))
from stranger_plant import draw_hidden, draw_stranger, stranger_belief, stranger_session

TICK = 125e-6


def seen(speed_lag_s, loss_s2, torque_lag_s, *, loss_std=1e-9, swing=10.0):
    return Seen(Nuisance(speed_lag_s, 1e-6), Nuisance(loss_s2, loss_std), Nuisance(torque_lag_s, 1e-6), swing)


def filtered(lag):
    return lag * (lag + TICK) / 2


def test_a_held_torque_is_less_than_its_samples():
    """sin(x)/x of it, x = ½ωT; a speed from two angles has lost as much, and nothing of its corners."""
    found = losses(seen(TICK / 2, TICK**2 / 24, -TICK / 2), TICK, 2 * TICK, held=False)
    assert found.torque_s2.value == pytest.approx(-(TICK**2) / 24, rel=0.02)
    assert found.speed_s2.value == pytest.approx(TICK**2 / 24, rel=0.02)
    assert found.corner_s2 == pytest.approx(0.0, abs=1e-12)
    assert found.torque_s2.std < 1e-10


def test_a_sensor_at_the_tick_sees_the_corners():
    """T²/12 of dT/dt over the rotor, which passes for a gain of as much times the swing."""
    found = losses(seen(0.0, -(TICK**2) / 12 * 10, -TICK / 2), TICK, TICK, held=False)
    assert found.corner_s2 == pytest.approx(-(TICK**2) / 12, rel=0.02)
    assert found.speed_s2.value == pytest.approx(0.0, abs=1e-10)


def test_a_lag_that_both_share_is_a_filter():
    lag = 143e-6
    found = losses(seen(lag + TICK / 2, filtered(lag), lag - TICK / 2), TICK, TICK, held=False)
    assert found.torque_s2.value == pytest.approx(filtered(lag) - TICK**2 / 24, rel=0.05)


def test_a_torque_late_by_whole_ticks_has_lost_nothing_to_a_filter():
    lag = 143e-6
    found = losses(seen(lag + TICK / 2, filtered(lag), 1.5 * TICK), TICK, TICK, held=False)
    assert found.torque_s2.value == pytest.approx(-(TICK**2) / 24, abs=1e-10)


def test_where_ways_are_as_likely_the_band_holds_them_all():
    """A lag of two ticks and a half, of torque and speed: a filter as well as a late report, nothing measured."""
    both = seen(2.5 * TICK, 0.0, 2.5 * TICK, loss_std=1e-6)
    found = losses(both, TICK, TICK, held=False)
    for true in (-(TICK**2) / 24, filtered(2 * TICK) - TICK**2 / 24):
        assert abs(found.torque_s2.value - true) < 2.2 * found.torque_s2.std


def test_without_a_controllers_period_the_usual_ones_are_open():
    known, unknown = (
        losses(seen(0.0, 0.0, 0.0, loss_std=1e-6), period, 1e-3, held=False) for period in (TICK, None)
    )
    assert unknown.torque_s2.std >= known.torque_s2.std


@pytest.mark.long
@pytest.mark.parametrize("every", [1, 8])
def test_bands_hold_on_machines_from_another_hand(every):
    """Logs of every tick and of every eighth: of 12 machines each, no more than chance leaves out.

    Cells of a machine stand or fall together: of 12 machines one or two at the most may be off as a whole.
    """
    inside = []
    for seed in range(40, 52):
        stranger = draw_stranger(seed, (0.1, 0.15, 0.25, 0.5)[seed % 4], every)
        table = estimate(stranger_session(stranger, seed), stranger_belief(stranger), "multiphase").table
        off = table.inertia_kgm2 - stranger.truth(table.position_rad)
        inside.append(np.mean(np.abs(off) <= 1.96 * table.std_kgm2))
    assert np.mean(inside) > 0.87


def test_a_whole_record_is_fitted_behind_a_filter_and_late_reports():
    """A speed behind a filter of 270 µs and two ticks: its noise is no white one, and its lag half a stiffness."""
    stranger = draw_stranger(12, 0.1, 2)
    table = estimate(stranger_session(stranger, 12), stranger_belief(stranger), "trajectory").table
    off = table.inertia_kgm2 - stranger.truth(table.position_rad)
    assert np.sqrt(np.mean(off**2)) < 3e-4 * stranger.mean_kgm2
    assert np.mean(np.abs(off) <= 1.96 * table.std_kgm2) > 0.8


def test_a_weight_is_a_spring_to_the_ripple():
    """−T_l'/ω² of the inertia, which the motion tells: without, the band holds one cell in ten."""
    stranger = draw_hidden(710019, 0.5, None)
    assert stranger.cause == "weight"
    table = estimate(stranger_session(stranger, 710019), stranger_belief(stranger), "multiphase").table
    off = table.inertia_kgm2 - stranger.truth(table.position_rad)
    assert np.mean(np.abs(off) <= 1.96 * table.std_kgm2) > 0.8


@pytest.mark.long
def test_one_number_is_told_of_a_table():
    """The file's band, the verdict's expected error and the sentence about the recording's bound."""
    stranger = draw_stranger(41, 0.25, 2)
    session, belief = stranger_session(stranger, 41), stranger_belief(stranger)
    stiffer = belief.coupling.model_copy(update={"stiffness_nm_rad": 1.3 * belief.coupling.stiffness_nm_rad})
    for machine in (belief, belief.model_copy(update={"coupling": stiffer})):
        found = estimate(session, machine, "multiphase")
        band = float(np.median(found.table.std_kgm2))
        told = found.to_json()["trust"]["predicted_error"] * float(np.mean(found.table.inertia_kgm2))
        assert told == pytest.approx(band, rel=1e-9)
        reach = reach_of(session, machine, replace(found, trust=replace(found.trust, verdict="good")))
        assert reach.table_kgm2 == pytest.approx(band, rel=1e-9)
        off = found.table.inertia_kgm2 - stranger.truth(found.table.position_rad)
        assert np.mean(np.abs(off) <= 1.96 * found.table.std_kgm2) > 0.8
    assert found.trust.left_out > 0.01
