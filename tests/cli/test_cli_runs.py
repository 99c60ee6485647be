"""`schwung runs`: a service's records from the command line."""

from __future__ import annotations

import json
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from cli_running import invoke

from schwung.service.store import Store
from schwung.service.values import RunView


def document(scale: float, std: float | None = 0.001, start: float = 0.0) -> Mapping[str, Any]:
    angles = np.linspace(start, start + 3.0, 30)
    inertia = scale * (0.2 + 0.1 * np.sin(angles))
    return {"table": {"position_rad": angles.tolist(), "inertia_kgm2": inertia.tolist(),
                      "std_kgm2": None if std is None else [std] * 30}}  # fmt: skip


def estimated(store: Store, content: Mapping[str, Any]) -> RunView:
    run = store.add_run("estimate", {"kind": "estimate"}, "Ada", None, None)
    (store.run_folder(run.id) / "session.h5").write_bytes(b"recorded")
    session = store.add_session(run, {"excited": 1})
    store.add_estimate(run, session.id, "good", content)
    return store.end_run(run.id, "done", {"verdict": "good"})


@pytest.fixture
def kept(tmp_path: Path) -> tuple[Path, list[RunView]]:
    store = Store(tmp_path / "kept")
    curves = (document(1.0), document(1.1), document(1.0, None, 9.0))
    runs = [estimated(store, curve) for curve in curves]
    store.close()
    return tmp_path / "kept", runs


def test_runs_are_listed_and_shown_by_the_beginning_of_their_ids(
    kept: tuple[Path, list[RunView]], capsys: pytest.CaptureFixture[str]
) -> None:
    folder, runs = kept
    code, out, _ = invoke(capsys, "runs", "list", "--data", str(folder), "--json")
    assert code == 0
    assert {run["id"] for run in json.loads(out)["runs"]} == {run.id for run in runs}
    target = folder.parent / "one.zip"
    arguments = ("runs", "show", runs[0].id[:12], "--data", str(folder), "--archive", str(target), "--json")
    code, out, _ = invoke(capsys, *arguments)
    assert (code, json.loads(out)["files"][0]["name"]) == (0, "session.h5")
    assert target.stat().st_size > 0
    code, _, err = invoke(capsys, *arguments)
    assert (code, "is there already" in err) == (2, True)


def test_a_change_is_more_than_chance_or_it_is_not(
    kept: tuple[Path, list[RunView]], capsys: pytest.CaptureFixture[str]
) -> None:
    folder, runs = kept
    code, out, _ = invoke(
        capsys, "runs", "compare", *(run.id for run in runs), "--data", str(folder), "--json"
    )
    first, second, third = json.loads(out)["compared"]
    assert code == 0
    assert first["change"] is None
    assert second["change"] == pytest.approx(0.1, rel=1e-6)
    assert second["largest_kgm2"] == pytest.approx(0.03, rel=1e-2)
    assert second["at_rad"] == pytest.approx(np.pi / 2, abs=0.1)
    assert second["beyond"] == 1.0
    assert third["change"] is None  # no angle in common


def test_pruning_keeps_what_is_young_and_asks(
    kept: tuple[Path, list[RunView]], capsys: pytest.CaptureFixture[str]
) -> None:
    folder, runs = kept
    code, out, _ = invoke(capsys, "runs", "prune", "--data", str(folder), "--older-than", "1", "-y", "--json")
    assert (code, json.loads(out)["removed"]) == (0, [])
    code, out, _ = invoke(capsys, "runs", "prune", "--data", str(folder), "--older-than", "0", "-y", "--json")
    assert sorted(json.loads(out)["removed"]) == sorted(run.id for run in runs)
    assert list((folder / "runs").iterdir()) == []


@pytest.mark.parametrize("arguments", [("list",), ("show", "00"), ("compare", "00", "11"), ("prune",)])
def test_a_folder_without_a_store_is_told_and_not_made(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], arguments: tuple[str, ...]
) -> None:
    code, _, err = invoke(capsys, "runs", *arguments, "--data", str(tmp_path / "none"))
    assert code == 2
    assert "holds no store" in err
    assert not (tmp_path / "none").exists()


def test_what_names_no_run_is_told(
    kept: tuple[Path, list[RunView]], capsys: pytest.CaptureFixture[str]
) -> None:
    for text in ("zz", "", "%", "../x"):
        code, _, err = invoke(capsys, "runs", "show", text, "--data", str(kept[0]))
        assert (code, "no run begins so" in err) == (2, True), err
