"""What is taken away says the same motion in every format."""

from __future__ import annotations

import csv
import json
import re
from pathlib import Path

import numpy as np
import pytest
from optimise_machines import PAPER, task, with_physics

from schwung.optimise.comparison import there_and_back
from schwung.optimise.formats import cycle_torque, mean_torque, read_motion, write_all
from schwung.optimise.values import Stroke

HANGING = with_physics(PAPER, load_torque={"amplitude_nm": 20.0, "phase_rad": 1.0})


@pytest.fixture(scope="module")
def strokes() -> tuple[Stroke, Stroke]:
    return there_and_back(HANGING, task())


@pytest.fixture
def folder(strokes: tuple[Stroke, Stroke], tmp_path: Path) -> Path:
    write_all(tmp_path, "m", *strokes, 1000.0, {})
    return tmp_path


def columns(path: Path) -> dict[str, np.ndarray]:
    rows = list(csv.DictReader(path.open(encoding="utf-8")))
    return {name: np.array([float(row[name]) for row in rows]) for name in rows[0]}


def test_setpoints_are_the_motions_and_come_back(folder: Path) -> None:
    made = columns(folder / "setpoints.csv")
    motion = read_motion(json.loads((folder / "motion.json").read_text()))
    alone = motion.model_copy(update={"start_time_s": 0.0, "dwell_s": 0.0})
    np.testing.assert_allclose(made["position_rad"], alone.demand(made["time_s"]).position_rad, atol=1e-9)
    assert made["position_rad"][-1] == pytest.approx(0.0, abs=1e-7)
    assert np.max(made["position_rad"]) == pytest.approx(np.pi, abs=1e-3)


@pytest.mark.parametrize(("file", "names"), [
    ("twincat_cam.st", ("MasterPos", "SlavePos", "SlaveVelo", "SlaveAcc")),
    ("codesys_cam.st", ("dX", "dY", "dV", "dA")),
])  # fmt: skip
def test_cams_are_the_motion_with_the_time_in_ms_as_master(
    folder: Path, strokes: tuple[Stroke, Stroke], file: str, names: tuple[str, ...]
) -> None:
    text = (folder / file).read_text()
    x, y, v, a = (np.array(re.findall(rf"{name} := (\S+?)[,)]", text), dtype=float) for name in names)
    motion = strokes[0].motion(start_time_s=0.0)
    demand = motion.demand(x[:-1] * 1e-3)
    assert x[-1] == pytest.approx(100.0)
    np.testing.assert_allclose(y[:-1], demand.position_rad, atol=1e-8)
    np.testing.assert_allclose(v[:-1], demand.speed_rad_s * 1e-3, atol=1e-7)
    np.testing.assert_allclose(a[:-1], demand.acceleration_rad_s2 * 1e-6, atol=1e-6)
    assert re.search(r"\[[01]\.\.\d+\]", text)


def test_a_cubic_between_pvt_points_is_the_motion(folder: Path, strokes: tuple[Stroke, Stroke]) -> None:
    made = columns(folder / "pvt.csv")
    h, i = made["time_s"][1], 20
    p, v = made["position_rad"], made["speed_rad_s"]
    middle = (p[i] + p[i + 1]) / 2 + h / 8 * (v[i] - v[i + 1])
    demand = strokes[0].motion(start_time_s=0.0).demand(np.array([made["time_s"][i] + h / 2]))
    assert middle == pytest.approx(demand.position_rad[0], abs=1e-7)


def test_the_torque_beside_setpoints_has_the_strokes_impulse_and_holds_the_load(
    strokes: tuple[Stroke, Stroke],
) -> None:
    there, back = strokes
    motion = there.motion(back, start_time_s=0.05, dwell_s=0.03)
    time = motion.time(1000.0)
    torque = cycle_torque(there, back, motion, time)
    at_rest = {0.02: there.hold_start_nm, 0.165: there.hold_end_nm, 0.305: there.hold_start_nm}
    for instant, held in at_rest.items():
        assert torque[round(instant * 1000)] == pytest.approx(held, abs=1e-6)
    assert there.hold_start_nm == pytest.approx(-20 * np.sin(1.0), abs=0.05)
    inside = (time > 0.05) & (time <= 0.1501)
    impulse = np.trapezoid(there.torque_nm, there.time_s)
    assert float(np.sum(torque[inside])) * 1e-3 == pytest.approx(impulse, abs=0.05)


def test_a_mean_over_a_straight_torque_is_its_middle(strokes: tuple[Stroke, Stroke]) -> None:
    there = strokes[0]
    edges = there.time_s[40:42]
    assert mean_torque(there, edges)[0] == pytest.approx(np.mean(there.torque_nm[40:42]))


def test_chebyshev_coefficients_give_the_motion_again(folder: Path, strokes: tuple[Stroke, Stroke]) -> None:
    document = json.loads((folder / "motion.json").read_text())
    share = np.polynomial.chebyshev.chebval(np.linspace(-1, 1, strokes[0].share.size), document["chebyshev"])
    np.testing.assert_allclose(share, strokes[0].share, atol=3e-3)
