"""Curves that nearly cancel one another: each makes the next sample likelier, and where they do not cancel, at rest,
they drive the machine away. Where no run is kept aside, it is driven by the recorded torque alone, and that shows it.
"""

from __future__ import annotations

from collections.abc import Collection, Mapping
from dataclasses import dataclass
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from strangers import Stranger, belief_of, session_of

from schwung.drivetrain.physics_term import PhysicsTerm
from schwung.explain.publishing import free_run
from schwung.explain.publishing import publish as published

PLAIN = Stranger("viscous friction", ())


@dataclass(frozen=True)
class Curve:
    name: str
    worth: float  # log evidence
    named: bool = False

    @property
    def found(self) -> Curve:
        return self


class Chosen:
    """A set of curves."""

    def __init__(self, curves: Collection[Curve]) -> None:
        self.set: Any = SimpleNamespace(curves=tuple(curves), log=sum(c.worth for c in curves))

    def leave_out(self, curves: Collection[Curve]) -> None:
        self.__init__([c for c in self.set.curves if c not in curves])  # type: ignore[misc]

    def sayable(self) -> tuple[list[Curve], tuple[str, ...]]:
        return list(self.set.curves), ()

    def over(self, curve: Curve) -> str:
        return curve.name


SPEED, PLANE, ANGLE, RIPPLE, LAW = (
    Curve("speed", 900.0),
    Curve("plane", 500.0),
    Curve("angle", 280.0),
    Curve("ripple", 300.0),
    Curve("law", 1.0, named=True),
)


def left_by(off: Mapping[str, float], monkeypatch: pytest.MonkeyPatch) -> tuple[set[str], tuple[str, ...]]:
    """What is left of the curves where the machine without some goes so far astray, and the notes; else 5."""
    chosen = Chosen([SPEED, PLANE, ANGLE, RIPPLE, LAW])
    everything = {c.name for c in chosen.set.curves}

    def astray(machine: set[str], _session: None) -> float:
        return off.get(" ".join(sorted(everything - machine)), 5.0)

    monkeypatch.setattr(published, "learned", lambda _machine, curves: {c.name for c in curves})
    monkeypatch.setattr(published, "read_back", lambda machine: machine)
    monkeypatch.setattr(free_run, "astray", astray)
    one = SimpleNamespace(chosen=chosen, machine=None, session=None)
    causes, machine, notes = published._Publishing._driven_freely(one, list(chosen.set.curves), everything)  # type: ignore[arg-type]
    assert {c.name for c in causes} == machine == {c.name for c in chosen.set.curves}
    return everything - {c.name for c in causes}, notes


def test_of_curves_that_drive_it_away_the_one_goes_that_is_worth_the_least(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    out, (note,) = left_by({"plane": 3.0, "angle": 3.1, "ripple": 4.9}, monkeypatch)
    assert out == {"angle"}
    assert "over angle" in note


def test_a_little_nearer_is_no_reason(monkeypatch: pytest.MonkeyPatch) -> None:
    assert left_by({"plane": 3.6, "angle": 4.9}, monkeypatch) == (set(), ())


def test_it_goes_on_for_as_long_as_one_does_as_much(monkeypatch: pytest.MonkeyPatch) -> None:
    away = {"angle": 3.0, "angle ripple": 2.0, "angle plane ripple": 1.9}
    assert left_by(away, monkeypatch)[0] == {"angle", "ripple"}


def test_a_name_stands_by_its_probability(monkeypatch: pytest.MonkeyPatch) -> None:
    assert left_by({"law": 0.1}, monkeypatch)[0] == set()


@pytest.mark.parametrize("nowhere", [np.nan, np.inf])
def test_what_cannot_be_simulated_judges_nothing(nowhere: float, monkeypatch: pytest.MonkeyPatch) -> None:
    assert left_by(dict.fromkeys(("angle", "plane", "speed", "ripple"), nowhere), monkeypatch)[0] == set()


@pytest.mark.long
def test_astray_is_the_mean_square_over_all_that_lasts() -> None:
    session, machine = session_of(PLAIN, 5, every=8, times=(0.25,)), belief_of(PLAIN)
    assert np.isnan(free_run.astray(machine, session))  # a quarter of a second says nothing of what adds up
    lasting = session_of(PLAIN, 5, every=8, times=(4.0,))
    off = [one.position_rms_rad for one in free_run.free_runs(machine, lasting)]
    assert free_run.astray(machine, lasting) == pytest.approx(np.sqrt(np.mean(np.square(off))))
    braked = PhysicsTerm.model_validate({"name": "torque_offset", "torque_nm": 1.0})
    assert free_run.astray(machine.model_copy(update={"physics": (braked,)}), lasting) > 2 * max(off)
