"""Real recordings come in as published: identified parameters, cycles, units, and what they cannot say."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from real_recordings import RealRecordings, emps_machine, hsm150_machine, pendulum_machine
from scipy.signal import butter, decimate, sosfiltfilt

from schwung.drivetrain import load_machine, write_machine
from schwung.errors import InputError
from schwung.explain.plausibility import examine
from schwung.motion import Array
from schwung.session import Session, read_session
from schwung.session.guess import Proposal, propose
from schwung.session.imports import import_recordings, make_recipe, read_table, repeats, write_session

#: M (kg), Fv (N·s/m), Fc (N), offset (N): Janot, Gautier, Brunot 2019, IDIM-LS with their standard deviations.
PUBLISHED = np.array([95.1089, 203.5034, 20.3935, -3.1648])
PUBLISHED_STD = np.array([0.1085, 1.1460, 0.1012, 0.0444])


def identified(session: Session) -> tuple[Array, float]:
    """IDIM-LS over a whole record: band-pass differentiation of position, parallel decimation; with rms residual."""
    position = np.concatenate([run.position_rad for run in session.runs])
    force = np.concatenate([run.torque_nm for run in session.runs])
    rate = session.runs[0].sample_rate_hz
    smooth = sosfiltfilt(butter(4, 60 / (rate / 2), output="sos"), position)
    speed = np.gradient(smooth, 1 / rate)
    columns = [np.gradient(speed, 1 / rate), speed, np.sign(speed), np.ones_like(speed)]
    # the measured force and the model are filtered alike and thinned out
    matrix = np.column_stack([decimate(column, 25, ftype="fir") for column in columns])[4:-4]
    measured = decimate(force, 25, ftype="fir")[4:-4]
    found, *_ = np.linalg.lstsq(matrix, measured, rcond=None)
    return found, float(np.sqrt(np.mean((measured - matrix @ found) ** 2)))


def test_emps_gives_the_published_parameters(recordings: RealRecordings) -> None:
    found, residual = identified(recordings.emps)
    # the filters are not those of the publication: three of its standard deviations, and 1 % beside them
    assert np.all(np.abs(found - PUBLISHED) < 3 * PUBLISHED_STD + 0.01 * np.abs(PUBLISHED))
    assert residual == pytest.approx(2.2, abs=0.4)  # N


def test_emps_is_cut_into_the_cycles_of_its_reference(recordings: RealRecordings) -> None:
    session = recordings.emps
    assert session.axis == "linear"
    assert [len(run) for run in session.runs] == [6240, 6240, 6240, 6121]
    assert repeats(session) == ((0, 1, 2, 3),)
    assert max(run.position_rad.max() for run in session.runs) == pytest.approx(0.246, abs=1e-3)
    assert all("not measured" in run.extra["speed_origin"] for run in session.runs)
    demand = session.runs[0].position_demand_rad
    assert demand is not None
    np.testing.assert_allclose(session.runs[1].position_demand_rad, demand, atol=1e-12)


def test_emps_is_cut_into_strokes_where_it_reverses(recordings: RealRecordings) -> None:
    said = {"axis": "linear", "time": "t", "position": "qm", "torque": "vir", "torque_scale": "gtau"}
    path = recordings.folder / "emps" / "DATA_EMPS.mat"
    strokes = import_recordings([path], make_recipe({**said, "split": "reverse"})).session
    assert repeats(strokes) == ((0, 2, 4, 6), (1, 3, 5, 7))  # there and back


def test_cycles_with_pulses_are_no_repeats_of_those_without(recordings: RealRecordings) -> None:
    files = [recordings.folder / "emps" / name for name in ("DATA_EMPS.mat", "DATA_EMPS_PULSES.mat")]
    recipe = make_recipe(
        {"axis": "linear", "time": "t", "position": "qm", "torque": "vir", "torque_scale": "gtau"}
    )
    session = import_recordings(files, recipe).session
    assert len(session.runs) == 8
    assert repeats(session)[0] == (0, 1, 2, 3)
    assert all(run.extra["same_path"] == 0 for run in session.runs[4:])
    assert identified(recordings.emps_pulses)[0][0] == pytest.approx(PUBLISHED[0], rel=0.02)


def test_emps_is_a_machine_that_the_file_can_express(recordings: RealRecordings, tmp_path: Path) -> None:
    write_machine(emps_machine(), tmp_path / "machine.toml")
    assert load_machine(tmp_path / "machine.toml") == emps_machine()
    write_session(recordings.emps, tmp_path / "emps.h5")
    assert read_session(tmp_path / "emps.h5").axis == "linear"
    assert examine(recordings.emps, emps_machine()).doubts == ()


@pytest.mark.parametrize(
    ("name", "samples", "rate"), [("ddp", 3000, 500), ("dircol", 1169, 333), ("sysid", 1170, 300)]
)
def test_the_pendulum_swings_up_from_rest(
    recordings: RealRecordings, name: str, samples: int, rate: float
) -> None:
    path = recordings.folder / "dfki-pendulum" / f"{name}_measured.csv"
    options = {"position": "position", "speed": "velocity", "torque": "torque"}
    with pytest.raises(InputError, match="is not uniform"):  # stamps of a PC
        import_recordings([path], make_recipe(options))
    run = recordings.pendulum(name).runs[0]
    assert (len(run), run.sample_rate_hz) == (samples, rate)
    assert run.position_rad[0] == pytest.approx(0, abs=0.01)
    assert run.position_rad[-1] == pytest.approx(np.pi, abs=0.1)
    kinds = examine(recordings.pendulum(name), pendulum_machine()).kinds()
    assert "one_run" in kinds
    assert not {"speed_unit", "position_unit", "torque_unit", "torque_sign"} & set(kinds)


def test_hsm150_does_not_determine_its_inertia(recordings: RealRecordings) -> None:
    session = recordings.hsm150("neg_0.04_1", "neg_0.04_2", "pos_0.06_1", "pos_0.06_3")
    found = examine(session, hsm150_machine())
    assert "inertia_undetermined" in found.kinds()
    assert found.stops == ()
    steps = np.unique(np.round(np.diff(np.unique(session.runs[0].speed_rad_s)), 3))
    assert steps[steps > 0][0] == pytest.approx(0.628, abs=1e-3)  # one count per sample: 2π/10000 rad in 1 ms


def guessed(path: Path, **said: object) -> Proposal:
    found = propose(read_table(path), said)
    assert len(found) == 1
    return found[0]


def test_emps_is_guessed_but_for_the_units_that_nobody_says(recordings: RealRecordings) -> None:
    found = guessed(recordings.folder / "emps" / "DATA_EMPS.mat", axis="linear")
    assert (found.options["position"], found.options["position_demand"]) == ("qm", "qg")
    assert (found.options["time"], found.options["torque"]) == ("t", "vir")
    assert found.curves.inertia * 35.15 == pytest.approx(PUBLISHED[0], rel=0.03)  # gtau, which is no column
    assert "torque_scale" not in found.options


def test_the_units_of_hsm150_are_told_by_its_encoder(recordings: RealRecordings) -> None:
    found = guessed(recordings.folder / "hsm150" / "idf_neg_0.045_1.mat")
    position = {guess.what: guess for guess in found.guesses}["position"]
    assert (found.options["position"], found.options["speed"]) == ("data[:,2]", "data[:,3]")
    assert position.sure
    assert found.options["position_unit"] == "rad"
    assert "10000 counts a turn" in position.evidence  # 2500 lines, as the file's own description says


@pytest.mark.parametrize("name", ["ddp", "dircol", "sysid"])
def test_the_pendulum_is_guessed_by_its_noisy_speed(recordings: RealRecordings, name: str) -> None:
    found = guessed(recordings.folder / "dfki-pendulum" / f"{name}_measured.csv")
    assert (found.options["position"], found.options["speed"]) == ("position", "velocity")
    assert (found.options["position_unit"], found.options["speed_unit"]) == ("rad", "rad/s")
    assert found.options["resample"] is True
    assert "torque_scale" not in found.options
