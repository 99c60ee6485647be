"""Manners of the command line: only JSON on stdout, nothing left behind, nobody is left to guess."""

import io
import json
import math
import os
import signal
from collections.abc import Iterator
from pathlib import Path

import h5py
import numpy as np
import pytest
import typer
from cli_running import RIGID_MACHINE, invoke

from schwung.api.folders import planned_folder
from schwung.cli.console import Terminal, describe_table, json_text
from schwung.cli.flow import finish
from schwung.cli.options import export_choice, measured
from schwung.drivetrain import InertiaTable
from schwung.errors import InputError, InterruptedByUser
from schwung_sim.bench import Bench


@pytest.fixture(autouse=True)
def _elsewhere(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    (tmp_path / "machine.toml").write_text(RIGID_MACHINE)


@pytest.fixture
def channel(request: pytest.FixtureRequest) -> Iterator[str]:
    name = f"manners-{request.node.name}"
    with Bench("two-mass", channel=name, node_id=1):
        yield name


def _commission(channel: str, *more: str) -> list[str]:
    bus = ["-i", "stepped", "-c", channel, "-b", "1000000"]
    return ["commission", "-m", "machine.toml", "--distance", "180deg", "--duration", "250ms", *bus, *more]


@pytest.mark.posix
@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM, signal.SIGHUP])
def test_whoever_asks_to_stop_twice_is_told_what_there_is_to_tell(
    number: int, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    """A terminal that closed ended the process by its second signal, after the drive was off and before a word."""
    told, say = "stopped; 1 of 60 motions are in session.h5", typer.secho

    def at_work(**_: object) -> None:
        try:
            os.kill(os.getpid(), number)
        except KeyboardInterrupt:
            raise InterruptedByUser("you", told) from None

    def while_it_is_said(*words: object, **how: object) -> None:
        os.kill(os.getpid(), number)
        say(*words, **how)

    monkeypatch.setattr("schwung.cli.app", at_work)
    monkeypatch.setattr(typer, "secho", while_it_is_said)
    code, _, err = invoke(capsys, "commission")
    assert code == InterruptedByUser.exit_code
    assert told in err


@pytest.mark.parametrize("again", [KeyboardInterrupt, typer.Abort])
def test_an_interrupt_on_the_way_out_hides_nothing_of_the_first(
    again: type[BaseException], monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    """The framework makes an end without a word of what comes while it passes the first one on."""

    def at_work(**_: object) -> None:
        try:
            raise InterruptedByUser("interrupted", "3 of 60 motions are in session.h5")
        except InterruptedByUser:
            raise again from None

    monkeypatch.setattr("schwung.cli.app", at_work)
    code, _, err = invoke(capsys, "demo")
    assert code == InterruptedByUser.exit_code
    assert "3 of 60 motions are in session.h5" in err


@pytest.mark.parametrize(
    ("what", "text", "value"),
    [
        ("angle", "180deg", math.pi), ("angle", "-90 °", -math.pi / 2), ("angle", "0.5REV", math.pi),
        ("angle", ".5", 0.5), ("time", "250ms", 0.25), ("time", "1e-3", 1e-3), ("speed", "60rpm", 2 * math.pi),
        ("torque", "20 N·m", 20.0), ("frequency", "1kHz", 1000.0),
    ],
)  # fmt: skip
def test_a_quantity_is_read_with_its_unit(what: str, text: str, value: float) -> None:
    assert measured(what, signed=True)(text) == pytest.approx(value, rel=1e-12)


@pytest.mark.parametrize(
    ("what", "text"),
    [
        ("time", "250rpm"), ("time", "5deg"), ("angle", "5ms"), ("frequency", "50rad"), ("torque", "5Hz"),
        ("time", "0"), ("torque", "-3"), ("frequency", "nan"), ("time", "1e999"), ("time", "1.2.3"), ("time", ""),
    ],
)  # fmt: skip
def test_a_quantity_of_another_kind_or_without_sense_is_refused(what: str, text: str) -> None:
    with pytest.raises(typer.BadParameter):
        measured(what)(text)


def test_an_angle_of_an_export_may_be_in_degrees() -> None:
    assert export_choice("at=90deg").position_rad == pytest.approx(math.pi / 2)
    with pytest.raises(InputError, match="unknown"):
        export_choice("at 90deg")


@pytest.mark.parametrize(
    "arguments",
    [
        ["commission", "--distance", "1"],
        ["demo", "--duration", "5deg"],
        ["demo", "--no-such-option"],
        ["estimate", "none.h5", "-m", "machine.toml"],
        ["bench", "--tcp", "here"],
        ["no-such-command"],
    ],
)
def test_with_json_a_mistake_is_json_alone_on_stdout(
    capsys: pytest.CaptureFixture[str], arguments: list[str]
) -> None:
    code, out, err = invoke(capsys, *arguments, "--json")
    document = json.loads(out)
    assert code == document["exit_code"] == 2
    assert document["error"] in err


def test_no_arguments_show_the_help(capsys: pytest.CaptureFixture[str]) -> None:
    code, out, _ = invoke(capsys)
    assert code == 0
    assert "commission" in out


def test_where_nobody_answers_nothing_moves_and_nothing_is_left_behind(
    capsys: pytest.CaptureFixture[str], channel: str, monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    monkeypatch.setattr("sys.stdin", io.StringIO(""))
    code, out, _ = invoke(capsys, *_commission(channel, "--json"))
    assert code == 3
    assert "--yes" in json.loads(out)["error"]
    assert [path.name for path in tmp_path.iterdir()] == ["machine.toml"]


def test_a_no_is_a_no_and_leaves_nothing_behind(
    capsys: pytest.CaptureFixture[str], channel: str, monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    monkeypatch.setattr("sys.stdin", io.StringIO("maybe\n"))
    code, _, err = invoke(capsys, *_commission(channel))
    assert code == 3
    assert "you said no" in err
    assert [path.name for path in tmp_path.iterdir()] == ["machine.toml"]


def test_a_refusal_tells_machines_every_check(
    capsys: pytest.CaptureFixture[str], channel: str, tmp_path: Path
) -> None:
    code, out, _ = invoke(capsys, *_commission(channel, "--max-torque", "10", "--yes", "--json"))
    document = json.loads(out)
    assert code == document["exit_code"] == 3
    assert {check["name"]: check["severity"] for check in document["preflight"]}["torque"] == "stop"
    assert [path.name for path in tmp_path.iterdir()] == ["machine.toml"]


def test_a_dry_run_tells_machines_the_plan(capsys: pytest.CaptureFixture[str], channel: str) -> None:
    code, out, _ = invoke(capsys, *_commission(channel, "--dry-run", "--json"))
    assert code == 0
    plan = json.loads(out)["plan"]
    assert plan["motion"]["distance_rad"] == pytest.approx(math.pi)
    assert plan["limits"]["torque_max_nm"] > 0
    assert (plan["mode"], plan["sampling"], plan["injecting"]) == ("csp", "sync", "setpoints")


def test_the_way_can_be_chosen_and_a_wrong_word_is_answered_with_the_right_ones(
    capsys: pytest.CaptureFixture[str], channel: str
) -> None:
    way = ("--mode", "pp", "--sampling", "trace", "--trace-rate", "2kHz")
    code, out, _ = invoke(capsys, *_commission(channel, "--dry-run", "--json", *way))
    assert code == 0
    plan = json.loads(out)["plan"]
    assert (plan["mode"], plan["sampling"], plan["injecting"]) == ("pp", "trace", "generator")
    assert plan["trace_rate_hz"] == 2000.0
    assert any("no steps" in reason for reason in plan["reasons"])
    for option in ("--mode", "--sampling", "--injection"):
        code, _, err = invoke(capsys, *_commission(channel, "--dry-run", option, "quickly"))
        assert code == 2
        assert f'{option}: is "quickly"' in err
        assert "auto" in err


def test_what_bode_found_is_planned_with_and_told(
    capsys: pytest.CaptureFixture[str], channel: str, tmp_path: Path
) -> None:
    found = {
        "format": "schwung-bode", "version": 1,
        "parameters": {"stiffness_nm_rad": {"value": 24000.0, "std": 10.0}},
        "proposal": {"frequency_hz": 62.5, "amplitude_nm": 30.0},
    }  # fmt: skip
    (tmp_path / "bode.json").write_text(json.dumps(found))
    code, out, err = invoke(capsys, *_commission(channel, "--dry-run", "--json", "--bode", str(tmp_path)))
    assert code == 0
    plan = json.loads(out)["plan"]
    assert plan["excitation"]["frequency_hz"] == 62.5
    assert plan["excitation"]["amplitude_nm"] == 30.0
    assert [reason for reason in plan["reasons"] if "bode" in reason] == plan["reasons"][:2]
    assert "bode's proposal" in err


@pytest.mark.parametrize(
    "error", [KeyboardInterrupt(), ImportError("initialization failed")], ids=["plain", "swallowed"]
)
def test_an_interrupt_is_told(
    capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch, error: BaseException
) -> None:
    def interrupted(*_: object) -> None:
        raise error from KeyboardInterrupt()  # as a library does that was loading just then

    monkeypatch.setattr("schwung.drivetrain.load_machine", interrupted)
    code, out, err = invoke(capsys, "estimate", "none.h5", "-m", "machine.toml", "--json")
    assert code == json.loads(out)["exit_code"] == 130
    assert "interrupted" in err


def test_a_folder_in_the_way_is_known_before_anything_starts(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    with pytest.raises(InputError, match="is a file"):
        planned_folder(tmp_path / "machine.toml" / "deeper")
    assert planned_folder(tmp_path / "new" / "deeper") == tmp_path / "new" / "deeper"
    assert not (tmp_path / "new").exists()
    monkeypatch.setattr(os, "access", lambda *_: False)
    with pytest.raises(InputError, match="no permission"):
        planned_folder(tmp_path / "new")


def test_a_demo_that_cannot_start_leaves_no_folder(
    capsys: pytest.CaptureFixture[str], tmp_path: Path
) -> None:
    code, _, err = invoke(capsys, "demo", "--plant", "nope", "--out", "d")
    assert code == 2
    assert "nope" in err
    assert not (tmp_path / "d").exists()


def test_a_session_without_excited_run_is_named_by_its_file(
    capsys: pytest.CaptureFixture[str], tmp_path: Path
) -> None:
    with h5py.File(tmp_path / "plain.h5", "w") as file:
        file.attrs.update(format="schwung-session", version=1, created="2026-01-01T00:00:00", source="test")
        run = file.create_group("run/0000")
        run.attrs.update(role="reference", repeat=0, sample_rate_hz=1000.0)
        for name, unit in {"time": "s", "position": "rad", "speed": "rad/s", "torque": "N·m"}.items():
            values = np.arange(500) / 1000 if name == "time" else np.zeros(500)
            run.create_dataset(name, data=values).attrs["unit"] = unit
    code, _, err = invoke(capsys, "estimate", "plain.h5", "-m", "machine.toml")
    assert code == 2
    assert "plain.h5" in err


def test_the_bench_lists_its_choices_for_machines(capsys: pytest.CaptureFixture[str]) -> None:
    code, out, _ = invoke(capsys, "bench", "--list", "--json")
    assert code == 0
    listing = json.loads(out)
    assert "torque_nm" in listing["conceal"]["coulomb_friction"]["keys"]
    assert "heartbeat-stop" in listing["faults"]


def test_the_bench_announces_itself_to_machines(capsys: pytest.CaptureFixture[str]) -> None:
    code, out, _ = invoke(capsys, "bench", "--tcp", "127.0.0.1:0", "--seconds", "0.1", "--json")
    assert code == 0
    assert json.loads(out)["bus"]["port"] > 0


def test_json_is_strict() -> None:
    assert json.loads(json_text({"a": [1.0, math.nan, {"b": math.inf}]})) == {"a": [1.0, None, {"b": None}]}


def test_a_table_in_degrees_is_noticed() -> None:
    angles = np.linspace(0.0, 180.0, 5)
    assert "degrees" in describe_table(InertiaTable(angles, np.full(5, 0.1)))
    assert "degrees" not in describe_table(InertiaTable(np.radians(angles), np.full(5, 0.1)))
    assert "(0 … 180°)" in describe_table(InertiaTable(np.radians(angles) - 1e-4, np.full(5, 0.1)))
    assert "kg " in describe_table(InertiaTable(angles, np.full(5, 0.1)), "linear")


def test_an_export_that_was_wished_but_not_made_is_no_success(capsys: pytest.CaptureFixture[str]) -> None:
    finish(Terminal(), {"export": {"parameters": 3}})
    with pytest.raises(SystemExit) as ended:
        finish(Terminal(), {"export": {"refused": "an unusable table"}})
    assert ended.value.code == 3


def test_a_table_in_a_narrow_terminal_breaks_no_word(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setenv("COLUMNS", "80")
    sentence = "A stiffness that differs along the way\nstiffness_over_angle"
    numbers = "order: 2.96 per turn (2.93 … 2.99)\nphase: 1.64 rad (1.57 … 1.71)"
    Terminal().table(
        "Names",
        ("physics", "probability", "parameters (95 %)", "where", "machine.toml"),
        [(sentence, "> 99 %", numbers, "wherever the axis was\nbetween the shafts", "yes")],
    )
    shown = capsys.readouterr().out
    assert max(map(len, shown.splitlines())) <= 80
    for word in ("stiffness_over_angle", "machine.toml", "probability", "wherever"):
        assert word in shown
