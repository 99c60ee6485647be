"""A coupling of two straight lines: where it swings through both, states do not settle by themselves."""

from typing import Any

import numpy as np
import pytest
from integrated import TICK_S, shaken

from schwung.drivetrain.machine import Coupling, Load, Machine, Motor
from schwung.drivetrain.physics_term import PhysicsTerm
from schwung.explain.weighing.round import View, at_rest
from schwung.explain.weighing.weigh import _view
from schwung.explain.weighing.work import Work
from schwung.innovations.likelihood import Noise
from schwung.session.model import Run, Session

ROTOR, LOAD, SOFT, STIFF, KINK, BELIEVED, DAMPING = 0.02, 0.06, 2000.0, 9000.0, 8e-4, 8000.0, 1.0
EVERY, NOISE = 8, (2e-6, 0.015, 0.08)


def carried(wound: Any) -> Any:
    """What the coupling carries (N·m)."""
    return STIFF * wound - (STIFF - SOFT) * np.clip(wound, -KINK, KINK)


def slope(state: np.ndarray, torque: float) -> np.ndarray:
    angle, speed, load_angle, load_speed = state
    between = carried(angle - load_angle) + DAMPING * (speed - load_speed)
    return np.array([speed, (torque - between) / ROTOR, load_speed, between / LOAD])


@pytest.fixture(scope="module")
def session() -> Session:
    chance, (time, states, torques) = np.random.default_rng(1), shaken(slope)
    played = np.column_stack([states[:, :2], torques])
    angle, speed, torque = (played + chance.standard_normal(played.shape) * np.array(NOISE)).T
    taken = slice(None, None, EVERY)
    run = Run(
        role="reference", repeat=0, time_s=time[taken], position_rad=angle[taken], speed_rad_s=speed[taken],
        torque_nm=torque[taken], sample_rate_hz=1 / (EVERY * TICK_S),
    )  # fmt: skip
    return Session((run,), created="2026-01-01T00:00:00+00:00", source="two lines")


def test_its_states_settle_where_the_machine_is(session: Session) -> None:
    wound = np.linspace(-8e-3, 8e-3, 161)
    more = carried(wound) - BELIEVED * wound
    table = [[float(x), float(y)] for x, y in zip(wound, more, strict=True)]
    machine = Machine(
        name="two lines",
        motor=Motor(inertia_kgm2=ROTOR, viscous_friction_nms=0.0, peak_torque_nm=60.0),
        coupling=Coupling(stiffness_nm_rad=BELIEVED, damping_nms=DAMPING),
        load=Load(viscous_friction_nms=0.0, inertia_kgm2=LOAD),
        physics=(PhysicsTerm(name="residual", probability=1.0, coordinate="wind_up", table=table),),
    )
    view: View = _view(session, machine, (), Work())
    about = at_rest(view, (), Noise(NOISE[2], NOISE[1], NOISE[0]))
    assert np.sqrt(about.square([0]) / about.samples([0])) < 1.3
