"""Sessions as MDF4 and Parquet: nothing is lost on the way there and back; signals of other programs come in."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from schwung.errors import InputError
from schwung.motion import Excitation, Motion
from schwung.session import Run, Session
from schwung.session.imports import import_recordings, make_recipe, read_table
from schwung.session.interchange import read_any, write_any

asammdf = pytest.importorskip("asammdf")
arrow = pytest.importorskip("pyarrow")
parquet = pytest.importorskip("pyarrow.parquet")


def session() -> Session:
    """Two runs of unlike length, one of them without a demand; names and extras that are not ASCII."""
    rng = np.random.default_rng(3)

    def run(size: int, excited: bool) -> Run:
        return Run(
            role="excited" if excited else "reference",
            repeat=int(excited),
            sample_rate_hz=997.3,
            time_s=0.25 + np.arange(size) / 997.3,
            position_rad=rng.normal(size=size),
            speed_rad_s=rng.normal(size=size) * 1e-9,
            torque_nm=rng.normal(size=size) * 1e6,
            position_demand_rad=None if excited else rng.normal(size=size),
            torque_added_nm=rng.normal(size=size) if excited else None,
            motion=Motion(kind="poly5", distance_rad=1 / 3, duration_s=0.7),
            excitation=Excitation(frequency_hz=50.1, amplitude_nm=2.0, hold_s=1e-3) if excited else None,
            extra={
                "note": "Prüfstand → 1",
                "traced": np.arange(5, dtype=np.float32),
                "times": {"a": [1, 2.5]},
            },
        )

    return Session(
        runs=(run(40, False), run(33, True)),
        created="2024-02-28T09:30:00+01:00",
        source="Achse Ü",
        axis="linear",
        drive={"identity": {"serial": 7}, "units": {"position_rad": 0.1 + 0.2}},
        partial_reasons=("lost samples",),
        extra={"operator": "Ä"},
    )


@pytest.mark.parametrize("suffix", ["mf4", "parquet", "h5"])
def test_there_and_back_nothing_is_lost(tmp_path: Path, suffix: str) -> None:
    first = session()
    write_any(first, tmp_path / f"s.{suffix}")
    again = read_any(tmp_path / f"s.{suffix}")
    assert (again.created, again.source, again.axis, again.drive) == (
        first.created, first.source, first.axis, first.drive,
    )  # fmt: skip
    if suffix != "h5":  # HDF5 keeps these in groups of their own, which are written while recording
        assert (again.partial_reasons, again.extra) == (first.partial_reasons, first.extra)
    for run, same in zip(first.runs, again.runs, strict=True):
        assert (run.role, run.repeat, run.sample_rate_hz) == (same.role, same.repeat, same.sample_rate_hz)
        assert (run.motion, run.excitation) == (same.motion, same.excitation)
        assert run.datasets().keys() == same.datasets().keys()
        for name, values in run.datasets().items():
            np.testing.assert_array_equal(values, same.datasets()[name])
        assert run.extra.keys() == same.extra.keys()
        np.testing.assert_array_equal(run.extra["traced"], same.extra["traced"])
        assert same.extra["traced"].dtype == np.float32
        assert (run.extra["note"], run.extra["times"]) == (same.extra["note"], same.extra["times"])


def test_other_tools_see_names_and_units(tmp_path: Path) -> None:
    write_any(session(), tmp_path / "s.mf4")
    with asammdf.MDF(tmp_path / "s.mf4") as file:
        assert file.get("position", group=0).unit == "m"
        assert file.get("torque", group=1).unit == "N"
        assert [group.channel_group.acq_name for group in file.groups] == [
            "run 0000 reference 0",
            "run 0001 excited 1",
        ]
        assert file.start_time.isoformat() == "2024-02-28T08:30:00+00:00"
    write_any(session(), tmp_path / "s.parquet")
    table = parquet.read_table(tmp_path / "s.parquet")
    assert table.schema.field("speed").metadata[b"unit"] == b"m/s"
    assert table.column("run").to_pylist() == [0] * 40 + [1] * 33


def test_a_session_of_ours_is_no_recording_of_others(tmp_path: Path) -> None:
    for suffix in ("mf4", "parquet"):
        write_any(session(), tmp_path / f"s.{suffix}")
        with pytest.raises(InputError, match="schwung convert"):
            read_table(tmp_path / f"s.{suffix}")


def measured(path: Path) -> None:
    """As a measuring system logs: position in deg at 1 kHz, torque at 250 Hz from a start of its own; a state."""
    fast, slow = np.arange(3000) / 1000 + 5.0, np.arange(740) / 250 + 5.013
    with asammdf.MDF(version="4.11") as file:
        swing = 90 * np.sin(2 * np.pi * fast)
        file.append(
            [
                asammdf.Signal(swing.astype(np.float32), fast, name="ActPos", unit="deg"),
                asammdf.Signal(np.gradient(swing, 1e-3) / 6, fast, name="ActVel", unit="rpm"),
                asammdf.Signal(np.array([b"run"] * fast.size), fast, name="State", encoding="utf-8"),
            ]
        )
        torque = -0.3 * (np.pi / 2) * (2 * np.pi) ** 2 * np.sin(2 * np.pi * slow)
        file.append([asammdf.Signal(torque * 1e3, slow, name="Torque", unit="mNm")])
        file.save(path, overwrite=True)


def test_several_rates_in_one_mdf_are_brought_together_as_said(tmp_path: Path) -> None:
    measured(tmp_path / "scope.mf4")
    options = {"position": "ActPos", "speed": "ActVel", "torque": "Torque", "split": "none"}
    with pytest.raises(InputError, match=r"torque: is not sampled together with position.*--resample"):
        import_recordings([tmp_path / "scope.mf4"], make_recipe(options))
    found = import_recordings([tmp_path / "scope.mf4"], make_recipe(options | {"resample": True}))
    run = found.session.runs[0]
    assert run.sample_rate_hz == 250
    assert any("cubic interpolation" in note for note in found.notes)
    acceleration = np.gradient(run.speed_rad_s, 1 / 250)[20:-20]
    inertia = np.dot(run.torque_nm[20:-20], acceleration) / np.dot(acceleration, acceleration)
    assert inertia == pytest.approx(0.3, rel=2e-3)


def test_samples_that_the_mdf_calls_invalid_are_named(tmp_path: Path) -> None:
    time = np.arange(100) / 100
    invalid = np.zeros(100, dtype=bool)
    invalid[42] = True
    with asammdf.MDF(version="4.11") as file:
        file.append(
            [
                asammdf.Signal(time.copy(), time, name="p", unit="rad", invalidation_bits=invalid),
                asammdf.Signal(time.copy(), time, name="t", unit="Nm"),
            ]
        )
        file.save(tmp_path / "x.mf4")
    with pytest.raises(InputError, match=r"x\.mf4: p, sample 42"):
        import_recordings([tmp_path / "x.mf4"], make_recipe({"position": "p", "torque": "t"}))


def test_a_parquet_table_with_dates_comes_in(tmp_path: Path) -> None:
    stamps = np.datetime64("2024-05-01T08:00:00", "us") + (np.arange(400) * 2000).astype("timedelta64[us]")
    angle = np.sin(np.arange(400) / 50)
    table = arrow.table({"time": stamps, "angle": angle, "torque": angle * 2, "state": ["on"] * 400})
    parquet.write_table(table, tmp_path / "x.parquet")
    recipe = make_recipe({"position": "angle", "torque": "torque", "split": "none"})
    run = import_recordings([tmp_path / "x.parquet"], recipe).session.runs[0]
    assert run.sample_rate_hz == 500
    np.testing.assert_array_equal(run.position_rad, angle)


@pytest.mark.parametrize(
    ("name", "content", "told"),
    [
        ("x.mf4", b"MDF     4.10    " + b"\0" * 20, "is no MDF that could be read"),
        ("x.parquet", b"PAR1 and nothing behind it", "is no Parquet that could be read"),
        ("x.zip", b"PK", "its ending says no format"),
    ],
)
def test_damaged_files_are_named(tmp_path: Path, name: str, content: bytes, told: str) -> None:
    (tmp_path / name).write_bytes(content)
    with pytest.raises(InputError, match=told):
        read_any(tmp_path / name)


def test_a_session_that_was_cut_down_is_refused(tmp_path: Path) -> None:
    write_any(session(), tmp_path / "s.parquet")
    table = parquet.read_table(tmp_path / "s.parquet")
    parquet.write_table(table.slice(0, 40), tmp_path / "cut.parquet")
    with pytest.raises(InputError, match="describes 2 runs and holds 1"):
        read_any(tmp_path / "cut.parquet")
    parquet.write_table(table.drop_columns(["torque"]), tmp_path / "less.parquet")
    with pytest.raises(InputError, match=r"run 0000/torque: is missing"):
        read_any(tmp_path / "less.parquet")


def test_what_exists_is_kept(tmp_path: Path) -> None:
    (tmp_path / "s.mf4").write_text("mine")
    with pytest.raises(InputError, match="exists already"):
        write_any(session(), tmp_path / "s.mf4")
    assert (tmp_path / "s.mf4").read_text() == "mine"
