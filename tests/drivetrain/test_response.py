"""Frequency response: the equations solved another way, their limits, and the paper's own numbers."""

from __future__ import annotations

import numpy as np
import pytest
from numpy.typing import NDArray

from schwung.drivetrain.machine import Control, Load, Machine, Motor, paper_machine
from schwung.drivetrain.response import (
    anti_resonance_hz,
    disturbance_to_position_ratio,
    injection_to_speed,
    injection_to_torque,
    motor_to_load,
    position_demand_to_position,
    position_demand_to_speed,
    resonance_hz,
    torque_to_speed,
)
from schwung.errors import InputError

FREQUENCY = np.geomspace(0.5, 1000, 40)
LOAD = 0.11


def _validation_machine() -> Machine:
    """The paper's machine with the gains of its validation, method.md."""
    control = Control(
        position_gain_per_s=100, speed_gain_nms=5.65, speed_integral_time_s=8e-3, sample_rate_hz=8000
    )
    return paper_machine().model_copy(update={"control": control})


def _closed_loop_states(machine: Machine, s: complex) -> NDArray[np.complex128]:
    """Solve (sI − A) x = B for x = [θ_r, ω_r, θ_l, ω_l, ∫e], columns: driven by θ*, by T_add."""
    b_r, b_l = machine.motor.viscous_friction_nms, machine.load.viscous_friction_nms
    control, rotor = machine.required_control(), machine.motor.inertia_kgm2
    assert machine.coupling is not None
    k, b = machine.coupling.stiffness_nm_rad, machine.coupling.damping_nms
    kpp, kps, tn = control.position_gain_per_s, control.speed_gain_nms, control.speed_integral_time_s
    a = np.array(
        [
            [0, 1, 0, 0, 0],
            [-(k + kps * kpp) / rotor, -(b + b_r + kps) / rotor, k / rotor, b / rotor, kps / tn / rotor],
            [0, 0, 0, 1, 0],
            [k / LOAD, b / LOAD, -k / LOAD, -(b + b_l) / LOAD, 0],
            [-kpp, -1, 0, 0, 0],
        ]
    )  # fmt: skip
    inputs = np.array([[0, 0], [kps * kpp / rotor, 1 / rotor], [0, 0], [0, 0], [kpp, 0]])
    return np.linalg.solve(s * np.eye(5) - a, inputs)


def test_closed_loop_gains_solve_the_equations_of_motion() -> None:
    machine = paper_machine()
    states = np.array([_closed_loop_states(machine, 2j * np.pi * f) for f in FREQUENCY])
    np.testing.assert_allclose(position_demand_to_position(machine, LOAD, FREQUENCY), states[:, 0, 0])
    np.testing.assert_allclose(position_demand_to_speed(machine, LOAD, FREQUENCY), states[:, 1, 0])
    np.testing.assert_allclose(injection_to_speed(machine, LOAD, FREQUENCY), states[:, 1, 1])
    np.testing.assert_allclose(motor_to_load(machine, LOAD, FREQUENCY), states[:, 3, 1] / states[:, 1, 1])
    speed_over_torque = torque_to_speed(machine, LOAD, FREQUENCY)
    total = injection_to_torque(machine, LOAD, FREQUENCY)
    np.testing.assert_allclose(speed_over_torque * total, states[:, 1, 1])


def test_without_friction_it_is_equation_3() -> None:
    paper = paper_machine()
    machine = paper.model_copy(
        update={
            "motor": paper.motor.model_copy(update={"viscous_friction_nms": 0.0}),
            "load": Load(viscous_friction_nms=0.0),
        }
    )
    s, rotor, k, b = 2j * np.pi * FREQUENCY, 0.012, 24963, 8.62
    both = rotor + LOAD
    expected = (LOAD * s**2 + b * s + k) / (rotor * LOAD * s**3 + both * b * s**2 + both * k * s)
    np.testing.assert_allclose(torque_to_speed(machine, LOAD, FREQUENCY), expected)


def test_the_inversion_of_method_md_undoes_it() -> None:
    machine, s = paper_machine(), 2j * np.pi * FREQUENCY
    motor, load = machine.motor, machine.load
    y = 1 / torque_to_speed(machine, LOAD, FREQUENCY) - motor.inertia_kgm2 * s - motor.viscous_friction_nms
    inverted = (1 / (1 / y - 1 / (8.62 + 24963 / s)) - load.viscous_friction_nms) / s
    np.testing.assert_allclose(inverted, LOAD, rtol=1e-6)


def test_a_very_stiff_coupling_is_rigid() -> None:
    machine = paper_machine()
    assert machine.coupling is not None
    stiff = machine.coupling.model_copy(update={"stiffness_nm_rad": 1e10})
    rigid = machine.model_copy(update={"coupling": None})
    s = 2j * np.pi * FREQUENCY
    np.testing.assert_allclose(torque_to_speed(rigid, LOAD, FREQUENCY), 1 / ((0.012 + LOAD) * s + 0.3))
    np.testing.assert_allclose(
        torque_to_speed(rigid, LOAD, FREQUENCY),
        torque_to_speed(machine.model_copy(update={"coupling": stiff}), LOAD, FREQUENCY),
        rtol=1e-3,
    )
    assert np.isinf(anti_resonance_hz(rigid, LOAD))
    assert np.isinf(resonance_hz(rigid, LOAD))


def test_anti_resonance_and_resonance_are_where_the_motor_stands_still_and_swings_most() -> None:
    machine = paper_machine()
    assert machine.coupling is not None
    light = machine.coupling.model_copy(update={"damping_nms": 0.01})
    machine = machine.model_copy(
        update={
            "coupling": light,
            "motor": Motor(inertia_kgm2=0.012, viscous_friction_nms=0, peak_torque_nm=233),
        }
    )
    frequency = np.linspace(40, 400, 36001)
    gain = np.abs(torque_to_speed(machine, LOAD, frequency))
    assert frequency[np.argmin(gain)] == pytest.approx(anti_resonance_hz(machine, LOAD), abs=0.02)
    beyond = frequency > 150
    assert frequency[beyond][np.argmax(gain[beyond])] == pytest.approx(resonance_hz(machine, LOAD), abs=0.02)


def test_the_numbers_of_the_paper() -> None:
    machine = _validation_machine()
    ends = machine.load_inertia_at(np.array([np.pi / 2, 0.0]))
    np.testing.assert_allclose(anti_resonance_hz(machine, ends), [63, 107], atol=0.5)
    ratio = disturbance_to_position_ratio(
        machine, 0.11, distance_rad=np.pi, duration_s=0.5, frequency_hz=50, amplitude_nm=0.2 * 233
    )
    assert ratio == pytest.approx(0.078, abs=0.0005)


def test_disturbance_to_position_ratio_scales() -> None:
    machine = _validation_machine()

    def ratio(distance: float, duration: float, amplitude: float) -> float:
        return float(
            disturbance_to_position_ratio(
                machine,
                LOAD,
                distance_rad=distance,
                duration_s=duration,
                frequency_hz=50,
                amplitude_nm=amplitude,
            )
        )

    assert ratio(3, 0.5, 40) == pytest.approx(2 * ratio(-6, 0.5, 40))
    assert ratio(3, 0.5, 40) == pytest.approx(2 * ratio(3, 0.5, 20))
    # θ* becomes speed by s while the loop follows, so that a slower motion is a better ratio.
    assert ratio(3, 1.0, 40) == pytest.approx(2 * ratio(3, 0.5, 40), rel=0.02)


def test_slow_demands_are_followed_and_speed_feed_forward_removes_the_lag() -> None:
    machine = paper_machine()
    slow = np.array([0.01, 0.1])
    lagging = position_demand_to_position(machine, LOAD, slow)
    np.testing.assert_allclose(np.abs(lagging), 1, atol=1e-4)
    np.testing.assert_allclose(np.angle(lagging), -2 * np.pi * slow / 60, rtol=1e-3)  # 1/K_pp behind
    led = position_demand_to_position(machine, LOAD, slow, speed_feed_forward=1.0)
    assert np.all(np.abs(np.angle(led)) < 1e-3 * np.abs(np.angle(lagging)))


def test_shapes_broadcast() -> None:
    machine, inertia, frequency = paper_machine(), np.array([[0.05], [0.1], [0.16]]), np.array([50.0, 100.0])
    for gain in (torque_to_speed, injection_to_speed, injection_to_torque, position_demand_to_position):
        table = gain(machine, inertia, frequency)
        assert table.shape == (3, 2)
        assert table[1, 1] == gain(machine, 0.1, 100.0)


def test_what_cannot_be_answered() -> None:
    machine = paper_machine()
    for inertia, frequency in ((0.0, 50.0), (-1.0, 50.0), (np.nan, 50.0), (0.1, 0.0), (0.1, np.inf)):
        with pytest.raises(InputError, match="is not a positive number"):
            torque_to_speed(machine, inertia, frequency)
    with pytest.raises(InputError, match=r"has no \[control\]"):
        injection_to_speed(machine.model_copy(update={"control": None}), 0.1, 50)
    with pytest.raises(InputError, match="distance_rad"):
        disturbance_to_position_ratio(
            machine, 0.1, distance_rad=0, duration_s=0.5, frequency_hz=50, amplitude_nm=40
        )
