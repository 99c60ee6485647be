"""Recordings of exact physics, integrated once per test process."""

from inspect import signature

import pytest
from estimation_plant import noisy, pair, session_of, thinned

from schwung.drivetrain.machine import Control, Coupling, Load, Machine, Motor
from schwung.estimation import estimate


@pytest.fixture(scope="session")
def estimated():
    """`estimate`, once per question: for the recordings here, of which many tests look at the same result."""
    answers = {}

    def answer(*given, **named):
        asked = signature(estimate).bind(*given, **named)
        asked.apply_defaults()
        session, machine, *others = asked.arguments.values()
        question = (id(session), id(machine), *others)
        if question not in answers:  # with what was asked, so that its identity stays its own
            answers[question] = estimate(*given, **named), session, machine
        return answers[question][0]

    return answer


@pytest.fixture(scope="session")
def machine():
    """Table 1 as believed: everything but the load inertia."""
    return Machine(
        name="Table 1",
        motor=Motor(inertia_kgm2=0.012, viscous_friction_nms=0.2, peak_torque_nm=233.0),
        coupling=Coupling(stiffness_nm_rad=24963.0, damping_nms=8.62),
        load=Load(viscous_friction_nms=0.1),
        control=Control(
            position_gain_per_s=60.0, speed_gain_nms=7.0, speed_integral_time_s=8e-3, sample_rate_hz=8000.0
        ),
    )


@pytest.fixture(scope="session")
def rigid(machine):
    return machine.model_copy(update={"coupling": None})


@pytest.fixture(scope="session")
def fast():
    """250 ms, 50 Hz, 4 kHz: within the method's reach."""
    return pair(0.25)


@pytest.fixture(scope="session")
def faster():
    """200 ms: at the edge (Fig. 14)."""
    return pair(0.2)


@pytest.fixture(scope="session")
def slow():
    """500 ms: where the former method works."""
    return pair(0.5, rate=2000.0)


@pytest.fixture(scope="session")
def clipped():
    """100 ms: the torque is clipped at its peak."""
    return pair(0.1)


@pytest.fixture(scope="session")
def bus_rate(fast):
    """250 ms as sampled over a bus at 1 kHz, 20 samples per period."""
    return thinned(fast, 4)


@pytest.fixture(scope="session")
def repeats(bus_rate):
    """Three references and three excited runs, in the order in which they would be recorded."""
    reference, excited = bus_rate.runs
    runs = [noisy(run, repeat) for repeat in range(3) for run in (reference, excited)]
    return session_of(*runs)


@pytest.fixture(scope="session")
def fractional():
    """47 Hz at 1 kHz: 21.28 samples per period."""
    return pair(0.25, frequency_hz=47.0, rate=1000.0)


@pytest.fixture(scope="session")
def constant():
    """Constant inertia of 0.1 kg·m², without noise: nothing is left to be wrong."""
    return pair(0.5, inertia=0.1, noise=0.0, rate=2000.0)


@pytest.fixture(scope="session")
def constant_rigid():
    return pair(0.5, inertia=0.1, noise=0.0, rate=2000.0, rigid=True)
