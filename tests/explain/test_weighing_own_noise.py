"""Noise that is what a set leaves: of the runs that are fitted, whatever the others are about."""

from dataclasses import replace

import numpy as np
import pytest
from integrated import RATE_HZ, sampled, view_of
from scipy.integrate import solve_ivp

from schwung.drivetrain.inertia import InertiaTable
from schwung.drivetrain.machine import Load, Machine, Motor
from schwung.explain.causes.candidate import Candidate
from schwung.explain.causes.joined import run_by_run
from schwung.explain.causes.present import Member
from schwung.explain.weighing.round import at_rest, linearised
from schwung.explain.weighing.wide import wide_fit
from schwung.innovations.effect import Effect
from schwung.innovations.likelihood import Noise
from schwung.session.model import Run

NOISE = Noise(torque_nm=0.4, speed_rad_s=0.02, position_rad=2e-6)
ROTOR, LOAD = 0.02, 0.06


def load_at(angle):
    return LOAD * (1 + 0.6 * np.sin(3 * angle))


HUM_HZ, HUM_NM = 40.0, 20.0
ANGLES = np.linspace(-1.0, 3.0, 4001)
MACHINE = Machine(
    name="rigid",
    motor=Motor(inertia_kgm2=ROTOR, viscous_friction_nms=0.0, peak_torque_nm=100.0),
    load=Load(inertia_table=InertiaTable(ANGLES, load_at(ANGLES)), viscous_friction_nms=0.0),
)


def run_of(number: int, rate: float | None = None, hum_nm: float = 0.0) -> Run:
    """A sine's torque (of so much a second more than 5 Hz), and a hum of its own phase that none reports; by another
    integrator."""
    time = np.arange(500) / RATE_HZ

    def torque(now):
        return 20.0 * np.sin(2 * np.pi * (5 + (number if rate is None else rate)) * now)

    def rates(now, state):
        slope = 1.8 * LOAD * np.cos(3 * state[0])
        hum = hum_nm * np.sin(2 * np.pi * HUM_HZ * now + number)
        return [state[1], (torque(now) + hum - slope * state[1] ** 2 / 2) / (ROTOR + load_at(state[0]))]

    moved = solve_ivp(rates, (0, time[-1]), np.zeros(2), "RK45", time, max_step=1e-4).y
    return sampled(number, time, moved, torque(time), NOISE)


def test_a_run_about_former_states_says_nothing_of_the_noise() -> None:
    """One that was kept aside still moved as the belief had it, and all noise was as large as that was wrong."""
    view = at_rest(view_of([run_of(number) for number in range(3)], MACHINE), [], NOISE).view
    former = replace(view.runs[2], states=view.runs[2].states * 1.3)
    stale = replace(view, runs=(*view.runs[:2], former))
    found = [linearised(one, [], NOISE, 1.0, (0, 1)).noise for one in (view, stale)]
    assert found[1].torque_nm == pytest.approx(found[0].torque_nm)
    assert found[1].speed_rad_s == pytest.approx(found[0].speed_rad_s)
    assert found[0].speed_rad_s == pytest.approx(NOISE.speed_rad_s, rel=0.15)


@run_by_run
def hum(along, _shape):
    """A sine and a cosine for each of four runs."""
    waves, columns = 2 * np.pi * HUM_HZ * along.time_s, np.zeros((along.speed.size, 8))
    columns[:, 2 * along.number] = np.sin(waves)
    columns[:, 2 * along.number + 1] = np.cos(waves)
    return Effect(on_motor=columns)


def test_what_a_run_that_is_kept_aside_has_of_its_own_is_no_noise() -> None:
    """The phase of its hum is known of the fitted runs alone: its repeat, which is fitted, differed by all of a hum."""
    view = view_of([run_of(number, number // 2, HUM_NM) for number in range(4)], MACHINE)
    view = replace(view, repeats=((0, 1), (2, 3)))
    phases = np.arange(4.0) * [1, 1, 1, np.nan]
    known = np.nan_to_num(HUM_NM * np.stack([np.cos(phases), np.sin(phases)], 1).reshape(-1))
    found = {}
    for own in (True, False):
        candidate = Candidate("periodic_disturbance", hum, (HUM_NM,) * 8, each_run=own)
        members = [Member(candidate, (), known, np.array(candidate.deviations))]
        found[own] = wide_fit(view, members, NOISE, (0, 1, 2)).noise.torque_nm
    assert found[True] == pytest.approx(NOISE.torque_nm, rel=0.3)
    assert found[False] > 5 * NOISE.torque_nm  # of a cause that all runs share, the others tell as well
