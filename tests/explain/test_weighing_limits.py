"""A torque that is clipped, and what only looks like one: one careful stroke with a large sine."""

import numpy as np
import pytest
from next_experiment import Room, weighed_session

from schwung.drivetrain.machine import Machine
from schwung.explain.causes.true_torque import seems_clipped
from schwung.innovations.signals import picked_signals_of
from schwung.session.model import Run


@pytest.mark.long
@pytest.mark.parametrize(("seed", "names"), [(70013, {"load_torque"}), (70019, set())])
def test_what_passes_most_of_what_is_asked_for_is_no_saturation(seed: int, names: set[str]) -> None:
    """Limits of which 4 % and 35 % were clipped had 0.92 and 0.77."""
    room = Room.drawn_by(seed)
    assert room is not None
    assert _named(room) == names


@pytest.mark.long
@pytest.mark.parametrize("seed", [73005, 73036, 73055, 80000])
def test_noise_at_the_peak_is_no_saturation(seed: int) -> None:
    """Nothing is hidden; samples beyond the limit were those whose noise is large: 0.91, 0.99, 1.00, 1.00 (of sixteen
    samples)."""
    room = Room.sound(seed)
    assert _named(room) == set()


def _sine(samples: int, seed: int) -> tuple[Run, np.ndarray]:
    """A sine of 10 N·m, which the model knows, and noise of 0.5, which is not in how the machine moves."""
    time, chance = np.arange(samples) / 1000.0, np.random.default_rng(seed)
    true, noise = 10 * np.sin(40 * time), 0.5 * chance.standard_normal(time.size)
    return Run("reference", 0, 1000.0, time, np.sin(9 * time), 9 * np.cos(9 * time), true + noise), noise


def _shares(run: Run) -> tuple[np.ndarray, np.ndarray]:
    motor, load = ({"inertia": 0.01, "viscous_friction": 0.0} for _ in range(2))
    machine = Machine.model_validate({"name": "arm", "motor": {**motor, "peak_torque": 50.0}, "load": load})
    limits, shares = np.transpose(seems_clipped([picked_signals_of(run, machine, 160.0)]))
    return limits, shares


def _clipped(run: Run, noise: np.ndarray, limit: float) -> float:
    """What share of all beyond a limit seems clipped."""
    beyond = np.clip(run.torque_nm, -limit, limit) - run.torque_nm
    return -float(beyond @ noise) / float(beyond @ beyond)


def test_noise_seems_clipped_where_little_else_is_beyond() -> None:
    run, noise = _sine(200_000, 4)
    limits, shares = _shares(run)
    for limit in (5.0, 9.0, 10.0):
        assert np.interp(limit, limits, shares) == pytest.approx(_clipped(run, noise, limit), rel=0.1)
    assert np.interp(5.0, limits, shares) < 0.05
    assert np.interp(10.5, limits, shares) > 0.5


def test_few_samples_beyond_a_limit_seem_clipped_more_by_chance() -> None:
    """Of some thirty samples, as one stroke has."""
    more = 0
    for seed in range(200):
        run, noise = _sine(400, seed)
        more += _clipped(run, noise, 9.8) > np.interp(9.8, *_shares(run))
    assert 0 < more < 20


def _named(room: Room) -> set[str]:
    runs = [run for _ in range(2) for run in room.record(room.setting.done)]
    return {one.name for one in weighed_session(runs, room).told.names if one.probability > 0.5}
