"""Names of what machines do by formulas that are written here, rigid ones that follow their demand exactly."""

from collections.abc import Callable
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from schwung.drivetrain.inertia import InertiaTable
from schwung.drivetrain.machine import Load, Machine, Motor
from schwung.drivetrain.physics_term import PhysicsTerm
from schwung.explain.causes.along import Ranges
from schwung.explain.causes.candidate import Missed
from schwung.explain.causes.late import beyond_bent, lagging
from schwung.explain.causes.vocabulary.periodic import strongest
from schwung.explain.publishing.publish import publish
from schwung.explain.weighing.values import Weighed
from schwung.explain.weighing.weigh import weigh
from schwung.motion import Array, Motion
from schwung.session.model import Run, Session

RATE_HZ, ROTOR_KGM2, NOISE_NM = 2000.0, 0.002, 0.02
ANGLES = np.linspace(-1.0, 5.0, 601)
RANGES = Ranges(0.0, 4.0, 50.0, 2000.0, 40.0, 1.0, 0.1, 8, 160.0)


def _inertia(angle: Array) -> Array:
    """Of a slide that a crank moves, and its slope."""
    return 0.01 + 0.02 * np.sin(angle) ** 2


def _slope(angle: Array) -> Array:
    return 0.02 * np.sin(2 * angle)


def _motion(number: int) -> Motion:
    return Motion(
        kind="poly5", distance_rad=3.0, duration_s=0.3 + 0.1 * (number // 2), start_time_s=0.1,
        dwell_s=0.2, returns=True,
    )  # fmt: skip


def _session(disturbance: Callable[[Array, int], Array], ahead_rad: float = 0.0) -> Session:
    """Two motions, two repeats of each; the crank is `ahead_rad` ahead of where it is believed."""
    chance, runs = np.random.default_rng(3), []
    for number in range(4):
        motion = _motion(number)
        time = motion.time(RATE_HZ)
        d = motion.demand(time)
        turned = d.position_rad + ahead_rad
        torque = (ROTOR_KGM2 + _inertia(turned)) * d.acceleration_rad_s2
        torque += 0.5 * _slope(turned) * d.speed_rad_s**2 - disturbance(time, number)
        noise = chance.standard_normal((3, time.size))
        runs.append(
            Run(
                role="reference", repeat=number % 2, sample_rate_hz=RATE_HZ, time_s=time,
                position_rad=d.position_rad + 1e-6 * noise[0], speed_rad_s=d.speed_rad_s + 0.01 * noise[1],
                torque_nm=torque + NOISE_NM * noise[2], position_demand_rad=d.position_rad,
                torque_added_nm=None, motion=motion, excitation=None, name=f"run {number}",
            )
        )  # fmt: skip
    return Session(runs, created="2026-01-01T00:00:00", source="a formula")


def _machine(*physics: PhysicsTerm) -> Machine:
    return Machine(
        name="rigid",
        motor=Motor(inertia_kgm2=ROTOR_KGM2, viscous_friction_nms=0.0, peak_torque_nm=5.0),
        load=Load(inertia_table=InertiaTable(ANGLES, _inertia(ANGLES))),
        physics=physics,
    )


def _likely(found: Weighed) -> set[str]:
    return {one.name for one in found.names if one.probability > 0.5}


def _nothing(time: Array, _number: int) -> Array:
    return np.zeros_like(time)


def _hum(time: Array, number: int) -> Array:
    return np.asarray(0.06 * np.cos(2 * np.pi * 38.4 * time + 1.7 * number**2))


@pytest.mark.long
@pytest.mark.parametrize("ahead_rad", [-0.3, 0.06])
def test_a_profile_that_is_shifted_is_not_another_profile(ahead_rad: float) -> None:
    found = weigh(_session(_nothing, ahead_rad), _machine())
    assert _likely(found) == {"inertia_profile_shift"}
    shift = found.names[0].parameters["shift_rad"]
    assert shift.value == pytest.approx(ahead_rad, abs=0.003)


@pytest.mark.long
def test_a_disturbance_of_fixed_frequency_has_a_phase_in_each_run() -> None:
    found = publish(_session(_hum), _machine())
    assert {one.physics for one in found.names if one.probability > 0.5} == {"periodic_disturbance"}
    parameters = found.names[0].parameters
    assert parameters["frequency_hz"].value == pytest.approx(38.4, abs=0.1)
    assert parameters["amplitude_nm"].value == pytest.approx(0.06, rel=0.1)
    assert found.proof is not None
    assert found.proof.taken > 0.8


@pytest.mark.long
@pytest.mark.parametrize(("waves", "name"), [(0.8, {"friction_over_angle"}), (4.0, set())])
def test_what_gives_energy_somewhere_is_no_friction(waves: float, name: set[str]) -> None:
    """A torque against the motion, 0.06 (1 + waves · cos 3θ): where waves are 4, the other way on half of the path."""

    def against(time: Array, number: int) -> Array:
        d = _motion(number).demand(time)
        return np.asarray(-0.06 * (1 + waves * np.cos(3 * d.position_rad)) * np.tanh(d.speed_rad_s / 0.05))

    found = publish(_session(against), _machine())
    assert {one.physics for one in found.names if one.probability > 0.5} == name
    assert {one.coordinate for one in found.curves if one.probability > 0.5} == (
        set() if name else {"position"}
    )
    assert found.proof is not None
    assert found.proof.taken > 0.9


def test_a_known_disturbance_of_fixed_frequency_is_not_named_again() -> None:
    known = PhysicsTerm(name="periodic_disturbance", frequency_hz=38.4, amplitude_nm=0.06)
    assert not _likely(weigh(_session(_hum), _machine(known)))


def test_no_line_is_sought_where_noise_is_white_or_where_the_injection_is_answered() -> None:
    chance = np.random.default_rng(8)
    time = np.arange(1000) / 1000.0
    white = [Missed(chance.standard_normal(1000), np.zeros(1000), 1e-3, ()) for _ in range(6)]
    assert strongest(white, RANGES) == ()
    answered = [one.torque_nm + np.sin(2 * np.pi * 47.0 * time + number) for number, one in enumerate(white)]
    ((found,),) = strongest([Missed(each, 0.0 * each, 1e-3, ()) for each in answered], RANGES)
    assert found == pytest.approx(47.0, abs=0.5)
    assert strongest([Missed(each, 0.0 * each, 1e-3, (47.0,)) for each in answered], RANGES) == ()
    # nor is an odd harmonic of the injection one, which is what yields in a coupling
    assert strongest([Missed(each, 0.0 * each, 1e-3, (47.0 / 3,)) for each in answered], RANGES) == ()
    assert strongest([Missed(each, 0.0 * each, 1e-3, (47.0 / 2.5,)) for each in answered], RANGES) != ()


def test_a_late_speed_is_late_by_its_delay_at_the_injection_too() -> None:
    """At 120 Hz and 1.5 ms the first of Padé's approximations is 0.1 rad off; a filter of as much is what it was."""
    time, turn, delay = np.arange(4000) / 8000.0, 2 * np.pi * 120.0, 1.5e-3
    run = SimpleNamespace(time_s=time, step_s=time[1], quiet=lambda values: values)
    along: Any = SimpleNamespace(speed=np.sin(turn * time), acceleration=turn * np.cos(turn * time), run=run)
    inside = slice(400, -400)

    def told(bend_s: float) -> Any:
        late = -delay * lagging(along, along.acceleration, bend_s) + beyond_bent(along, delay, bend_s)
        return (along.speed + late)[inside]

    late = np.sin(turn * (time - delay))[inside]
    assert np.max(np.abs(told(delay / 2) - late)) < 2e-3
    plain = along.speed - delay * lagging(along, along.acceleration, delay / 2)
    assert np.max(np.abs(plain[inside] - late)) > 0.09
    filtered = np.sin(turn * time - np.arctan(turn * delay))[inside] / np.hypot(1, turn * delay)
    assert np.max(np.abs(told(delay) - filtered)) < 2e-3
