"""The simulation against physics: energy, steady states, vibration, the frequency response, and scipy."""

from __future__ import annotations

import runpy
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
from scipy.integrate import solve_ivp

from schwung.drivetrain.inertia import InertiaTable, LoadTorqueTable
from schwung.drivetrain.machine import Control, Coupling, Load, Machine, Motor, paper_machine
from schwung.drivetrain.physics_term import PhysicsTerm
from schwung.drivetrain.response import injection_to_speed, resonance_hz, torque_to_speed
from schwung.drivetrain.simulation import FeedForward, Simulated, simulate
from schwung.errors import InputError
from schwung.motion import Array, Demand, Excitation, Motion

RATE = 8000.0


def _time(seconds: float, rate: float = RATE) -> Array:
    return np.arange(round(seconds * rate) + 1) / rate


def _rest(time: Array) -> Demand:
    return Demand(np.zeros_like(time), np.zeros_like(time), np.zeros_like(time))


def _machine(rigid: bool = False, rate: float = RATE, **changes: object) -> Machine:
    """The paper's machine, changed."""
    paper = paper_machine()
    control = paper.required_control().model_copy(update={"sample_rate_hz": rate})
    coupling = None if rigid else paper.coupling
    return paper.model_copy(update={"control": control, "coupling": coupling, **changes})


def _frictionless(rigid: bool) -> Machine:
    machine = _machine(
        rigid,
        motor=Motor(inertia_kgm2=0.012, viscous_friction_nms=0, peak_torque_nm=233),
        load=Load(inertia_table=paper_machine().load.inertia_table),
    )
    undamped = machine.coupling and machine.coupling.model_copy(update={"damping_nms": 0.0})
    return machine.model_copy(update={"coupling": undamped})


@pytest.mark.parametrize("rigid", [False, True])
def test_energy_is_conserved_with_an_inertia_that_depends_on_angle(rigid: bool) -> None:
    machine = _frictionless(rigid)
    motion, time = Motion(distance_rad=np.pi, duration_s=0.2), _time(0.6)
    added = Excitation(frequency_hz=50, amplitude_nm=40).torque(time)
    result = simulate(machine, motion.demand(time), time, added)
    # The torque is held between ticks, so that its work is exactly torque times angle.
    work = np.concatenate([[0.0], np.cumsum(result.torque_nm[:-1] * np.diff(result.position_rad))])
    inertia = machine.load_inertia_at(result.load_position_rad)
    energy = 0.012 * result.speed_rad_s**2 / 2 + inertia * result.load_speed_rad_s**2 / 2
    if machine.coupling is not None:
        wind_up = result.position_rad - result.load_position_rad
        energy += machine.coupling.stiffness_nm_rad * wind_up**2 / 2
    assert np.max(energy) > 10
    np.testing.assert_allclose(energy, work, rtol=1e-5, atol=2e-4)


def test_free_vibration_has_the_resonance_frequency() -> None:
    machine = _frictionless(rigid=False)
    nearly_open = Control(
        position_gain_per_s=1e-6, speed_gain_nms=1e-9, speed_integral_time_s=5, sample_rate_hz=RATE
    )
    machine = machine.model_copy(update={"control": nearly_open})
    time = _time(1.0)
    added = np.where(time < 0.001, 50.0, 0.0)
    result = simulate(machine, _rest(time), time, added, inertia=0.1)
    twist = result.position_rad - result.load_position_rad
    free = time > 0.002
    down = np.flatnonzero((twist[:-1] >= 0) & (twist[1:] < 0) & free[:-1])
    crossing = time[down] + twist[down] / (twist[down] - twist[down + 1]) / RATE
    period = (crossing[-1] - crossing[0]) / (crossing.size - 1)
    assert 1 / period == pytest.approx(float(resonance_hz(machine, 0.1)), rel=1e-5)


def test_cruising_lags_by_speed_over_gain_and_needs_the_friction_torque() -> None:
    machine, speed, time = _machine(), 5.0, _time(2.0)
    demand = Demand(speed * time, np.full_like(time, speed), np.zeros_like(time))
    result = simulate(machine, demand, time, inertia=0.1)
    assert result.following_error_rad[-1] == pytest.approx(speed / 60, rel=1e-6)
    assert result.speed_rad_s[-1] == pytest.approx(speed, rel=1e-6)
    assert result.torque_nm[-1] == pytest.approx(0.3 * speed, rel=1e-6)
    assert result.position_rad[-1] - result.load_position_rad[-1] == pytest.approx(
        0.1 * speed / 24963, rel=1e-4
    )
    led = simulate(machine, demand, time, inertia=0.1, feed_forward=FeedForward(speed_share=1.0))
    assert led.following_error_rad[-1] == pytest.approx(0, abs=1e-8)


@pytest.mark.parametrize("rigid", [False, True])
def test_at_rest_the_motor_holds_the_load_torque(rigid: bool) -> None:
    table = LoadTorqueTable(np.array([0.0, 1.0, 2.0]), np.array([-5.0, -9.0, 3.0]))
    load = Load(viscous_friction_nms=0.1, inertia_kgm2=0.1, torque_table=table)
    machine = _machine(rigid, load=load)
    time = _time(0.1)
    result = simulate(machine, _rest(time), time, start_rad=1.0)
    np.testing.assert_allclose(result.position_rad, 1.0, atol=1e-12)
    np.testing.assert_allclose(result.torque_nm, 9.0, rtol=1e-5)
    lag = 0 if rigid else 9.0 / 24963
    np.testing.assert_allclose(result.position_rad - result.load_position_rad, lag, rtol=1e-5, atol=1e-15)


def _component(signal: Array, time: Array, frequency: float) -> complex:
    """Complex amplitude at a frequency of which `time` holds whole periods."""
    return complex(2 * np.mean(signal * np.exp(-2j * np.pi * frequency * time)))


@pytest.mark.parametrize("rigid", [False, True])
@pytest.mark.parametrize("frequency", [20.0, 50.0, 100.0, 200.0])
def test_an_injected_sine_gives_the_frequency_response(frequency: float, rigid: bool) -> None:
    machine = _machine(rigid, rate=40_000.0)
    time = _time(2.0, 40_000.0)
    added = 5 * np.sin(2 * np.pi * frequency * time)
    result = simulate(machine, _rest(time), time, added, inertia=0.1)
    last = slice(-8001, -1)  # 0.2 s: whole periods, settled
    speed, torque, injected = (
        _component(values[last], time[last], frequency)
        for values in (result.speed_rad_s, result.torque_nm, added)
    )
    held = np.exp(-1j * np.pi * frequency / 40_000) * np.sinc(frequency / 40_000)  # zero-order hold
    assert speed / (torque * held) == pytest.approx(
        complex(torque_to_speed(machine, 0.1, frequency)), rel=3e-4
    )
    # The sampled controller differs from the continuous one by half a sample of delay.
    expected = complex(injection_to_speed(machine, 0.1, frequency))
    assert abs(speed / injected - expected) < 0.03 * abs(expected)


def _by_scipy(
    machine: Machine, inertia: float, demand: Array, added: Array, terms: Callable[[float], float]
) -> Array:
    """Motor speed (rad/s) per tick, rigid machine with constant inertia, solved from tick to tick."""
    control, load = machine.required_control(), machine.load
    total, friction = 0.012 + inertia, 0.2 + load.viscous_friction_nms
    period, integral, state, speeds = 1 / control.sample_rate_hz, -(load.torque_nm or 0.0), [0.0, 0.0], []
    for wanted, injected in zip(demand, added, strict=True):
        speeds.append(state[1])
        error = control.position_gain_per_s * (wanted - state[0]) - state[1]
        torque = control.speed_gain_nms * error + integral + injected
        integral += control.speed_gain_nms * error * period / control.speed_integral_time_s
        torque += load.torque_nm or 0.0

        def rates(_: float, y: Array, torque: float = torque) -> list[float]:
            return [y[1], (torque - friction * y[1] + terms(y[1])) / total]

        state = solve_ivp(rates, (0, period), state, method="DOP853", rtol=1e-10, atol=1e-12).y[:, -1]
    return np.array(speeds)


def test_load_torque_and_learned_friction_against_scipy() -> None:
    physics = (
        PhysicsTerm.model_validate({"name": "coulomb_friction", "torque_nm": 2.0}),
        PhysicsTerm.model_validate({"name": "viscous_friction", "coefficient_nms": 0.15}),
    )
    load = Load(viscous_friction_nms=0.1, inertia_kgm2=0.1, torque_nm=-4.0)
    machine = _machine(rigid=True, load=load, physics=physics)
    time = _time(0.05)
    demand = Motion(distance_rad=1.0, duration_s=0.05, start_time_s=0.005).demand(time)
    added = 10 * np.sin(2 * np.pi * 50 * time)
    ours = simulate(machine, demand, time, added)
    theirs = _by_scipy(
        machine, 0.1, demand.position_rad, added, lambda w: -2.0 * np.tanh(w / 0.02) - 0.15 * w
    )
    assert np.max(np.abs(theirs)) > 5
    np.testing.assert_allclose(ours.speed_rad_s, theirs, atol=2e-5)


def test_torque_offset_is_held_at_rest() -> None:
    offset = PhysicsTerm.model_validate({"name": "torque_offset", "torque_nm": 1.5})
    time = _time(0.05)
    result = simulate(_machine(physics=(offset,)), _rest(time), time)
    np.testing.assert_allclose(result.torque_nm, -1.5)
    np.testing.assert_allclose(result.position_rad, 0, atol=1e-12)


@pytest.mark.long
def test_as_exact_as_scipy_and_a_hundred_times_faster() -> None:
    """The table, the coupling and the injection, by the benchmark's own rival."""
    benchmark = runpy.run_path(str(Path(__file__).parents[2] / "benchmarks" / "simulation.py"))
    ours, rival = benchmark["measure"](0.2, analogue=False)
    assert ours.error_rad_s < 5e-6
    assert rival.wall_s > 100 * ours.wall_s


def test_substeps_are_enough() -> None:
    motion, time = Motion(distance_rad=np.pi, duration_s=0.1), _time(0.4)
    for machine in (_machine(), _machine(coupling=Coupling(stiffness_nm_rad=4e6, damping_nms=3.0))):
        usual = simulate(machine, motion.demand(time), time)
        finer = simulate(machine, motion.demand(time), time, substeps=200)
        np.testing.assert_allclose(usual.speed_rad_s, finer.speed_rad_s, atol=1e-4)


class TestTorqueLimit:
    def test_total_torque_is_clipped_and_said_so(self) -> None:
        motion, time = Motion(distance_rad=np.pi, duration_s=0.2), _time(0.6)
        free = simulate(_machine(), motion.demand(time), time)
        added = np.where(time > 0.15, 250.0, 0.0)
        limited = simulate(_machine(), motion.demand(time), time, added)
        assert not np.any(free.clipped)
        assert np.any(limited.clipped)
        assert limited.peak_torque_nm == 233.0
        np.testing.assert_array_equal(np.abs(limited.torque_nm[limited.clipped]), 233.0)

    def test_the_integrator_does_not_wind_up(self) -> None:
        """After a long time at the limit it overshoots little more than a drive whose limit is never reached."""
        time = _time(1.5)
        step = Demand(np.where(time > 0.01, 1.0, 0.0), np.zeros_like(time), np.zeros_like(time))
        weak = _machine(motor=Motor(inertia_kgm2=0.012, viscous_friction_nms=0.2, peak_torque_nm=8.0))
        strong = _machine(motor=Motor(inertia_kgm2=0.012, viscous_friction_nms=0.2, peak_torque_nm=5000.0))
        slow, quick = (simulate(machine, step, time, inertia=0.1) for machine in (weak, strong))
        assert np.mean(slow.clipped) > 0.1
        assert not np.any(quick.clipped)
        assert slow.highest_position_rad < quick.highest_position_rad + 0.3
        assert slow.position_rad[-1] == pytest.approx(1.0, abs=1e-3)


class TestFeedForward:
    def _stroke(self, forward: FeedForward) -> Simulated:
        motion, time = Motion(kind="poly5", distance_rad=np.pi, duration_s=0.25), _time(0.7)
        return simulate(_machine(), motion.demand(time), time, feed_forward=forward)

    def test_the_table_beats_a_number_beats_nothing(self) -> None:
        table = _machine().load.inertia_table
        assert table is not None
        mean = float(np.mean(table.inertia_kgm2))
        nothing, number, whole = (
            self._stroke(FeedForward(1.0, inertia)).rms_following_error_rad for inertia in (None, mean, table)
        )
        assert whole < number < nothing
        assert nothing > 5 * whole

    def test_a_rigid_frictionless_machine_follows_without_a_controller(self) -> None:
        """The fed torque is the inverse of the machine, centrifugal term included."""
        machine = _frictionless(rigid=True)
        hardly = Control(
            position_gain_per_s=1e-6, speed_gain_nms=1e-9, speed_integral_time_s=5, sample_rate_hz=RATE
        )
        machine = machine.model_copy(update={"control": hardly})
        motion, time = Motion(kind="poly5", distance_rad=np.pi, duration_s=0.25), _time(0.4)
        forward = FeedForward(0.0, machine.load.inertia_table)
        result = simulate(machine, motion.demand(time), time, feed_forward=forward)
        # Half a tick late at up to 23.6 rad/s, as the torque is held.
        assert result.peak_following_error_rad < 23.6 * 0.5 / RATE + 5e-4


def _straight(demand: Demand, time: Array, at: Array) -> Demand:
    """A demand as a drive interpolates it."""
    columns = (demand.position_rad, demand.speed_rad_s, demand.acceleration_rad_s2)
    return Demand(*(np.interp(at, time, column) for column in columns))


class TestSampling:
    def test_samples_between_ticks_lie_on_the_same_curve(self) -> None:
        motion = Motion(kind="poly5", distance_rad=np.pi, duration_s=0.2)
        odd = np.linspace(0, 0.4, 4322)  # 10.8 kHz: hardly ever on a tick
        fine = simulate(_machine(), motion.demand(_time(0.4)), _time(0.4))
        between = simulate(_machine(), motion.demand(odd), odd)
        np.testing.assert_allclose(
            between.position_rad, np.interp(odd, _time(0.4), fine.position_rad), atol=2e-5
        )
        assert np.isin(between.torque_nm[::100], between.torque_nm).all()

    def test_slow_samples_are_every_eighth_tick(self) -> None:
        motion = Motion(kind="poly5", distance_rad=np.pi, duration_s=0.2)
        slow, fast = _time(0.4, 1000), _time(0.4)
        coarse = motion.demand(slow)
        straight = _straight(coarse, slow, fast)
        added = 40 * np.sin(2 * np.pi * 50 * slow)
        for hold, at_ticks in ((False, np.interp(fast, slow, added)), (True, np.repeat(added, 8)[:-7])):
            sampled = simulate(_machine(), coarse, slow, added, hold_torque_added=hold)
            every = simulate(_machine(), straight, fast, at_ticks)
            np.testing.assert_allclose(sampled.torque_nm, every.torque_nm[::8], atol=1e-9)
            np.testing.assert_allclose(sampled.position_rad, every.position_rad[::8], atol=1e-12)

    def test_clipping_between_samples_is_not_overlooked(self) -> None:
        slow, fast = _time(0.4, 1000), _time(0.4)
        coarse = Motion(distance_rad=np.pi, duration_s=0.08).demand(slow)
        sampled = simulate(_machine(), coarse, slow)
        every = simulate(_machine(), _straight(coarse, slow, fast), fast)
        expected = [np.any(every.clipped[8 * i : 8 * i + 8]) for i in range(slow.size)]
        np.testing.assert_array_equal(sampled.clipped, expected)
        assert np.any(sampled.clipped & (np.abs(sampled.torque_nm) < 233))

    def test_starting_elsewhere_shifts_demand_and_table(self) -> None:
        machine, time = _machine(), _time(0.3)
        demand = Motion(distance_rad=-1.0, duration_s=0.1).demand(time)
        shifted = simulate(machine, demand, time, start_rad=2.0)
        absolute = Demand(demand.position_rad + 2.0, demand.speed_rad_s, demand.acceleration_rad_s2)
        np.testing.assert_array_equal(shifted.position_rad, simulate(machine, absolute, time).position_rad)
        assert shifted.lowest_position_rad == pytest.approx(1.0, abs=0.1)


class TestRefusals:
    def test_unknown_inertia_unless_given(self) -> None:
        machine, time = _machine(load=Load(viscous_friction_nms=0.1)), _time(0.01)
        with pytest.raises(InputError, match=r"load\.inertia is not known"):
            simulate(machine, _rest(time), time)
        table = InertiaTable(np.array([0.0, 1.0]), np.array([0.1, 0.1]))
        np.testing.assert_array_equal(
            simulate(machine, _rest(time), time, inertia=table).position_rad, np.zeros_like(time)
        )
        for inertia in (0.0, -0.1, float("nan"), float("inf")):
            with pytest.raises(InputError, match="positive"):
                simulate(machine, _rest(time), time, inertia=inertia)

    def test_no_control(self) -> None:
        time = _time(0.01)
        with pytest.raises(InputError, match=r"has no \[control\]"):
            simulate(_machine(control=None), _rest(time), time)

    def test_arrays_that_do_not_fit(self) -> None:
        time = _time(0.01)
        with pytest.raises(InputError, match="does not increase"):
            simulate(_machine(), _rest(time[::-1]), time[::-1])
        with pytest.raises(InputError, match=r"demand\.position_rad"):
            simulate(_machine(), _rest(time[:-1]), time)
        with pytest.raises(InputError, match="torque_added_nm"):
            simulate(_machine(), _rest(time), time, np.full_like(time, np.nan))

    def test_too_stiff_to_simulate(self) -> None:
        light = Motor(inertia_kgm2=1e-7, viscous_friction_nms=0, peak_torque_nm=0.1)
        load = Load(inertia_kgm2=1e-6)
        machine = _machine(motor=light, load=load, coupling=Coupling(stiffness_nm_rad=1e9, damping_nms=0))
        time = _time(0.01)
        with pytest.raises(InputError, match=r"too fast to simulate\. Leave out \[coupling\]"):
            simulate(machine, _rest(time), time)

    def test_too_few_substeps(self) -> None:
        machine = _machine(coupling=Coupling(stiffness_nm_rad=1e8, damping_nms=0))
        motion, time = Motion(distance_rad=np.pi, duration_s=0.1), _time(0.4)
        with pytest.raises(InputError, match="does not stay finite with 1 sub-steps"):
            simulate(machine, motion.demand(time), time, substeps=1)
        with pytest.raises(InputError, match="substeps"):
            simulate(machine, motion.demand(time), time, substeps=-1)
