"""The rivals' insides against closed forms, batch solutions and scipy's integrator."""

import numpy as np
import pytest
from estimation_plant import crank
from scipy.integrate import solve_ivp

from schwung.drivetrain import paper_machine, simulate
from schwung.errors import InputError
from schwung.estimation.rivals import augmented
from schwung.estimation.rivals.acceleration_median import sliding_median
from schwung.estimation.rivals.bspline import knots_for
from schwung.estimation.rivals.common import age_s, memory_s, noise_level
from schwung.estimation.rivals.ekf import ExtendedKalman
from schwung.estimation.rivals.gdft import half_period_phasor, window_samples
from schwung.estimation.rivals.kalman_fourier import kalman_phasor
from schwung.estimation.rivals.loadside import LoadSide, load_side
from schwung.estimation.rivals.rls import recursive_least_squares
from schwung.estimation.rivals.sigma_point import SigmaPoint
from schwung.estimation.rivals.windowed_ls import sliding_line
from schwung.motion import Motion

RATE, FREQUENCY = 4000.0, 50.0
OMEGA = 2 * np.pi * FREQUENCY
TIME = np.arange(800) / RATE
EXTENDED, SIGMA_POINT = ExtendedKalman().inertia, SigmaPoint().inertia


class TestGeneralisedDft:
    def test_odd_harmonics_vanish_and_even_ones_do_not(self):
        """m = 4, l = ±1: orders 4i ± 1, the odd ones, are told apart within half a period."""
        wanted = 0.7 * np.exp(0.3j)
        sine = np.real(wanted * np.exp(1j * OMEGA * TIME))
        odd = sum(np.cos(order * OMEGA * TIME + order) for order in (3, 5, 7))
        found = half_period_phasor(sine + odd, TIME, RATE, FREQUENCY)
        np.testing.assert_allclose(found[39:], wanted, atol=1e-12)
        for order in (0, 2, 4):
            even = half_period_phasor(sine + np.cos(order * OMEGA * TIME + 0.4), TIME, RATE, FREQUENCY)
            assert np.max(np.abs(even[39:] - wanted)) > 0.1

    def test_it_answers_within_half_a_period(self):
        assert window_samples(RATE, FREQUENCY) == 40
        step = np.where(TIME >= 0.1, np.sin(OMEGA * TIME), 0.0)
        found = np.abs(half_period_phasor(step, TIME, RATE, FREQUENCY))
        at = round(0.1 * RATE)
        assert found[at + 20] < 0.9
        np.testing.assert_allclose(found[at + 39 :], 1.0, atol=1e-9)

    def test_it_passes_more_noise_than_a_whole_period(self):
        noise = np.random.default_rng(1).normal(size=40_000)
        time = np.arange(noise.size) / RATE
        level = np.nanstd(half_period_phasor(noise, time, RATE, FREQUENCY))
        assert level == pytest.approx(np.sqrt(2) * np.sqrt(4 / 80), rel=0.05)


class TestKalmanFourier:
    def test_a_sine_and_a_constant_are_found_exactly(self):
        wanted = 0.7 * np.exp(0.3j)
        signal = 5.0 + np.real(wanted * np.exp(1j * OMEGA * TIME))
        found = kalman_phasor(signal, RATE, FREQUENCY, memory_s(FREQUENCY)) * np.exp(-1j * OMEGA * TIME)
        np.testing.assert_allclose(found[400:], wanted, atol=1e-6)

    def test_it_is_the_exponentially_weighted_fit(self):
        signal = np.random.default_rng(2).normal(size=600)
        memory = memory_s(FREQUENCY)
        found = kalman_phasor(signal, RATE, FREQUENCY, memory)
        for i in (450, 599):
            back = (np.arange(600) - i)[: i + 1] / RATE
            weight = np.exp(back / memory / 2)
            basis = np.column_stack([np.ones(i + 1), np.cos(OMEGA * back), -np.sin(OMEGA * back)])
            fit = np.linalg.lstsq(basis * weight[:, None], signal[: i + 1] * weight)[0]
            assert found[i] == pytest.approx(fit[1] + 1j * fit[2], abs=1e-8)

    def test_after_one_period_two_percent_are_left(self):
        assert np.exp(-1 / FREQUENCY / memory_s(FREQUENCY)) == pytest.approx(0.018, abs=0.001)

    def test_its_age_is_its_lag_behind_a_slow_ramp(self):
        ramp = 1 + 0.5 * TIME
        found = np.abs(kalman_phasor(ramp * np.sin(OMEGA * TIME), RATE, FREQUENCY, memory_s(FREQUENCY)))
        lag = np.mean((ramp - found)[400:720]) / 0.5  # whole periods
        assert lag == pytest.approx(age_s(RATE, FREQUENCY), rel=0.02)


def test_recursive_least_squares_is_the_weighted_batch_solution():
    rng = np.random.default_rng(3)
    regressors = rng.normal(size=(300, 3)) * [100.0, 1.0, 1e-3]
    values = regressors @ [0.1, -2.0, 30.0] + 0.1 * rng.normal(size=300)
    found = recursive_least_squares(regressors, values, 0.97)
    weight = np.sqrt(0.97 ** np.arange(299, -1, -1))
    batch = np.linalg.lstsq(regressors * weight[:, None], values * weight)[0]
    np.testing.assert_allclose(found[-1], batch, rtol=1e-3)


def test_recursive_least_squares_keeps_calm_without_excitation():
    """Forgetting without news lets a covariance grow: half a million samples of silence, and it still answers."""
    rng = np.random.default_rng(4)
    regressors = np.concatenate(
        [rng.normal(size=(200, 1)), np.zeros((500_000, 1)), rng.normal(size=(200, 1))]
    )
    found = recursive_least_squares(regressors, 0.1 * regressors[:, 0], 0.95)
    assert np.all(np.isfinite(found))
    assert found[-1, 0] == pytest.approx(0.1, rel=1e-6)


def test_a_straight_line_of_inertia_is_found_exactly():
    """C = d(J ω)/dt with J = 0.1 + 0.8 t, at the window's middle."""
    inertia = 0.1 + 0.8 * TIME
    speed, acceleration = np.sin(OMEGA * TIME), OMEGA * np.cos(OMEGA * TIME)
    load = LoadSide(inertia * acceleration + 0.8 * speed, np.zeros_like(TIME), speed, acceleration)
    found = sliding_line(load, 80, 1 / RATE)
    middle = TIME[79:] - 39.5 / RATE
    np.testing.assert_allclose(found[79:], 0.1 + 0.8 * middle, rtol=1e-9)
    assert np.all(np.isnan(found[:79]))


def test_sliding_median_is_that_of_what_is_there():
    values = np.random.default_rng(5).normal(size=200)
    values[::3] = np.nan
    values[100:112] = np.nan
    found = sliding_median(values, 9)
    windows = np.lib.stride_tricks.sliding_window_view(values, 9)
    there = np.isfinite(windows).any(axis=1)
    np.testing.assert_allclose(found[8:][there], np.nanmedian(windows[there], axis=1))
    assert np.all(np.isnan(found[8:][~there]))


def test_the_noise_level_is_that_of_the_noise():
    """White noise of 0.02 on a motion and a sine, with a tenth of a percent of stray samples."""
    noise = 0.02 * np.random.default_rng(6).normal(size=TIME.size)
    signal = 20 * np.sin(5 * TIME) + 1.5 * np.sin(OMEGA * TIME) + noise
    signal[300] += 50
    assert noise_level(signal) == pytest.approx(0.02, rel=0.2)
    assert noise_level(np.zeros(50)) > 0


def test_the_load_side_is_that_of_the_simulation():
    """Load speed and angle, which no motor reports, against the simulation's own."""
    machine = paper_machine()
    motion = Motion(distance_rad=np.pi, duration_s=0.3, start_time_s=0.1, dwell_s=0.1, kind="poly5")
    time = motion.time(8000.0)
    demand = motion.demand(time)
    added = 46.6 * np.sin(OMEGA * time) * np.sin(np.pi * time / time[-1]) ** 2
    run = simulate(machine, demand, time, added)
    # the torque sample acts over the step that it begins: its mean about a sample is that of two
    torque = np.concatenate([run.torque_nm[:1], (run.torque_nm[1:] + run.torque_nm[:-1]) / 2])
    load = load_side(machine, torque, run.speed_rad_s, 8000.0, FREQUENCY)
    inner = slice(200, -200)
    assert np.max(np.abs(load.speed_rad_s - run.load_speed_rad_s)[inner]) < 0.02 * np.ptp(run.speed_rad_s) / 2
    assert np.max(np.abs(run.position_rad - load.twist_rad - run.load_position_rad)[inner]) < 2e-4
    slope = machine.load.inertia_table.slope_at(run.load_position_rad)
    balance = crank(run.load_position_rad) * load.acceleration_rad_s2 + slope * load.speed_rad_s**2 / 2
    assert np.sqrt(np.mean((load.torque_nm - balance)[inner] ** 2)) < 0.01 * np.ptp(load.torque_nm)


class TestKnots:
    def test_they_are_one_travel_apart_and_cover_what_was_visited(self):
        knots = knots_for(np.linspace(-1.0, 2.0, 100), 0.3)
        assert knots[0] == -1.0
        assert knots[-1] == 2.0
        np.testing.assert_allclose(np.diff(knots[3:-3]), 0.3)

    @pytest.mark.parametrize(("angles", "travel"), [(np.zeros(10), 0.1), (np.arange(10.0), 0.0)])
    def test_no_motion_is_refused(self, angles, travel):
        with pytest.raises(InputError, match="no motion"):
            knots_for(angles, travel)


class TestAugmentedModel:
    @pytest.fixture
    def params(self, machine):
        return augmented.params_of(machine, 0.1, 1 / 1000)

    def test_a_step_is_that_of_scipy(self, params):
        """One sample of 1 ms, in which the coupling swings a quarter of its period."""
        start = np.array([1.0, -0.5, 1e-3, np.log(0.1)])
        found, work = np.empty(4), np.empty((5, 4))
        augmented.advance(start, 10.0, 30.0, params, found, work)

        def slope(t, x):
            shaft = params.damping * (x[0] - x[1]) + params.stiffness * x[2]
            torque = 10 + 20 * t / 1e-3
            return [(torque - shaft - 0.2 * x[0]) / 0.012, (shaft - 0.1 * x[1]) / 0.1, x[0] - x[1]]

        exact = solve_ivp(slope, (0, 1e-3), start[:3], rtol=1e-11, atol=1e-13).y[:, -1]
        np.testing.assert_allclose(found[:3], exact, rtol=2e-4, atol=1e-7)
        assert found[3] == start[3]

    @pytest.mark.parametrize("kalman", [EXTENDED, SIGMA_POINT])
    def test_the_model_s_own_inertia_is_found(self, params, kalman):
        torque = 40 * np.sin(OMEGA * np.arange(600) / 1000)
        log_inertia = np.full(600, np.log(0.13))
        speed = augmented._speed(torque, log_inertia, params)
        run = augmented.Filtering(
            params=params,
            torque_nm=torque,
            speed_rad_s=speed,
            state=np.array([0.0, 0.0, 0.0, np.log(0.07)]),
            covariance=np.diag([1e-4, 1e-4, 0.0, 1.0]),
            process=np.array([1e-8, 0.0, 0.0, 1e-5]),
            speed_variance=1e-4,
            memory_s=2.5e-3,
        )
        np.testing.assert_allclose(kalman(run)[300:], 0.13, rtol=3e-3)
        lag = augmented.lag_s(kalman, run)
        assert 1e-3 < lag < 20e-3

    def test_both_filters_agree_where_the_model_is_all_but_linear(self, params):
        rng = np.random.default_rng(7)
        torque = 40 * np.sin(OMEGA * np.arange(500) / 1000)
        speed = augmented._speed(torque, np.full(500, np.log(0.1)), params) + 0.01 * rng.normal(size=500)
        run = augmented.Filtering(
            params, torque, speed, np.array([0.0, 0.0, 0.0, np.log(0.1)]),
            np.diag([1e-4, 1e-4, 0.0, 0.01]), np.array([1e-8, 0.0, 0.0, 1e-5]), 1e-4, 2.5e-3,
        )  # fmt: skip
        np.testing.assert_allclose(EXTENDED(run), SIGMA_POINT(run), rtol=0.005)
