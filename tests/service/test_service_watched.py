"""Who watches over a service: Prometheus, whoever collects logs, systemd."""

from __future__ import annotations

import asyncio
import configparser
import io
import json
import logging
import os
import shlex
import socket
import threading
import time
from collections.abc import Iterator
from pathlib import Path

import pytest
from service_desk import service_desk
from typer.testing import CliRunner

from schwung.cli import app
from schwung.service.latch import Stopped
from schwung.service.logs import EventLog, JsonFormatter
from schwung.service.systemd import Notifier, Watchdog
from schwung.service.values import RunView


def test_a_line_of_the_log_has_who_drive_job_and_event() -> None:
    lines = io.StringIO()
    handler = logging.StreamHandler(lines)
    handler.setFormatter(JsonFormatter())
    logger = logging.getLogger("schwung.service.events")
    logger.addHandler(handler)
    logger.setLevel(logging.INFO)
    try:
        log = EventLog({"d": "Axis 3"}.__getitem__)
        run = RunView("a" * 16, "commission", "queued", "Ada", "2026-01-01T00:00:00Z", drive_id="d")
        for state in ("queued", "running", "running", "failed"):
            log(
                RunView(
                    **{
                        **vars(run),
                        "state": state,
                        "error": {"text": "no answer"} if state == "failed" else None,
                    }
                )
            )
        log(Stopped("Ada", "2026-01-01T00:00:01Z"))
        log(None)
        try:
            raise ValueError("ä")
        except ValueError:
            logger.exception("a listener failed")
    finally:
        logger.removeHandler(handler)
    told = [json.loads(line) for line in lines.getvalue().splitlines()]
    assert [line["event"] for line in told] == [
        "run queued", "run running", "run ended", "stop", "stop released", "a listener failed",
    ]  # fmt: skip
    who_where = {"who": "Ada", "drive": "Axis 3", "job": "a" * 16, "kind": "commission"}
    assert who_where.items() <= told[2].items()
    assert (told[2]["state"], told[2]["detail"], told[2]["level"]) == ("failed", "no answer", "warning")
    assert told[5]["error"] == "ValueError: ä"
    assert "Traceback" in told[5]["trace"]


@pytest.fixture
def systemd(tmp_path: Path) -> Iterator[tuple[socket.socket, dict[str, str]]]:
    """What listens, and the environment that it gives to a service; the watchdog bites after 0.4 s."""
    path = str(tmp_path / "notify")
    with socket.socket(socket.AF_UNIX, socket.SOCK_DGRAM) as listener:
        listener.bind(path)
        listener.settimeout(2.0)
        yield listener, {"NOTIFY_SOCKET": path, "WATCHDOG_USEC": "400000", "WATCHDOG_PID": str(os.getpid())}


@pytest.mark.posix
def test_systemd_is_told(systemd: tuple[socket.socket, dict[str, str]]) -> None:
    listener, environment = systemd
    Notifier(environment).tell(READY=1, STATUS="serving")
    assert listener.recv(1000) == b"READY=1\nSTATUS=serving"
    assert Notifier(environment).watchdog_s == pytest.approx(0.4)
    assert Notifier({**environment, "WATCHDOG_PID": "1"}).watchdog_s is None  # another process is meant
    for gone in ({}, {"NOTIFY_SOCKET": "/nowhere"}, {"NOTIFY_SOCKET": "nonsense"}):
        Notifier(gone).tell(READY=1)


@pytest.mark.posix
@pytest.mark.parametrize("hangs", ["nothing", "the loop", "a lane"])
def test_the_watchdog_is_told_while_loop_and_lanes_answer(
    systemd: tuple[socket.socket, dict[str, str]], hangs: str
) -> None:
    listener, environment = systemd
    loop = asyncio.new_event_loop()
    running = threading.Thread(target=loop.run_forever)
    running.start()
    freed, silent = threading.Event(), [0.0]
    watchdog = Watchdog(Notifier(environment), lambda: silent[0], loop)
    try:
        assert listener.recv(100) == b"WATCHDOG=1"
        if hangs == "the loop":
            loop.call_soon_threadsafe(freed.wait)
        elif hangs == "a lane":
            silent[0] = 1.0
        time.sleep(0.5)
        _drain(listener)
        time.sleep(0.5)
        assert bool(_drain(listener)) is (hangs == "nothing")
    finally:
        freed.set()
        watchdog.close()
        loop.call_soon_threadsafe(loop.stop)
        running.join()
        loop.close()


def test_a_lane_that_hangs_does_not_answer(tmp_path: Path) -> None:
    with service_desk(tmp_path) as desk:
        desk.service.silent_s()
        time.sleep(0.05)
        assert desk.service.silent_s() < 0.05 + 0.5
        freed = threading.Event()
        (lane,) = desk.service._lanes.values()
        lane.put(freed.wait)  # type: ignore[arg-type]  # what it returns is nobody's
        time.sleep(0.05)
        desk.service.silent_s()
        time.sleep(0.3)
        assert desk.service.silent_s() >= 0.3
        freed.set()
        end = time.monotonic() + 5
        while desk.service.silent_s() >= 0.3:
            assert time.monotonic() < end
            time.sleep(0.01)


def test_the_unit_starts_what_was_asked_for() -> None:
    words = ["-i", "socketcan", "-c", "can0", "--bus", "a=b c", "--allow-host", "50%.lab", "--log-json"]
    told = CliRunner().invoke(app, ["serve", "--systemd-unit", *words]).stdout
    unit = configparser.ConfigParser(interpolation=None, strict=False)
    unit.optionxform = str  # type: ignore[assignment,method-assign]  # its keys have capitals
    unit.read_string(told)
    assert unit["Service"]["Type"] == "notify"
    assert unit["Service"]["WatchdogSec"] == "60"
    started = shlex.split(unit["Service"]["ExecStart"].replace("%%", "%"))
    assert started[1:4] == ["-m", "schwung", "serve"]
    for word in words:
        assert word in started


def _drain(listener: socket.socket) -> list[bytes]:
    listener.setblocking(False)
    found = []
    try:
        while True:
            found.append(listener.recv(100))
    except BlockingIOError:
        return found
    finally:
        listener.settimeout(2.0)
