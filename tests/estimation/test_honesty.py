"""Bands that mean what they say, cells that nothing is known of left out, and the Cramér-Rao bound come near."""

from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest
from estimation_plant import crank, motion_of, noisy, phases, record, session_of, sine_for
from scipy.interpolate import CubicSpline
from scipy.signal import lfilter

from schwung.drivetrain import InertiaTable, Load
from schwung.errors import InputError
from schwung.estimation import estimate
from schwung.estimation.balance import Basis
from schwung.estimation.bound import cramer_rao
from schwung.estimation.delay import LOSSES, amplitudes_restored
from schwung.estimation.fit import _spread
from schwung.estimation.methods import METHODS
from schwung.estimation.solve import solve
from schwung.estimation.trajectory import _table
from schwung.session import Run


@pytest.fixture(scope="module")
def four():
    """Four phases, 150 ms, 2 kHz, exact."""
    return phases(0.15, rate=2000.0, peak=1e9, noise=0.0)


def with_noise(session, seed, times=1.0, position_rad=0.0):
    rng = np.random.default_rng([seed, 3])

    def one(number, run):
        made = noisy(run, 100 * seed + number, times)
        off = position_rad * rng.normal(size=len(run))
        return replace(made, repeat=run.repeat, position_rad=run.position_rad + off)

    return session_of(*(one(number, run) for number, run in enumerate(session.runs)))


# The solution's own band -----------------------------------------------------------------------------------


def _solved(seed, curve, noise=0.02, rows=400):
    rng = np.random.default_rng(seed)
    basis, angle = Basis(0.0, 1.0), np.sort(rng.uniform(size=rows))
    disturbing = np.cos(40 * angle)[:, None]
    y = curve(angle) + 0.3 * disturbing[:, 0] + noise * rng.normal(size=rows)
    found = solve(basis.at(angle), disturbing, y, np.array([1.0]))
    grid = np.linspace(0, 1, 64)
    at = basis.at(grid)
    std = np.sqrt(np.einsum("ij,jk,ik->i", at, found.covariance[: basis.size, : basis.size], at))
    return at @ found.coefficients - curve(grid), std, found


def test_bands_of_curves_by_chance_hold_them_as_often_as_they_say():
    inside = []
    for seed in range(60):
        swing, phase = np.random.default_rng([seed, 1]).uniform(0, 1, 2)
        off, std, _ = _solved(seed, lambda x, a=swing, p=phase: 1 + a * np.cos(2 * np.pi * (x + p)))
        inside.append(np.mean(np.abs(off) < 1.96 * std))
    assert 0.93 < np.mean(inside) < 0.98


def test_the_band_of_a_constant_is_a_cubics_and_not_nothing():
    """The stiffest curve: its covariance is that of four numbers, and must not drown in rounding."""
    sizes, ratios = [], []
    for seed in range(20):
        off, std, _ = _solved(seed, np.ones_like)
        sizes.append(np.mean(std))
        ratios.append(np.mean((off / std) ** 2))
    assert 0.5 * 0.02 * np.sqrt(4 / 400) < np.mean(sizes) < 3 * 0.02 * np.sqrt(4 / 400)
    assert 0.4 < np.mean(ratios) < 1.6


def test_what_is_considered_widens_the_band_by_what_it_would_move():
    """y may be off by a fifth of itself: so may the curve, all cells together, and is not fitted away."""
    rng, angle = np.random.default_rng(7), np.linspace(0, 1, 300)
    basis = Basis(0.0, 1.0)
    y = 2.0 + 0.01 * rng.normal(size=300)
    nothing = np.zeros((300, 0))
    plain = solve(basis.at(angle), nothing, y, np.empty(0))
    found = solve(basis.at(angle), nothing, y, np.empty(0), considered=0.2 * y[:, None])
    np.testing.assert_array_equal(found.coefficients, plain.coefficients)
    at = basis.at(np.linspace(0.1, 0.9, 9))
    more = at @ (found.covariance - plain.covariance) @ at.T
    np.testing.assert_allclose(more, 0.4**2, rtol=0.02)  # one and the same for all: fully correlated


def test_leverage_counts_what_was_fitted():
    _, _, found = _solved(1, lambda x: 1 + 0.3 * np.sin(2 * np.pi * x))
    assert 5 < np.sum(found.leverage) < 25
    assert found.variance == pytest.approx(0.02**2, rel=0.2)


def test_noise_is_found_where_it_is_and_not_where_it_was_fitted():
    """A third of the band has three times the noise; half of one row in ten has been followed by the fit."""
    rng, n = np.random.default_rng(4), 600
    frequency = np.linspace(0.25, 2.5, n)
    true = np.where(frequency < 1.0, 3.0, 1.0)
    free = np.tile(np.where(np.arange(n) % 10 == 0, 0.5, 1.0), 2)
    residual = np.tile(true, 2) * np.sqrt(free) * rng.normal(size=2 * n)
    found = _spread(residual, free, frequency)
    assert found.shape == (2 * n,)
    away = np.tile((frequency < 0.5) | (frequency > 1.6), 2)
    np.testing.assert_allclose(found[away], np.tile(true, 2)[away], rtol=0.2)


# What a drive's filter takes off ---------------------------------------------------------------------------


def test_a_filter_of_torque_and_speed_is_given_to_the_angle_too(four, machine):
    """0.2 ms of first order on both, none on the angle: 0.4 % of their amplitude, which delays alone would leave."""
    tau, rate, finer = 2e-4, 2000.0, 64
    machine = machine.model_copy(update={"control": None})  # no period is known that would explain a part

    def lagged(values):
        time = np.arange(values.size) / rate
        fine = CubicSpline(time, values)(np.arange((values.size - 1) * finer + 1) / (finer * rate))
        share = -np.expm1(-1 / (finer * rate * tau))
        start = [(1 - share) * fine[0]]
        return lfilter([share], [1, share - 1], fine, zi=start)[0][::finer]

    late = [
        replace(run, speed_rad_s=lagged(run.speed_rad_s), torque_nm=lagged(run.torque_nm))
        for run in four.runs
    ]
    table = estimate(with_noise(session_of(*late), 1), machine, "multiphase").table
    plain = estimate(with_noise(four, 1), machine, "multiphase").table
    off = table.inertia_kgm2 / crank(table.position_rad) - 1
    assert abs(np.mean(off)) < 1e-3
    assert np.mean(np.abs(off) < 1.96 * table.std_kgm2 / table.inertia_kgm2) > 0.8
    assert np.mean(table.std_kgm2) > np.mean(plain.std_kgm2)  # what is not known of the filter shows


def test_amplitudes_are_restored_in_the_session_as_recorded():
    """1 − γω² of a 50 Hz sine in torque and speed each; the angle and all lags stay as they are."""
    time = np.arange(1000) / 2000.0
    sine = np.sin(2 * np.pi * 50 * time)
    run = Run(
        role="reference", repeat=0, sample_rate_hz=2000.0, time_s=time, position_rad=sine.copy(),
        speed_rad_s=2 * sine, torque_nm=3 * sine,
    )  # fmt: skip
    made = replace(run, extra={LOSSES: (1e-8, 3e-8, 200.0)}, torque_nm=0 * sine)
    found = amplitudes_restored(session_of(run, run), session_of(made, run))
    inner, power = slice(100, -100), (2 * np.pi * 50) ** 2
    restored, untouched = found.runs
    np.testing.assert_allclose(restored.torque_nm[inner], 3 * (1 + 1e-8 * power) * sine[inner], atol=1e-5)
    np.testing.assert_allclose(restored.speed_rad_s[inner], 2 * (1 + 3e-8 * power) * sine[inner], atol=1e-5)
    np.testing.assert_array_equal(restored.position_rad, sine)
    np.testing.assert_array_equal(untouched.torque_nm, run.torque_nm)


# Cells without information ---------------------------------------------------------------------------------


@pytest.mark.parametrize("method", ["denoised", "multiphase"])
def test_angles_without_injection_are_left_out_not_filled(machine, method):
    """Injected until half-way of the first stroke: the other half was passed, and says nothing."""
    motion = motion_of(0.25)
    until = motion.start_time_s + motion.duration_s / 2
    sines = [replace_end(sine_for(motion, phase_rad=m * np.pi / 2), until) for m in range(4)]
    runs = [record(motion, sine, rate=2000.0, peak=1e9) for sine in [None, *sines]]
    result = estimate(session_of(*runs), machine, method)
    table = result.table
    assert 0.1 < table.position_rad.max() < 0.6 * np.pi
    assert all(np.all(np.isfinite(v)) for v in (table.inertia_kgm2, table.std_kgm2))
    assert np.max(np.abs(table.inertia_kgm2 / crank(table.position_rad) - 1)) < 0.3


def replace_end(sine, end_s):
    return sine.model_copy(update={"end_s": end_s})


def test_the_trajectory_fits_table_leaves_out_what_the_prior_alone_says():
    """Where the band is 30 % of the inertia or more, there is no cell."""
    basis = SimpleNamespace(low_rad=0.0, high_rad=1.0)

    def inertia_at(angle):
        return np.full_like(angle, 0.1), np.where(angle > 0.65, 0.2, 1e-3)

    found = SimpleNamespace(model=SimpleNamespace(layout=SimpleNamespace(basis=basis)), inertia_at=inertia_at)
    table, notes = _table(found, 11)
    np.testing.assert_allclose(table.position_rad, np.linspace(0, 0.6, 7))
    assert notes == ("4 of 11 angles are not determined and were left out.",)


@pytest.mark.parametrize("moving", [False, True], ids=["at rest", "moving without torque"])
@pytest.mark.parametrize("method", ["auto", *sorted(METHODS)])
def test_signals_of_nothing_are_an_error_that_says_so(machine, method, moving):
    motion = motion_of(0.25)
    time = np.arange(700) / 1000
    path = np.interp(time, [0.1, 0.35, 0.45, 0.7], [0, np.pi, np.pi, 0]) if moving else np.zeros_like(time)
    runs = [
        Run(
            role="reference" if number == 0 else "excited", repeat=0, sample_rate_hz=1000.0, time_s=time,
            position_rad=path.copy(), speed_rad_s=np.zeros_like(time), torque_nm=np.zeros_like(time),
            motion=motion, excitation=sine_for(motion, phase_rad=number * np.pi / 2) if number else None,
            name=f"run {number}",
        )
        for number in range(5)
    ]  # fmt: skip
    with pytest.raises(InputError) as caught:
        estimate(session_of(*runs), machine, method)
    assert caught.value.remedy


# The bound -------------------------------------------------------------------------------------------------


def test_four_phases_come_within_one_and_a_half_times_the_bound(four, machine):
    """Five times the usual noise, and 0.1 mrad of the angle, so that noise decides; rms of four."""
    angle = np.linspace(-0.5, np.pi + 0.5, 400)
    load = Load(viscous_friction_nms=0.1, inertia_table=InertiaTable(angle, crank(angle)))
    true_machine = machine.model_copy(update={"load": load})
    squares, bounds = [], []
    for seed in range(4):
        session = with_noise(four, seed, 5.0, 1e-4)
        bound = cramer_rao(session, true_machine)
        table = estimate(session, machine, "multiphase").table
        squares.append(np.mean((table.inertia_kgm2 - crank(table.position_rad)) ** 2))
        bounds.append(bound.rms_kgm2**2)
    ratio = np.sqrt(np.mean(squares) / np.mean(bounds))
    print(f"multiphase: {ratio:.2f} times the Cramér-Rao bound")
    assert ratio < 1.5
