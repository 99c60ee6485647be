"""What phasors prove: every factor but 1 in a unit is found by a relation, and nothing else is."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest
from commissioning_drive import believed_machine
from hypothesis import given
from hypothesis import strategies as st

from schwung.commissioning.evidence import Evidence, Measured
from schwung.commissioning.proof import Belief, Proof, believed_range, cascade, judge
from schwung.drivetrain.response import injection_to_speed, injection_to_torque

MACHINE = believed_machine()
FREQUENCY_HZ = 18.0
BELIEF = Belief(MACHINE, FREQUENCY_HZ)
TURNING = 2 * math.pi * FREQUENCY_HZ
#: The usual confusions: edges of an encoder, gears, rpm, revolutions, degrees, thousands.
FACTORS = (2.0, 4.0, 2 * math.pi, 10.0, 60.0, 180 / math.pi, 256.0, 1000.0)
BOTH_WAYS = (*FACTORS, *(1 / factor for factor in FACTORS))


def seen(
    position: float = 1.0,
    speed: float = 1.0,
    torque: float = 1.0,
    added: float = 1.0,
    load_kgm2: float = 0.11,
    late_s: float = 0.0,
) -> Evidence:
    """What the believed machine would show at 2 N·m, each quantity reported so many times what it is."""
    truly_added = 2.0 / added  # what the drive makes of the counts that it gets
    moved = truly_added * complex(injection_to_speed(MACHINE, load_kgm2, FREQUENCY_HZ))
    acted = truly_added * complex(injection_to_torque(MACHINE, load_kgm2, FREQUENCY_HZ))

    def told(value: complex) -> Measured:
        return Measured(value, 0.002 * abs(value), 0.02 * abs(value))

    return Evidence(
        frequency_hz=FREQUENCY_HZ,
        lag_s=1.5e-3,
        position=told(position * moved / (1j * TURNING)),
        speed=told(speed * moved),
        torque=told(torque * acted * np.exp(-1j * TURNING * late_s)),
        added=2.0 + 0j,
        added_acting=2.0 + 0j,
    )


def wrong(found: Evidence, last: bool = False) -> str:
    """The name of the relation that does not hold."""
    finding = judge(found, BELIEF, last=last).wrong
    return "" if finding is None else finding.name


def test_right_units_are_proven() -> None:
    proof = judge(seen(), BELIEF, last=False)
    assert proof.proven
    assert proof.notes == ()
    assert [finding.factor for finding in proof.findings] == pytest.approx([1.0, 1.0, 1.0], rel=0.05)


@pytest.mark.parametrize("factor", BOTH_WAYS)
def test_a_wrong_speed_or_position_is_told_by_the_other(factor: float) -> None:
    assert wrong(seen(speed=factor)) == "speed over position"
    assert wrong(seen(position=factor)) == "speed over position"


@pytest.mark.parametrize("factor", BOTH_WAYS)
def test_an_encoder_is_told_by_the_torque_where_speed_comes_from_position(factor: float) -> None:
    found = judge(replace(seen(position=factor), speed=None), BELIEF, last=True).wrong
    assert found is not None
    assert found.name == "torque over acceleration"
    if 0.2 < factor < 20:
        assert found.factor == pytest.approx(1 / factor, rel=0.15)


@pytest.mark.parametrize("factor", BOTH_WAYS)
def test_a_rated_torque_is_told_by_what_the_cascade_answers(factor: float) -> None:
    """It scales what is sent and what is reported alike: no comparison of the two would tell."""
    assert wrong(seen(torque=factor, added=factor), last=True) == "torque over acceleration"


@pytest.mark.parametrize("factor", [f for f in BOTH_WAYS if 0.1 <= f <= 60])
def test_a_reported_torque_of_another_scale_than_the_injected_is_told(factor: float) -> None:
    assert wrong(seen(torque=factor)) in ("injected torque", "torque over acceleration")


@pytest.mark.parametrize(
    ("changed", "name"),
    [
        ({"added": -1.0}, "injected torque"),
        ({"torque": -1.0}, "injected torque"),
        ({"speed": -1.0}, "speed over position"),
        ({"position": -1.0}, "speed over position"),
        ({"position": -1.0, "speed": -1.0}, "torque over acceleration"),
        ({"torque": -1.0, "added": -1.0}, "torque over acceleration"),
    ],
)
def test_every_sign_is_told(changed: dict[str, float], name: str) -> None:
    assert wrong(seen(**changed)) == name


@given(
    load=st.floats(0.11 / 3, 0.11 * 3),
    late_s=st.floats(-1e-3, 1e-3),
    off=st.lists(st.floats(0.9, 1.1), min_size=3, max_size=3),
)
def test_no_alarm_for_a_load_off_by_three_a_late_torque_and_units_off_by_a_tenth(
    load: float, late_s: float, off: list[float]
) -> None:
    found = seen(position=off[0], speed=off[1], torque=off[2], load_kgm2=load, late_s=late_s)
    for last in (False, True):
        assert wrong(found, last) == ""


def test_a_torque_whose_phase_nobody_knows_leaves_the_inertia_to_tell() -> None:
    blind = replace(seen(), added=None, added_acting=None)
    assert judge(blind, BELIEF, last=True).proven
    heavy = replace(seen(torque=20.0), added=None, added_acting=None)
    assert wrong(heavy) == "torque over acceleration"
    turned = replace(seen(torque=-1.0), added=None, added_acting=None)
    assert wrong(turned, last=True) == "torque over acceleration"
    assert wrong(turned) == ""  # presliding friction is a spring, and looks like this


def _stuck(found: Evidence) -> Proof:
    none = Measured(0j, 1e-9, 1e-9)
    return judge(
        replace(found, position=none, speed=none, torque=Measured(2 + 0j, 1e-3, 1e-2)), BELIEF, last=True
    )


def test_an_axis_that_does_not_move_proves_nothing_and_accuses_nobody() -> None:
    proof = _stuck(seen())
    assert proof.wrong is None
    assert not proof.proven
    assert proof.unclear == ("torque over acceleration",)


def test_a_speed_too_coarse_to_tell_is_noted_and_no_obstacle() -> None:
    coarse = replace(seen(), speed=Measured(0.001 + 0j, 0.1, 0.5))
    proof = judge(coarse, BELIEF, last=True)
    assert proof.proven
    assert "606C" in proof.notes[0]


def test_the_mean_speed_of_a_stroke_tells_where_the_sine_does_not() -> None:
    coarse = replace(
        seen(),
        speed=Measured(0.001 + 0j, 0.1, 0.5),
        travel_rad_s=0.2,
        travel_told_rad_s=2.0,
        travel_std_rad_s=0.05,
    )
    assert wrong(coarse) == "speed over position"
    assert wrong(replace(coarse, travel_told_rad_s=-0.2)) == "speed over position"
    assert wrong(replace(coarse, travel_told_rad_s=0.21)) == ""


def test_gains_that_are_not_the_drives_are_noted_where_the_inertia_vouches_for_the_units() -> None:
    """b is that of the gains; an inertia of twice the believed rotor alone cannot be 15 times too large."""
    light = MACHINE.model_copy(update={"load": MACHINE.load.model_copy(update={"inertia_kgm2": 0.001})})
    control = MACHINE.required_control()
    softer = light.model_copy(
        update={"control": control.model_copy(update={"speed_gain_nms": control.speed_gain_nms / 6})}
    )
    found = seen(load_kgm2=0.001)
    proof = judge(found, Belief(softer, FREQUENCY_HZ), last=True)
    assert proof.proven
    assert "[control]" in proof.notes[0]


def test_the_believed_range_reaches_from_the_rotor_to_three_loads() -> None:
    low, high = believed_range(BELIEF)
    assert low < MACHINE.motor.inertia_kgm2
    assert MACHINE.motor.inertia_kgm2 + 3 * 0.11 < high < 2 * (MACHINE.motor.inertia_kgm2 + 3 * 0.11)


def test_the_cascade_takes_back_what_the_response_says() -> None:
    """T = O − K P by the closed loop of drivetrain.response, another way to the same."""
    moved = complex(injection_to_speed(MACHINE, 0.11, FREQUENCY_HZ)) / (1j * TURNING)
    acted = complex(injection_to_torque(MACHINE, 0.11, FREQUENCY_HZ))
    assert acted == pytest.approx(1 - complex(cascade(MACHINE, FREQUENCY_HZ)) * moved, rel=1e-9)
