"""A stiffness that differs along the way, of a machine whose compliance waves: another formula than the law's."""

from pathlib import Path

import numpy as np
import pytest
from sealed_sessions import drawn
from strangers import STIFFNESS, Stranger, belief_of, session_of

from schwung.explain.publishing.publish import publish
from schwung.explain.weighing import growth
from schwung.explain.weighing.asked import further
from schwung.explain.weighing.resting import Rests
from schwung.explain.weighing.search import Scored, Search
from schwung.explain.weighing.settling import Settled
from schwung.explain.weighing.weigh import weigh


@pytest.mark.long
def test_a_coupling_that_gives_more_here_than_there_has_a_name():
    stranger = Stranger("gives", ("stiffness_over_angle",), gives=(0.15, 3.0))
    found = weigh(session_of(stranger, 5, every=8, times=(0.25,)), belief_of(stranger))
    (name,) = (one for one in found.names if one.probability > 0.5)
    assert name.name == "stiffness_over_angle"
    angle = np.linspace(0.0, 4.3, 200)
    share, order, phase = (name.parameters[key].value for key in ("share", "order", "phase_rad"))
    told = 1 + share * np.sin(order * angle + phase)
    true = 1 / (1 - 0.15 * np.cos(3 * angle))
    assert STIFFNESS * np.max(np.abs(told - true)) < 0.06 * STIFFNESS
    assert share == pytest.approx(0.15, abs=0.03)
    turns = name.parameters["order"]
    assert 0.002 < (turns.high - turns.low) / turns.value < 0.2  # it is known so well, and no better


@pytest.mark.long
def test_a_coupling_half_as_stiff_as_believed_is_found_beside_two_others(tmp_path: Path) -> None:
    """Its resonance is far off: no line about the belief leads there, and curves of all kinds stood for it."""
    session, machine, label = drawn(tmp_path, 288502, kind="three")
    found = weigh(session, machine)
    hidden = {effect["physics"]: effect["parameters"] for effect in label["effects"]}
    told = {one.name: one for one in found.names if one.probability > 0.5}
    assert set(told) == set(hidden)
    stiffness = told["coupling_stiffness"].parameters["stiffness_nm_rad"].value
    assert stiffness == pytest.approx(hidden["coupling_stiffness"]["stiffness_nm_rad"], rel=0.01)


@pytest.mark.long
def test_a_cubic_stiffness_has_its_size(tmp_path: Path) -> None:
    """By what a coupling carries at the samples, straight between them, it was 5 % too large, of 0.8 % uncertainty."""
    session, machine, label = drawn(tmp_path, 293207, 2, kind="two", level="clear")
    found = next(one for one in publish(session, machine).names if one.physics == "nonlinear_stiffness")
    (true,) = (e["parameters"]["cubic_nm_rad3"] for e in label["effects"] if e["physics"] == found.physics)
    assert found.parameters["cubic_nm_rad3"].value == pytest.approx(true, rel=0.015)


class _Found(Exception):
    """The first cause that was found."""


@pytest.mark.long
def test_a_coupling_that_is_four_times_as_stiff_here_as_there_has_its_order(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """To first order about an even stiffness twice the true order takes ten times as much: five causes stood for it,
    none of them with a name."""
    session, machine, label = drawn(tmp_path, 315507, 2, kind="foreign")

    def first(rests: Rests, search: Search, start: Scored, at: Settled, gained: dict[int, float]) -> None:
        found = further(rests, search, start, at, gained)
        assert found is not None
        raise _Found(found[1].members[-1])

    monkeypatch.setattr(growth, "further", first)
    with pytest.raises(_Found) as found:
        weigh(session, machine)
    (member,), (hidden,) = found.value.args, label["effects"]
    assert member.candidate.name == "stiffness_over_angle"
    assert member.shape[0] == pytest.approx(hidden["parameters"]["order"], abs=0.01)
    share = float(np.hypot(*member.coefficients))
    assert share == pytest.approx(hidden["parameters"]["share"], rel=0.01)
