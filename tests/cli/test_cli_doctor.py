"""`schwung doctor`: what it finds on a bench, and that it leaves no trace there."""

from __future__ import annotations

import json
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import can
import pytest
from cli_running import invoke

from schwung.clock import clock_of
from schwung.commissioning import doctor_canopen
from schwung.commissioning.doctor_canopen import LISTEN_S
from schwung.fieldbus.profile import load_canopen_profile
from schwung_sim.bench import Bench

EDS = load_canopen_profile("schwung-bench").eds_path


@pytest.fixture(autouse=True)
def _elsewhere(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """And in a hurry: half a second of listening before every look at a drive would be most of these tests."""
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr(doctor_canopen, "LISTEN_S", 0.05)


@pytest.fixture
def channel(request: pytest.FixtureRequest) -> str:
    return f"doctor-{request.node.name}"


@pytest.fixture
def bench(channel: str) -> Iterator[Bench]:
    with Bench("two-mass", channel=channel, node_id=3) as running:
        yield running


Ask = Callable[..., tuple[int, dict[str, dict[str, Any]]]]


@pytest.fixture
def ask(capsys: pytest.CaptureFixture[str], channel: str) -> Ask:
    """Run the doctor; its exit code, and its findings by name."""

    def run(*more: str, node: int = 3) -> tuple[int, dict[str, dict[str, Any]]]:
        code, out, _ = invoke(
            capsys,
            "doctor",
            "-i",
            "stepped",
            "-c",
            channel,
            "-b",
            "1000000",
            "-n",
            str(node),
            "--json",
            *more,
        )
        document = json.loads(out)
        if code in (0, 3):
            assert document["can_start"] == (code == 0)
        severities = [check["severity"] for check in document["checks"]]
        assert severities == sorted(severities, key=["stop", "warning", "note", "ok"].index)
        assert all(c["remedy"] for c in document["checks"] if c["severity"] in ("stop", "warning"))
        return code, {check["name"]: check for check in document["checks"]}

    return run


def test_a_healthy_drive_can_start(bench: Bench, ask: Ask) -> None:
    code, found = ask()
    assert code == 0
    assert {
        name: found[name]["severity"] for name in ("bus", "identity", "state", "units", "EDS", "set-up")
    } == dict.fromkeys(("bus", "identity", "state", "units", "EDS", "set-up"), "ok")
    assert "1000 kbit/s" in found["bit rate"]["text"]
    assert "43%" in found["sample rate"]["text"]
    assert "12.57 rad" in found["position limits"]["text"]


def test_nothing_is_written_and_nothing_commanded(
    bench: Bench, ask: Ask, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Every frame that goes out is an SDO upload: no download, no NMT, no SYNC, no PDO, no heartbeat."""
    sent: list[can.Message] = []
    opened = can.Bus

    def spied(*args: Any, **kwargs: Any) -> can.BusABC:
        bus = opened(*args, **kwargs)
        send = bus.send

        def spy(message: can.Message, timeout: float | None = None) -> None:
            sent.append(message)
            send(message, timeout)

        monkeypatch.setattr(bus, "send", spy)
        return bus

    monkeypatch.setattr("can.Bus", spied)
    before = dict(bench.servo.dictionary.values)
    assert ask("--eds", str(EDS))[0] == 0
    assert ask(node=9)[0] == 3
    assert len(sent) > 100
    for message in sent:
        specifier = message.data[0] >> 5  # CiA 301 7.2.4.3: 2 and 3 upload, 4 abort, 5 block upload
        assert 0x601 <= message.arbitration_id <= 0x67F, f"{message}"
        assert specifier in (2, 3, 4, 5), f"{message}"
    assert bench.servo.dictionary.values == before


def test_a_fault_an_open_limit_and_an_earlier_run_are_told(bench: Bench, ask: Ask, tmp_path: Path) -> None:
    od = bench.servo.dictionary
    for key in (0x607D << 8 | 1, 0x607D << 8 | 2, 0x6080 << 8):
        od.values[key] = 0
    earlier = tmp_path / "schwung-20260101-000000"
    earlier.mkdir()
    change = {
        "index": "0x6060",
        "subindex": 0,
        "type": "INTEGER8",
        "name": "",
        "old": 1,
        "new": 8,
        "when": "x",
    }
    backup = {"format": "schwung-backup", "version": 1, "drive": {}, "restored": None, "changes": [change]}
    (earlier / "setup.backup.json").write_text(json.dumps(backup))
    od.readers[0x6041 << 8] = lambda: 0x0008
    od.readers[0x603F << 8] = lambda: 0x8611
    code, found = ask()
    assert code == 3
    assert found["state"]["severity"] == "stop"
    assert "following error" in found["state"]["text"]
    assert "--min-position" in found["position limits"]["remedy"]
    assert "--max-speed" in found["speed limit"]["remedy"]
    assert f"schwung restore {earlier.name}/setup.backup.json" in found["earlier run"]["remedy"]


def test_supply_remote_and_inputs_are_told(bench: Bench, ask: Ask) -> None:
    od = bench.servo.dictionary
    od.readers[0x6041 << 8] = lambda: 0x0040  # switch on disabled, no voltage, not remote
    od.readers[0x60FD << 8] = lambda: 0b1001
    code, found = ask()
    assert code == 3
    assert "STO" in found["supply"]["remedy"]
    assert found["supply"]["severity"] == "stop"
    assert "bit 9" in found["remote"]["text"]
    assert found["remote"]["severity"] == "warning"  # some drives set it in the NMT state operational only
    if 0x60FD << 8 in od.entries:
        assert "negative limit switch" in found["limit switches"]["text"]
        assert found["interlock"]["severity"] == "stop"


def test_an_object_that_the_drive_will_not_show_is_told(channel: str, ask: Ask) -> None:
    with Bench("two-mass", channel=channel, node_id=3, faults="sdo-abort=0x6064", clock="wall") as bench:
        clock_of(bench.bus).wait(lambda: bool(bench.servo.sdo.aborts), 1.0)
        code, found = ask()
    assert code == 3
    assert found["position"]["severity"] == "stop"
    assert "refuses to show 0x6064:00" in found["EDS"]["text"]


def test_a_drive_that_stops_answering_is_a_finding_and_no_failure(channel: str, ask: Ask) -> None:
    with Bench("two-mass", channel=channel, node_id=3, faults="sdo-timeout=0x6502", clock="wall") as bench:
        clock_of(bench.bus).wait(lambda: bool(bench.servo.sdo.silent), 1.0)
        code, found = ask()
    assert code == 3
    assert "6502" in found["answers"]["text"]
    assert found["bus"]["severity"] == "ok"


def test_a_drive_that_is_switched_on_is_left_alone(bench: Bench, ask: Ask) -> None:
    bench.servo.dictionary.readers[0x6041 << 8] = lambda: 0x0637
    code, found = ask()
    assert code == 3
    assert "power stage is on" in found["state"]["text"]


def test_the_wrong_node_is_told_who_is_there(bench: Bench, ask: Ask) -> None:
    code, found = ask(node=9)
    assert code == 3
    assert "node 9 does not answer; this does: 3" in found["node"]["text"]
    assert "--node 3" in found["node"]["remedy"]


def test_an_empty_bus_is_told_what_to_look_at(ask: Ask) -> None:
    code, found = ask()
    assert code == 3
    assert "nothing is heard" in found["node"]["text"]
    assert "termination" in found["node"]["remedy"]


def test_another_master_is_noticed(
    bench: Bench, ask: Ask, channel: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(doctor_canopen, "LISTEN_S", LISTEN_S)
    other = can.Bus(interface="stepped", channel=channel)
    sync = can.Message(arbitration_id=0x080, is_extended_id=False)
    clock_of(other).every(0.02, lambda: other.send(sync))
    code, found = ask()
    other.shutdown()
    assert code == 3
    assert "SYNC" in found["other master"]["text"]


def test_a_slow_bus_is_told_its_highest_rate(bench: Bench, capsys: pytest.CaptureFixture[str]) -> None:
    arguments = ["doctor", "-i", "stepped", "-c", bench.channel, "-b", "125000", "-n", "3"]
    code, out, _ = invoke(capsys, *arguments, "--profile", "generic-cia402", "--json")
    found = {check["name"]: check for check in json.loads(out)["checks"]}
    assert code == 0
    assert found["sample rate"]["severity"] == "warning"
    assert "250 Hz" in found["sample rate"]["text"]
    code, out, _ = invoke(capsys, *arguments, "--json")  # this one can record by itself
    assert json.loads(out)["way"]["sampling"] == "trace"


def test_the_eds_of_another_firmware_is_noticed(bench: Bench, ask: Ask, tmp_path: Path) -> None:
    newer = tmp_path / "newer.eds"
    text = EDS.read_text().replace("RevisionNumber=0x00010000", "RevisionNumber=0x00020000")
    newer.write_text(f"{text}\n[3F00]\nParameterName=New thing\nDataType=0x0007\nAccessType=rw\n")
    bench.servo.dictionary.entries.pop(0x6067 << 8)
    code, found = ask("--eds", str(newer))
    assert code == 0
    assert "0x00020000" in found["firmware"]["text"]
    assert found["EDS file"]["severity"] == "note"  # 3F00 is not listed


def test_of_the_eds_of_another_manufacturer_that_alone_is_told(
    bench: Bench, capsys: pytest.CaptureFixture[str], channel: str
) -> None:
    foreign = load_canopen_profile("elmo-gold").eds_path
    _, out, _ = invoke(
        capsys, "doctor", "-i", "stepped", "-c", channel, "-n", "3", "--eds", str(foreign), "--json"
    )
    (told,) = (check for check in json.loads(out)["checks"] if check["name"] == "profile and EDS")
    assert "the EDS is of 0x0000009A" in told["text"]


def test_gains_that_the_machine_file_has_to_give_are_a_warning(channel: str, ask: Ask) -> None:
    with Bench("two-mass", channel=channel, node_id=3, profile="elmo-gold"):
        code, found = ask()
    assert code == 0
    assert found["control gains"]["severity"] == "warning"
    assert "[control]" in found["control gains"]["remedy"]


def test_what_the_eds_asks_not_to_read_is_not_read(bench: Bench, ask: Ask, tmp_path: Path) -> None:
    bench.servo.dictionary.entries.pop(0x2400 << 8 | 1)
    assert "2400:01" in ask("--eds", str(EDS))[1]["EDS"]["text"]
    shy = tmp_path / "shy.eds"
    shy.write_text(EDS.read_text().replace("[2400sub1]\n", "[2400sub1]\nObjFlags=0x2\n"))
    assert "2400:01" not in ask("--eds", str(shy))[1]["EDS"]["text"]


def test_a_profile_of_another_drive_is_refused_in_words(bench: Bench, ask: Ask) -> None:
    code, found = ask("--profile", "maxon-epos4")
    assert code == 3
    assert "vendor id" in found["identity"]["text"]


def test_people_see_what_is_wrong_and_with_verbose_what_is_well(
    bench: Bench, capsys: pytest.CaptureFixture[str]
) -> None:
    arguments = ["doctor", "-i", "stepped", "-c", bench.channel, "-n", "3"]
    code, out, _ = invoke(capsys, *arguments)
    assert code == 0
    assert "Commissioning can start" in out
    assert "--bitrate" in out
    assert "identity" not in out
    assert "identity" in invoke(capsys, *arguments, "--verbose")[1]


def test_wrong_options_are_a_mistake_and_no_finding(capsys: pytest.CaptureFixture[str]) -> None:
    assert invoke(capsys, "doctor", "-i", "nonsense", "-c", "x")[0] == 2
    assert invoke(capsys, "doctor", "-i", "stepped", "-c", "x", "--profile", "none")[0] == 2
