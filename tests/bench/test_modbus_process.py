"""The Modbus bench and the tool as two processes: found, looked over, commissioned; killed in mid-motion, put back."""

from __future__ import annotations

import json
import re
import signal
import subprocess
import sys
import time
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

from bench_process import schwung
from modbus_desk import profile_of

from schwung.cli.demo import BELIEF
from schwung.fieldbus.modbus import ModbusDrive, ModbusLink, modbus_options

FAULT_AND_COMMUNICATION = ("Fault", "0x7500")


@contextmanager
def modbus_bench(*options: str) -> Iterator[list[str]]:
    """A bench in its own process; yields the bus options of the tool."""
    process = subprocess.Popen(
        [sys.executable, "-m", "schwung", "bench", "--seconds", "100", *options],
        stdout=subprocess.PIPE, stderr=subprocess.STDOUT, text=True,
    )  # fmt: skip
    try:
        assert process.stdout is not None
        line = process.stdout.readline()
        found = re.search(r"interface=(\S+) channel=(\S+)(?: bitrate=(\d+) parity=(\S+))?", line)
        assert found, line + process.stdout.read()
        serial = ["-b", found[3], "--bus", f"parity={found[4]}"] if found[3] else []
        yield ["-i", found[1], "-c", found[2], *serial]
    finally:
        process.terminate()
        process.wait(10)
        assert process.stdout is not None
        process.stdout.close()


def arguments(folder: Path, bus: list[str]) -> list[str]:
    machine = folder / "machine.toml"
    machine.write_text(BELIEF)
    return [
        "commission", "-m", str(machine), "--distance", "180deg", "--duration", "250ms", "-y", "--repeats", "1",
        "--trace-rate", "1kHz", "--out", str(folder / "out"), *bus,
    ]  # fmt: skip


def test_scan_and_doctor_reach_a_modbus_drive_over_a_serial_line() -> None:
    with modbus_bench("--modbus-rtu", "--seed", "42") as bus:
        scanned = schwung("scan", *bus, "--nodes", "1-2", "--json")
        assert scanned.returncode == 0, scanned.stderr
        (node,) = json.loads(scanned.stdout)["nodes"]
        assert (node["profiles"], node["serial"]) == (["schwung-bench-modbus"], 42)
        looked = schwung("doctor", *bus, "--json")
        assert looked.returncode == 0, looked.stderr
        assert json.loads(looked.stdout)["can_start"]
        wrong = schwung("doctor", *bus, "--profile", "schwung-bench")
        assert wrong.returncode == 2
        assert "is not for Modbus" in wrong.stderr
        assert "Traceback" not in wrong.stderr


def test_killed_in_mid_motion_the_drive_stops_by_itself_and_restore_puts_it_back(tmp_path: Path) -> None:
    with modbus_bench("--modbus-tcp", "127.0.0.1:0") as bus:
        command = [sys.executable, "-m", "schwung", *arguments(tmp_path, bus)]
        tool = subprocess.Popen(command, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL)
        profile = profile_of()
        with ModbusDrive(
            ModbusLink(modbus_options(bus[1], bus[3], None, {}), 1, profile.modbus), profile
        ) as looker:
            end_s = time.monotonic() + 60
            while abs(looker.state().position_rad) < 0.5 and time.monotonic() < end_s:
                time.sleep(0.005)
            tool.send_signal(signal.SIGKILL)
            tool.wait(10)
            assert looker.read(looker.parameter(104)).raw == 1
            looker.close()  # our looking would keep the watchdog quiet
        time.sleep(2.0)
        with ModbusDrive(
            ModbusLink(modbus_options(bus[1], bus[3], None, {}), 1, profile.modbus), profile
        ) as looker:
            state = looker.state()
            assert state.cia402 == FAULT_AND_COMMUNICATION[0]
            assert FAULT_AND_COMMUNICATION[1] in state.error
        restored = schwung("restore", str(tmp_path / "out" / "setup.backup.json"))
        assert restored.returncode == 0, restored.stderr
        with ModbusDrive(
            ModbusLink(modbus_options(bus[1], bus[3], None, {}), 1, profile.modbus), profile
        ) as looker:
            assert looker.read(looker.parameter(104)).raw == 0  # mode
            assert looker.read(looker.parameter(110)).raw == 0  # watchdog
            assert looker.read(looker.parameter(406)).raw == 0  # generator
