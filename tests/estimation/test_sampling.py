"""Held injections: what stands in the middle of each step tells the inertia that samples do not."""

from dataclasses import replace

import numpy as np
import pytest

from schwung.drivetrain import Control, Coupling, Load, Machine, Motor, simulate
from schwung.estimation import estimate
from schwung.estimation.delay import find_delay
from schwung.estimation.sampling import derived_speed, prepared
from schwung.motion import Excitation, Motion
from schwung.session import Run, Session

RATE, FINER, TRUTH = 1000.0, 8, 0.11
MACHINE = Machine(
    name="constant load",
    motor=Motor(inertia_kgm2=0.012, viscous_friction_nms=0.2, peak_torque_nm=233.0),
    coupling=Coupling(stiffness_nm_rad=24963.0, damping_nms=8.62),
    load=Load(viscous_friction_nms=0.1, inertia_kgm2=TRUTH),
    control=Control(
        position_gain_per_s=60.0, speed_gain_nms=7.0, speed_integral_time_s=20e-3, sample_rate_hz=8000.0
    ),
)
MOTION = Motion(distance_rad=np.pi, duration_s=0.25, start_time_s=0.2, dwell_s=0.15)


def _run(held: bool, excited: bool, says_held: bool, speed_source: str = "position", late: int = 0) -> Run:
    """What a drive reports at 1 kHz: angle and speed at SYNC, torque a tick before, its controller's `late` more."""
    excitation = Excitation(
        frequency_hz=50.0,
        amplitude_nm=46.6,
        ramp_s=0.04,
        end_s=MOTION.total_s - 0.01,
        hold_s=1 / RATE if says_held else None,
    )
    fine = MOTION.time(FINER * RATE)
    commanded_at = fine[np.arange(fine.size) // FINER * FINER] if held else fine
    torque = excitation.torque(commanded_at) if excited else None
    made = simulate(MACHINE, MOTION.demand(fine), fine, torque_added_nm=torque, hold_torque_added=True)
    position = made.position_rad[FINER::FINER]
    time = np.arange(position.size) / RATE
    controller = made.torque_nm - (0.0 if torque is None else torque)
    added = excitation.torque(time) if excited else np.zeros_like(time)
    reported = controller[FINER - 1 - late : -1 - late : FINER] + added
    return Run(
        role="excited" if excited else "reference", repeat=0, sample_rate_hz=RATE, time_s=time, position_rad=position,
        speed_rad_s=made.speed_rad_s[FINER::FINER], torque_nm=reported,
        torque_added_nm=added, motion=MOTION,
        excitation=excitation if excited else None, extra={"speed_source": speed_source},
    )  # fmt: skip


def _session(held: bool, says_held: bool, **options: str) -> Session:
    runs = tuple(_run(held, excited, says_held, **options) for excited in (False, True))
    return Session(runs, created="2026-01-01T00:00:00", source="simulated")


def _bias(session: Session) -> float:
    return float(np.median(estimate(session, MACHINE).table.inertia_kgm2)) - TRUTH


def test_a_held_injection_that_says_so_is_estimated_without_bias() -> None:
    assert abs(_bias(_session(held=True, says_held=True))) < 0.001


def test_a_continuous_injection_is_left_alone() -> None:
    session = _session(held=False, says_held=False, speed_source="drive")
    assert all(a is b for a, b in zip(prepared(session).runs, session.runs, strict=True))


def test_derived_speed_is_exact_at_the_injected_frequency() -> None:
    rate, frequency = 1000.0, 50.0
    time = np.arange(400) / rate
    position = np.sin(2 * np.pi * frequency * time)
    true = 2 * np.pi * frequency * np.cos(2 * np.pi * frequency * time)
    got = derived_speed(position, rate, frequency)
    assert np.max(np.abs(got - true)[1:-1]) < 1e-9 * np.max(np.abs(true))


@pytest.mark.parametrize("excited", [False, True])
def test_values_stand_in_the_middle_of_their_step(excited: bool) -> None:
    session = _session(held=True, says_held=True)
    made, plain = prepared(session).runs[excited], session.runs[excited]
    assert made.time_s[0] == pytest.approx(0.5 / RATE)
    assert len(made) == len(plain) - 1


def test_a_held_sine_is_seen_as_it_is_in_the_middle_of_each_step() -> None:
    step, omega = 1 / RATE, 2 * np.pi * 50.0
    time = np.arange(200) * step
    angle = np.sin(omega * time)
    run = replace(
        _run(held=True, excited=True, says_held=True),
        time_s=time, position_rad=angle, speed_rad_s=omega * np.cos(omega * time),
        torque_nm=np.append(0.0, np.cos(omega * time[:-1])), torque_added_nm=np.append(0.0, np.cos(omega * time[:-1])),
    )  # fmt: skip
    made = prepared(Session((run,), created="2026-01-01T00:00:00", source="exact")).runs[0]
    middle, inside = time[1:] - step / 2, slice(4, -4)
    x = omega * step / 2
    assert made.position_rad[inside] == pytest.approx(np.sin(omega * middle)[inside], abs=2e-5)
    assert made.speed_rad_s[inside] == pytest.approx(omega * np.cos(omega * middle)[inside], abs=2e-5 * omega)
    # the fundamental of a staircase of samples cos(ωt): sin(x)/x of it, half a step late
    assert made.torque_nm[inside] == pytest.approx(
        np.sin(x) / x * np.cos(omega * time[:-1])[inside], abs=2e-5
    )


@pytest.mark.parametrize("late", [0, 1, 2])
def test_how_late_a_controller_is_reported_is_found_in_the_motion(late: int) -> None:
    """A drive that filters neither torque nor speed: half a tick, and whole ones that its reporting takes."""
    session = prepared(Session(
        tuple(_run(held=True, excited=excited, says_held=True, late=late) for excited in (False, True)),
        created="2026-01-01T00:00:00", source="simulated",
    ))  # fmt: skip
    found = find_delay(session, session.excited, MACHINE)
    assert found is not None
    assert found.controller is not None
    assert found.controller.value == pytest.approx((late + 0.5) / (FINER * RATE), abs=15e-6)
    assert found.controller.std < 15e-6
