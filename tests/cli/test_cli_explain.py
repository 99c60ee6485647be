"""`schwung explain`: what it writes and tells. The search is replaced by a hand-made answer."""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from probability_samples import answer

from schwung.api import explaining
from schwung.api.reports import explanation_note
from schwung.cli import main
from schwung.drivetrain import load_machine, paper_machine, write_machine
from schwung.errors import InputError
from schwung.explain.publishing.values import Proof, Published
from schwung.session import Run, SessionWriter

TIME = np.arange(400) / 1000


@pytest.fixture
def places(tmp_path: Path) -> Path:
    """A folder with a session and a belief."""
    write_machine(paper_machine(), tmp_path / "belief.toml")
    with SessionWriter(tmp_path / "session.h5", source="test") as writer:
        for number in range(2):
            writer.append(
                Run(
                    role="reference", repeat=number, sample_rate_hz=1000.0, time_s=TIME, position_rad=np.sin(TIME),
                    speed_rad_s=np.cos(TIME), torque_nm=TIME,
                )
            )  # fmt: skip
    return tmp_path


def _run(
    capsys: pytest.CaptureFixture[str],
    monkeypatch: pytest.MonkeyPatch,
    places: Path,
    result: object,
    *more: str,
) -> tuple[int, str, str]:
    def stand_in(_session: object, _machine: object, *, progress: object = None) -> object:
        assert callable(progress)
        progress("Weighing [causes]", 0.5)
        if isinstance(result, BaseException):
            raise result
        return result

    monkeypatch.setattr(explaining, "publish", stand_in)
    monkeypatch.setenv("COLUMNS", "200")  # a narrower table breaks between a number and its unit
    arguments = ["explain", str(places / "session.h5"), "-m", str(places / "belief.toml"), *more]
    with pytest.raises(SystemExit) as ended:
        main(arguments)
    out, err = capsys.readouterr()
    return int(ended.value.code or 0), out, err


def test_it_tells_names_curves_and_proof_and_writes_all_three(
    places: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    out = places / "result"
    code, text, _ = _run(capsys, monkeypatch, places, answer(), "--out", str(out))
    assert code == 0
    said = " ".join(text.split())
    for words in ("a constant offset (98 %, at −0.01 … 0.02 rad, while moving forward)",
                  "over speed without a name", "2.00 N·m", "backlash", "20 %", "sign ω",
                  "6 σ", "1.01 σ", "the <first> note"):  # fmt: skip
        assert words in said
    document = json.loads((out / "explanation.json").read_text())
    assert document["names"][0]["parameters"]["torque_nm"]["ci95"] == [1.9, 2.1]
    assert [term.name for term in load_machine(out / "machine.toml").physics] == ["torque_offset", "residual"]
    page = (out / "explanation.html").read_text()
    assert page.count("<svg") == 7  # bars, before and after, map, term, curve, mismatch, remainder
    assert "&lt;first&gt;" in page
    assert "a constant offset (98 %, at −0.01 … 0.02 rad, while moving forward)" in explanation_note(out)[0]


def test_json_is_the_document_alone(
    places: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    code, out, err = _run(capsys, monkeypatch, places, answer(), "--out", str(places / "result"), "--json")
    assert code == 0
    assert json.loads(out) == json.loads((places / "result" / "explanation.json").read_text())
    assert "Names" in err


def test_an_answer_of_nothing_and_without_proof_is_told(
    places: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    nothing = replace(
        answer(), names=(), curves=(), runners_up=(), overlays=(), proof=None, machine=paper_machine()
    )
    code, out, _ = _run(capsys, monkeypatch, places, nothing, "--out", str(places / "result"))
    assert code == 0
    assert "leaves out nothing that this session tells from noise" in " ".join(out.split())
    assert (places / "result" / "explanation.html").exists()


@pytest.mark.parametrize(
    ("error", "code"), [(InputError("session", "is odd", "Mend it."), 2), (KeyboardInterrupt(), 130)]
)
def test_what_goes_wrong_leaves_nothing_behind(
    places: Path,
    capsys: pytest.CaptureFixture[str],
    monkeypatch: pytest.MonkeyPatch,
    error: BaseException,
    code: int,
) -> None:
    ended, _, err = _run(capsys, monkeypatch, places, error, "--out", str(places / "result"))
    assert ended == code
    assert "Traceback" not in err
    assert not (places / "result").exists()


def test_an_fmu_needs_its_map(places: Path, capsys: pytest.CaptureFixture[str]) -> None:
    with pytest.raises(SystemExit) as ended:
        main(["explain", str(places / "session.h5"), "--belief", "x.fmu"])
    assert ended.value.code == 2
    assert "without a map" in capsys.readouterr().err


def test_it_may_write_beside_the_session_but_not_over_a_belief(
    places: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    def run(*more: str) -> tuple[int, str]:
        code, _, err = _run(capsys, monkeypatch, places, answer(), "--out", str(places), *more)
        return code, err

    assert run()[0] == 0
    assert run()[0] == 0  # its own files may be replaced
    code, err = run("-m", str(places / "machine.toml"))
    assert code == 2
    assert "would be lost" in err
    (places / "explanation.json").unlink()  # now nobody knows whose machine file it is
    assert run()[0] == 2


def test_a_folder_that_cannot_be_written_is_told_before_the_search(
    places: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    (places / "file").write_text("")
    in_vain = AssertionError("searched in vain")
    code, _, err = _run(capsys, monkeypatch, places, in_vain, "--out", str(places / "file" / "result"))
    assert code == 2
    assert "is a file" in err


def test_help_has_examples(capsys: pytest.CaptureFixture[str]) -> None:
    with pytest.raises(SystemExit):
        main(["explain", "--help"])
    out = capsys.readouterr().out
    assert "schwung explain session.h5 -m machine.toml" in out
    assert "--machine" in out


def test_a_report_knows_an_explanation_beside_its_session_and_nothing_else(
    places: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    assert explanation_note(places) == ()
    _run(capsys, monkeypatch, places, answer(), "--out", str(places / "explanation"))
    (note,) = explanation_note(places)
    assert "explained" in note
    assert "explanation.html" in note
    (places / "explanation" / "explanation.json").write_text('{"format": "other", "verdict": 3}')
    assert explanation_note(places) == ()


def test_a_plan_that_cannot_be_written_is_refused_before_the_work(
    places: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    arguments = ["explain", str(places / "session.h5"), "-m", str(places / "belief.toml"), "--next"]
    with pytest.raises(SystemExit) as ended:
        main([*arguments, str(places / "nowhere" / "next.json"), "--out", str(places / "out")])
    assert ended.value.code == 2
    assert "its folder is not there" in " ".join(capsys.readouterr().err.split())
    assert not (places / "out").exists()


def test_what_kept_runs_refute_is_unexplained() -> None:
    refuted = replace(answer(), proof=Proof((3,), -0.06, 7.26, 7.27))
    assert refuted.headline.startswith("unexplained: the belief misses 7.26 σ of the noise on run 3,")
    assert "unexplained" not in answer().headline


def test_the_verdict_is_by_what_the_file_takes_of_runs_kept_aside() -> None:
    found, nothing = answer(), replace(answer(), names=(), curves=())

    def verdict(of: Published, before: float, after: float) -> str:
        return replace(of, proof=Proof((3,), 0.1, before, after)).verdict

    assert verdict(found, 8.0, 1.0) == "explained"
    assert verdict(found, 8.0, 3.0) == "partly_explained"
    assert verdict(found, 8.0, 7.0) == "unexplained"
    assert verdict(found, 1.12, 1.1) == "partly_explained"  # what is missed is little beside the noise
    assert verdict(nothing, 1.01, 1.01) == "consistent"
    assert verdict(nothing, 1.34, 1.34) == "unexplained"  # a sloshing payload that no law took
    assert verdict(nothing, 8.0, 8.0) == "unexplained"
    silent = replace(nothing, proof=Proof((3,), 0.0, 8.0, 8.0)).headline
    assert (
        silent
        == "unexplained: the belief misses 8 σ of the noise on run 3, and nothing was found that takes it"
    )
