"""Steps of a coupling that is another in each."""

import numpy as np
import pytest
from scipy.linalg import expm

from schwung.innovations import step_kernel
from schwung.innovations.steps import Steps
from schwung.innovations.values import FurtherMass, Shaft

SHAFT = Shaft(0.004, 0.01, 0.02, 9000.0, 1.9, False)
INERTIA = np.linspace(0.02, 0.03, 40)


def test_where_it_is_the_same_everywhere_they_are_the_steps_of_that_coupling():
    each = np.tile([9000.0, 1.9], (INERTIA.size, 1))
    one = Steps.of_each(SHAFT, each, INERTIA, 5e-4)
    other = Steps.of(SHAFT, INERTIA, 5e-4, slopes=False)
    np.testing.assert_allclose(one.transition, other.transition, rtol=1e-6, atol=1e-9)
    np.testing.assert_allclose(one.inputs, other.inputs, rtol=1e-6, atol=1e-12)


@pytest.mark.parametrize("stiffness", [9.0, 30000.0])
def test_each_has_its_own(stiffness):
    each = np.tile([9000.0, 1.9], (INERTIA.size, 1))
    each[7] = stiffness, 0.3
    steps = Steps.of_each(SHAFT, each, INERTIA, 5e-4)
    alone = Steps.of(SHAFT._replace(stiffness=stiffness, damping=0.3), INERTIA[7:8], 5e-4, slopes=False)
    np.testing.assert_allclose(steps.transition[7], alone.transition[0], rtol=1e-6, atol=1e-9)
    assert not np.allclose(steps.transition[7], steps.transition[6], rtol=1e-3)


@pytest.mark.parametrize("rigid", [False, True])
def test_a_further_mass_swings_as_newton_says(rigid):
    """Three masses in a row, or two, in their own coordinates; a torque on the motor and one on the load."""
    inertia, behind, rate, ratio, step_s = 0.01, 0.003, 300.0, 0.02, 5e-4
    shaft = SHAFT._replace(rigid=rigid, further=FurtherMass(behind, rate, ratio))
    whole = step_kernel.steps(shaft, np.array([inertia]), step_s)[0]
    spring, damper = behind * rate**2, 2 * ratio * rate * behind
    k, b = (0.0, 0.0) if rigid else (shaft.stiffness, shaft.damping)
    masses = np.array([shaft.rotor_inertia, inertia, behind])
    stiff = np.array([[k, -k, 0], [-k, k + spring, -spring], [0, -spring, spring]])
    damped = np.array([[b, -b, 0], [-b, b + damper, -damper], [0, -damper, damper]])
    damped += np.diag([shaft.motor_friction, shaft.load_friction, 0])
    onto = np.eye(3)[:, :2]
    if rigid:  # motor and load are one
        one = np.array([[1, 0], [1, 0], [0, 1]])
        masses, stiff, damped = masses @ one, one.T @ stiff @ one, one.T @ damped @ one
        onto = one.T @ onto
    size = masses.size
    rates = np.zeros((2 * size + 2, 2 * size + 2))  # with the two torques, which are held
    rates[:size, size : 2 * size] = np.eye(size)
    rates[size : 2 * size, :size], rates[size : 2 * size, size : 2 * size] = (
        -stiff / masses[:, None],
        -damped / masses[:, None],
    )
    rates[size : 2 * size, 2 * size :] = onto / masses[:, None]
    exact = expm(rates * step_s)[: 2 * size]
    # angle and speed of the motor, the wind-up, the load's speed, and how far and fast it is ahead
    if rigid:
        ours = np.array([[1, 0, 0, 0], [0, 0, 1, 0], [1, -1, 0, 0], [0, 0, 1, -1]], dtype=float)
    else:
        ours = np.zeros((6, 6))
        ours[0, 0] = ours[1, 3] = ours[2, 0] = ours[3, 4] = ours[4, 1] = ours[5, 4] = 1.0
        ours[2, 1] = ours[4, 2] = ours[5, 5] = -1.0
    moved = ours @ exact[:, : 2 * size] @ np.linalg.inv(ours)
    held = whole[:, 2 * size : 2 * size + 2] + whole[:, 2 * size + 2 : 2 * size + 4]  # straight, of one
    np.testing.assert_allclose(whole[:, : 2 * size], moved, rtol=1e-9, atol=1e-9)
    np.testing.assert_allclose(held, ours @ exact[:, 2 * size :], rtol=1e-9, atol=1e-12)
