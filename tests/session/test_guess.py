"""`--guess`: columns, units, signs and rate by what position, speed and torque must satisfy; and what it cannot."""

from __future__ import annotations

import gzip
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import pytest

from schwung.errors import InputError
from schwung.motion import Array, Motion
from schwung.session.guess import Proposal, propose
from schwung.session.imports import import_recordings, make_recipe, read_table

INERTIA = 0.02


@dataclass(frozen=True)
class Truth:
    """An axis that swings: (n,) each, SI."""

    time: Array
    position: Array
    speed: Array
    torque: Array


def swing(rate: float = 1000.0, strokes: int = 3, weight: float = 0.0) -> Truth:
    motion = Motion(kind="poly5", distance_rad=1.2, duration_s=0.4, start_time_s=0.3, dwell_s=0.3)
    demand = motion.demand(motion.time(rate)[:-1])
    position = np.tile(demand.position_rad, strokes)
    speed = np.tile(demand.speed_rad_s, strokes)
    acceleration = np.tile(demand.acceleration_rad_s2, strokes)
    noise = np.random.default_rng(1).normal(size=position.size)
    torque = INERTIA * acceleration + 0.05 * speed + 0.3 * np.tanh(speed / 0.05) + weight * np.sin(position)
    return Truth(np.arange(position.size) / rate, position, speed, torque + 0.02 * noise)


def written(path: Path, header: str, columns: list[Array], separator: str = ",", form: str = "%.7g") -> Path:
    rows = [separator.join(form % value for value in row) for row in zip(*columns, strict=True)]
    path.write_text("\n".join(([header] if header else []) + rows) + "\n", encoding="utf-8")
    return path


def proposal(path: Path, **said: object) -> Proposal:
    found = propose(read_table(path), said)
    assert len(found) == 1
    return found[0]


def inertia(path: Path, found: Proposal) -> float:
    """What the proposed import says about it: least squares on acceleration, speed, its sign, and a constant."""
    session = import_recordings([path], make_recipe(found.options)).session
    rate = session.runs[0].sample_rate_hz
    rows, torques = [], []
    for run in session.runs:
        speed = np.convolve(run.speed_rad_s, np.ones(9) / 9, "same")
        columns = [np.gradient(speed, 1 / rate), speed, np.tanh(speed / 0.05), np.ones_like(speed)]
        rows.append(np.column_stack(columns)[20:-20])
        torques.append(np.convolve(run.torque_nm, np.ones(9) / 9, "same")[20:-20])
    return float(np.linalg.lstsq(np.concatenate(rows), np.concatenate(torques), rcond=None)[0][0])


def test_columns_without_names_in_degrees_and_microseconds(tmp_path: Path) -> None:
    truth = swing()
    columns = [truth.time * 1e6, truth.torque, np.degrees(truth.speed), np.degrees(truth.position)]
    path = written(tmp_path / "x.txt", "", columns, " ", "%.5f")
    found = proposal(path)
    assert (found.options["time"], found.options["time_unit"]) == ("column 0", "us")
    assert (found.options["position"], found.options["position_unit"]) == ("column 3", "deg")
    assert (found.options["speed"], found.options["speed_unit"]) == ("column 2", "deg/s")
    assert found.options["torque"] == "column 1"
    assert any("rad with rad/s" in guess.alternatives for guess in found.guesses)
    assert any(question.startswith("torque") for question in found.questions)  # nothing says its unit
    assert inertia(path, found) == pytest.approx(INERTIA, rel=0.02)


def test_counts_by_their_ratio_to_rpm_and_both_signs_turned_at_once(tmp_path: Path) -> None:
    truth = swing()
    counts = np.rint(truth.position * 10000 / (2 * np.pi))
    demand = np.concatenate((counts[4:], counts[-1:].repeat(4)))
    rpm = -truth.speed * 60 / (2 * np.pi)
    text = written(tmp_path / "x.csv", "stamp;enc;soll;n;M",
                   [1714550400 + truth.time, counts, demand, rpm, -truth.torque], ";", "%.6f").read_text()  # fmt: skip
    path = tmp_path / "x.csv.gz"
    path.write_bytes(gzip.compress(text.encode("utf-16-le")))  # without its mark
    found = proposal(path)
    assert found.options["position"] == "enc"
    assert found.options["position_unit"] == "counts=10000"
    assert found.options["position_scale"] == "-1"  # one turn of the sign instead of two
    assert "speed_scale" not in found.options
    assert "torque_scale" not in found.options
    assert found.options["speed_unit"] == "rpm"
    assert found.options["position_demand"] == "soll"
    assert "leads enc by 4 ms" in {guess.what: guess.evidence for guess in found.guesses}["demanded position"]
    assert inertia(path, found) == pytest.approx(INERTIA, rel=0.02)


@pytest.mark.parametrize(("speed_sign", "torque_sign"), [(-1, 1), (1, -1)])
def test_one_turned_sign_is_turned_back(tmp_path: Path, speed_sign: int, torque_sign: int) -> None:
    truth = swing(weight=0.8)  # heavy enough that torque over acceleration alone falls
    columns = [truth.time, truth.position, speed_sign * truth.speed, torque_sign * truth.torque]
    found = proposal(written(tmp_path / "x.csv", "t,pos,vel,torque", columns))
    assert found.options.get("speed_scale") == ("-1" if speed_sign < 0 else None)
    assert found.options.get("torque_scale") == ("-1" if torque_sign < 0 else None)
    assert "position_scale" not in found.options


def test_the_header_is_believed_and_says_so(tmp_path: Path) -> None:
    truth = swing()
    columns = [
        truth.time * 1e3,
        np.degrees(truth.position),
        truth.speed * 60 / (2 * np.pi),
        truth.torque * 1e3,
    ]
    path = written(tmp_path / "x.csv", "Zeit [ms];Lage [°];Drehzahl [1/min];Moment [mNm]", columns, ";")
    path.write_text(path.read_text().replace(".", ","), encoding="utf-16")
    found = proposal(path)
    assert found.questions == ()
    assert inertia(path, found) == pytest.approx(INERTIA, rel=0.02)


def test_a_header_that_cannot_be_true_is_doubted(tmp_path: Path) -> None:
    """The speed is in rad/s, whatever the header says: the ratio to the position's slope shows it."""
    truth = swing()
    path = written(tmp_path / "x.csv", "t,Pos [rad],Vel [rpm],Trq [Nm]",
                   [truth.time, truth.position, truth.speed, truth.torque])  # fmt: skip
    position = {guess.what: guess for guess in proposal(path).guesses}["position"]
    assert not position.sure
    assert "as no usual units have it (rad, rpm)" in position.evidence


def test_each_joint_of_a_robot_gets_its_own_columns(tmp_path: Path) -> None:
    truth = swing()
    columns, header = [truth.time], ["time"]
    for joint, shift, scale in ((1, 0, 1.0), (2, 210, 0.7), (3, 470, -1.5)):
        header += [f"tau_{joint}", f"q_{joint}", f"qd_{joint}"]
        columns += [np.roll(each, shift) * scale for each in (truth.torque, truth.position, truth.speed)]
    path = written(tmp_path / "robot.csv", ",".join(header), columns)
    found = propose(read_table(path), {})
    assert [each.name for each in found] == ["q_1", "q_2", "q_3"]
    for joint, each in enumerate(found, start=1):
        assert (each.options["speed"], each.options["torque"]) == (f"qd_{joint}", f"tau_{joint}")
        assert "torque_scale" not in each.options


def test_without_names_the_joints_are_told_by_their_dynamics(tmp_path: Path) -> None:
    truth = swing(strokes=4)
    other = np.roll(truth.position, 333), np.roll(truth.speed, 333), np.roll(truth.torque, 333)
    columns = [truth.time, other[2], truth.position, truth.speed, other[1], other[0], truth.torque]
    found = propose(read_table(written(tmp_path / "x.csv", "t,a,b,c,d,e,f", columns)), {})
    told = [(each.options["position"], each.options["speed"], each.options["torque"]) for each in found]
    assert told == [("b", "c", "f"), ("e", "d", "a")]


def test_a_demand_that_does_not_lead_is_the_smoother_one(tmp_path: Path) -> None:
    truth = swing()
    noisy = truth.position + np.random.default_rng(2).normal(size=truth.position.size) * 1e-4
    path = written(
        tmp_path / "x.csv", "t,x,y,torque", [truth.time, truth.position, noisy, truth.torque], form="%.9g"
    )
    found = proposal(path)
    assert (found.options["position"], found.options["position_demand"]) == ("y", "x")
    assert "smoother" in {guess.what: guess.evidence for guess in found.guesses}["demanded position"]


def test_torque_and_current_in_proportion_are_one_signal(tmp_path: Path) -> None:
    truth = swing()
    columns = [truth.time, truth.position, truth.torque / 0.31, truth.torque]
    found = proposal(written(tmp_path / "x.csv", "t,q,current,torque", columns, form="%.16g"))
    torque = {guess.what: guess for guess in found.guesses}["torque"]
    assert "the same in another unit" in "; ".join(torque.alternatives)


def test_what_is_said_is_taken(tmp_path: Path) -> None:
    truth = swing()
    columns = [truth.time, np.degrees(truth.position), np.degrees(truth.speed), truth.torque]
    path = written(tmp_path / "x.csv", "t,a,b,c", columns)
    found = proposal(path, position="a", position_unit="deg", torque="c", torque_unit="Nm")
    assert found.questions == ()
    assert found.options["speed_unit"] == "deg/s"


def test_a_column_of_numbers_is_no_time(tmp_path: Path) -> None:
    truth = swing()
    columns = [np.arange(truth.time.size) * 1.0, truth.position, truth.speed, truth.torque]
    found = proposal(written(tmp_path / "x.csv", "sample,pos,vel,torque", columns))
    assert any("--rate" in question for question in found.questions)


@pytest.mark.parametrize(
    ("header", "told"), [("t,a,b", "no column that gathers the speed"), ("t,pos,torque", "too few samples")]
)
def test_what_cannot_be_guessed_is_said(tmp_path: Path, header: str, told: str) -> None:
    rng = np.random.default_rng(4)
    size = 30 if "few" in told else 800
    columns = [np.arange(size) / 500, rng.normal(size=size), rng.normal(size=size)]
    with pytest.raises(InputError, match=told):
        propose(read_table(written(tmp_path / "x.csv", header, columns)), {})


def comma(value: float) -> str:
    """As a German program writes it: 1.234,5."""
    return f"{value:,.7g}".translate(str.maketrans(",.", ".,"))


@pytest.mark.parametrize(
    ("header", "scales", "german"),
    [
        ("Zeit;Lage;Drehzahl;Drehmoment\ns;°;1/min;mNm", (1.0, 180 / np.pi, 30 / np.pi, 1e3), True),
        ("Zeit;Lage;Drehzahl;Drehmoment\nms;Grad;U/min;Nm", (1e3, 180 / np.pi, 30 / np.pi, 1.0), True),
        ("time_ms,pos_deg,vel_deg_s,torque_mNm", (1e3, 180 / np.pi, 180 / np.pi, 1e3), False),
        ("FileTime ticks,pos,vel [rpm],torque [Nm]", (1e7, 1.0, 30 / np.pi, 1.0), False),
    ],
)  # fmt: skip
def test_units_stand_in_a_second_line_at_the_end_of_a_name_or_are_ticks(
    tmp_path: Path, header: str, scales: tuple[float, ...], german: bool
) -> None:
    truth, path = swing(), tmp_path / "x.csv"
    columns = [truth.time + 1.0, truth.position, truth.speed, truth.torque]
    scaled = [scale * values for scale, values in zip(scales, columns, strict=True)]
    if german:
        rows = [";".join(comma(value) for value in row) for row in zip(*scaled, strict=True)]
        path.write_text("\n".join([header, *rows]) + "\n", encoding="cp1252")
    else:
        written(path, header, scaled, form="%.9g")
    assert inertia(path, proposal(path)) == pytest.approx(INERTIA, rel=0.05)


def test_a_head_over_several_columns_tells_axes_of_one_name_apart(tmp_path: Path) -> None:
    first, second = swing(), swing(weight=0.5)
    late = np.roll(second.position, 400), np.roll(second.speed, 400), np.roll(second.torque, 400)
    columns = [first.time, first.position, first.speed, first.torque, *late]
    head = ",Axis 1,,,Axis 2,,\nTime,Position,Speed,Torque,Position,Speed,Torque\ns,rad,rad/s,Nm,rad,rad/s,Nm"
    path = written(tmp_path / "x.csv", head, columns)
    found = propose(read_table(path), {})
    assert [each.name for each in found] == ["Axis 1 Position", "Axis 2 Position"]
    assert [each.options["torque"] for each in found] == ["Axis 1 Torque", "Axis 2 Torque"]
    written(path, head.split("\n")[1], columns)
    assert [each.name for each in propose(read_table(path), {})] == ["Position 1", "Position 2"]


def test_a_file_in_which_nothing_moves_is_one_sentence(tmp_path: Path) -> None:
    still = np.zeros(100)
    path = written(tmp_path / "x.csv", "t,q,u", [np.arange(100) / 1e3, still + 1.0, still])
    with pytest.raises(InputError, match="no column that ever changes"):
        propose(read_table(path), {})


def test_lost_rows_do_not_change_the_rate(tmp_path: Path) -> None:
    truth = swing()
    there = np.random.default_rng(3).random(truth.time.size) > 0.02
    columns = [values[there] for values in (truth.time, truth.position, truth.speed, truth.torque)]
    path = written(tmp_path / "x.csv", "t,q,dq,tau", columns)
    found = import_recordings([path], make_recipe(proposal(path).options)).session
    assert {run.sample_rate_hz for run in found.runs} == {1000.0}
