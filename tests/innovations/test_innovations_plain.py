"""What runs without numba says what the compiled kernels say."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np
import pytest
from scipy.interpolate import CubicSpline

from schwung.innovations import kalman, kernel, plain, play, spline_kernel, step_kernel
from schwung.innovations.contact import PARTS
from schwung.innovations.splines import interpolated
from schwung.innovations.values import Added, FurtherMass, Shaft, System
from schwung.motion import Array

SHAFTS = {
    "flexible": Shaft(0.012, 0.2, 0.1, 24963.0, 8.62, False),
    "rigid": Shaft(0.012, 0.2, 0.1, 0.0, 0.0, True),
    "flexible, a mass behind": Shaft(0.012, 0.2, 0.1, 24963.0, 8.62, False, FurtherMass(0.02, 500.0, 0.04)),
    "rigid, a mass behind": Shaft(0.012, 0.2, 0.1, 0.0, 0.0, True, FurtherMass(0.02, 500.0, 0.04)),
}


def _agree(found: Any, expected: Any) -> None:
    for one, other in zip(found, expected, strict=True):
        np.testing.assert_allclose(one, other, rtol=1e-9, atol=1e-12 * np.max(np.abs(other)))


def _steps(shaft: Shaft, inertia: Array, duration: float) -> Array:
    return plain.steps_of_each(shaft, np.array([[shaft.stiffness, shaft.damping]]), inertia, duration)


@pytest.fixture(params=list(SHAFTS))
def system(request: pytest.FixtureRequest) -> System:
    """A machine that is shaken, in 300 steps of 1 ms, with its torque's error as the last state."""
    shaft, noise = SHAFTS[request.param], np.random.default_rng(4)
    stepped = _steps(shaft, np.linspace(0.05, 0.17, 299), 1e-3)
    size = stepped.shape[1]
    transition = np.zeros((299, size + 1, size + 1))
    transition[:, :size, :size] = stepped[:, :, :size]
    transition[:, :size, size] = -stepped[:, :, size]
    forcing = np.zeros((299, size + 1))
    forcing[:, :size] = stepped[:, :, size] * 10 * np.sin(np.arange(299) / 5)[:, None]
    noises = np.column_stack([-stepped[:, :, size + 2], np.ones(299)])
    spread = np.array([*[1e-3, 0.1, 1e-3, 0.1, 0.0, 0.0][:size], 0.3])
    measured = np.cumsum(noise.normal(size=(300, 2)), axis=0) * [1e-3, 0.1]
    apart = np.where(np.arange(299)[:, None] % 50 == [7, 9, 11], 20.0, 0.0)
    on_load = np.zeros((299, 2, size + 1))
    if shaft.rigid:
        apart[:, 1] = 0.0
    else:
        on_load[:, :, :size] = np.swapaxes(stepped[:, :, [size + 1, size + 3]], 1, 2)
    opened = (
        (0.0 if shaft.rigid else 1.0)
        * noise.normal(size=(299, size + 1))
        * [
            *[1e-6, 1e-3, 1e-6, 1e-3, 0.0, 0.0][:size],
            0.0,
        ]
    )
    return System(
        transition, forcing, noises, np.full(299, 0.1), apart, measured,
        noise.uniform(0.5, 2, (300, 2)) * [1e-10, 1e-4],
        np.zeros(size + 1), spread, opened, on_load,
    )  # fmt: skip


@pytest.mark.parametrize("shaft", SHAFTS.values(), ids=list(SHAFTS))
def test_steps(shaft: Shaft) -> None:
    inertia = np.geomspace(1e-5, 10.0, 40)
    _agree(_steps(shaft, inertia, 1e-3), step_kernel.steps(shaft, inertia, 1e-3))
    if not shaft.rigid:
        coupling = np.geomspace([10.0, 0.01], [1e6, 30.0], 40)
        each = (shaft, coupling, inertia, 1e-3)
        _agree(plain.steps_of_each(*each), step_kernel.steps_of_each(*each))


def test_filter_and_sensitivities(system: System) -> None:
    compiled, found = kalman.filtered(system), plain.filtered(system)
    _agree(found, compiled)
    np.testing.assert_allclose(kalman.deviance(system), plain.deviance(system), rtol=1e-9)
    _agree(kernel.smoothed(system.transition, compiled), plain.smoothed(system.transition, compiled))
    adjoints = kernel.adjoints(system.transition, compiled)
    _agree(adjoints, plain.adjoints(system.transition, compiled))
    # the first state is foreseen, and what samples say of it moves it as what adds to a step
    first = system.first - system.spread**2 * adjoints[0]
    np.testing.assert_allclose(kernel.smoothed(system.transition, compiled)[0], first, rtol=1e-6, atol=1e-9)
    size, random = system.first.size - 1, np.random.default_rng(5)
    torque, share = random.normal(size=(300, 6)), random.normal(size=(299, 4))
    torque[::3, 2:] = torque[1::3, :3] = share[::2, 1:] = 0.0  # splines are, but for a few entries
    added = Added(
        *random.normal(size=(2, 299, size)), torque, random.normal(size=(299, size)), share,
        random.normal(size=(299, size, 3)), random.normal(size=(300, 2, 3)),
    )  # fmt: skip
    whitened: list[Callable[..., Any]] = [plain.whitened, kernel.whitened]
    _agree(*(one(system.transition, compiled, added) for one in whitened))


def test_factors() -> None:
    left = np.random.default_rng(6).normal(size=(9, 4))
    matrix = left.T @ left
    _agree(plain.cholesky(matrix), kernel.cholesky(matrix))
    assert not np.all(np.isfinite(plain.cholesky(-matrix)))
    assert not np.all(np.isfinite(kernel.cholesky(-matrix)))


def test_rows_of_splines() -> None:
    places = np.concatenate([np.linspace(-0.3, 1.4, 57), [0.0, 1.0]])  # straight on outside
    _agree(spline_kernel.spline_rows(0.0, 0.125, 8, places), plain.spline_rows(0.0, 0.125, 8, places))


@pytest.mark.parametrize("derivative", [0, 1, 2])
def test_a_spline_is_that_of_scipy(derivative: int) -> None:
    time = 0.2 + 0.05 * np.arange(30)
    values, places = np.sin(9 * time)[:, None] * [1.0, -2.0], np.linspace(time[0], time[-1], 101)
    found = interpolated(values, time[0], 0.05, places, derivative)
    np.testing.assert_allclose(found, CubicSpline(time, values)(places, derivative), rtol=1e-8, atol=1e-9)


def test_a_coupling_with_play() -> None:
    """Half of the steps within the gap, a contact that lifts among them."""
    shaft, noise, steps = SHAFTS["flexible"], np.random.default_rng(5), 200
    inertia = np.full(steps, 0.1)
    whole = _steps(shaft, inertia, 1e-3)
    pressed = _steps(shaft, inertia, 1e-3 / PARTS)
    free = _steps(shaft._replace(stiffness=25.0, damping=0.01), inertia, 1e-3 / PARTS)
    torques = 8 * np.sin(np.arange(steps) / 6)[:, None] * np.array([1.0, -0.2, 1.0, -0.2, 0.01, 0.0])
    coupling = np.tile([shaft.stiffness, shaft.damping], (steps, 1))
    driven = np.sin(np.arange(steps + 1) / 9)[:, None] * np.array([3e-4, 0.2])
    found = []
    for through in (play._through, plain.through):
        system = System(
            np.zeros((steps, 5, 5)), np.zeros((steps, 5)), np.ones((steps, 5)), np.full(steps, 0.01),
            np.zeros((steps, 3)), np.cumsum(noise.normal(size=(steps + 1, 2)), axis=0) * [0.0, 1e-6],
            np.tile([1e-8, 1e-4], (steps + 1, 1)), np.zeros(5), np.array([1e-3, 0.1, 1e-3, 0.1, 0.1]),
            np.zeros((steps, 5)), np.zeros((steps, 2, 5)),
        )  # fmt: skip
        noise, inputs, contact = np.random.default_rng(5), whole[:, :, 4:].copy(), np.zeros((steps, 3))
        through(system, pressed, free, torques, coupling, driven, 5e-4, 0.5e-3 / PARTS, inputs, contact)
        made = system.transition, system.forcing, system.noise, system.open_contact, system.on_load
        found.append((*made, inputs, contact))
    _agree(found[1], found[0])
    assert 0.1 < np.mean(found[0][-1][:, 0]) < 0.9
