"""Both inversions turn the exact two-mass model round, wherever the frequency lies."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from schwung.drivetrain.machine import Coupling, Load, Machine, Motor
from schwung.estimation.inversion import invert_complex, invert_magnitude

ROTOR = 0.012


def frequency_response(machine, inertia, frequency_hz):
    """ω_r/T by solving the two equations of motion as a linear system, frictions as the machine has them."""
    s = 2j * np.pi * frequency_hz
    motor, load, coupling = machine.motor, machine.load, machine.coupling
    if coupling is None:
        friction = motor.viscous_friction_nms + load.viscous_friction_nms
        return 1 / ((motor.inertia_kgm2 + inertia) * s + friction)
    shaft = coupling.damping_nms + coupling.stiffness_nm_rad / s
    response = []
    for value in inertia:
        system = [
            [motor.inertia_kgm2 * s + motor.viscous_friction_nms + shaft, -shaft],
            [-shaft, value * s + load.viscous_friction_nms + shaft],
        ]
        response.append(np.linalg.solve(system, [1.0, 0.0])[0])
    return np.array(response)


def make(friction=True, coupled=True, damping=8.62):
    return Machine(
        name="m",
        motor=Motor(inertia_kgm2=ROTOR, viscous_friction_nms=0.2 if friction else 0.0, peak_torque_nm=233.0),
        coupling=Coupling(stiffness_nm_rad=24963.0, damping_nms=damping) if coupled else None,
        load=Load(viscous_friction_nms=0.1 if friction else 0.0),
    )


INERTIAS = np.linspace(0.005, 1.0, 300)
TORQUE = 30 * np.exp(1j * np.linspace(0, 6, INERTIAS.size))


@pytest.mark.parametrize("frequency_hz", [5.0, 50.0, 79.6, 100.0, 240.0, 600.0])
@pytest.mark.parametrize("coupled", [True, False])
def test_complex_inversion_is_exact_with_frictions(frequency_hz, coupled):
    machine = make(coupled=coupled)
    speed = TORQUE * frequency_response(machine, INERTIAS, frequency_hz)
    inertia = invert_complex(machine, frequency_hz, TORQUE, speed)
    np.testing.assert_allclose(inertia.real, INERTIAS, rtol=1e-6)
    assert np.max(np.abs(inertia.imag)) < 1e-6


def test_rigid_inversion_is_the_textbook_formula():
    machine = make(friction=False, coupled=False)
    speed = TORQUE / (2j * np.pi * 50 * (ROTOR + INERTIAS))
    np.testing.assert_allclose(invert_complex(machine, 50.0, TORQUE, speed).real, INERTIAS, rtol=1e-12)
    np.testing.assert_allclose(invert_magnitude(machine, 50.0, TORQUE, speed), INERTIAS, rtol=1e-12)


@pytest.mark.parametrize("frequency_hz", [5.0, 50.0, 79.6, 100.0, 240.0, 600.0])
def test_magnitude_root_rule_finds_the_true_inertia_on_both_branches(frequency_hz):
    """Below and above the anti-resonance, without friction, from the forward model solved independently."""
    machine = make(friction=False)
    speed = TORQUE * frequency_response(machine, INERTIAS, frequency_hz)
    np.testing.assert_allclose(invert_magnitude(machine, frequency_hz, TORQUE, speed), INERTIAS, rtol=1e-5)


def test_both_branches_do_occur_and_share_one_magnitude():
    """Two inertias either side of k/ω² with one |G|: the magnitude alone could not tell them apart."""
    machine = make(friction=False)
    dense = np.linspace(0.01, 2.0, 200_001)
    gain = np.abs(frequency_response_frictionless(dense, 50.0))
    lowest = int(np.argmin(gain))
    above = lowest + int(np.argmin(np.abs(gain[lowest:] - gain[lowest // 2])))
    pair = np.array([dense[lowest // 2], dense[above]])
    assert pair[1] > 24963.0 / (2 * np.pi * 50) ** 2 > pair[0]
    speed = frequency_response(machine, pair, 50.0)
    np.testing.assert_allclose(np.abs(speed[0]), np.abs(speed[1]), rtol=1e-4)
    found = invert_magnitude(machine, 50.0, np.ones(2, complex), speed)
    np.testing.assert_allclose(found, pair, rtol=1e-6)


def frequency_response_frictionless(inertia, frequency_hz):
    """Equation 3 as printed."""
    s, k, b = 2j * np.pi * frequency_hz, 24963.0, 8.62
    return (inertia * s**2 + b * s + k) / (
        ROTOR * inertia * s**3 + (ROTOR + inertia) * b * s**2 + (ROTOR + inertia) * k * s
    )


def test_magnitude_that_no_inertia_gives_is_nan():
    """A gain below the deepest anti-resonance has no root."""
    machine = make(friction=False)
    floor = np.abs(frequency_response_frictionless(np.linspace(0.01, 2.0, 20_001), 50.0)).min()
    speed = np.array([0.5 * floor * np.exp(-1.5j)])
    assert np.isnan(invert_magnitude(machine, 50.0, np.ones(1, complex), speed)).all()


def test_nan_and_zero_stay_nan():
    speed = np.array([np.nan + 0j, 0j])
    for machine in (make(), make(coupled=False)):
        assert np.isnan(invert_complex(machine, 50.0, np.ones(2, complex), speed)).all()
        assert np.isnan(invert_magnitude(machine, 50.0, np.ones(2, complex), speed)).all()


@given(delay_s=st.floats(1e-5, 3e-4), inertia=st.floats(0.05, 0.16))
def test_a_delayed_speed_shows_in_the_imaginary_part(delay_s, inertia):
    """The free check: to first order the imaginary part is the total inertia times ωτ."""
    machine = make(coupled=False, friction=False)
    speed = 1 / (2j * np.pi * 50 * (ROTOR + np.array([inertia]))) * np.exp(-2j * np.pi * 50 * delay_s)
    found = invert_complex(machine, 50.0, np.ones(1, complex), speed)[0]
    assert found.imag == pytest.approx((ROTOR + inertia) * np.sin(2 * np.pi * 50 * delay_s), rel=1e-9)
