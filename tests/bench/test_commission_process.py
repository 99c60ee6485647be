"""Two processes on a bus, and the tool killed in every way: the drive stops, parameters come back."""

import json
import signal
import subprocess
import sys
import time
from pathlib import Path

import can
import pytest
from bench_process import bench_process, commission_arguments, schwung

from schwung.commissioning import read_backup
from schwung.fieldbus.canopen import scan_bus
from schwung.session import read_session

#: A commissioning that is not soon over, at a rate that costs little.
LONG = ("--repeats", "30", "--rate", "250")


def _state(options: list[str]) -> str:
    """What the drive says of itself to whoever asks, here to us."""
    given = dict(text.split("=") for text in options if "=" in text)
    bus = can.Bus(interface="socketcand", channel=options[3], host=given["host"], port=int(given["port"]))
    try:
        (found,) = scan_bus(bus, [1])
    finally:
        bus.shutdown()
    return found.cia402.lower()


def _start_and_wait_for_a_motion(arguments: list[str], session: Path) -> subprocess.Popen[str]:
    """The tool, some motions into a long commissioning."""
    process = subprocess.Popen(
        [sys.executable, "-m", "schwung", *arguments],
        stdout=subprocess.PIPE,
        stderr=subprocess.STDOUT,
        text=True,
    )
    end = time.monotonic() + 40
    while time.monotonic() < end and process.poll() is None:
        if session.exists() and read_session(session).runs:
            time.sleep(0.1)  # into the next motion
            return process
        time.sleep(0.1)
    process.kill()
    raise AssertionError(process.communicate()[0])


def test_scan_commission_and_estimate_again(tmp_path: Path) -> None:
    with bench_process("--seed", "3") as bus:
        done = schwung(
            *commission_arguments(
                tmp_path, bus, "--repeats", "1", "--rate", "500", "--export", "table", "--json"
            )
        )
        assert done.returncode == 0, done.stdout + done.stderr
        result = json.loads(done.stdout)
        assert result["export"]["improvement"] >= 5
        assert result["estimate"]["trust"]["verdict"] in ("good", "doubtful")
        assert "operation" not in _state(bus)
    again = schwung(
        "estimate",
        str(tmp_path / "out/session.h5"),
        "-m",
        str(tmp_path / "machine.toml"),
        "--out",
        str(tmp_path / "e"),
        "--json",
    )
    assert json.loads(again.stdout)["table"] == result["estimate"]["table"]
    for name in ("out/report.html", "out/inertia.csv", "e/report.html", "e/inertia.csv"):
        assert (tmp_path / name).stat().st_size > 500


def test_a_killed_tool_leaves_a_drive_that_stops_and_a_file_that_restores_it(tmp_path: Path) -> None:
    out = tmp_path / "out"
    with bench_process("--seed", "4") as bus:
        tool = _start_and_wait_for_a_motion(commission_arguments(tmp_path, bus, *LONG), out / "session.h5")
        tool.kill()
        tool.communicate()
        end = time.monotonic() + 5
        while "enabled" in (state := _state(bus)) and time.monotonic() < end:
            time.sleep(0.1)
        assert "enabled" not in state  # stopped by its own heartbeat consumer
        backup = out / "setup.backup.json"
        assert read_backup(backup).restored is None
        again = schwung(*commission_arguments(tmp_path, bus, "--out", str(out)))
        assert again.returncode == 2
        restored = schwung("restore", str(backup))  # the bus is in the file
        assert restored.returncode == 0, restored.stderr
        assert read_backup(backup).restored is not None
        nothing = schwung("restore", str(backup), "--json")
        assert json.loads(nothing.stdout)["restored"] == 0
        assert len(read_session(out / "session.h5").runs) >= 1


@pytest.mark.posix
def test_an_interrupted_tool_stops_the_drive_and_puts_everything_back(tmp_path: Path) -> None:
    """Ctrl-C, and a closed terminal, twice each."""
    with bench_process("--seed", "5") as bus:
        for number in (signal.SIGINT, signal.SIGHUP):
            out = tmp_path / number.name
            tool = _start_and_wait_for_a_motion(
                commission_arguments(tmp_path, bus, *LONG, "--out", str(out)), out / "session.h5"
            )
            try:
                tool.send_signal(number)
                time.sleep(0.05)
                tool.send_signal(number)  # people do
                said, _ = tool.communicate(timeout=20)
            finally:
                tool.kill()  # one that is still there would take a processor from all tests to come
            assert tool.returncode == 130, said
            assert "Traceback" not in said
            assert "motions are in" in said
            assert "enabled" not in _state(bus)
            assert read_backup(out / "setup.backup.json").restored is not None
            assert len(read_session(out / "session.h5").runs) >= 1


def test_a_thread_that_cannot_keep_sync_even_is_said_so_and_the_drive_stopped(tmp_path: Path) -> None:
    """A drive on the wall clock, and a bus without kernel SYNC: jitter of 0.2 ms is too much for setpoints."""
    with bench_process("--clock", "wall", "--fault", "jitter=0.0002") as bus:
        uneven = ("--max-jitter", "1e-6", "--repeats", "1")
        done = schwung(*commission_arguments(tmp_path, bus, *uneven, "--mode", "csp"))
        assert done.returncode == 4, done.stdout + done.stderr
        assert "SYNC: came unevenly" in done.stderr
        assert "enabled" not in _state(bus)
        planned = schwung(
            *commission_arguments(tmp_path, bus, *uneven, "--dry-run", "--out", str(tmp_path / "pp"))
        )
        assert "the drive moves, injects and samples by itself" in " ".join(planned.stdout.split())


def test_no_bench_no_traceback(tmp_path: Path) -> None:
    started = time.monotonic()
    nobody = schwung("scan", "-i", "socketcand", "-c", "vcan0", "--bus", "host=127.0.0.1", "--bus", "port=9")
    assert nobody.returncode == 4
    assert "Traceback" not in nobody.stderr
    assert len(nobody.stderr.strip().splitlines()) == 1
    assert time.monotonic() - started < 8
