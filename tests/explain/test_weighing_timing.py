"""By how much torque and speed are reported apart is told, whether or not that is a finding."""

from pathlib import Path

import pytest
from sealed_sessions import drawn
from strangers import STRANGERS, belief_of, session_of

from schwung.explain.weighing.weigh import weigh


@pytest.mark.long
@pytest.mark.parametrize(
    ("seed", "key"), [(1006104, "time_constant_s"), (1006112, "delay_s")], ids=["true torque", "speed"]
)
def test_what_is_late_by_no_more_than_drives_usually_are_is_told_to_microseconds(
    tmp_path: Path, seed: int, key: str
) -> None:
    """A torque 87 µs after what is reported of it, a speed that is reported 115 µs late: no names, for drives that are
    sound are off by as much."""
    session, machine, label = drawn(tmp_path, seed, 1, kind="single", level="clear")
    (hidden,) = label["effects"]
    found = weigh(session, machine)
    assert not found.names
    later = found.timing.later_s
    assert found.timing.than == "speed"
    assert later.value == pytest.approx(-hidden["parameters"][key], abs=3e-6)
    assert later.high - later.low < 6e-6


@pytest.mark.long
@pytest.mark.parametrize(("number", "later_s"), [(0, 0.0), (2, 0.4e-3 - 125e-6 / 2)], ids=["sound", "named"])
def test_of_what_has_a_name_it_is_told_as_well(number: int, later_s: float) -> None:
    """A filter that is worked out from tick to tick of 125 µs is half of one sooner than its time constant."""
    stranger = STRANGERS[number]
    found = weigh(session_of(stranger, 0, every=4, times=(0.2, 0.4)), belief_of(stranger))
    assert {one.name for one in found.names} == set(stranger.right)
    assert found.timing.later_s.value == pytest.approx(later_s, abs=6e-6)
