"""Tables over the load angle and their CSV files."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from schwung.drivetrain.inertia import (
    InertiaTable,
    LoadTorqueTable,
    read_inertia_csv,
    read_load_torque_csv,
    slider_crank_inertia,
    write_inertia_csv,
    write_load_torque_csv,
)
from schwung.errors import InputError


def test_slope_is_the_derivative() -> None:
    angle = np.linspace(0, np.pi, 361)
    table = InertiaTable(angle, slider_crank_inertia(angle))
    at, step = np.linspace(0.1, 3.0, 50), 1e-6
    numeric = (table.at(at + step) - table.at(at - step)) / (2 * step)
    np.testing.assert_allclose(table.slope_at(at), numeric, atol=1e-6)
    np.testing.assert_array_equal(table.slope_at(np.array([-0.1, 3.2])), [0.0, 0.0])


def test_slider_crank_moves_nothing_at_the_dead_centres() -> None:
    np.testing.assert_allclose(slider_crank_inertia(np.array([0.0, np.pi])), 0.055)
    # At a right angle the slider moves with the crank pin, whatever the rod's length.
    np.testing.assert_allclose(slider_crank_inertia(np.array([np.pi / 2])), 0.055 + 0.105)


def test_exact_round_trips(tmp_path: Path) -> None:
    rng = np.random.default_rng(1)
    angle = np.cumsum(rng.uniform(0.01, 1, 50)) - 7
    table = InertiaTable(angle, rng.uniform(0.01, 1, 50), rng.uniform(0, 0.1, 50))
    write_inertia_csv(table, tmp_path / "j.csv")
    again = read_inertia_csv(tmp_path / "j.csv")
    np.testing.assert_array_equal(again.position_rad, table.position_rad)
    np.testing.assert_array_equal(again.inertia_kgm2, table.inertia_kgm2)
    np.testing.assert_array_equal(again.std_kgm2, table.std_kgm2)
    torque = LoadTorqueTable(angle, rng.normal(size=50))
    write_load_torque_csv(torque, tmp_path / "t.csv")
    np.testing.assert_array_equal(
        read_load_torque_csv(tmp_path / "t.csv").load_torque_nm, torque.load_torque_nm
    )


def test_header_is_the_contract(tmp_path: Path) -> None:
    two = np.array([1.0, 2.0])
    write_inertia_csv(InertiaTable(two, two), tmp_path / "j.csv")
    assert (tmp_path / "j.csv").read_text() == "position_rad,inertia_kgm2\n1.0,1.0\n2.0,2.0\n"
    write_inertia_csv(InertiaTable(two, two, two), tmp_path / "j.csv")
    assert (tmp_path / "j.csv").read_text().startswith("position_rad,inertia_kgm2,std_kgm2\n")
    write_load_torque_csv(LoadTorqueTable(two, -two), tmp_path / "t.csv")
    assert (tmp_path / "t.csv").read_text() == "position_rad,load_torque_nm\n1.0,-1.0\n2.0,-2.0\n"


def test_spreadsheets_and_later_columns_are_read(tmp_path: Path) -> None:
    path = tmp_path / "j.csv"
    path.write_bytes("\ufeffposition_rad, inertia_kgm2,note\r\n0,0.05,a\r\n\r\n1,0.07,b\r\n".encode())
    table = read_inertia_csv(path)
    np.testing.assert_array_equal(table.inertia_kgm2, [0.05, 0.07])
    assert table.std_kgm2 is None


@pytest.mark.parametrize(
    ("text", "place", "problem"),
    [
        ("", ":1", "header is missing"),
        ("angle,J\n0,1\n1,1\n", ":1", "header is 'angle,J'"),
        ("position_rad;inertia_kgm2\n0;1\n1;1\n", ":1", "header"),
        ("position_rad,position_rad,inertia_kgm2\n0,0,1\n1,1,1\n", ":1", "header"),
        ("0,1\n1,1\n", ":1", "header"),
        ("position_rad,inertia_kgm2\n0,1\n", "", "fewer than two"),
        ("position_rad,inertia_kgm2\n0,1\n1,1\n1,2\n", ":4", "does not increase"),
        ("position_rad,inertia_kgm2\n0,1\n1,0,5\n", ":3", "3 columns"),
        ("position_rad,inertia_kgm2\n0,1\n1,-1\n", ":3", "inertia_kgm2 is '-1'"),
        ("position_rad,inertia_kgm2\n0,1\n1,0\n", ":3", "inertia_kgm2 is '0'"),
        ("position_rad,inertia_kgm2\n0,1\nnan,1\n", ":3", "position_rad is 'nan'"),
        ("position_rad,inertia_kgm2\n0,1\n1,inf\n", ":3", "inertia_kgm2 is 'inf'"),
        ("position_rad,inertia_kgm2\n0,550000\n1,1\n", ":2", "inertia_kgm2"),  # g·cm²
        ("position_rad,inertia_kgm2\n0,1\n1,x\n", ":3", "inertia_kgm2 is 'x'"),
        ("position_rad,inertia_kgm2,std_kgm2\n0,1,0\n1,1,-0.1\n", ":3", "std_kgm2 is '-0.1'"),
    ],
)
def test_defects_name_file_and_line(tmp_path: Path, text: str, place: str, problem: str) -> None:
    path = tmp_path / "j.csv"
    path.write_text(text)
    with pytest.raises(InputError) as caught:
        read_inertia_csv(path)
    assert caught.value.place == f"{path}{place}"
    assert problem in caught.value.problem
    assert caught.value.remedy


def test_unreadable_files(tmp_path: Path) -> None:
    with pytest.raises(InputError, match="no such file"):
        read_load_torque_csv(tmp_path / "t.csv")
    (tmp_path / "t.csv").write_bytes(b"\xff")
    with pytest.raises(InputError, match="UTF-8"):
        read_load_torque_csv(tmp_path / "t.csv")


def test_tables_refuse_nonsense() -> None:
    one, two = np.array([1.0]), np.array([1.0, 2.0])
    nonsense = [
        (one, one, None),
        (two[::-1], two, None),
        (two, -two, None),
        (two, one, None),
        (two, two, one),
    ]
    for angles, inertias, std in [*nonsense, (two, two, -two), (two, two, np.array([1.0, np.nan]))]:
        with pytest.raises(InputError):
            InertiaTable(angles, inertias, std)
    for position, torque in ((one, one), (two[::-1], two), (two, np.array([1.0, np.nan])), (two, one)):
        with pytest.raises(InputError):
            LoadTorqueTable(position, torque)
