"""The tool at the Modbus bench: found, looked over; as two processes: killed in mid-motion, put back."""

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

import numpy as np
import pytest
from bench_process import schwung
from modbus_desk import bus_options, profile_of

from schwung.cli import main
from schwung.cli.demo import BELIEF
from schwung.clock import WallClock
from schwung.errors import StateError
from schwung.fieldbus.drive import Acquisition, Move, Setpoints
from schwung.fieldbus.modbus import ModbusDrive, ModbusLink, modbus_options
from schwung_sim.drives.modbus.power import State
from schwung_sim.modbus_bench import ModbusBench

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


def invoke(capsys: pytest.CaptureFixture[str], *arguments: str) -> tuple[int, str, str]:
    """The tool within this process: exit code, stdout and stderr."""
    with pytest.raises(SystemExit) as ended:
        main(list(arguments))
    return int(ended.value.code or 0), *capsys.readouterr()


def test_scan_and_doctor_reach_a_modbus_drive_over_a_serial_line(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    with ModbusBench(seed=42) as bench:
        options = bus_options(bench)
        bus = ["-i", str(options.interface), "-c", str(options.channel), "-b", str(options.bitrate)]
        bus += [part for key, value in options.extra.items() for part in ("--bus", f"{key}={value}")]
        code, out, err = invoke(capsys, "scan", *bus, "--nodes", "1-2", "--json")
        assert code == 0, err
        (node,) = json.loads(out)["nodes"]
        assert (node["profiles"], node["serial"]) == (["schwung-bench-modbus"], 42)
        code, out, err = invoke(capsys, "doctor", *bus, "--json")
        assert code == 0, err
        assert json.loads(out)["can_start"]
        code, _, err = invoke(capsys, "doctor", *bus, "--profile", "schwung-bench")
        assert code == 2
        assert "is not for Modbus" in err
        machine = tmp_path / "machine.toml"
        machine.write_text(BELIEF)
        moving = ["-m", str(machine), "--angles", "0", "-y", "--out", str(tmp_path)]
        code, _, err = invoke(capsys, "bode", *moving, *bus)
        assert code == 3
        assert "Modbus is too slow for setpoints" in err


def test_halt_from_another_thread_ends_a_motion_over_a_socket() -> None:
    """By the wall's clock, so that the two really meet at the lock of the link."""
    profile = profile_of()
    with ModbusBench(tcp=("127.0.0.1", 0), seed=7) as bench:
        options = bus_options(bench)
        line = modbus_options(str(options.interface), options.channel, None, {})
        with ModbusDrive(ModbusLink(line, 1, profile.modbus, clock=WallClock()), profile) as drive:
            acquisition = Acquisition("pp", 1000.0, sampling="trace", trace_rate_hz=500.0, trace_s=2.0)
            drive.write(drive.setup(acquisition))
            drive.start(acquisition)
            drive.enable()
            moves = (Move(10, 20.0, 12.0, 100.0),)
            stroke = Setpoints(1000.0, np.zeros(2000), np.zeros(2000), moves)
            stopping = WallClock().later(0.3, drive.halt)
            with pytest.raises(StateError, match="halted"):
                drive.play(stroke)
            stopping.close()
            assert bench.servo.power.state is State.QUICK_STOP
            drive.disable()
            assert not bench.axis.energised


@pytest.mark.long
@pytest.mark.posix
def test_killed_in_mid_motion_the_drive_stops_by_itself_and_restore_puts_it_back(tmp_path: Path) -> None:
    with modbus_bench("--modbus-tcp", "127.0.0.1:0") as bus:
        command = [sys.executable, "-m", "schwung", *arguments(tmp_path, bus)]
        tool = subprocess.Popen(command, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL)
        profile = profile_of()
        with ModbusDrive(
            ModbusLink(modbus_options(bus[1], bus[3], None, {}), 1, profile.modbus, clock=WallClock()),
            profile,
        ) as looker:
            end_s = time.monotonic() + 60
            while abs(looker.state().position_rad) < 0.5 and time.monotonic() < end_s:
                time.sleep(0.02)
            tool.send_signal(signal.SIGKILL)
            tool.wait(10)
            assert looker.read(looker.parameter(104)).raw == 1
            looker.close()  # our looking would keep the watchdog quiet
        time.sleep(2.0)
        with ModbusDrive(
            ModbusLink(modbus_options(bus[1], bus[3], None, {}), 1, profile.modbus, clock=WallClock()),
            profile,
        ) as looker:
            state = looker.state()
            assert state.cia402 == FAULT_AND_COMMUNICATION[0]
            assert FAULT_AND_COMMUNICATION[1] in state.error
        restored = schwung("restore", str(tmp_path / "out" / "setup.backup.json"))
        assert restored.returncode == 0, restored.stderr
        with ModbusDrive(
            ModbusLink(modbus_options(bus[1], bus[3], None, {}), 1, profile.modbus, clock=WallClock()),
            profile,
        ) as looker:
            assert looker.read(looker.parameter(104)).raw == 0  # mode
            assert looker.read(looker.parameter(110)).raw == 0  # watchdog
            assert looker.read(looker.parameter(406)).raw == 0  # generator
