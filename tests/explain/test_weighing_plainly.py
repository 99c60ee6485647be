"""What has no name in plain words: which laws come near to it, and where causes act."""

from __future__ import annotations

from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from schwung.explain.causes.candidate import Candidate
from schwung.explain.causes.curves import column
from schwung.explain.publishing.places import Acts, where_of
from schwung.explain.publishing.plainly import nearest
from schwung.innovations.effect import Effect

TIME = np.arange(4000) / 1000
SPEED = 10 * np.sin(2 * np.pi * TIME)
DRY = Candidate("coulomb_friction", lambda a, _: Effect(column(-a.direction)), (1.0,),
                lambda c, _: {"torque_nm": c[0]}, positive=(0,), least=(0.0,), family="dry")  # fmt: skip
VISCOUS = Candidate("viscous_friction", lambda a, _: Effect(column(-a.speed)), (1.0,),
                    lambda c, _: {"coefficient_nms": c[0]}, positive=(0,), least=(0.0,))  # fmt: skip
EITHER_WAY = Candidate(
    "asymmetric_friction",
    lambda a, _: Effect(-np.stack([np.maximum(a.direction, 0), np.minimum(a.direction, 0)], 1)), (1.0, 1.0),
    lambda c, _: {"torque_positive_nm": c[0], "torque_negative_nm": c[1]}, positive=(0, 1), least=(0.0, 0.0),
    family="dry",
)  # fmt: skip
OFFSET = Candidate("torque_offset", lambda a, _: Effect(column(np.ones_like(a.speed))), (1.0,),
                   lambda c, _: {"torque_nm": c[0]}, coordinate="direction")  # fmt: skip
LAWS = (OFFSET, EITHER_WAY, VISCOUS, DRY)


def run(torque: Any) -> Any:
    """A run along which a curve without a name does this (N·m)."""
    along = SimpleNamespace(
        speed=SPEED, direction=np.tanh(SPEED / 0.01), load_angle=-np.cos(2 * np.pi * TIME), torque=0 * SPEED
    )
    return SimpleNamespace(run=0, along=along, missed_nm=-torque)


def acts(torque: Any, coordinate: str = "speed") -> Acts:
    """That curve."""
    curve = Candidate(
        coordinate, lambda _a, _s: Effect(column(-torque)), (1.0,), named=False, coordinate=coordinate
    )
    return Acts(coordinate, curve, (), np.ones(1))


def test_friction_of_no_textbook_is_near_to_dry_and_viscous_friction() -> None:
    torque = np.tanh(SPEED / 0.01) * (2 + 0.3 * np.abs(SPEED) + 0.2 * np.cos(np.abs(SPEED)))
    found = nearest([acts(torque)], LAWS, [run(torque)])
    assert found is not None
    assert set(found.laws) == {
        "coulomb_friction",
        "viscous_friction",
    }  # of two for one thing, that with fewer numbers
    assert found.laws["coulomb_friction"]["torque_nm"] == pytest.approx(2, rel=0.1)
    assert found.laws["viscous_friction"]["coefficient_nms"] == pytest.approx(0.3, rel=0.1)
    assert 0.99 < found.share < 1


def test_where_one_law_is_all_of_it_no_other_is_told() -> None:
    """Of what is left, which is rounding, any takes something: a headline said viscous friction of 1e-18 N·m·s."""
    torque = 2 * np.tanh(SPEED / 0.01)
    found = nearest([acts(torque)], LAWS, [run(torque)])
    assert found is not None
    assert set(found.laws) == {"coulomb_friction"}


def test_what_no_law_comes_near_to_is_not_described() -> None:
    wave = np.sin(40 * np.cos(2 * np.pi * TIME))
    assert nearest([acts(wave)], LAWS, [run(wave)]) is None
    assert nearest([], LAWS, [run(wave)]) is None
    # and no friction pushes
    pushing = -2 * np.tanh(SPEED / 0.01)
    assert nearest([acts(pushing)], LAWS, [run(pushing)]) is None


def test_a_cause_is_told_where_it_acts_and_which_way() -> None:
    place = run(0 * SPEED).along.load_angle
    torque = np.where((np.abs(place - 0.3) < 0.1) & (SPEED > 0), 1.5, 0.0)
    where = where_of(acts(torque, "position"), [run(torque)], "rotary")
    assert where is not None
    assert where.interval == pytest.approx((0.2, 0.4), abs=0.02)
    assert (where.way, where.unit) == ("forward", "rad")
    assert where.share == pytest.approx(1)
    assert where.text.endswith("rad, while moving forward")
    everywhere = where_of(acts(SPEED, "speed"), [run(SPEED)], "linear")
    assert everywhere is not None
    assert (everywhere.interval, everywhere.way, everywhere.text) == (None, "", "")
    nothing = Candidate("torque_filter", lambda a, _: Effect(speed=column(a.speed)), (1.0,))
    assert where_of(Acts("torque_filter", nothing, (), np.ones(1)), [run(SPEED)], "rotary") is None
