"""--can-log: what went over the bus, both ways and in order, read back with python-can's own reader."""

from __future__ import annotations

import itertools
import subprocess
import sys
from collections import Counter
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path

import can
import numpy as np
import pytest
from bench_machine import guessed_machine

from schwung.clock import SteppedBus
from schwung.commissioning import Wishes, prepare, record_prepared
from schwung.errors import InputError, InterruptedByUser
from schwung.fieldbus.canopen import BusOptions, open_bus
from schwung.fieldbus.canopen.logged import LoggedBus, require_log
from schwung.fieldbus.connecting import connected
from schwung.python_can import with_mf4
from schwung_sim.bench import Bench

_channels = itertools.count()


class Unheard:
    """An observer of whom an interrupt comes when motion has begun."""

    def __init__(self, interrupt: bool) -> None:
        self._interrupt = interrupt

    def phase(self, text: str) -> None: ...

    def progress(self, done: int, total: int) -> None:
        if self._interrupt and 2 * done > total > 100:
            raise KeyboardInterrupt

    def note(self, text: str) -> None: ...


@pytest.fixture(autouse=True)
def unpredicted(monkeypatch: pytest.MonkeyPatch) -> None:
    """What preflight foretells of the estimate takes as long as a motion, and is on no bus."""
    monkeypatch.setattr("schwung.commissioning.preflight._predicted", lambda *_: None)


def commission(log: Path, out: Path, *, interrupt: bool = False) -> list[can.Message]:
    """Commission a bench and log it; returns what a third one on the bus has heard."""
    channel = f"logged-{next(_channels)}"
    heard: list[can.Message] = []
    out.mkdir()
    with Bench("two-mass", channel=channel, node_id=1):
        tap = SteppedBus(channel)
        task = tap.clock.read(tap, heard.append, lambda error: None)
        with connected(BusOptions("stepped", channel, 1_000_000, log=log), 1, "schwung-bench") as opened:
            wishes = Wishes(distance_rad=1.0, duration_s=0.1, repeats=1, sample_rate_hz=500.0)
            ready = prepare(opened.drive, opened.profile, guessed_machine(), wishes)
            assert "log" not in opened.drive.describe()["bus"]
            record_prepared(opened.drive, ready, out, Unheard(interrupt), wishes.max_jitter_share)
        task.close()
        tap.shutdown()
    return heard


def read_back(path: Path) -> list[can.Message]:
    with_mf4()  # where this process has got to know python-can by schwung, as other tests make it
    with can.LogReader(path) as reader:
        return list(reader)


def test_a_log_may_be_an_mf4_file_though_its_library_is_loaded_late(tmp_path: Path) -> None:
    pytest.importorskip("asammdf")
    code = """
import sys
from schwung.clock import SteppedBus
from schwung.fieldbus.canopen.logged import LoggedBus
import can
assert "asammdf" not in sys.modules
bus = LoggedBus(SteppedBus(), __import__("pathlib").Path(sys.argv[1]))
bus.send(can.Message(arbitration_id=0x601, data=[0x40, 0x41, 0x60, 0], is_extended_id=False))
bus.shutdown()
"""
    subprocess.run([sys.executable, "-c", code, str(tmp_path / "bus.mf4")], check=True)
    assert [(m.arbitration_id, bytes(m.data)) for m in read_back(tmp_path / "bus.mf4")] == [
        (0x601, bytes([0x40, 0x41, 0x60, 0]))
    ]


def test_every_frame_of_a_commissioning_is_in_the_log(tmp_path: Path) -> None:
    heard = commission(tmp_path / "bus.blf", tmp_path / "out")
    logged = read_back(tmp_path / "bus.blf")
    assert len(logged) > 2000
    assert Counter(_what(m) for m in logged) == Counter(_what(m) for m in heard)
    assert {m.arbitration_id: m.is_rx for m in logged}[0x080] is False  # SYNC is ours
    assert {m.arbitration_id: m.is_rx for m in logged}[0x581] is True  # SDO answers are the drive's
    stamps = np.array([m.timestamp for m in logged])
    assert np.all(np.diff(stamps) > -1e-3)
    assert stamps[-1] - stamps[0] == pytest.approx(heard[-1].timestamp - heard[0].timestamp, abs=0.01)


def test_an_interrupt_leaves_a_whole_log(tmp_path: Path) -> None:
    with pytest.raises(InterruptedByUser):
        commission(tmp_path / "bus.asc", tmp_path / "out", interrupt=True)
    logged = read_back(tmp_path / "bus.asc")
    controlwords = [m.data[0] for m in logged if m.arbitration_id == 0x201]
    assert 0x0F in controlwords
    assert controlwords[-1] in (0x00, 0x02, 0x06)  # how the drive was stopped is in it, too


@pytest.mark.parametrize("ending", [".log", ".csv", ".trc"])
def test_formats(tmp_path: Path, ending: str) -> None:
    path, channel = tmp_path / f"bus{ending}", f"logged-{next(_channels)}"
    far = SteppedBus(channel)
    for _ in range(2):
        bus = open_bus(BusOptions("stepped", channel, 1_000_000, log=path))
        bus.send(can.Message(arbitration_id=0x123, data=b"\1\2", is_extended_id=False))
        far.send(can.Message(arbitration_id=0x321, is_extended_id=False))
        assert bus.recv(1.0)
        bus.shutdown()
    far.shutdown()
    for name in (f"bus{ending}", f"bus-2{ending}"):  # opened again: another log, and the first one stays
        assert [_what(m) for m in read_back(tmp_path / name)] == [(0x123, b"\1\2"), (0x321, b"")]


@pytest.mark.parametrize(
    ("make", "sentence"),
    [
        (lambda folder: folder / "bus.pcap", 'has the ending ".pcap". Use .asc, .blf'),
        (lambda folder: folder / "bus", 'has the ending ""'),
        (lambda folder: folder / "there" / "bus.blf", "folder that is not there"),
        (lambda folder: folder / "old.blf", "exists already"),
    ],
)
def test_a_log_that_cannot_be_is_refused(tmp_path: Path, make: Callable[[Path], Path], sentence: str) -> None:
    (tmp_path / "old.blf").touch()
    with pytest.raises(InputError, match=sentence):
        require_log(make(tmp_path))


def test_a_full_disk_disturbs_no_bus_and_is_told(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    class Full(can.CanutilsLogWriter):
        def on_message_received(self, msg: can.Message) -> None:
            raise OSError(28, "No space left on device")

    monkeypatch.setattr(can, "Logger", Full)
    for under_way in (False, True):
        bus = LoggedBus(SteppedBus(f"logged-{next(_channels)}"), tmp_path / "bus.log")
        bus.send(can.Message(arbitration_id=0x123, is_extended_id=False))
        bus.clock.sleep(1.0)
        if not under_way:
            with pytest.raises(InputError, match=r"is not complete .*No space left"):
                bus.shutdown()
            continue
        with pytest.raises(KeyError) as raised, _shut_down(bus):
            raise KeyError
        assert "No space left" in raised.value.__notes__[0]


@contextmanager
def _shut_down(bus: can.BusABC) -> Iterator[None]:
    try:
        yield
    finally:
        bus.shutdown()


def _what(message: can.Message) -> tuple[int, bytes]:
    return message.arbitration_id, bytes(message.data)
