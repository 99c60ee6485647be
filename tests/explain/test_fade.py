"""A torque constant that falls as the motor heats: its heat, and its name on a machine of another formula."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.integrate import solve_ivp
from sealed_sessions import fewer
from strangers import STRANGERS, belief_of, session_of

from schwung.drivetrain.fade import faded, heated
from schwung.drivetrain.physics_term import PhysicsTerm
from schwung.explain.publishing.learned import Found, learned
from schwung.explain.weighing.weigh import weigh
from schwung.motion import Array

WARMS = next(one for one in STRANGERS if one.warms[0] > 0)


@pytest.mark.parametrize("time_s", [3e-3, 0.1, 50.0])
@pytest.mark.parametrize("first", [0.0, 0.7])
def test_heat_follows_the_square_of_the_torque(time_s: float, first: float) -> None:
    time = np.linspace(0.0, 0.5, 501)
    torque = 20 * np.sin(25 * time) + 5

    def rate(now: float, heat: Array) -> Array:
        return np.asarray((np.interp(now, time, (torque / 30) ** 2) - heat) / time_s)

    solved = solve_ivp(rate, (0.0, 0.5), [first], t_eval=time, max_step=1e-3, rtol=1e-9, atol=1e-12).y[0]
    assert heated(torque, 30.0, time_s, 1e-3, first) == pytest.approx(solved, abs=2e-6)


def test_heat_never_turns_a_torque_round() -> None:
    assert faded(10.0, 0.5, 0.4) == pytest.approx(8.0)
    assert faded(-10.0, 0.5, 3.0) == pytest.approx(0.0)


def test_what_heats_to_the_same_is_one_whatever_torque_it_is_told_at() -> None:
    believed = belief_of(WARMS).model_copy(
        update={
            "physics": (
                PhysicsTerm(
                    name="torque_constant_fade", share_at_peak=0.4, peak_nm=20.0, time_constant_s=0.3
                ),
            )
        }
    )
    more = {"share_at_peak": 0.9, "peak_nm": 60.0, "time_constant_s": 0.3, "start_heat": 0.0}
    (term,) = learned(believed, [Found("torque_constant_fade", True, more, {})]).physics
    assert term.parameters["share_at_peak"] == pytest.approx(0.4 + 0.9 / 9)


@pytest.mark.long
def test_a_motor_that_weakens_by_another_formula_is_one_that_fades() -> None:
    """1/(1 + h) in place of 1 − h, and every run begins as warm as the last one left it."""
    session = fewer(session_of(WARMS, 5, every=8, times=(0.25, 0.4)), 2)
    told = weigh(session, belief_of(WARMS))
    assert {one.name for one in told.names if one.probability > 0.5} == {"torque_constant_fade"}
    (fade,) = (one for one in told.names if one.name == "torque_constant_fade")
    share, time_s = (fade.parameters[key] for key in ("share_at_peak", "time_constant_s"))
    peak_nm = fade.parameters["peak_nm"].value
    # 1.5 h at 60 N·m, of which a tenth is lost at a mean heat of 0.1
    assert share.value * (60 / peak_nm) ** 2 == pytest.approx(1.5, rel=0.25)
    assert time_s.value == pytest.approx(0.25, rel=0.25)
