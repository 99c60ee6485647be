"""The bench in a thread, on the TCP bus and as a process of its own; and its refusals."""

import os
import re
import signal
import socket
import subprocess
import sys
import threading
import time
from pathlib import Path
from typing import Any

import can
import pytest
from bench_peer import Master

from schwung_sim.bench import Bench, default_eds
from schwung_sim.errors import BenchError
from schwung_sim.plants import make_plant
from schwung_sim.socketcand import SocketcandHub

CHILD = """
import sys
from schwung_sim.bench import Bench
Bench(tcp=("127.0.0.1", 0), seed=9).run_forever(max_time_s=float(sys.argv[1]))
"""


def test_a_motion_over_the_virtual_bus() -> None:
    with Bench(channel="motion", seed=3, clock="sync") as bench, Master(**bench.tool_options) as master:
        master.prepare()
        master.enable()
        for n in range(1000):
            answer = master.cycle(0x0F, 100 * n)
            assert answer is not None
        assert abs(answer[1] - 100 * 999) < 5000
        assert bench.servo.syncs == 1003
        assert bench.axis.time_s == pytest.approx(1.003)
        assert master.read(0x1018, 4) == 3


def test_same_seed_same_bits() -> None:
    def record(seed: int) -> list[Any]:
        with Bench(channel=f"bits {seed}", seed=seed) as bench, Master(**bench.tool_options) as master:
            master.prepare()
            master.enable()
            return [master.cycle(0x0F, 200 * n, 50 * (n % 2)) for n in range(200)]

    assert record(4) == record(4)


def test_two_clients_of_the_tcp_bus() -> None:
    with Bench(tcp=("127.0.0.1", 0), seed=3) as bench:
        options = bench.tool_options
        assert options["interface"] == "socketcand"
        with Master(**options) as one, Master(**options, tcp_tune=True) as two:
            assert one.read(0x1018, 4) == 3
            seen = [two.bus.recv(1).arbitration_id for _ in range(2)]  # type: ignore[union-attr]
            assert seen == [0x605, 0x585]  # what one asks and what it is answered
            two.prepare()
            two.enable()
            for n in range(200):
                assert two.cycle(0x0F, 100 * n) is not None


def test_frames_of_every_length_cross_the_tcp_bus() -> None:
    hub = SocketcandHub()
    options = {"interface": "socketcand", "host": hub.host, "port": hub.port, "channel": "bench"}
    inside = hub.bus()
    try:
        with can.Bus(**options) as one, can.Bus(**options) as two:
            one.send(can.Message(arbitration_id=0x80, is_extended_id=False))  # from here on both are settled
            time.sleep(0.3)
            for bus in (two, inside):
                assert bus.recv(1).data == b""
            for length in range(9):
                for extended, can_id in ((False, 0x7FF), (False, 0x000), (True, 0x1FFFFFFF), (True, 0x1)):
                    data = bytes(range(0xF8, 0xF8 + length))
                    one.send(can.Message(arbitration_id=can_id, data=data, is_extended_id=extended))
                    for bus in (two, inside):
                        got = bus.recv(1)
                        assert got is not None
                        assert (got.arbitration_id, bytes(got.data), got.is_extended_id) == (
                            can_id,
                            data,
                            extended,
                        )
            inside.send(can.Message(arbitration_id=0x123, data=b"\x01\x0a", is_extended_id=False))
            assert one.recv(1).data == two.recv(1).data == b"\x01\x0a"
            assert one.recv(0.02) is None  # nobody hears himself
    finally:
        inside.shutdown()
        hub.close()


def test_a_burst_arrives_whole_and_in_order() -> None:
    hub = SocketcandHub()
    inside = hub.bus()
    try:
        with can.Bus(interface="socketcand", host=hub.host, port=hub.port, channel="bench") as client:
            for n in range(3000):
                inside.send(
                    can.Message(arbitration_id=0x181, data=n.to_bytes(8, "little"), is_extended_id=False)
                )
            got = []
            while len(got) < 3000 and (message := client.recv(2)) is not None:
                got.append(int.from_bytes(message.data, "little"))
            assert got == list(range(3000))
    finally:
        inside.shutdown()
        hub.close()


@pytest.mark.parametrize(
    "text",
    [b"< send 123 9 1 >", b"< send xyz 1 1 >", b"< send 800 0 >", b"< send 123 2 1 >", b"< nonsense >"],
)
def test_hub_answers_nonsense_with_an_error(text: bytes) -> None:
    hub = SocketcandHub()
    try:
        with socket.create_connection((hub.host, hub.port)) as raw:
            raw.settimeout(2)
            assert raw.recv(100) == b"< hi >"
            for request, reply in ((b"< open bench >", b"< ok >"), (b"< rawmode >", b"< ok >")):
                raw.sendall(request)
                assert raw.recv(100) == reply
            raw.sendall(text)
            assert raw.recv(100).startswith(b"< error ")
    finally:
        hub.close()


def test_hub_refuses_another_channel() -> None:
    hub = SocketcandHub(channel="bench")
    try:
        with pytest.raises(can.CanError, match="could not open bus"):
            can.Bus(interface="socketcand", host=hub.host, port=hub.port, channel="vcan7")
    finally:
        hub.close()


# -- as a process --


def start_child(seconds: float) -> tuple[subprocess.Popen[str], dict[str, Any]]:
    child = subprocess.Popen([sys.executable, "-c", CHILD, str(seconds)], stdout=subprocess.PIPE, text=True)
    assert child.stdout is not None
    line = child.stdout.readline()
    found = re.match(r"bench ready: interface=socketcand channel=bench host=(\S+) port=(\d+) node=5", line)
    assert found, line
    return child, {"interface": "socketcand", "channel": "bench", "host": found[1], "port": int(found[2])}


@pytest.mark.posix
def test_process_serves_and_ends_on_a_signal() -> None:
    child, options = start_child(60)
    try:
        with Master(**options) as master:
            assert master.read(0x1018, 4) == 9
            child.send_signal(signal.SIGINT)
            assert child.wait(10) == 0
    finally:
        child.kill()


@pytest.mark.posix
@pytest.mark.parametrize("ending", [signal.SIGINT, signal.SIGTERM])
def test_either_signal_ends_it(ending: signal.Signals) -> None:
    """Of this process, whose handlers are as before afterwards."""
    before = signal.getsignal(ending)
    told: list[str] = []

    def announce(line: str) -> None:
        told.append(line)
        threading.Timer(0.05, os.kill, (os.getpid(), ending)).start()

    Bench(tcp=("127.0.0.1", 0)).run_forever(60, announce)
    assert told[0].startswith("bench ready: interface=socketcand")
    assert signal.getsignal(ending) is before


def test_it_ends_by_itself() -> None:
    began_s = time.monotonic()
    Bench(tcp=("127.0.0.1", 0)).run_forever(0.1, lambda line: None)
    assert 0.1 <= time.monotonic() - began_s < 10


# -- refusals --


@pytest.mark.parametrize(
    ("options", "sentence"),
    [
        ({"plant": "hovercraft"}, r"hovercraft.*two-mass"),
        ({"conceal": "gremlins=1"}, "gremlins"),
        ({"plant": make_plant("two-mass"), "conceal": "coulomb_friction"}, "has its own physics"),
        ({"node_id": 0}, r"node id: 0 is not within 1…127"),
        ({"node_id": 128}, "128"),
        ({"clock": "sundial"}, "sundial.*sync and wall"),
        ({"seed": -1}, "-1 is negative"),
        ({"eds": Path("/nowhere/drive.eds")}, r"drive\.eds: there is no such EDS"),
        ({"interface": "socketcan", "channel": "vcan99"}, "vcan99.*cannot be opened"),
        ({"interface": "telepathy"}, "telepathy.*cannot be opened"),
        ({"tcp": ("0.0.0.0", 0)}, "not this machine's loopback"),
        ({"tcp": ("example.com", 0)}, "not this machine's loopback"),
        ({"tcp": ("127.0.0.1", 99999)}, "cannot serve"),
        ({"faults": "gremlins@1"}, "there is no such fault.*following-error"),
        ({"faults": "drop"}, "numbers cannot be read"),
        ({"faults": "drop=2"}, "no probability"),
        ({"faults": "reset@soon"}, "numbers cannot be read"),
        ({"faults": "reset@-1"}, "negative"),
    ],
)
def test_wrong_use_is_refused_in_a_sentence(options: dict[str, Any], sentence: str) -> None:
    with pytest.raises(BenchError, match=sentence):
        Bench(**({"channel": "refused"} | options))


def test_port_in_use_is_refused() -> None:
    with Bench(tcp=("127.0.0.1", 0)) as bench, pytest.raises(BenchError, match="Take another port"):
        Bench(tcp=("127.0.0.1", bench.tool_options["port"]))


def test_eds_that_is_none_is_refused(tmp_path: Path) -> None:
    nonsense = tmp_path / "drive.eds"
    nonsense.write_text("[drive]\nParameterName\n=x")
    with pytest.raises(BenchError, match="no EDS that can be read"):
        Bench(eds=nonsense, channel="refused")
    wrong = tmp_path / "wrong.eds"
    wrong.write_text(default_eds().read_text().replace("[6041]", "[5FFF]"))
    with pytest.raises(BenchError, match="0x6041"):
        Bench(eds=wrong, channel="refused")
