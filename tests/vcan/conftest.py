"""Tests that need the kernel's own CAN: fresh interfaces, or a skip that says how to get one."""

from __future__ import annotations

import contextlib
import os
import shutil
import socket
import subprocess
import sys
from collections.abc import Callable, Iterator
from pathlib import Path

import can
import pytest
from can.interfaces.socketcan import SocketcanBus

SO_RCVBUFFORCE = 33  # asm-generic/socket.h; not in the socket module
HOW = "python3 tests/vcan/uml.py .venv/bin/pytest -m vcan tests/vcan"


def ip_link(*arguments: str) -> str:
    """Run `ip link`; returns what it complains about, empty when it worked."""
    program = shutil.which("ip", path=os.environ.get("PATH", "") + ":/usr/sbin:/sbin")
    if program is None:
        return "no `ip` here (package iproute2)"
    done = subprocess.run([program, "link", *arguments], capture_output=True, text=True, check=False)
    return "" if done.returncode == 0 else done.stderr.strip() or "ip link failed"


def is_up(channel: str) -> bool:
    flags = Path("/sys/class/net", channel, "flags")
    return flags.exists() and bool(int(flags.read_text(encoding="utf-8"), 16) & 1)


@contextlib.contextmanager
def interface(channel: str) -> Iterator[str]:
    """A virtual CAN interface that is up: a new one where we may create it, else a `vcan0` that exists."""
    complaint = ip_link("add", "dev", channel, "type", "vcan")
    if not complaint:
        complaint = ip_link("set", channel, "up")
        try:
            if complaint:
                pytest.fail(f"created {channel}, but: {complaint}")
            yield channel
        finally:
            ip_link("delete", channel)
    elif is_up("vcan0"):
        yield "vcan0"
    else:
        pytest.skip(f"no vcan here ({complaint}); run it in user-mode-linux: {HOW}")


@pytest.fixture
def vcan_channel() -> Iterator[str]:
    """An interface for this test alone."""
    with interface(f"vcan{os.getpid()}") as channel:
        yield channel


@pytest.fixture(scope="module")
def bench_channel(request: pytest.FixtureRequest) -> Iterator[str]:
    """An interface with a bench on it, a process of its own; `request.param` is its clock.

    A drive has a processor of its own: where we may say so, ours is the bench's whenever it has something to do.
    """
    with interface(f"bench{os.getpid()}") as channel:
        script = f"""
import contextlib, os
from schwung_sim.bench import Bench
with contextlib.suppress(AttributeError, PermissionError):
    os.sched_setscheduler(0, os.SCHED_FIFO, os.sched_param(1))
Bench("two-mass", interface="socketcan", channel="{channel}", clock="{request.param}", node_id=5).run_forever(200)
"""
        with subprocess.Popen([sys.executable, "-c", script], stdout=subprocess.PIPE, text=True) as process:
            try:
                assert process.stdout is not None
                line = process.stdout.readline()
                assert "bench ready" in line, line
                yield channel
            finally:
                process.terminate()


@pytest.fixture
def open_bus_on() -> Iterator[Callable[[str], can.BusABC]]:
    """Opens python-can buses on an interface, with room for 5000 unread frames each; closes them all."""
    buses: list[can.BusABC] = []

    def opened(channel: str) -> can.BusABC:
        bus = can.Bus(interface="socketcan", channel=channel)
        buses.append(bus)
        assert isinstance(bus, SocketcanBus)
        for option in (socket.SO_RCVBUF, SO_RCVBUFFORCE):
            with contextlib.suppress(PermissionError):  # beyond the system's limit only for root
                bus.socket.setsockopt(socket.SOL_SOCKET, option, 4 << 20)
        return bus

    yield opened
    for bus in buses:
        bus.shutdown()


@pytest.fixture
def open_bus(vcan_channel: str, open_bus_on: Callable[[str], can.BusABC]) -> Callable[[], can.BusABC]:
    """The same, on the test's own interface."""
    return lambda: open_bus_on(vcan_channel)


@pytest.fixture
def measured(record_property: Callable[[str, object], None]) -> Callable[[str, str], None]:
    """Keep a measured figure; all of them are printed at the end of the session."""
    return lambda name, figure: record_property(f"measured {name}", figure)


def pytest_terminal_summary(terminalreporter: pytest.TerminalReporter) -> None:
    figures = [
        f"{name.removeprefix('measured ')}: {figure}"
        for outcome in ("passed", "failed", "skipped")
        for report in terminalreporter.getreports(outcome)
        for name, figure in report.user_properties
        if name.startswith("measured ")
    ]
    if figures:
        terminalreporter.section("measured on the kernel's CAN")
        for line in figures:
            terminalreporter.write_line(line)
