"""What two coordinates say at once: sampled, written, read back, and in the equations again."""

from types import SimpleNamespace

import numpy as np
import pytest
from strangers import STRANGERS, belief_of

from schwung.drivetrain import load_machine, write_machine
from schwung.explain.causes.along import Ranges
from schwung.explain.causes.known import known
from schwung.explain.causes.vocabulary import vocabulary
from schwung.explain.publishing.drawn_plane import PLANES, drawn_plane
from schwung.explain.publishing.learned import Found, learned
from schwung.explain.publishing.written import sayable

RANGES = Ranges(0.0, 4.0, 50.0, 2000.0, 40.0, 1.0, 0.1, 8, 160.0)


@pytest.mark.parametrize("over", PLANES)
def test_what_is_read_back_does_what_was_found(over, tmp_path):
    machine = belief_of(STRANGERS[0])
    candidate = next(c for c in vocabulary(RANGES, known(machine, 0.0, 4.0)) if c.name == over)
    chance = np.random.default_rng(7)
    coefficients = chance.normal(size=candidate.size)
    coefficients *= 0.1 / np.sqrt(candidate.size)  # small beside the torque that it is over
    plane = drawn_plane(candidate, (), coefficients, RANGES)
    assert plane is not None
    found = Found("residual", False, plane.parameters(), {"probability": 0.9})
    write_machine(learned(machine, [found]), tmp_path / "machine.toml")
    read = known(load_machine(tmp_path / "machine.toml"), 0.0, 4.0)
    place = {key: chance.uniform(*ends, 300) for key, ends in (
        ("angle", (0.0, 4.0)), ("load_speed", (-50.0, 50.0)), ("torque", (-40.0, 40.0)), ("motion_time_s", (0.0, 1.0)),
    )}  # fmt: skip
    made = SimpleNamespace(**place, load_angle=place["angle"])
    motor, load, *_ = candidate.effect(made, ()).of(coefficients)
    (told,) = read.planes
    x, y = {
        "position, speed": (place["angle"], place["load_speed"]),
        "position, torque": (place["angle"], place["torque"]),
        "torque, time_in_motion": (place["torque"], place["motion_time_s"]),
    }[over]
    assert told.at(x, y) == pytest.approx(motor + load, abs=0.03 * np.max(np.abs(motor + load)))


def test_two_found_one_after_the_other_are_one_term():
    machine = belief_of(STRANGERS[0])
    candidate = next(c for c in vocabulary(RANGES, known(machine, 0.0, 4.0)) if c.name == "position, torque")
    plane = drawn_plane(candidate, (), np.full(candidate.size, 1e-3), RANGES)
    assert plane is not None
    found = Found("residual", False, plane.parameters(), {})
    twice = learned(machine, [found, found])
    assert len(twice.physics) == 1
    again = known(twice, 0.0, 4.0).planes[0]
    assert again.torque_nm == pytest.approx(2 * plane.torque_nm, abs=1e-6)


def test_what_no_file_can_say_is_left_out_and_told():
    machine = belief_of(STRANGERS[0])
    candidate = next(
        c for c in vocabulary(RANGES, known(machine, 0.0, 4.0)) if c.name == "torque, time_in_motion"
    )
    planes = [drawn_plane(candidate, (), np.full(candidate.size, size), RANGES) for size in (1e-3, 1e3, 1e-3)]
    found = [Found("residual", False, plane.parameters(), {}) for plane in planes if plane is not None]
    kept, notes = sayable(machine, found, ["torque and time in motion"] * 3)
    assert kept == (0, 2)
    (note,) = notes
    assert note.startswith(
        "what depends on torque and time in motion is modelled, but machine.toml cannot say it: it "
    )


def test_an_inertia_below_zero_where_the_machine_was_is_left_out_and_told():
    machine = belief_of(STRANGERS[0])
    found = Found("inertia_profile", True, {"table": [[0.0, -0.5], [2.0, -0.5], [4.0, -0.5]]}, {})
    kept, notes = sayable(machine, [found], ["position"], (0.0, 4.0))
    assert kept == ()
    assert notes[0].startswith(
        "what depends on position is modelled, but machine.toml cannot say it: it inertia_kgm2"
    )
