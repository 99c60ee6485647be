"""What comes late: the speed of a motor whose injection a bus holds, and a torque that a file says to lag."""

from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest
from scipy.interpolate import CubicSpline

from schwung.drivetrain.machine import Load, Machine, Motor
from schwung.drivetrain.physics_term import PhysicsTerm
from schwung.explain.causes.along import Along, Ranges
from schwung.explain.causes.known import known
from schwung.explain.causes.late import acceleration_bent
from schwung.explain.causes.true_torque import TrueTorque
from schwung.explain.causes.vocabulary.reporting import usual
from schwung.innovations.held import Held
from schwung.innovations.signals import Drive, Signals

ROTOR, STEP_S, INJECTED_NM, HZ = 0.012, 1e-3, 46.6, 50.0


@pytest.fixture(scope="module")
def held() -> Along:
    """A rotor alone under a sine that is held for a millisecond each, exactly."""
    time = STEP_S * np.arange(401)
    injected = INJECTED_NM * np.sin(2 * np.pi * HZ * (time[:-1] + STEP_S / 2))
    speed = np.concatenate([[0.0], np.cumsum(injected) * STEP_S / ROTOR])
    drive = Drive(time, CubicSpline(time, 0 * time), Held(time, injected))
    run = Signals(
        time, STEP_S, 0 * time, speed, drive, np.column_stack([0 * time, speed]), True, band_hz=450.0
    )
    machine = SimpleNamespace(
        motor=SimpleNamespace(inertia_kgm2=ROTOR), coupling=None, load_inertia_at=np.zeros_like
    )
    ranges = Ranges(0.0, 1.0, 1.0, 1.0, INJECTED_NM, 0.4, 1e-3, 1, 450.0)
    return Along(run, machine, machine, ranges, 0, 0.0, SimpleNamespace())


@pytest.mark.parametrize("delay_s", [1e-4, 3e-4, 5e-4, 8e-4])
def test_a_late_speed_is_what_it_was(held: Along, delay_s: float) -> None:
    """The lines' own speeds say it, whatever part of a step the delay is."""
    was = np.interp(held.time_s - delay_s, held.time_s, held.speed)
    late = delay_s * acceleration_bent(held, delay_s / 2)
    inside = slice(20, -20)
    largest = np.max(np.abs(held.speed - was)[inside])
    assert np.max(np.abs(held.speed - late - was)[inside]) < 0.01 * largest


@pytest.mark.parametrize("taken", [0.2, 0.5, 0.9])
@pytest.mark.parametrize("delay_s", [1e-4, 4e-4, 1.2e-3])
def test_it_is_wherever_in_its_step_the_drive_takes_what_is_held(
    held: Along, taken: float, delay_s: float
) -> None:
    """The corners are a share of a step behind the samples."""
    corners = held.time_s + taken * STEP_S
    now, was = (np.interp(held.time_s - late_s, corners, held.speed) for late_s in (0.0, delay_s))
    run = replace(held.run, states=np.column_stack([0 * now, now]), speed_rad_s=now)
    along = replace(held, run=run, beyond=replace(held.beyond, held_late=taken), kept={})
    late = delay_s * acceleration_bent(along, delay_s / 2)
    inside = slice(20, -20)
    assert np.max(np.abs(now - late - was)[inside]) < 0.015 * np.max(np.abs(now - was)[inside])


def test_before_a_sample_acceleration_is_that_of_its_step(held: Along) -> None:
    inside, step = slice(20, -20), np.append(0.0, held.run.drive.held.torque_nm) / ROTOR
    assert held.acceleration_before[inside] == pytest.approx(step[inside], abs=2e-3 * np.max(step))


def test_a_file_s_lag_is_one_whatever_the_frequency(held: Along) -> None:
    """T/(1 + τs) of a sine, ωτ about 1: T − τ T' would be larger than T."""
    lag_s, rate = 3.5e-3, 2 * np.pi * HZ
    motor = Motor(inertia_kgm2=ROTOR, viscous_friction_nms=0.0, peak_torque_nm=100.0)
    lags = PhysicsTerm.model_validate({"name": "torque_lag", "time_constant_s": lag_s})
    machine = Machine(name="lags", motor=motor, load=Load(inertia_kgm2=0.1), physics=(lags,))
    torque = INJECTED_NM * np.sin(rate * held.time_s)
    nothing = Held(held.time_s, np.zeros(held.time_s.size - 1))
    drive = Drive(held.time_s, CubicSpline(held.time_s, torque), nothing)
    run = replace(held.run, drive=drive)
    along = replace(
        held, run=run, machine=machine, present=machine, true_torque=TrueTorque(run, torque), kept={}
    )
    late = INJECTED_NM * np.imag(np.exp(1j * rate * held.time_s) / (1 + 1j * rate * lag_s))
    found = known(machine, 0.0, 1.0).effect(along).on_motor[:, 0]
    assert np.max(np.abs(torque + found - late)[100:-20]) < 0.03 * INJECTED_NM


@pytest.mark.parametrize(("hertz", "share"), [(40.0, 0.0), (270.0, 1.0)])
def test_what_is_late_beyond_the_band_is_late_by_itself(held: Along, hertz: float, share: float) -> None:
    """At a resonance there, which a loop's own noise excites, a lag would be a damping."""
    rate = 2 * np.pi * hertz
    torque, speed = INJECTED_NM * np.sin(rate * held.time_s), np.cos(rate * held.time_s)
    nothing = Held(held.time_s, np.zeros(held.time_s.size - 1))
    drive = Drive(held.time_s, CubicSpline(held.time_s, torque), nothing)
    run = replace(
        held.run, drive=drive, states=np.column_stack([0 * speed, speed]), speed_rad_s=speed, band_hz=160.0
    )
    along = replace(held, run=run, true_torque=TrueTorque(run, torque), kept={})
    beyond = next(one for one in usual(1.25e-4) if one.name == "usual_timing_beyond")
    done = beyond.effect(along, ())
    assert done.on_motor is not None
    assert done.speed is not None
    for found, changes in (
        (done.on_motor[:, 0], INJECTED_NM * rate * np.cos(rate * held.time_s)),
        (done.speed[:, 1], rate * np.sin(rate * held.time_s)),
    ):
        assert np.std((found - share * changes)[40:-40]) < 0.2 * np.std(changes)
    assert not np.any(done.on_motor[:, 1])
    assert not np.any(done.speed[:, 0])
