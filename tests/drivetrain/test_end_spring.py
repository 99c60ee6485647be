"""A spring at the end of the stroke, against energy and another integrator."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest
from scipy.integrate import solve_ivp

from schwung.drivetrain import load_machine, write_machine
from schwung.drivetrain.effects import Effects, effects_of
from schwung.drivetrain.machine import Control, Load, Machine, paper_machine
from schwung.drivetrain.physics_term import PhysicsTerm
from schwung.drivetrain.simulation import Simulated, simulate
from schwung.errors import InputError
from schwung.motion import Array, Demand

RATE = 8000.0
#: Spring, where it begins, what pushes the load into it, and the load.
STIFFNESS, POSITION, PUSH_NM, INERTIA = 60.0, 0.5, 10.0, 0.1
ROTOR, COUPLING, DAMPING = 0.012, 24963.0, 8.62


def spring(**changes: Any) -> PhysicsTerm:
    return PhysicsTerm.model_validate(
        {"name": "end_spring", "stiffness_nm_rad": STIFFNESS, "position_rad": POSITION, **changes}
    )


def machine(*terms: PhysicsTerm, rigid: bool) -> Machine:
    """Without friction, under a drive that does next to nothing."""
    paper = paper_machine()
    return paper.model_copy(
        update={
            "motor": paper.motor.model_copy(update={"viscous_friction_nms": 0.0}),
            "coupling": None if rigid else paper.coupling,
            "load": Load(inertia_kgm2=INERTIA),
            "control": Control(
                position_gain_per_s=1e-9,
                speed_gain_nms=1e-9,
                speed_integral_time_s=5.0,
                sample_rate_hz=RATE,
            ),
            "physics": terms,
        }
    )


def pushed(by: Machine, torque_nm: float, start_rad: float = 0.0) -> Simulated:
    """From rest, for as long as the load takes into the spring and back more than once."""
    time = np.arange(0.0, 0.8, 1 / RATE)
    still = Demand(*np.zeros((3, time.size)))
    return simulate(by, still, time, np.full(time.size, torque_nm), start_rad=start_rad)


@pytest.mark.parametrize("side", [1, -1])
def test_a_load_swings_against_it_without_losing_energy(side: int) -> None:
    made = pushed(machine(spring(position_rad=side * POSITION, side=side), rigid=True), side * PUSH_NM)
    turned, speed = side * made.load_position_rad, made.load_speed_rad_s
    into = np.maximum(turned - POSITION, 0.0)
    energy = 0.5 * (ROTOR + INERTIA) * speed**2 + 0.5 * STIFFNESS * into**2 - PUSH_NM * turned
    put_in = PUSH_NM * np.max(turned)
    np.testing.assert_allclose(energy, 0.0, atol=1e-5 * put_in)
    # it turns where the spring has taken what was put in: k x²/2 = T (p + x)
    turns = (PUSH_NM + np.sqrt(PUSH_NM**2 + 2 * STIFFNESS * PUSH_NM * POSITION)) / STIFFNESS
    assert np.max(into) == pytest.approx(turns, rel=1e-4)
    assert np.min(turned[4000:]) < 0.3 * POSITION  # and it has come back


def test_it_is_another_integrators_motion() -> None:
    made = pushed(machine(spring(), rigid=False), PUSH_NM)

    def rates(_: float, x: Array) -> list[float]:
        shaft = COUPLING * (x[0] - x[2]) + DAMPING * (x[1] - x[3])
        load = shaft - STIFFNESS * max(x[2] - POSITION, 0.0)
        return [x[1], (PUSH_NM - shaft) / ROTOR, x[3], load / INERTIA]

    time = made.time_s
    other = solve_ivp(rates, (0.0, time[-1]), [0.0] * 4, t_eval=time, rtol=1e-8, atol=1e-10, max_step=1e-3).y
    np.testing.assert_allclose(made.load_position_rad, other[2], atol=2e-5)
    np.testing.assert_allclose(made.load_speed_rad_s, other[3], atol=2e-3)
    free = pushed(machine(rigid=False), PUSH_NM)
    assert np.max(np.abs(free.load_position_rad - other[2])) > 1.0


def test_a_stiff_stop_is_met_in_steps_that_are_short_enough() -> None:
    """A stop of its own swing within a tick: its energy comes back, at whichever part of a step it is met."""
    stiff = 200 * COUPLING
    made = pushed(machine(spring(stiffness_nm_rad=stiff), rigid=True), PUSH_NM)
    free = made.load_position_rad < POSITION
    energy = 0.5 * (ROTOR + INERTIA) * made.load_speed_rad_s**2 - PUSH_NM * made.load_position_rad
    assert np.max(np.abs(energy[free])) < 2e-3 * PUSH_NM * POSITION


def test_who_stands_in_it_is_pushed_back_by_it() -> None:
    made = pushed(machine(spring(), rigid=False), 0.0, start_rad=0.8)
    wound = made.position_rad[0] - made.load_position_rad[0]
    assert made.torque_nm[0] == pytest.approx(STIFFNESS * (made.load_position_rad[0] - POSITION))
    assert wound == pytest.approx(made.torque_nm[0] / COUPLING)
    np.testing.assert_allclose(made.load_position_rad, made.load_position_rad[0], atol=1e-9)


def test_a_machine_may_have_one_at_either_end(tmp_path: Path) -> None:
    both = (spring(), spring(stiffness_nm_rad=7.0, position_rad=-0.2, side=-1.0))
    write_machine(machine(*both, rigid=True), tmp_path / "machine.toml")
    read = load_machine(tmp_path / "machine.toml")
    assert effects_of(read.physics) == Effects(
        end_high_nm_rad=STIFFNESS, end_high_rad=POSITION, end_low_nm_rad=7.0, end_low_rad=-0.2
    )


@pytest.mark.parametrize(
    ("terms", "sentence"),
    [
        ((spring(side=0.5),), r"side is 0\.5\. It has to be 1 \(acts beyond position_rad\) or -1"),
        ((spring(side=-3),), "side is -3"),
        ((spring(stiffness_nm_rad=-1.0),), "stiffness_nm_rad is -1. It has to be zero or more"),
        ((spring(position_rad=None),), "position_rad is None.*finite number"),
        ((spring(), spring(position_rad=0.9)), "given twice"),
    ],
)
def test_what_is_no_spring_is_told(terms: tuple[PhysicsTerm, ...], sentence: str) -> None:
    with pytest.raises(InputError, match=sentence) as caught:
        effects_of(terms)
    assert caught.value.place == "physics.end_spring"
