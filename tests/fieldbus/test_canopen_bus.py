"""Bus options as python-can has them, bus load, sending with retries, and a reader that always ends."""

from __future__ import annotations

import errno
import socket
import threading
import time
from collections.abc import Iterator

import can
import pytest

from schwung.errors import BusError, InputError
from schwung.fieldbus.canopen.bus import BusOptions, bit_rate, bus_load, frame_bits, open_bus
from schwung.fieldbus.canopen.link import Frame, Link


@pytest.fixture(autouse=True)
def no_configuration(monkeypatch: pytest.MonkeyPatch, tmp_path_factory: pytest.TempPathFactory) -> None:
    for name in ("CAN_INTERFACE", "CAN_CHANNEL", "CAN_BITRATE", "CAN_CONFIG"):
        monkeypatch.delenv(name, raising=False)
    monkeypatch.setenv("HOME", str(tmp_path_factory.mktemp("home")))


def test_flags_and_further_options_reach_python_can() -> None:
    options = BusOptions.from_flags(
        "socketcand", "vcan0", None, ["host=127.0.0.1", "port=29536", "--tcp-tune=true"]
    )
    config = options.resolve()
    assert config["host"] == "127.0.0.1"
    assert config["port"] == 29536
    assert config["tcp_tune"] is True
    assert "bitrate" not in config


def test_what_is_not_given_comes_from_the_environment(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("CAN_INTERFACE", "virtual")
    monkeypatch.setenv("CAN_CHANNEL", "from-environment")
    monkeypatch.setenv("CAN_BITRATE", "500000")
    assert BusOptions().resolve()["channel"] == "from-environment"
    assert BusOptions(channel="given").resolve()["channel"] == "given"
    assert bit_rate(BusOptions()) == 500_000


@pytest.mark.parametrize(
    ("options", "named"),
    [
        (BusOptions(), "no interface is given"),
        (BusOptions("socketcand", "x"), "host or port is missing"),
        (BusOptions("socketcand", "x", extra={"host": "127.0.0.1", "port": "abc"}), "must be a number. Give"),
        (BusOptions("no-such-interface", "x"), "no-such-interface"),
        (BusOptions("virtual", "x", extra={"receive_own_messages": True}), "receive_own_messages"),
    ],
)
def test_a_wrong_option_is_an_input_error_with_a_remedy(options: BusOptions, named: str) -> None:
    with pytest.raises(InputError, match=named) as raised:
        open_bus(options)
    assert raised.value.remedy


@pytest.mark.parametrize("greeting", [b"", b"SSH-2.0-OpenSSH"])
def test_a_server_that_does_not_greet_is_not_waited_for(
    monkeypatch: pytest.MonkeyPatch, greeting: bytes
) -> None:
    monkeypatch.setattr("schwung.fieldbus.canopen.bus._SERVER_S", 0.1)
    with socket.create_server(("127.0.0.1", 0)) as server:
        port = server.getsockname()[1]
        answering = threading.Thread(target=lambda: server.accept()[0].sendall(greeting), daemon=True)
        answering.start()
        with pytest.raises(BusError, match=f"127.0.0.1:{port} does not greet"):
            open_bus(BusOptions("socketcand", "vcan0", extra={"host": "127.0.0.1", "port": port}))
        answering.join()


def test_an_option_without_a_value_is_refused() -> None:
    with pytest.raises(InputError, match="key=value"):
        BusOptions.from_flags(extra=["host"])


def test_an_adapter_that_is_not_there_is_a_bus_error() -> None:
    with pytest.raises(BusError, match="socketcan nocan7"):
        open_bus(BusOptions("socketcan", "nocan7"))


@pytest.mark.parametrize(("size", "bits"), [(0, 55), (1, 65), (4, 95), (8, 135)])
def test_worst_case_frame_length(size: int, bits: int) -> None:
    """Davis et al. 2007: 55 + 10 s for 11-bit identifiers."""
    assert frame_bits(size) == bits


def test_bus_load_counts_every_frame() -> None:
    frames = [(1, 1000.0), (8, 1000.0), (8, 1000.0), (4, 1000.0)]
    assert bus_load(frames, 1e6) == pytest.approx(0.430)
    assert bus_load(frames, 250e3) > 1


class FullBuffer(can.BusABC):
    """An adapter whose send buffer is full for the first `full` attempts."""

    def __init__(self, full: int, code: int = errno.ENOBUFS) -> None:
        super().__init__("full")
        self.channel_info, self.left, self.code = "a full adapter", full, code
        self.sent: list[can.Message] = []

    def send(self, msg: can.Message, timeout: float | None = None) -> None:
        if self.left:
            self.left -= 1
            raise can.CanOperationError("Failed to transmit", self.code)
        self.sent.append(msg)

    def _recv_internal(self, timeout: float | None) -> tuple[can.Message | None, bool]:
        time.sleep(min(timeout or 0, 0.01))
        return None, False


def test_a_full_send_buffer_is_tried_again() -> None:
    bus = FullBuffer(4)
    link = Link(bus)
    link.send(0x201, b"\x01")
    link.close()
    assert [m.arbitration_id for m in bus.sent] == [0x201]


@pytest.mark.parametrize(("code", "named"), [(errno.ENOBUFS, "buffer"), (errno.ENETDOWN, "cannot send")])
def test_a_bus_that_takes_nothing_is_a_bus_error_within_bounded_time(code: int, named: str) -> None:
    link = Link(FullBuffer(10**9, code))
    began = time.monotonic()
    with pytest.raises(BusError, match=named):
        link.send(0x201, b"\x01")
    assert time.monotonic() - began < 1.0
    link.close()


@pytest.fixture
def pair() -> Iterator[tuple[Link, can.BusABC]]:
    one, other = (can.Bus(interface="virtual", channel="test-link") for _ in range(2))
    link = Link(one)
    yield link, other
    link.close()
    one.shutdown()
    other.shutdown()


def test_frames_go_to_who_asked_for_them(pair: tuple[Link, can.BusABC]) -> None:
    link, other = pair
    got: list[bytes] = []
    arrived = threading.Event()

    def callback(message: can.Message) -> None:
        got.append(bytes(message.data))
        arrived.set()

    link.subscribe(0x181, callback)
    other.send(Frame(0x182, b"no"))
    other.send(Frame(0x181, b"yes"))
    assert arrived.wait(1.0)
    assert got == [b"yes"]


def test_bus_off_is_reported(pair: tuple[Link, can.BusABC]) -> None:
    link, other = pair
    failures: list[BusError] = []
    reported = threading.Event()
    link.on_failure = lambda error: (failures.append(error), reported.set())[0]
    other.send(can.Message(arbitration_id=0x40, is_error_frame=True, is_extended_id=False, data=bytes(8)))
    assert reported.wait(1.0)
    assert "bus-off" in str(failures[0])


def test_closing_is_quick_even_when_the_bus_was_closed_first(pair: tuple[Link, can.BusABC]) -> None:
    link, _ = pair
    link.bus.shutdown()
    began = time.monotonic()
    link.close()
    assert time.monotonic() - began < 1.0


def test_a_copied_frame_equals_its_original() -> None:
    frame = Frame(0x181, b"\x01\x02")
    copy = frame.__deepcopy__(None)
    assert copy.equals(frame)
    assert not copy.is_extended_id
