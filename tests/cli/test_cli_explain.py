"""`schwung explain`: what it writes and tells. The search itself is replaced by a hand-made answer."""

from __future__ import annotations

import importlib
import json
from collections.abc import Callable
from pathlib import Path
from types import ModuleType
from typing import Any

import numpy as np
import pytest

from schwung.api.reports import explanation_note
from schwung.cli import main
from schwung.drivetrain import load_machine, paper_machine, write_machine
from schwung.errors import InputError
from schwung.session import SessionWriter


@pytest.fixture
def samples(monkeypatch: pytest.MonkeyPatch) -> ModuleType:
    """The hand-made explanations that the report's tests share."""
    monkeypatch.syspath_prepend(str(Path(__file__).parents[1] / "report"))
    return importlib.import_module("explanation_samples")


@pytest.fixture
def places(tmp_path: Path, samples: ModuleType) -> Path:
    """A folder with a session and a belief."""
    write_machine(paper_machine(), tmp_path / "belief.toml")
    with SessionWriter(tmp_path / "session.h5", source="test") as writer:
        for run in samples.session().runs:
            writer.append(run)
    return tmp_path


Answer = Callable[[Any], None]


@pytest.fixture
def answer(monkeypatch: pytest.MonkeyPatch) -> Answer:
    """Let the search give this explanation, or raise this error, and report progress as it would."""

    def stand_in(result: Any) -> None:
        def explain(session: Any, machine: Any, *, progress: Any = None) -> Any:
            assert len(session.runs) == 6
            assert machine.coupling is not None
            for step in range(5):
                progress("Residual [of all runs]", step / 4)
            if isinstance(result, Exception):
                raise result
            return result

        importlib.import_module(
            "schwung.api.simulators"
        )  # else what is first imported now keeps the stand-in
        monkeypatch.setattr(importlib.import_module("schwung.explain.explain"), "explain", explain)

    return stand_in


def _run(capsys: pytest.CaptureFixture[str], places: Path, *more: str) -> tuple[int, str, str]:
    arguments = [
        "explain",
        str(places / "session.h5"),
        "-m",
        str(places / "belief.toml"),
        "--no-weigh",
        *more,
    ]
    with pytest.raises(SystemExit) as ended:
        main(arguments)
    out, err = capsys.readouterr()
    return int(ended.value.code or 0), out, err


def test_it_writes_document_machine_and_page(
    places: Path, samples: ModuleType, answer: Answer, capsys: pytest.CaptureFixture[str]
) -> None:
    answer(samples.explained())
    out = places / "result"
    code, text, _ = _run(capsys, places, "--out", str(out))
    assert code == 0
    assert sorted(path.name for path in out.iterdir()) == [
        "explanation.html", "explanation.json", "machine.toml", "machine_inertia.csv",
    ]  # fmt: skip
    document = json.loads((out / "explanation.json").read_text())
    assert (document["format"], document["version"]) == ("schwung-explanation", 2)
    assert document["verdict"] == "explained"
    assert document["names"][0]["parameters"]["torque_nm"]["value"] == 4.0
    learned = load_machine(out / "machine.toml")
    assert learned.physics[0].number("torque_nm") == 4.0
    angles = np.linspace(0, np.pi, 7)
    assert learned.load_inertia_at(angles) == pytest.approx(paper_machine().load_inertia_at(angles))
    page = (out / "explanation.html").read_text()
    assert "torque_nm = 4.0" in page  # the learned file itself
    for words in (
        "explained",
        "Dry friction",
        "coulomb_friction",
        "4.00 N·m",
        "noise floor",
        "belief + physics",
    ):
        assert words in text
    assert "the floor rests on <one> pair" in " ".join(text.split())


def test_json_is_the_document_and_nothing_else_is_on_stdout(
    places: Path, samples: ModuleType, answer: Answer, capsys: pytest.CaptureFixture[str]
) -> None:
    answer(samples.consistent())
    code, out, err = _run(capsys, places, "--out", str(places / "result"), "--json")
    assert code == 0
    assert json.loads(out) == json.loads((places / "result" / "explanation.json").read_text())
    assert json.loads(out)["names"] == []
    assert "consistent" in err


def test_it_may_write_beside_the_session_but_not_over_a_belief(
    places: Path, samples: ModuleType, answer: Answer, capsys: pytest.CaptureFixture[str]
) -> None:
    answer(samples.explained())
    code, *_ = _run(capsys, places, "--out", str(places))
    assert code == 0
    code, *_ = _run(capsys, places, "--out", str(places))  # its own files may be replaced
    assert code == 0
    code, _, err = _run(capsys, places, "--out", str(places), "-m", str(places / "machine.toml"))
    assert code == 2
    assert "would be lost" in err
    (places / "explanation.json").unlink()  # now nobody knows whose machine file it is
    code, _, err = _run(capsys, places, "--out", str(places))
    assert code == 2


def test_a_session_that_cannot_be_explained_is_named_and_leaves_nothing(
    places: Path, answer: Answer, capsys: pytest.CaptureFixture[str]
) -> None:
    answer(InputError("session", "has one run only", "Record repeats."))
    code, _, err = _run(capsys, places, "--out", str(places / "result"))
    assert code == 2
    assert "session.h5: has one run only. Record repeats." in err
    assert not (places / "result").exists()


def test_the_report_points_to_an_explanation_beside_the_session(
    places: Path, samples: ModuleType, answer: Answer, capsys: pytest.CaptureFixture[str]
) -> None:
    assert explanation_note(places) == ()
    answer(samples.explained(verdict="partly_explained"))
    _run(capsys, places, "--out", str(places / "explanation"))
    (note,) = explanation_note(places)
    assert "partly explained" in note
    assert "explanation.html" in note
    (places / "explanation" / "explanation.json").write_text('{"format": "other", "verdict": 3}')
    assert explanation_note(places) == ()


def test_help_has_examples(capsys: pytest.CaptureFixture[str]) -> None:
    with pytest.raises(SystemExit):
        main(["explain", "--help"])
    out = capsys.readouterr().out
    assert "schwung explain session.h5 -m machine.toml" in out
    assert "--machine" in out


def test_a_folder_that_cannot_be_written_is_told_before_the_search(
    places: Path, answer: Answer, capsys: pytest.CaptureFixture[str]
) -> None:
    answer(AssertionError("searched in vain"))
    (places / "file").write_text("")
    code, _, err = _run(capsys, places, "--out", str(places / "file" / "result"))
    assert code == 2
    assert "is a file" in err
