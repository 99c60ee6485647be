"""Recordings without a bus: a sample stands beside what led to it."""

import numpy as np
import pytest

from schwung_sim.drives.axis import ServoAxis
from schwung_sim.errors import BenchError
from schwung_sim.plants import TICK_S, make_plant
from schwung_sim.recording import Noise, play

SILENT = Noise(0.0, 0.0)


def test_demand_and_added_torque_are_those_of_the_sample_and_noise_is_added_after() -> None:
    ticks = 1600
    demand = 0.3 * (1 - np.cos(np.linspace(0, np.pi, ticks))) / 2
    added = np.linspace(0, 8.0, ticks)
    clean = play(ServoAxis(make_plant("two-mass")), demand, added, 8, SILENT, 1)
    assert clean.time_s[1] == pytest.approx(8 * TICK_S)
    assert clean.position_demand_rad == pytest.approx(demand[7::8])
    assert clean.torque_added_nm == pytest.approx(added[7::8])
    assert np.max(np.abs(clean.position_rad - clean.position_demand_rad)) < 0.02
    noisy = play(ServoAxis(make_plant("two-mass")), demand, added, 8, Noise(0.02, 0.1), 1)
    assert noisy.position_rad == pytest.approx(clean.position_rad)
    assert np.std(noisy.speed_rad_s - clean.speed_rad_s) == pytest.approx(0.02, rel=0.2)
    assert np.std(noisy.torque_nm - clean.torque_nm) == pytest.approx(0.1, rel=0.2)


def test_a_coarse_speed_comes_in_counts() -> None:
    made = play(
        ServoAxis(make_plant("two-mass")),
        np.linspace(0, 0.1, 800),
        np.zeros(800),
        4,
        Noise(0.0, 0.0, 0.25),
        1,
    )
    assert made.speed_rad_s / 0.25 == pytest.approx(np.rint(made.speed_rad_s / 0.25))


def test_unequal_lengths_are_refused() -> None:
    with pytest.raises(BenchError, match="one length"):
        play(ServoAxis(make_plant("two-mass")), np.zeros(8), np.zeros(9), 1, SILENT, 1)
