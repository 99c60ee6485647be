"""A further mass that swings near the load's own resonance, on a machine that another integrator moves."""

from functools import lru_cache

import numpy as np
import pytest
from integrated import RATE_HZ, sampled, view_of
from scipy.integrate import solve_ivp

from schwung.drivetrain.machine import Coupling, Load, Machine, Motor
from schwung.explain.weighing.present import Member
from schwung.explain.weighing.settling import Weighing, settled
from schwung.explain.weighing.vocabulary import vocabulary
from schwung.innovations.likelihood import Noise
from schwung.session.model import Run

#: Behind a held rotor the load swings at 66 Hz, as the mass behind it does behind a held load.
ROTOR, LOAD, STIFFNESS, DAMPING = 0.046, 0.142, 24_200.0, 9.0
FURTHER, SPRING, DAMPER = 0.0094, 1609.0, 0.756
RATE, RATIO = float(np.sqrt(SPRING / FURTHER)), DAMPER / (2 * float(np.sqrt(SPRING * FURTHER)))
MACHINE = Machine(
    name="three masses",
    motor=Motor(inertia_kgm2=ROTOR, viscous_friction_nms=0.0, peak_torque_nm=400.0),
    coupling=Coupling(stiffness_nm_rad=STIFFNESS, damping_nms=DAMPING),
    load=Load(inertia_kgm2=LOAD, viscous_friction_nms=0.0),
)
#: Of torque, speed and angle: what the samples have, and what the filter is told.
NOISE = Noise(torque_nm=3.0, speed_rad_s=0.076, position_rad=6e-6)
RUNS = range(2)


def torque(time, phase):
    """There and back, with sines about the resonance; it begins softly."""
    begun = 1 - np.exp(-((time / 0.02) ** 2))
    swept = sum(np.sin(2 * np.pi * hertz * time + phase * hertz) for hertz in (34, 58, 66, 74))
    return begun * (100 * np.sin(2 * np.pi * 4 * time) + 20 * swept)


def rates(time, state, phase):
    """Three masses in a row, springs and dampers between."""
    turned, speed, load_turned, load_speed, last_turned, last_speed = state
    carried = STIFFNESS * (turned - load_turned) + DAMPING * (speed - load_speed)
    passed = SPRING * (load_turned - last_turned) + DAMPER * (load_speed - last_speed)
    load = (carried - passed) / LOAD
    return [speed, (torque(time, phase) - carried) / ROTOR, load_speed, load, last_speed, passed / FURTHER]


def run_of(number: int) -> Run:
    """A quarter of a second at 2 kHz, sampled with noise."""
    time, phase = np.arange(500) / RATE_HZ, 1.0 + number
    moved = solve_ivp(rates, (0, time[-1]), np.zeros(6), "RK45", time, max_step=5e-5, args=(phase,)).y
    return sampled(number, time, moved, torque(time, phase), NOISE)


@lru_cache(maxsize=1)
def recorded() -> list[Run]:
    return [run_of(number) for number in RUNS]


def test_from_a_fifth_off_it_comes_to_rest_where_it_is() -> None:
    """Driven by the states that followed from it, all of the way at once, it came to rest a fifth too light, 5 % too
    fast and 30 % too damped."""
    view = view_of(recorded(), MACHINE)
    law = next(one for one in vocabulary(view.ranges, view.known) if one.name == "extra_compliance")
    begun = Member(law, (0.8 * RATE, 2 * RATIO), np.array([0.8 * FURTHER]), np.array(law.deviations))
    (found,) = settled(view, [begun], Weighing(NOISE, RUNS, 1.0)).members
    assert found.shape == pytest.approx((RATE, RATIO), rel=0.02)
    assert found.coefficients[0] == pytest.approx(FURTHER, rel=0.02)
