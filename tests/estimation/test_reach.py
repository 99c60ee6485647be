"""The recording's bound beside the table's band: which of the two is to be improved."""

from dataclasses import replace

import numpy as np
import pytest

from schwung.drivetrain import paper_machine
from schwung.drivetrain.inertia import InertiaTable
from schwung.estimation import estimate
from schwung.estimation.reach import Reach, reach_of


@pytest.fixture(scope="module")
def believed():
    return paper_machine()


def test_a_windowed_method_leaves_much_in_the_recording(bus_rate, believed):
    found = estimate(bus_rate, believed, method="denoised")
    reach = reach_of(bus_rate, believed, found)
    assert reach.ratio > 3
    assert reach.table_kgm2 == pytest.approx(np.median(found.table.std_kgm2))
    assert "a better method would tell more" in reach.text
    assert reach.to_json()["ratio"] == reach.ratio


def test_the_whole_record_leaves_little(bus_rate, believed):
    found = estimate(bus_rate, believed, method="trajectory")
    assert reach_of(bus_rate, believed, found).ratio < 3


@pytest.mark.parametrize(
    ("table", "method", "words"),
    [
        (1.5, "denoised", "only a better recording"),
        (3.0, "denoised", "a better method"),
        (3.0, "trajectory", "what the model or the sampling leaves out"),
    ],
)
def test_the_sentence_says_what_would_help(table, method, words):
    text = Reach(table, 1.0, method, "kg").text
    assert words in text
    assert f"±{table:g} kg (1σ)" in text


def test_without_a_band_or_with_an_unusable_table_there_is_nothing_to_say(bus_rate, believed):
    found = estimate(bus_rate, believed, method="denoised")
    bare = InertiaTable(found.table.position_rad, found.table.inertia_kgm2)
    assert reach_of(bus_rate, believed, replace(found, table=bare)) is None
    useless = replace(found, trust=replace(found.trust, verdict="unusable"))
    assert reach_of(bus_rate, believed, useless) is None
