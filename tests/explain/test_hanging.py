"""A further mass that the load's speed stiffens: how it swings, where it is sought, and the name of a pendulum."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.integrate import solve_ivp
from sealed_sessions import fewer
from strangers import STRANGERS, belief_of, session_of

from schwung.explain.causes.third_mass import explained, stiffened, third_mass
from schwung.explain.weighing.weigh import weigh
from schwung.motion import Array

STEP_S = 1e-3
TIME = np.arange(0.0, 0.6, STEP_S)
#: A stroke's acceleration, and the share of its speed's square.
PUSHED = 40 * np.sin(2 * np.pi * TIME / 0.6) + 3 * np.sin(2 * np.pi * 30 * TIME)
SHARE = np.sin(np.pi * TIME / 0.6) ** 4
HANGS = next(one for one in STRANGERS if one.hangs[0] > 0)


@pytest.mark.parametrize(
    ("rate", "stiffer", "decay"), [(60.0, 8.0, 3.0), (150.0, 0.5, 0.0), (20.0, 1.0, 40.0)]
)
def test_it_swings_as_its_stiffness_changes(rate: float, stiffer: float, decay: float) -> None:
    def square(now: float) -> float:
        return float(rate**2 * (1 + stiffer * np.interp(now, TIME, SHARE)))

    def rates(now: float, state: Array) -> Array:
        return np.array(
            [state[1], np.interp(now, TIME, PUSHED) - 2 * decay * state[1] - square(now) * state[0]]
        )

    swung = solve_ivp(
        rates, (0.0, TIME[-1]), [0.0, 0.0], t_eval=TIME, max_step=STEP_S / 2, rtol=1e-9, atol=1e-12
    ).y
    each = np.array([square(now) for now in TIME])
    wanted = each * swung[0] + 2 * decay * swung[1]
    found = stiffened(PUSHED, each, decay, STEP_S)
    assert found == pytest.approx(wanted, abs=5e-3 * np.max(np.abs(wanted)))


def test_where_the_speed_does_not_stiffen_it_is_a_further_mass() -> None:
    found = stiffened(PUSHED, np.full_like(TIME, 90.0**2), 0.05 * 90.0, STEP_S)
    assert found == pytest.approx(third_mass(PUSHED, 90.0, 0.05, STEP_S), abs=1e-8 * np.max(np.abs(found)))


def test_what_is_missed_is_explained_most_by_what_it_was_made_by() -> None:
    """In two runs, the second of which is no continuation of the first."""
    rates, stiffer = np.geomspace(20.0, 200.0, 24), np.geomspace(0.5, 20.0, 12)
    starts = np.array([0, TIME.size, 2 * TIME.size])
    one = stiffened(PUSHED, rates[10] ** 2 * (1 + stiffer[5] * SHARE), 0.05 * rates[10], STEP_S)
    noise = np.random.default_rng(3).standard_normal(2 * TIME.size) * np.std(one)
    twice = [np.concatenate([each, each]) for each in (one, PUSHED, SHARE)]
    scores = explained(twice[0] + noise, twice[1], twice[2], starts, STEP_S, rates, stiffer, 0.05)
    row, at = np.unravel_index(int(np.argmax(scores)), scores.shape)
    assert abs(int(row) - 10) + abs(int(at) - 5) <= 1


@pytest.mark.long
def test_a_pendulum_is_a_further_mass_that_the_speed_stiffens() -> None:
    """By its sine, and by as much damping at any frequency."""
    told = weigh(fewer(session_of(HANGS, 5, every=8, times=(0.25, 0.4)), 2), belief_of(HANGS))
    assert {one.name for one in told.names if one.probability > 0.5} == {"extra_compliance"}
    (mass,) = (one for one in told.names if one.name == "extra_compliance")
    inertia, hertz, share = HANGS.hangs
    assert mass.parameters["inertia_kgm2"].value == pytest.approx(inertia, rel=0.1)
    assert mass.parameters["stiffness_nm_rad"].value == pytest.approx(
        inertia * (2 * np.pi * hertz) ** 2, rel=0.2
    )
    assert mass.parameters["speed_share"].value == pytest.approx(share, rel=0.1)
