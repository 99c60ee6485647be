"""Recordings as strangers keep them: dates for stamps, rows twice or empty, 100 Hz that are none, gzip, UTF-16."""

from __future__ import annotations

import gzip
from collections.abc import Sequence
from datetime import datetime, timedelta
from pathlib import Path

import numpy as np
import pytest

from schwung.errors import InputError
from schwung.motion import Array, Motion
from schwung.session.imports import import_recordings, make_recipe, read_table
from schwung.session.imports.stamps import read_stamps

MOTION = Motion(kind="poly5", distance_rad=1.2, duration_s=1.2, start_time_s=0.6, dwell_s=0.6)


def position_at(time: Array) -> Array:
    return MOTION.demand(np.mod(np.maximum(time, 0.0), MOTION.total_s)).position_rad


def uneven(
    path: Path, lost: Sequence[int] = (), empty: Sequence[int] = (), twice: Sequence[int] = ()
) -> Array:
    """Six strokes at 100 Hz, stamped by a PC: 1.2 ms rms of jitter. The stamps that are there, (n,)."""
    time = (
        np.arange(round(6 * MOTION.total_s * 100)) / 100 + np.random.default_rng(5).normal(size=2520) * 1.2e-3
    )
    rows = ["t,pos,torque"]
    for k, stamp in enumerate(time):
        if k in lost:
            continue
        position = "" if k in empty else f"{position_at(np.array([stamp]))[0]:.7f}"
        rows += [f"{stamp:.7f},{position},{np.sin(2 * np.pi * stamp / MOTION.total_s):.6f}"] * (
            2 if k in twice else 1
        )
    path.write_text("\n".join(rows) + "\n", encoding="utf-8")
    return time


def recipe(**more: object) -> dict[str, object]:
    return {"time": "t", "position": "pos", "torque": "torque", **more}


def test_uneven_stamps_are_resampled_as_said_and_the_jitter_is_told(tmp_path: Path) -> None:
    uneven(tmp_path / "x.csv")
    with pytest.raises(InputError, match=r"time: is not uniform: .* samples rms.*--resample"):
        import_recordings([tmp_path / "x.csv"], make_recipe(recipe()))
    found = import_recordings([tmp_path / "x.csv"], make_recipe(recipe(resample=True)))
    assert len(found.session.runs) == 6
    assert [run.repeat for run in found.session.runs] == list(range(6))
    for run in found.session.runs:
        truth = position_at(run.extra["source_start_s"] + run.time_s)
        # cubic through stamps 10 ms apart: fourth difference of the path times 3/128
        np.testing.assert_allclose(run.position_rad, truth, atol=2e-4)
    assert any("rms" in note for note in found.notes)
    assert any("resampled to 100 Hz by cubic interpolation" in note for note in found.notes)


def test_rows_twice_and_empty_cells_count_as_lost(tmp_path: Path) -> None:
    path = tmp_path / "x.csv"
    uneven(path, empty=(150, 500), twice=(40, 700), lost=range(300, 312))
    with pytest.raises(InputError, match=r"x\.csv: pos, line 153: is empty"):
        import_recordings([path], make_recipe(recipe()))
    found = import_recordings([path], make_recipe(recipe(resample=True)))
    assert any(note.startswith("2 rows with an empty cell") for note in found.notes)
    assert any(note.startswith("2 rows with the stamp of the row before") for note in found.notes)
    assert any("in 2 pieces" in note for note in found.notes)  # 130 ms are missing: cut, not bridged
    for run in found.session.runs:
        np.testing.assert_allclose(
            run.position_rad, position_at(run.extra["source_start_s"] + run.time_s), atol=2e-3
        )


def test_a_stamp_that_stands_still_names_the_remedy(tmp_path: Path) -> None:
    uneven(tmp_path / "x.csv", twice=(40,))
    with pytest.raises(InputError, match=r"stands still at sample 41.*--resample"):
        import_recordings([tmp_path / "x.csv"], make_recipe(recipe()))


def test_a_clock_that_was_set_back_is_named(tmp_path: Path) -> None:
    path = tmp_path / "x.csv"
    uneven(path)
    lines = path.read_text().splitlines()
    path.write_text("\n".join([*lines[:200], *lines[190:]]) + "\n")
    with pytest.raises(InputError, match="runs backwards at sample 199"):
        import_recordings([path], make_recipe(recipe(resample=True)))


def test_a_column_that_is_mostly_empty_is_named(tmp_path: Path) -> None:
    path = tmp_path / "x.csv"
    uneven(path, empty=range(0, 2500, 1))
    with pytest.raises(InputError, match="position: is empty in 2500 of 2520 rows"):
        import_recordings([path], make_recipe(recipe(resample=True)))


FORMS = {
    "iso": "%Y-%m-%d %H:%M:%S.%f",
    "iso T Z": "%Y-%m-%dT%H:%M:%S.%fZ",
    "european": "%d.%m.%Y %H:%M:%S.%f",
    "american": "%m/%d/%Y %H:%M:%S.%f",
    "time of day": "%H:%M:%S.%f",
}


@pytest.mark.parametrize("form", FORMS.values(), ids=FORMS.keys())
def test_stamps_of_the_wall_clock_are_read_over_midnight(tmp_path: Path, form: str) -> None:
    begin = datetime(2024, 2, 28, 23, 59, 58)
    stamps = [(begin + timedelta(milliseconds=4 * k)).strftime(form) for k in range(1500)]
    angle = np.sin(np.arange(1500) / 100)
    rows = [f"{stamp};{value:.6f};{value:.4f}" for stamp, value in zip(stamps, angle, strict=True)]
    (tmp_path / "x.csv").write_text("time;pos;torque\n" + "\n".join(rows) + "\n")
    found = import_recordings([tmp_path / "x.csv"], make_recipe(recipe(time=None, split="none")))
    assert found.session.runs[0].sample_rate_hz == 250
    assert len(found.session.runs[0]) == 1500


@pytest.mark.parametrize("cells", [["on", "off"], ["2024-13-01 00:00:00", ""], ["08:00:00", "later"], []])
def test_what_is_no_stamp_is_none(cells: list[str]) -> None:
    assert read_stamps(cells) is None


@pytest.mark.parametrize("encoding", ["utf-16", "utf-16-le", "utf-16-be", "utf-8-sig", "cp1252"])
def test_any_encoding_gzipped_or_not(tmp_path: Path, encoding: str) -> None:
    rows = [f"{k / 100:.2f};{np.sin(k / 9):.5f};{np.cos(k / 9):.5f}".replace(".", ",") for k in range(200)]
    data = ("Zeit [s];Lage [°];Strom\n" + "\n".join(rows) + "\n").encode(encoding)
    (tmp_path / "x.csv").write_bytes(data)
    (tmp_path / "x.csv.gz").write_bytes(gzip.compress(data))
    for name in ("x.csv", "x.csv.gz"):
        table = read_table(tmp_path / name)
        assert [column.name for column in table.columns] == ["Zeit [s]", "Lage [°]", "Strom"]
        assert table.columns[1].values[9] == pytest.approx(np.sin(1), abs=1e-5)


def test_a_damaged_gzip_is_one_sentence(tmp_path: Path) -> None:
    (tmp_path / "x.csv.gz").write_bytes(gzip.compress(b"a,b\n" + b"1,2\n" * 1000)[:30])
    with pytest.raises(InputError, match="is a damaged gzip file"):
        read_table(tmp_path / "x.csv.gz")
