"""Which way a shaft goes and where it sticks, by its angles; and friction of a shaft that sticks, by its name."""

import numpy as np
import pytest
from next_experiment import RUBBING, STUCK, Room, weighed_session

from schwung.explain.causes.sticking import direction, on_average, slowest

STEP_S, STICKING = 1e-3, 0.01


def stuck_then_going() -> tuple[np.ndarray, np.ndarray]:
    """Angles and speeds of two shafts: the first rests for ten samples, where its speeds are ± 0.2 rad/s in turn."""
    speed = np.concatenate([np.tile([0.2, -0.2], 5), np.linspace(0.3, 1.2, 10)])
    angle = np.concatenate([np.zeros(10), np.cumsum(speed[10:]) * STEP_S])
    steady = np.full(20, -2.0)
    return np.column_stack([angle, steady.cumsum() * STEP_S]), np.column_stack([speed, steady])


def test_a_shaft_at_rest_goes_nowhere_whatever_its_speeds_say() -> None:
    angles, _ = stuck_then_going()
    one, other = (direction(speed, STICKING) for speed in on_average(angles, STEP_S).T)
    np.testing.assert_allclose(one[:9], 0.0, atol=1e-12)
    np.testing.assert_allclose(one[10:], 1.0, atol=1e-3)
    np.testing.assert_allclose(other, -1.0)


def test_steps_at_rest_and_beside_it_are_slow_and_no_others() -> None:
    angles, speeds = stuck_then_going()
    found = slowest(speeds, on_average(angles, STEP_S))
    assert found.shape == (19, 2)
    np.testing.assert_allclose(found[:10, 0], 0.0, atol=1e-12)  # the tenth is beside the last at rest
    assert found[10:, 0].min() > 0.25
    np.testing.assert_allclose(found[:, 1], 2.0)


def test_where_a_shaft_turns_within_a_step_that_is_slow() -> None:
    speed = np.linspace(-1.05, 0.95, 21)[:, None]
    angle = np.concatenate([[[0.0]], np.cumsum((speed[1:] + speed[:-1]) / 2 * STEP_S, axis=0)])
    found = slowest(speed, on_average(angle, STEP_S))[:, 0]
    assert found[10] == 0.0
    assert np.all(found[:9] > 0.05)
    assert np.all(found[12:] > 0.05)
    np.testing.assert_allclose(
        direction(on_average(angle, STEP_S)[:, 0], STICKING), np.sign(speed[:, 0]), atol=1e-3
    )


@pytest.mark.long
@pytest.mark.parametrize(
    ("seed", "name"),
    [(84001, "stribeck_friction"), (84002, "asymmetric_friction"), (84004, "coulomb_friction")],
)
def test_friction_that_is_most_of_the_torque_has_its_name(seed: int, name: str) -> None:
    """A third of the stroke at rest, stuck, each time with another torque that winds up; then it breaks away."""
    room = Room.drawn_by(seed, RUBBING, STUCK)
    assert room is not None
    assert room.hidden == name
    told = weighed_session(room.first(), room).told
    assert told.names[0].name == name
    assert told.names[0].probability > 0.5
    assert all(one.probability < 0.5 for one in told.names[1:])
