"""Files from elsewhere: what columns, units and times they hold, and one clear sentence for what is wrong."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import h5py
import numpy as np
import pytest
from scipy.io import savemat

from schwung.errors import InputError
from schwung.session import Session, read_session
from schwung.session.imports import import_recordings, make_recipe, read_recipe, read_table, write_session

TIME = np.arange(400) * 1e-3
ANGLE = 0.5 * (1 - np.cos(2 * np.pi * 2.5 * TIME))
TORQUE = np.cos(2 * np.pi * 2.5 * TIME)


def brought(path: Path | list[Path], **options: Any) -> Session:
    files = path if isinstance(path, list) else [path]
    return import_recordings(files, make_recipe({"position": "q", "torque": "u"} | options)).session


def written(path: Path, header: str, separator: str = ",", comma: bool = False, columns: Any = None) -> Path:
    columns = (TIME, ANGLE, TORQUE) if columns is None else columns
    rows = [separator.join(f"{value:.9g}" for value in row) for row in zip(*columns, strict=True)]
    text = "\n".join(rows)
    path.write_text(header + (text.replace(".", ",") if comma else text) + "\n", encoding="utf-8")
    return path


@pytest.mark.parametrize(
    ("header", "separator", "comma"),
    [
        ("t,q,u\n", ",", False),
        ("# t,q,u\n", ",", False),
        ("t;q;u\n", ";", True),
        ("t\tq\tu\n", "\t", True),
        ("t q u\n", " ", False),
        ("Recorded by a drive\nserial;12\n\nt;q;u\n", ";", False),
        ("t;q;u\n[s];[rad];[N·m]\n", ";", True),
        ('"t";"q";"u"\n', ";", False),
    ],
)
def test_any_usual_csv_is_read(tmp_path: Path, header: str, separator: str, comma: bool) -> None:
    run = brought(written(tmp_path / "a.csv", header, separator, comma)).runs[0]
    assert run.sample_rate_hz == 1000.0
    np.testing.assert_allclose(run.position_rad, ANGLE, atol=1e-8)
    np.testing.assert_allclose(run.torque_nm, TORQUE, atol=1e-8)


def test_a_file_without_names_is_read_by_number(tmp_path: Path) -> None:
    path = written(tmp_path / "a.txt", "", " ")
    run = brought(path, time="0", position="1", torque="2").runs[0]
    np.testing.assert_allclose(run.position_rad, ANGLE, atol=1e-8)


@pytest.mark.parametrize("encoding", ["utf-16", "cp1252", "utf-8-sig"])
def test_encodings_of_measuring_programs_are_read(tmp_path: Path, encoding: str) -> None:
    path = written(tmp_path / "a.csv", "t;q [°];u\n", ";")
    path.write_bytes(path.read_text(encoding="utf-8").encode(encoding))
    run = brought(path).runs[0]
    np.testing.assert_allclose(run.position_rad, np.deg2rad(ANGLE), atol=1e-8)


@pytest.mark.parametrize(
    ("options", "name", "factor"),
    [
        ({"position_unit": "deg"}, "position_rad", np.pi / 180),
        ({"position_unit": "counts=4096"}, "position_rad", 2 * np.pi / 4096),
        ({"position_unit": "mm"}, "position_rad", 1e-3),
        ({"position_unit": "rev", "position_scale": -1}, "position_rad", -2 * np.pi),
        ({"torque_unit": "mN·m"}, "torque_nm", 1e-3),
        ({"torque_unit": "%=2.4"}, "torque_nm", 0.024),
        ({"torque_unit": "A=0.0458"}, "torque_nm", 0.0458),
        ({"axis": "linear", "torque_unit": "kN"}, "torque_nm", 1e3),
    ],
)
def test_units_become_si(tmp_path: Path, options: dict[str, Any], name: str, factor: float) -> None:
    run = brought(written(tmp_path / "a.csv", "t,q,u\n"), **options).runs[0]
    reported = {"position_rad": ANGLE, "torque_nm": TORQUE}[name]
    np.testing.assert_allclose(getattr(run, name), factor * reported, atol=1e-8 * abs(factor))


def test_columns_of_text_are_passed_over(tmp_path: Path) -> None:
    rows = "\n".join(
        f"2024-01-01 12:00:00;{t:.3f};RUN;{q:.6f};{u:.6f}"
        for t, q, u in zip(TIME, ANGLE, TORQUE, strict=True)
    )
    path = tmp_path / "a.csv"
    path.write_text("date;t;state;q;u\n" + rows.replace(".", ","), encoding="utf-8")
    np.testing.assert_allclose(brought(path).runs[0].position_rad, ANGLE, atol=1e-6)
    with pytest.raises(InputError, match="state: holds no samples"):
        brought(path, torque="state")


def test_a_demand_in_another_turn_is_brought_to_the_position(tmp_path: Path) -> None:
    turning = 30 * TIME
    columns = (TIME, np.mod(turning - 0.01, 2 * np.pi), TORQUE, np.mod(turning + 0.01, 2 * np.pi))
    run = brought(written(tmp_path / "a.csv", "t,q,u,d\n", columns=columns), position_demand="d").runs[0]
    assert run.position_demand_rad is not None
    np.testing.assert_allclose(run.position_demand_rad - run.position_rad, 0.02, atol=1e-6)


def test_signals_may_be_rows_of_a_matrix(tmp_path: Path) -> None:
    savemat(tmp_path / "a.mat", {"data": np.vstack([TIME, ANGLE, TORQUE])})
    run = brought(tmp_path / "a.mat", time="data(1,:)", position="data[1,:]", torque="data[2,:]").runs[0]
    np.testing.assert_allclose(run.torque_nm, TORQUE)


def test_a_session_is_not_imported_again(tmp_path: Path) -> None:
    write_session(brought(written(tmp_path / "a.csv", "t,q,u\n")), tmp_path / "s.h5")
    with pytest.raises(InputError, match="is a schwung-session already"):
        brought(tmp_path / "s.h5")


def test_the_unit_of_position_tells_the_axis(tmp_path: Path) -> None:
    path = written(tmp_path / "a.csv", "t,q,u\n")
    assert brought(path, position_unit="mm").axis == "linear"
    assert brought(path).axis == "rotary"


def test_missing_speed_is_derived_without_lag_and_says_so(tmp_path: Path) -> None:
    path = written(tmp_path / "a.csv", "t,q,u\n")
    run = brought(path).runs[0]
    true = 0.5 * 2 * np.pi * 2.5 * np.sin(2 * np.pi * 2.5 * TIME)
    inner = slice(20, -20)
    assert np.max(np.abs(run.speed_rad_s - true)[inner]) < 1e-3 * true.max()
    assert "not measured" in run.extra["speed_origin"]
    assert "speed_origin" not in brought(path, speed="u").runs[0].extra


def test_wrapped_angles_are_unwrapped_and_said(tmp_path: Path) -> None:
    turning = 30 * TIME
    path = written(tmp_path / "a.csv", "t,q,u\n", columns=(TIME, np.mod(turning + 1, 2 * np.pi), TORQUE))
    imported = import_recordings([path], make_recipe({"position": "q", "torque": "u"}))
    np.testing.assert_allclose(imported.session.runs[0].position_rad, turning + 1, atol=1e-7)
    assert any("jumped by a whole turn 2 times" in note for note in imported.notes)
    kept = brought(path, unwrap=False).runs[0]
    assert kept.position_rad.max() <= 2 * np.pi


def scope_export(comma: bool = True, end: str = "EOF\n", full: bool = False, torque_ms: int = 1) -> str:
    """A TwinCAT Scope export: two groups with their own time columns; written after Beckhoff's documentation."""
    head = [
        ["Name", "Scope"], ["File", "C:\\scope.csv"],
        ["Starttime of export", "132959733843760000", "Montag, 2. Mai 2022", "15:56:24.376"],
        ["Endtime of export", "132959733853750000", "Montag, 2. Mai 2022", "15:56:25.375"], [], [],
        ["Name", "ActPos", "ActVelo", "Name", "ActTorque"],
        ["SymbolComment", "", "", "SymbolComment"],
        ["Data-Type", "REAL64", "REAL64", "Data-Type", "INT16"],
        ["SampleTime[ms]", "1", "1", "SampleTime[ms]", str(torque_ms)],
        ["SymbolName", "Axes.X.ActPos", "Axes.X.ActVelo", "SymbolName", "MAIN.ActTorque"],
        ["Offset", "0", "0", "Offset", "0"], ["Unit", "° (Angle)", "(None)", "Unit", "(None)"], [],
    ]  # fmt: skip
    rows = []
    for k, angle in enumerate(ANGLE):
        stamp = [
            str(132959733843760000 + 10_000 * k) if full else f"{k}",
            f"{angle:.6f}",
            f"{10 * angle:.6f}",
        ]
        slow = [stamp[0], f"{TORQUE[k]:.6f}"] if torque_ms == 1 else ["", ""]
        if torque_ms != 1 and k * torque_ms < 400:
            slow = [f"{k * torque_ms}", f"{TORQUE[k * torque_ms]:.6f}"]
        rows.append([*stamp, *slow])
    text = "\n".join("\t".join(row) for row in head) + "\n"
    body = "\n".join("\t".join(row) for row in rows) + "\n"
    return text + (body.replace(".", ",") if comma else body) + end


@pytest.mark.parametrize("form", [{}, {"comma": False, "end": ""}, {"full": True}])
def test_a_twincat_scope_export_is_understood(tmp_path: Path, form: dict[str, Any]) -> None:
    path = tmp_path / "scope.csv"
    path.write_text(scope_export(**form), encoding="utf-8")
    found = import_recordings(
        [path], make_recipe({"position": "Axes.X.ActPos", "speed": "ActVelo", "torque": "acttorque"})
    )
    run = found.session.runs[0]
    assert (run.sample_rate_hz, len(run)) == (1000.0, 400)
    np.testing.assert_allclose(run.position_rad, np.deg2rad(ANGLE), atol=1e-7)
    np.testing.assert_allclose(run.torque_nm, TORQUE, atol=1e-6)
    assert found.session.created == "2022-05-02T13:56:24.376+00:00"
    assert "position is taken in °, as the file says" in found.notes


@pytest.mark.parametrize("form", ["names only", "no times", "semicolons"])
def test_scope_exports_of_other_settings_are_understood(tmp_path: Path, form: str) -> None:
    rows = [[f"{1000 * t:.0f}", f"{q:.6f}", f"{u:.6f}"] for t, q, u in zip(TIME, ANGLE, TORQUE, strict=True)]
    head = [["Name", "Scope"], ["File", "C:\\scope.csv"], [], ["Name", "Pos", "Torque"]]
    separator = ","
    if form == "no times":
        head.append(["SampleTime[ms]", "1", "1"])
        rows = [row[1:] for row in rows]
    elif form == "semicolons":  # a time column per channel, and a separator at the end of each line
        separator = ";"
        head[-1] = ["Name", "Pos", "Name", "Torque", ""]
        rows = [[row[0], row[1], row[0], row[2], ""] for row in rows]
    path = tmp_path / "scope.csv"
    path.write_text("\n".join(separator.join(row) for row in [*head, [], *rows]) + "\n", encoding="utf-8")
    run = brought(path, position="Pos", torque="Torque").runs[0]
    assert run.sample_rate_hz == 1000.0
    np.testing.assert_allclose(run.torque_nm, TORQUE, atol=1e-6)


def test_channels_of_different_rates_need_resample(tmp_path: Path) -> None:
    path = tmp_path / "scope.csv"
    path.write_text(scope_export(torque_ms=4), encoding="utf-8")
    options = {"position": "ActPos", "torque": "ActTorque"}
    with pytest.raises(InputError, match=r"torque: is not sampled together with position.*Add --resample"):
        brought(path, **options)
    run = brought(path, **options, resample=True).runs[0]
    assert run.sample_rate_hz == 250.0
    inner = slice(10, -10)
    np.testing.assert_allclose(run.torque_nm[inner], TORQUE[::4][: len(run)][inner], atol=2e-3)
    np.testing.assert_allclose(run.position_rad[inner], np.deg2rad(ANGLE[::4][: len(run)][inner]), atol=2e-5)


def matrix_file(path: Path, version: str) -> Path:
    data = np.column_stack([TIME, 0 * TIME, ANGLE, TORQUE])
    if version == "5":
        savemat(path, {"data": data, "t": TIME, "gain": 35.15, "log": {"q": ANGLE, "u": TORQUE}})
        return path
    with h5py.File(path, "w", userblock_size=512) as file:  # MATLAB writes a text block before HDF5
        for name, values in {"data": data, "t": TIME[:, None], "log/q": ANGLE[:, None], "log/u": TORQUE[:, None],
                             "gain": np.array([[35.15]])}.items():  # fmt: skip
            file.create_dataset(name, data=values.T).attrs["MATLAB_class"] = np.bytes_("double")
    return path


@pytest.mark.parametrize("version", ["5", "7.3"])
def test_mat_files_of_both_kinds_are_read(tmp_path: Path, version: str) -> None:
    path = matrix_file(tmp_path / "a.mat", version)
    run = brought(path, time="t", position="data[:,2]", torque="data(:,4)", torque_scale="gain").runs[0]
    np.testing.assert_allclose(run.position_rad, ANGLE)
    np.testing.assert_allclose(run.torque_nm, 35.15 * TORQUE)
    nested = brought(path, time="t", position="log.q", torque="u").runs[0]
    np.testing.assert_allclose(nested.torque_nm, TORQUE)


@pytest.mark.parametrize(
    ("content", "options", "sentence"),
    [
        ("t,q,u\n0,1,2\n0.001,x,3\n0.002,1,3\n", {}, r"line 3, column 1: \"x\" is not a number"),
        ("t,q,u\n0,1,2\n0.001,,3\n0.002,1,3\n", {}, r"q, line 3: is empty"),
        ("t,q,u\n0,1,2\n", {"position": "w"}, r"--position w: there is no such column\. There are: t, q, u"),
        ("t,pos,u\n0,1,2\n", {"position": "poss"}, r"Did you mean pos\?"),
        ("t,q,q,u\n0,1,2,3\n", {}, r"--position q: is the name of several columns\. Give a number: 1, 2"),
        ("", {}, r"is empty"),
        ("nothing but words\n", {}, r"its last lines are not columns of numbers"),
        ("x,q,u\n" + "1,2,3\n" * 20, {}, r"has no time that could be found\. Name it with --time, or give --rate"),
        ("t,q,u\n0,1,2\n", {"torque_unit": "mm"}, r"--torque-unit: \"mm\" is no unit of torque"),
        ("t,q,u\n0,1,2\n", {"axis": "linear", "position_unit": "deg"}, r"belongs to a rotary axis\. Add --axis rotary"),
        ("t,q,u\n0,1,2\n", {"position_unit": "counts"}, r"\"counts\" needs a number above zero"),
        ("t,q,u\n0,1,2\n", {"torque_scale": "gain"}, r"is neither a number nor one in the file"),
        ("t,q,u\n0,1,2\n", {"split": "often"}, r"--split: is \"often\""),
        ("t,q,u\n0,1,2\n", {"role": "excited"}, r"role: is excited, but the sine is not known"),
        ("t,q,u\n0,1,2\n", {"time": "t", "rate": 1000}, r"rate: is given beside time"),
        ("t,q,u\n0,1,2\n1,1,2\n", {"time": "t"}, r"time of position: has 2 samples"),
    ],
)  # fmt: skip
def test_what_is_wrong_is_said_in_a_sentence(
    tmp_path: Path, content: str, options: dict[str, Any], sentence: str
) -> None:
    path = tmp_path / "a.csv"
    path.write_text(content, encoding="utf-8")
    with pytest.raises(InputError, match=sentence):
        brought(path, **options)


def test_a_damaged_mat_file_is_said(tmp_path: Path) -> None:
    path = tmp_path / "a.mat"
    path.write_bytes(b"MATLAB 5.0 MAT-file" + b"\1" * 200)
    with pytest.raises(InputError, match="is not a readable MAT file"):
        read_table(path)


def test_a_recipe_repeats_an_import(tmp_path: Path) -> None:
    written(tmp_path / "a.csv", "t,q,u\n")
    path = tmp_path / "recipe.toml"
    path.write_text(
        'files = ["a.csv"]\nposition = 1\ntorque = "u"\nposition_unit = "deg"\ntorque_scale = 2\n',
        encoding="utf-8",
    )
    recipe = make_recipe(read_recipe(path), str(path))
    run = import_recordings([Path(name) for name in recipe.files], recipe).session.runs[0]
    np.testing.assert_allclose(run.position_rad, np.deg2rad(ANGLE), atol=1e-8)
    np.testing.assert_allclose(run.torque_nm, 2 * TORQUE, atol=1e-8)


def test_an_unknown_key_of_a_recipe_is_named(tmp_path: Path) -> None:
    with pytest.raises(
        InputError, match=r"recipe\.toml: possition: is no key of a recipe\. Did you mean position\?"
    ):
        make_recipe({"possition": "q", "position": "q", "torque": "u"}, "recipe.toml")


def test_the_injected_sine_keeps_its_phase_in_the_run(tmp_path: Path) -> None:
    path = written(tmp_path / "a.csv", "t,q,u\n")
    sine = {"frequency_hz": 50.0, "amplitude_nm": 2.0, "phase_rad": 0.3}
    whole = brought(path, role="excited", excitation=sine, split="none").runs[0]
    pieces = brought(path, role="excited", excitation=sine, split="0.105s").runs
    assert whole.excitation is not None
    for run in pieces:
        assert run.excitation is not None
        start = run.extra["source_start_s"]
        np.testing.assert_allclose(
            run.excitation.torque(run.time_s), whole.excitation.torque(run.time_s + start), atol=1e-9
        )


def test_the_written_session_reads_back_whole(tmp_path: Path) -> None:
    session = brought(written(tmp_path / "a.csv", "t,q,u\n"))
    write_session(session, tmp_path / "s.h5")
    again = read_session(tmp_path / "s.h5")
    np.testing.assert_array_equal(again.runs[0].torque_nm, session.runs[0].torque_nm)
    assert again.runs[0].extra["same_motion"] == 0
    with pytest.raises(InputError, match="exists already"):
        write_session(session, tmp_path / "s.h5")
    with pytest.raises(InputError):
        write_session(session, tmp_path / "not there" / "s.h5")
    assert sorted(path.name for path in tmp_path.iterdir()) == ["a.csv", "s.h5"]
