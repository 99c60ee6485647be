"""An archive on Dask's workers: what is missing is done, what is done is kept, and no file ends it."""

from __future__ import annotations

import csv
import json
import os
import shutil
import subprocess
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from cli_running import RIGID_MACHINE, invoke
from distributed import Client, LocalCluster
from probability_samples import answer
from report_samples import session

import schwung.batch.cluster
import schwung.batch.run
from schwung.batch import Item, Results, Wish, items_of, run_batch
from schwung.batch.archive import key_of
from schwung.batch.cluster import outcomes, workers
from schwung.batch.picture import drift_figure, left_out_figure
from schwung.batch.summary import Row, rows_of
from schwung.batch.work import Outcome
from schwung.drivetrain import InertiaTable, paper_machine, simulate, write_machine
from schwung.errors import InputError
from schwung.motion import Excitation, Motion
from schwung.report.style import to_png
from schwung.session import Run, SessionWriter

DENOISED = Wish("estimate", "denoised")


def put_session(folder: Path, created: str, name: str = "session.h5") -> Path:
    """A session recorded at that date, with the machine file beside it."""
    folder.mkdir(parents=True, exist_ok=True)
    recorded = replace(session(), created=created)
    with SessionWriter(folder / name, source=recorded.source, created=created) as writer:
        for run in recorded.runs:
            writer.append(run)
    write_machine(paper_machine(), folder / "machine.toml")
    return folder / name


@pytest.fixture(scope="module")
def archive(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Two sessions of one machine, and beside them what is none, or has no machine."""
    folder = tmp_path_factory.mktemp("archive")
    put_session(folder / "older", "2024-01-02T00:00:00+00:00")
    put_session(folder / "newer", "2025-01-02T00:00:00+00:00")
    (folder / "newer" / "rubbish.h5").write_bytes(b"no HDF5 at all")
    (folder / "alone").mkdir()
    shutil.copy(folder / "older" / "session.h5", folder / "alone" / "session.h5")
    return folder


@pytest.fixture
def in_process(monkeypatch: pytest.MonkeyPatch) -> None:
    """Dask's own scheduler and worker, in this process: nothing is to be started."""

    @contextmanager
    def threads(*_: object) -> Iterator[Client]:
        with (
            LocalCluster(1, threads_per_worker=1, processes=False, dashboard_address=None) as cluster,
            Client(cluster, set_as_default=False) as client,
        ):
            yield client

    monkeypatch.setattr(schwung.batch.run, "workers", threads)


def test_patterns_name_sessions_once_and_no_verification(archive: Path, tmp_path: Path) -> None:
    (archive / "older" / "verification.h5").write_bytes(b"")
    items = items_of([str(archive), f"{archive}/*/session.h5"], None)
    assert len(items) == 4
    assert {item.machine and item.machine.name for item in items} == {"machine.toml", None}
    with pytest.raises(InputError, match="names no session file"):
        items_of([str(tmp_path / "*.h5")], None)


def test_a_key_is_of_contents_and_wish(archive: Path, tmp_path: Path) -> None:
    there = archive / "older"
    item = Item(there / "session.h5", there / "machine.toml")
    moved = Item(tmp_path / "other.h5", tmp_path / "machine.toml")
    shutil.copy(item.session, moved.session)
    for file in there.glob("machine*"):
        shutil.copy(file, tmp_path)
    assert key_of(moved, DENOISED) == key_of(item, DENOISED)
    assert key_of(item, Wish("explain")) != key_of(item, DENOISED)
    table = tmp_path / "machine_inertia.csv"
    table.write_text(table.read_text() + "\n")
    assert key_of(moved, DENOISED) != key_of(item, DENOISED)  # the tables of a machine belong to it


@pytest.mark.usefixtures("in_process")
def test_a_second_call_does_what_is_missing_and_no_file_ends_it(archive: Path, tmp_path: Path) -> None:
    items, results = items_of([str(archive)], None), Results(tmp_path)
    first = run_batch(items, DENOISED, results)
    assert [row.file.name for row in first.failures] == ["session.h5", "rubbish.h5"]
    assert "Give --machine" in first.failures[0].error
    assert "is not a readable HDF5 file" in first.failures[1].error
    good = [row for row in first.rows if not row.error]
    assert [row.created[:4] for row in good] == ["2024", "2025"]
    assert good[1].drift == pytest.approx(0.0)
    assert good[0].inertia_min_kgm2 == pytest.approx(0.055, rel=0.1)  # of the plant that was recorded
    assert good[0].deviation_kgm2 is not None
    files = sorted(tmp_path.glob("*.json"))
    assert len(files) == 2
    stamp, whole = files[1].stat().st_mtime_ns, files[0].read_text()
    files[0].write_text(whole[: len(whole) // 2])  # as somebody's copy that was cut short
    second = run_batch(items, DENOISED, results)
    assert second.found == 1
    assert files[1].stat().st_mtime_ns == stamp
    assert files[0].read_text() == whole
    assert run_batch(items, DENOISED, results, again=True).found == 0
    assert files[1].stat().st_mtime_ns > stamp


@pytest.mark.usefixtures("in_process")
def test_an_interrupt_keeps_what_is_done(archive: Path, tmp_path: Path) -> None:
    def after_the_first(text: str, _share: float) -> None:
        if text.startswith("Sessions, 1 "):
            raise KeyboardInterrupt

    items = items_of([f"{archive}/*er/session.h5"], None)
    stopped = run_batch(items, DENOISED, Results(tmp_path), progress=after_the_first)
    assert (len(stopped.rows), stopped.missing) == (1, 1)
    assert run_batch(items, DENOISED, Results(tmp_path)).found == 1


def test_a_lost_worker_is_told_and_a_deadly_session_given_up(archive: Path) -> None:
    told: list[str] = []
    item = Item(archive / "older" / "session.h5", archive / "older" / "machine.toml")
    with workers(None, 1, told.append) as client:
        assert client.submit(os.getpid).result() != os.getpid()
        client.submit(os._exit, 1, key="deadly").exception()
        (told_of,) = [outcome for _, _, outcome in outcomes(client, [(item, "another key")], DENOISED)]
    assert "was lost; what it was doing is done again" in told[0]
    assert "is not what it was" in str(told_of.error)  # and the worker that took its place has worked


class _Deadly:
    """A path that ends every process but this one that takes it out of its wrapping."""

    def __reduce__(self) -> tuple[object, tuple[str]]:
        here = f"__import__('os').getpid() == {os.getpid()}"
        return eval, (
            f"__import__('sys').modules[{__name__!r}]._Deadly() if {here} else __import__('os')._exit(1)",
        )


@pytest.mark.long
def test_short_sessions_share_a_task_and_a_deadly_one_dies_alone(
    archive: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    (item,) = items_of([str(archive / "older" / "session.h5")], None)
    work = [(item, key_of(item, DENOISED))] * 9
    deadly = Item(_Deadly(), item.machine)  # type: ignore[arg-type]
    work[4] = deadly, "deadly"
    monkeypatch.setattr(schwung.batch.cluster, "TASK_S", 60.0)  # on whatever computer
    handed_out: list[int] = []
    with workers(None, 1, lambda _sentence: None) as client:
        submit = client.submit

        def counted(function: Any, pairs: Any, *args: Any, **named: Any) -> Any:
            handed_out.append(len(pairs))
            return submit(function, pairs, *args, **named)

        monkeypatch.setattr(client, "submit", counted)
        found = list(outcomes(client, work, DENOISED))
    assert handed_out[:2] == [1, 1]  # nobody knows yet how long they take
    assert max(handed_out) > 1
    assert handed_out.count(1) >= 2 + max(handed_out)  # those of the deadly task again, one by one
    assert sorted(key for _, key, _ in found) == sorted(key for _, key in work)
    errors = {key: outcome.error for _, key, outcome in found}
    assert "two workers died of it" in str(errors.pop("deadly"))
    assert list(errors.values()) == [None]


@pytest.mark.usefixtures("in_process")
def test_the_command(archive: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    out = tmp_path / "out"
    code, printed, said = invoke(
        capsys, "batch", "estimate", str(archive), "--method", "denoised", "--out", str(out), "--json"
    )
    assert code == 1
    assert "2 of 4 sessions gave no result" in said
    document = json.loads(printed)
    assert document["exit_code"] == 1
    assert len(document["sessions"]) == 4
    rows = list(csv.DictReader((out / "summary.csv").open()))
    assert [bool(row["error"]) for row in rows] == [False, False, True, True]
    assert float(rows[0]["inertia_max_kgm2"]) == document["sessions"][0]["inertia_max_kgm2"]
    assert len(list(out.glob("*.png"))) == 1


@pytest.mark.long
@pytest.mark.usefixtures("in_process")
def test_explained(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """One motion of each kind, of which a weaker motor is told, although nothing is kept aside to prove it by."""
    true, out = paper_machine(), tmp_path / "out"
    chance, motion = np.random.default_rng(3), Motion(distance_rad=np.pi, duration_s=0.3)
    sine = Excitation(frequency_hz=50.0, amplitude_nm=46.6, ramp_s=0.04, end_s=motion.total_s)
    ticks = motion.time(8000.0)
    with SessionWriter(tmp_path / "session.h5", source="test") as writer:
        for excitation in (None, sine):
            moved = simulate(true, motion.demand(ticks), ticks, excitation and excitation.torque(ticks))
            position, speed, torque = (
                (values + size * chance.standard_normal(ticks.size))[::8]
                for values, size in (
                    (moved.position_rad, 2e-6), (moved.speed_rad_s, 0.02), (moved.torque_nm / 0.95, 0.1)
                )
            )  # fmt: skip
            writer.append(
                Run(
                    role="excited" if excitation else "reference", repeat=0, sample_rate_hz=1000.0,
                    time_s=ticks[::8], position_rad=position, speed_rad_s=speed, torque_nm=torque,
                    motion=motion, excitation=excitation,
                )
            )  # fmt: skip
    write_machine(true, tmp_path / "machine.toml")
    code, _, said = invoke(capsys, "batch", "explain", str(tmp_path / "session.h5"), "--out", str(out))
    row = next(csv.DictReader((out / "summary.csv").open()))
    assert (code, row["error"]) == (0, ""), said
    assert row["physics"] == "torque_constant"


def test_wishes_that_cannot_be_are_refused_before_anything(
    archive: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    machine = tmp_path / "m.toml"
    machine.write_text(RIGID_MACHINE + "\n[nonsense")
    for wrong, sentence in (
        (("-m", str(machine)), "is not TOML"),
        (("--method", "guess"), "guess"),
        (("--inversion", "guess"), "guess"),
        (("--scheduler", "tcp://127.0.0.1:9", "--jobs", "2"), "scheduler has its own"),
    ):
        out = tmp_path / "out"
        code, _, said = invoke(capsys, "batch", "estimate", str(archive), "--out", str(out), *wrong)
        assert code == 2
        assert sentence in said
        assert not out.exists()


def test_a_weighed_session_is_a_row_like_any_other(archive: Path, tmp_path: Path) -> None:
    item = Item(archive / "older" / "session.h5", archive / "older" / "machine.toml")
    (row,) = rows_of({item: Outcome("0", machine_name="Axis", document=answer().to_json())})
    assert (row.verdict, row.physics) == ("explained", "torque_offset, unnamed over speed")
    assert (row.rmse_before_nm, row.rmse_after_nm) == (2.1, 0.14)
    assert left_out_figure([row]).axes
    Results(tmp_path).keep("key", Outcome("0", document=answer().to_json()))
    assert Results(tmp_path).find("key") is not None  # a second call does not weigh it again
    bare = replace(answer(), proof=None).to_json()
    (unproven,) = rows_of({item: Outcome("0", document=bare)})
    assert unproven.rmse_after_nm is None


def test_pictures_can_be_drawn_of_any_row() -> None:
    angle = np.linspace(0.0, 3.0, 20)
    rows = [
        Row(Path("a.h5"), f"2024-0{month}-01", "linear", "m $1$", verdict, inertia_mean_kgm2=month / 10,
            curve=InertiaTable(angle, 0 * angle + month / 10, 0 * angle + 0.01))
        for month, verdict in ((1, "good"), (2, "doubtful"), (3, "unusable"))
    ]  # fmt: skip
    assert to_png(drift_figure(rows)).startswith(b"\x89PNG")
    explained = [
        replace(row, physics=physics)
        for row, physics in zip(rows, ("", "backlash, cogging", "cogging"), strict=True)
    ]
    assert to_png(left_out_figure(explained)).startswith(b"\x89PNG")
    assert to_png(left_out_figure(explained[:1])).startswith(b"\x89PNG")


def test_what_estimates_loads_no_pictures_and_no_bus() -> None:
    heavy = ("matplotlib", "can", "schwung.fieldbus")
    look = f"import sys, schwung.batch.work; print([name for name in {heavy} if name in sys.modules])"
    done = subprocess.run([sys.executable, "-c", look], capture_output=True, text=True, check=True)
    assert done.stdout.strip() == "[]"  # every worker would wait for them
