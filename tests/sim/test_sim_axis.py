"""The servo axis: demand, cascade, feed-forward, measurement, generator and trace, on both plants."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray

from schwung_sim import compiled
from schwung_sim.drives import controller
from schwung_sim.drives.axis import (
    FEED_FORWARD_SCALAR,
    FEED_FORWARD_TABLE,
    GENERATOR_AT_MOTION,
    GENERATOR_OFF,
    GENERATOR_ON,
    TRACE_ARMED,
    TRACE_FULL,
    AxisSettings,
    ServoAxis,
)
from schwung_sim.errors import BenchError
from schwung_sim.plants import TICK_S, Profile, TwoMassPlant, make_plant

Array = NDArray[np.float64]
CYCLE_S = 1e-3
STROKE, DURATION_S = np.pi, 0.25


def third(time: Array) -> Array:
    """The 1/3 profile from 0 to STROKE within DURATION_S, rest before and after."""
    u = np.clip(time / DURATION_S, 0, 1)
    rise, cruise, fall = 2.25 * u**2, 0.25 + 1.5 * (u - 1 / 3), 1 - 2.25 * (1 - u) ** 2
    return np.asarray(STROKE * np.where(u < 1 / 3, rise, np.where(u < 2 / 3, cruise, fall)))


def energised(name: str = "two-mass", settings: AxisSettings | None = None, **options: Any) -> ServoAxis:
    axis = ServoAxis(make_plant(name, **options), settings)
    axis.energise(True)
    return axis


def play(axis: ServoAxis, setpoints: Array, cycles_s: Array | None = None) -> Array:
    """Cyclic setpoints, rounded to counts; rows of demand, demand speed, following error, speed, torque."""
    count = 2 * np.pi / axis.settings.encoder_counts
    rows = []
    for i, setpoint in enumerate(setpoints):
        axis.set_target(round(setpoint / count) * count, CYCLE_S)
        axis.advance(CYCLE_S if cycles_s is None else cycles_s[i])
        rows.append((axis.demand_rad, axis.demand_speed_rad_s, axis.following_error_rad, axis.speed_rad_s,
                     axis.torque_nm))  # fmt: skip
    return np.array(rows)


def there_and_back() -> Array:
    time = np.arange(-50, 350) * CYCLE_S
    return np.concatenate([third(time), STROKE - third(time)])


def rms(values: Array) -> float:
    return float(np.sqrt(np.mean(values**2)))


# Demand


def test_cyclic_demand_meets_every_setpoint_one_cycle_later() -> None:
    axis = energised()
    setpoints = there_and_back()
    rows = play(axis, setpoints)
    np.testing.assert_allclose(rows[:, 0], setpoints, atol=2 * np.pi / 2**20)


def test_cyclic_demand_speed_is_smooth_within_the_cycle() -> None:
    """No stairs: at constant acceleration the demanded speed is the motion's own at every control tick."""
    axis = energised()
    setpoints = third(np.arange(1, 80) * CYCLE_S)
    speeds = []
    for setpoint in setpoints:
        axis.set_target(setpoint, CYCLE_S)
        for _ in range(8):
            axis.advance(TICK_S)
            speeds.append(axis.demand_speed_rad_s)
    time = np.arange(1, len(speeds) + 1) * TICK_S
    np.testing.assert_allclose(speeds[24:], (4.5 * STROKE / DURATION_S**2 * time)[24:], rtol=1e-6)


def test_jittered_setpoints_do_not_kick() -> None:
    """Arrivals 0.25 ms early and late: the axis follows as well as without, for the slopes come from setpoints."""
    setpoints = there_and_back()
    rng = np.random.default_rng(4)
    late = np.concatenate([[0], rng.integers(-2, 3, setpoints.size)])
    cycles = (8 + np.diff(late)) * TICK_S
    torque = np.max(np.abs(play(energised(), setpoints)[:, 4]))
    assert np.max(np.abs(play(energised(), setpoints, cycles)[:, 4])) < torque + 10


def test_missing_setpoint_is_bridged_then_the_axis_holds() -> None:
    axis = energised()
    for setpoint in third(np.arange(120) * CYCLE_S):
        axis.set_target(setpoint, CYCLE_S)
        axis.advance(CYCLE_S)
    speed, demand = axis.demand_speed_rad_s, axis.demand_rad
    axis.advance(CYCLE_S)
    assert axis.demand_rad == pytest.approx(demand + speed * CYCLE_S, rel=1e-6)
    axis.advance(TICK_S)
    assert axis.demand_speed_rad_s == 0.0
    assert axis.demand_rad == pytest.approx(demand, rel=1e-9)


def test_one_lost_setpoint_does_not_double_the_speed() -> None:
    axis = energised()
    setpoints = third(np.arange(150) * CYCLE_S)
    peak = 0.0
    for i, setpoint in enumerate(setpoints):
        if i != 120:
            axis.set_target(setpoint, CYCLE_S)
        axis.advance(CYCLE_S)
        peak = max(peak, abs(axis.demand_speed_rad_s))
    assert peak == pytest.approx(1.5 * STROKE / DURATION_S, rel=0.01)


def test_a_setpoint_given_twice_counts_once() -> None:
    once, twice = energised(), energised()
    for setpoint in third(np.arange(100) * CYCLE_S):
        once.set_target(setpoint, CYCLE_S)
        twice.set_target(setpoint, CYCLE_S)
        twice.set_target(setpoint, CYCLE_S)
        once.advance(CYCLE_S)
        twice.advance(CYCLE_S)
    assert twice.demand_rad == pytest.approx(once.demand_rad, abs=1e-12)
    assert twice.demand_speed_rad_s == pytest.approx(once.demand_speed_rad_s, rel=1e-9)


def moved(axis: ServoAxis, seconds: float) -> Array:
    """Demand and its speed at every control tick."""
    rows = []
    for _ in range(round(seconds / TICK_S)):
        axis.advance(TICK_S)
        rows.append((axis.demand_rad, axis.demand_speed_rad_s))
    return np.array(rows)


@pytest.mark.parametrize(("target", "peak"), [(2.0, 10.0), (-2.0, 10.0), (0.1, 4.4721)])
def test_own_move_is_a_trapezoid(target: float, peak: float) -> None:
    """0.1 rad is too short to reach the speed: peak √(2·s·a·d/(a + d))."""
    axis = energised()
    axis.start_move(target, 10.0, 200.0, 200.0)
    rows = moved(axis, 0.5)
    assert rows[-1].tolist() == [target, 0.0]
    assert np.max(np.abs(rows[:, 1])) == pytest.approx(peak, rel=0.01)
    assert np.max(np.abs(np.diff(rows[:, 1]))) <= 200 * TICK_S * (1 + 1e-6)
    axis.advance(1.0)
    assert axis.target_reached
    assert axis.standstill


def test_unequal_ramps() -> None:
    axis = energised()
    axis.start_move(3.0, 10.0, 100.0, 400.0)
    rows = moved(axis, 0.6)
    steps = np.diff(rows[:, 1]) / TICK_S
    assert [steps.max(), steps.min()] == pytest.approx([100, -400], rel=1e-6)
    assert rows[-1, 0] == 3.0


@pytest.mark.parametrize("second", [3.0, 0.2, -1.0, 1.2])
def test_a_new_move_on_the_way_starts_from_the_present_speed(second: float) -> None:
    axis = energised()
    axis.start_move(2.0, 10.0, 200.0, 200.0)
    first = moved(axis, 0.1)
    axis.start_move(second, 8.0, 200.0, 200.0)
    rows = np.concatenate([first, moved(axis, 0.8)])
    assert rows[-1].tolist() == [second, 0.0]
    assert np.max(np.abs(np.diff(rows[:, 1]))) <= 200 * TICK_S * (1 + 1e-6)
    assert np.max(np.abs(np.diff(rows[:, 0]))) <= 10 * TICK_S * (1 + 1e-6)


def test_quick_stop_ramps_down_and_holds() -> None:
    axis = energised()
    play(axis, third(np.arange(120) * CYCLE_S))
    start, speed = axis.demand_rad, axis.demand_speed_rad_s
    axis.quick_stop(500.0)
    rows = moved(axis, 0.2)
    assert rows[-1, 0] == pytest.approx(start + speed**2 / 1000, rel=1e-9)
    assert np.diff(rows[:, 1]).min() == pytest.approx(-500 * TICK_S, rel=1e-6)
    axis.advance(1.0)
    assert axis.standstill
    assert abs(axis.position_rad - rows[-1, 0]) < 1e-3


def test_without_power_it_coasts_and_the_demand_follows() -> None:
    axis = energised()
    play(axis, third(np.arange(120) * CYCLE_S))
    speed = axis.speed_rad_s
    axis.energise(False)
    axis.advance(0.05)
    assert axis.torque_demand_nm == 0.0
    assert axis.speed_rad_s > 0.5 * speed
    assert axis.following_error_rad == 0.0
    axis.energise(True)
    axis.advance(0.3)
    assert axis.standstill


# Cascade and feed-forward


@pytest.mark.parametrize("name", ["two-mass", "slider-crank"])
def test_inertia_table_lowers_the_following_error_fivefold(name: str) -> None:
    axis = energised(name)
    before = rms(play(axis, there_and_back())[:, 2])
    angle = np.linspace(-0.1, STROKE + 0.1, 64)
    table = tuple(axis.plant.true_inertia(angle))
    axis.configure(
        feed_forward_mode=FEED_FORWARD_TABLE, table_start_rad=-0.1, table_step_rad=angle[1] - angle[0],
        table_inertia_kgm2=table,
    )  # fmt: skip
    with_table = rms(play(axis, there_and_back())[:, 2])
    axis.configure(feed_forward_mode=FEED_FORWARD_SCALAR, scalar_inertia_kgm2=float(np.mean(table)))
    with_mean = rms(play(axis, there_and_back())[:, 2])
    assert before > 10 * with_table
    assert with_table < with_mean < before


def test_scalar_feed_forward_is_right_for_a_constant_inertia() -> None:
    axis = ServoAxis(TwoMassPlant(inertia=Profile.constant(0.1)))
    axis.energise(True)
    before = rms(play(axis, there_and_back())[:, 2])
    axis.configure(feed_forward_mode=FEED_FORWARD_SCALAR, scalar_inertia_kgm2=0.1)
    assert rms(play(axis, there_and_back())[:, 2]) < before / 10


def test_an_empty_table_is_no_feed_forward() -> None:
    axis, plain = energised(), energised()
    axis.configure(feed_forward_mode=FEED_FORWARD_TABLE, table_inertia_kgm2=())
    np.testing.assert_array_equal(play(axis, there_and_back()), play(plain, there_and_back()))


def test_the_law_is_the_printed_one() -> None:
    """T = K_ps (e + ∫e/T_n), e = K_pp Δθ on a rotor held by friction: within T_n the torque grows by K_ps e."""
    settings = AxisSettings(position_gain_1_s=60.0, speed_gain_nms_rad=7.0, speed_integral_time_s=0.008)
    axis = energised(settings=settings, conceal="coulomb_friction=200")
    axis.set_target(1e-3, CYCLE_S)
    axis.advance(3 * CYCLE_S)  # the demand has arrived and rests
    error, torque = 60 * axis.following_error_rad, axis.torque_demand_nm
    assert error == pytest.approx(0.06, rel=0.01)
    axis.advance(0.008)
    assert axis.torque_demand_nm - torque == pytest.approx(7.0 * error, rel=1e-9)
    axis.energise(False)
    axis.energise(True)  # clears the integrator
    axis.start_move(axis.position_rad + 1e-3, 1e3, 1e9, 1e9)
    axis.advance(2 * TICK_S)
    assert axis.torque_demand_nm == pytest.approx(7.0 * 0.06, rel=0.02)


def test_torque_limit_clips_without_winding_up() -> None:
    axis = energised(settings=AxisSettings(torque_limit_nm=20.0))
    rows = play(axis, there_and_back()[:400])
    assert np.max(np.abs(rows[:, 4])) <= 20.0 + 1e-9
    axis.advance(0.5)
    assert abs(axis.following_error_rad) < 1e-3
    assert not axis.torque_limit_active
    weak = energised(settings=AxisSettings(torque_limit_nm=1.0))
    play(weak, there_and_back()[:100])
    assert weak.torque_limit_active


# Measurement


def test_torque_and_speed_are_aligned_whatever_the_filter() -> None:
    """A lag between them of a tenth of a control tick would show: 50 Hz response against equation (3)."""
    inertia, frequency = 0.11, 50.0
    for filter_s in (0.0, 100e-6, 1e-3):
        axis = ServoAxis(
            TwoMassPlant(inertia=Profile.constant(inertia)),
            AxisSettings(
                speed_filter_s=filter_s, generator_amplitude_nm=30.0, generator_frequency_hz=frequency
            ),
        )
        axis.energise(True)
        axis.configure(generator_control=GENERATOR_ON)
        axis.advance(1.0)
        rows = np.empty((1600, 2))
        for row in rows:
            axis.advance(TICK_S)
            row[:] = axis.speed_rad_s, axis.torque_nm
        carrier = np.exp(-2j * np.pi * frequency * TICK_S * np.arange(1600))
        speed, torque = carrier @ rows
        s = 2j * np.pi * frequency
        through = 1 / (1 / (inertia * s + 0.1) + 1 / (8.62 + 24963.0 / s))
        ratio = (torque / speed) / (0.012 * s + 0.2 + through)
        assert abs(np.angle(ratio)) < 2 * np.pi * frequency * TICK_S / 10
        assert abs(ratio) == pytest.approx(1, abs=2e-3)


@pytest.mark.parametrize(("interpolate", "lag_s"), [(True, 0.0), (False, CYCLE_S / 2)])
def test_torque_offset_in_steps_lags_half_a_cycle_in_samples(interpolate: bool, lag_s: float) -> None:
    """Sampled once per cycle, held steps look half a cycle late; interpolated ones do not."""
    axis = energised(settings=AxisSettings(interpolate_torque=interpolate))
    n, frequency = 1000, 50.0
    torque = 30 * np.sin(2 * np.pi * frequency * CYCLE_S * np.arange(n))
    sampled, fine = np.empty(n), np.empty((n, 8))
    for i in range(n):
        axis.set_target(0.0, CYCLE_S)
        axis.set_torque_offset(torque[i])
        for k in range(8):
            axis.advance(TICK_S)
            fine[i, k] = axis.torque_nm
        sampled[i] = axis.torque_nm
    end = np.arange(1, n + 1) * CYCLE_S
    each = (np.arange(8 * n) + 1) * TICK_S
    late = slice(n - 200, n)
    apparent = sampled[late] @ np.exp(-2j * np.pi * frequency * end[late]) / 200
    true = fine.ravel()[8 * (n - 200) :] @ np.exp(-2j * np.pi * frequency * each[8 * (n - 200) :]) / 1600
    lag = -np.angle(apparent / true) / (2 * np.pi * frequency)
    # the controller's own answer to the sine is smooth and has no such lag, so it is not the whole half cycle
    assert lag == pytest.approx(lag_s, abs=0.4 * CYCLE_S / 2 if lag_s else 1e-5)


def test_position_is_whole_counts() -> None:
    axis = energised(settings=AxisSettings(encoder_counts=4096))
    play(axis, there_and_back()[:200])
    assert axis.position_rad == pytest.approx(axis.position_counts * 2 * np.pi / 4096, rel=1e-12)
    assert abs(axis.position_rad - axis.plant.motor_rad) <= 2 * np.pi / 4096


def test_following_error_is_demand_minus_position() -> None:
    axis = energised()
    play(axis, there_and_back()[:120])
    assert axis.following_error_rad == axis.demand_rad - axis.position_rad


def test_repeatable_from_the_seed() -> None:
    def history(seed: int) -> Array:
        axis = ServoAxis(make_plant("two-mass", "periodic_disturbance", seed=seed), seed=seed)
        axis.energise(True)
        return play(axis, there_and_back())

    np.testing.assert_array_equal(history(1), history(1))
    assert not np.array_equal(history(1), history(2))


# Generator and trace


def test_generator_waits_for_the_motion() -> None:
    axis = energised(
        settings=AxisSettings(generator_amplitude_nm=40.0, generator_control=GENERATOR_AT_MOTION)
    )
    axis.advance(0.1)
    assert abs(axis.torque_nm) < 1.0
    axis.start_move(0.01, 0.01, 1.0, 1.0)
    torque = []
    for _ in range(160):
        axis.advance(TICK_S)
        torque.append(axis.torque_demand_nm)
    assert max(torque) > 25
    assert torque[0] == pytest.approx(0.0, abs=0.5)  # the sine starts at its phase, 0
    axis.configure(position_gain_1_s=90.0)  # other settings leave it running
    axis.advance(0.1)
    torque = [torque[-1]]
    for _ in range(160):
        axis.advance(TICK_S)
        torque.append(axis.torque_demand_nm)
    assert max(torque) > 25
    axis.configure(generator_control=GENERATOR_OFF)
    axis.advance(1.0)
    assert abs(axis.torque_nm) < 2.0


def test_trace_starts_with_the_motion_and_fills() -> None:
    axis = energised()
    axis.arm_trace(divider=4, length=50)
    axis.advance(0.1)
    assert axis.trace_status == TRACE_ARMED
    assert axis.trace.position_counts.size == 0
    axis.start_move(1.0, 10.0, 200.0, 200.0)
    rows = [(axis.position_counts, axis.speed_rad_s, axis.torque_nm)]
    for _ in range(60):
        axis.advance(4 * TICK_S)
        rows.append((axis.position_counts, axis.speed_rad_s, axis.torque_nm))
    trace = axis.trace
    assert axis.trace_status == TRACE_FULL
    assert trace.sample_time_s == 4 * TICK_S
    expected = np.array(rows[:50])
    np.testing.assert_array_equal(trace.position_counts, expected[:, 0])
    np.testing.assert_array_equal(trace.speed_rad_s, expected[:, 1])
    np.testing.assert_array_equal(trace.torque_nm, expected[:, 2])


def test_trace_holds_the_generators_torque_and_the_demand_of_its_instants() -> None:
    axis = energised(
        settings=AxisSettings(
            generator_amplitude_nm=20.0, generator_frequency_hz=100.0, generator_control=GENERATOR_ON
        )
    )
    axis.advance(0.1)  # the sine began at 0: ten periods ago
    axis.arm_trace(divider=4, length=40)
    axis.start_move(1.0, 10.0, 200.0, 200.0)
    axis.advance(0.03)
    trace, time = axis.trace, np.arange(40) * 4 * TICK_S
    np.testing.assert_allclose(trace.torque_added_nm, 20.0 * np.sin(2 * np.pi * 100.0 * time), atol=1e-9)
    np.testing.assert_allclose(trace.demand_rad - trace.demand_rad[0], 100.0 * time**2, atol=1e-9)


def test_motions_are_counted_by_rests_between_them() -> None:
    """Strokes of one run (0.1 s apart) are one motion, the next run is the next: what events and drift go by."""
    axis = energised()
    stroke = third(np.arange(0, 350) * CYCLE_S)  # 0.25 s and 0.1 s of rest
    run = np.concatenate([stroke, STROKE - stroke, np.zeros(100)])
    play(axis, run)
    assert axis.plant.state["motions"][0] == 1
    play(axis, run)
    assert axis.plant.state["motions"][0] == 2


# Wrong use


def test_wrong_settings_are_refused() -> None:
    axis = energised()
    with pytest.raises(BenchError, match="no setting gain"):
        axis.configure(gain=3)
    with pytest.raises(BenchError, match="negative"):
        axis.configure(torque_limit_nm=-1.0)
    with pytest.raises(BenchError, match="positive"):
        axis.start_move(1.0, 0.0, 1.0, 1.0)
    with pytest.raises(BenchError, match="positive"):
        axis.quick_stop(0.0)
    with pytest.raises(BenchError, match="1 or more"):
        axis.arm_trace(0, 10)


def test_compiled_code_is_stamped_with_every_file_it_may_come_from() -> None:
    """Else an edit in effects.py would leave the old physics in the cached kernels of other files."""
    stamp = controller.two_mass_loop._cache._cache_file._source_stamp
    assert compiled._STAMP in stamp
