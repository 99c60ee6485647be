"""Learned torques over two coordinates at once: the balance of momentum, SciPy's interpolation, and bad files."""

import numpy as np
import pytest
from scipy.interpolate import RegularGridInterpolator
from test_residual_terms import balance, machine_with, moved

from schwung.drivetrain import load_machine, write_machine
from schwung.drivetrain.physics_term import PhysicsTerm
from schwung.drivetrain.residual_plane import plane_of, planes_of
from schwung.errors import InputError

ANGLES, SPEEDS = np.linspace(0.0, 3.0, 31), np.linspace(-40.0, 40.0, 33)
PUMPED = {
    "name": "residual",
    "coordinates": ["position", "speed"],
    "points": [ANGLES.tolist(), SPEEDS.tolist()],
    "table": (-0.2 * (1 + np.sin(ANGLES))[:, None] * SPEEDS).tolist(),
}
LOADED = {
    "name": "residual",
    "coordinates": ["position", "torque"],
    "points": [ANGLES.tolist(), [-200.0, 200.0]],
    "table": (0.05 * np.cos(ANGLES)[:, None] * np.array([-200.0, 200.0])).tolist(),
}
HEATED = {
    "name": "residual",
    "coordinates": ["torque", "time_in_motion"],
    "points": [[-200.0, 200.0], [0.0, 0.4]],
    "table": [[0.0, 20.0], [0.0, -20.0]],
}
CASES = {
    "position and speed": (PUMPED, lambda s, t: -0.2 * (1 + np.sin(s.load_position_rad)) * s.load_speed_rad_s),
    "position and torque": (LOADED, lambda s, t: 0.05 * np.cos(s.position_rad) * s.torque_nm),
    "torque and time": (HEATED, lambda s, t: -0.1 * s.torque_nm * np.clip(t - 0.02, 0, 0.4) / 0.4),
}  # fmt: skip


@pytest.mark.parametrize("rigid", [False, True])
@pytest.mark.parametrize("name", CASES)
def test_momentum_grows_by_what_the_table_says(name, rigid):
    term, acts = CASES[name]
    made, time = moved(machine_with(term, rigid=rigid))
    assert balance(made, time, acts(made, time)) < 5e-4
    assert balance(made, time, np.zeros(time.size)) > 1e-2


def test_between_the_points_it_is_bilinear_and_beyond_them_constant():
    chance = np.random.default_rng(3)
    x, y = np.sort(chance.uniform(-1, 1, 7)), np.sort(chance.uniform(-1, 1, 5))
    plane = plane_of(
        {**PUMPED, "points": [x.tolist(), y.tolist()], "table": chance.normal(size=(7, 5)).tolist()}
    )
    asked = chance.uniform(-1.5, 1.5, (200, 2))
    inside = np.clip(asked, [x[0], y[0]], [x[-1], y[-1]])
    wanted = RegularGridInterpolator((x, y), plane.torque_nm)(inside)
    assert plane.at(*asked.T) == pytest.approx(wanted)


def test_two_over_one_pair_add_up_and_survive_writing(tmp_path):
    shifted = {**PUMPED, "points": [(ANGLES + 0.05).tolist(), SPEEDS.tolist()]}
    write_machine(machine_with(PUMPED, shifted), tmp_path / "machine.toml")
    (plane,) = planes_of(load_machine(tmp_path / "machine.toml").physics).values()
    wanted = -0.2 * (2 + np.sin(1.0) + np.sin(0.95)) * 11.0
    assert plane.at(np.array([1.0]), np.array([11.0])) == pytest.approx([wanted], rel=1e-3)


@pytest.mark.parametrize(
    ("changed", "sentence"),
    [
        ({"coordinates": ["speed", "position"]}, 'one of \\["position", "speed"\\]'),
        ({"coordinates": "position"}, "coordinates is 'position'"),
        ({"coordinate": "speed"}, "beside coordinates"),
        ({"points": [[0, 1]]}, "points are not two lists"),
        ({"points": [[0, 0], [0, 1]]}, "points do not increase"),
        ({"points": [[0, 1], [0]]}, "points do not increase"),
        ({"table": [[0, 1]]}, "31 rows of 33"),
        ({"table": ["much"]}, "not made of rows of numbers"),
        ({"table": 3.0}, "31 rows of 33"),
        ({"table": [[0, float("nan")]]}, "not made of rows of numbers"),
        ({"coordinates": ["position", "torque"], "points": [[0, 1], [-1, 1]], "table": [[-1, 1], [-2, 2]]}, "Smooth"),
    ],
)  # fmt: skip
def test_what_is_no_such_table_is_told(changed, sentence):
    with pytest.raises(InputError, match=sentence):
        planes_of([PhysicsTerm.model_validate({**PUMPED, **changed})])
