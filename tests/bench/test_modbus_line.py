"""The line itself: refusals in words, silence, late answers, lost connections; no write is ever sent twice."""

from collections.abc import Iterator
from contextlib import contextmanager

import pytest
from modbus_desk import line_options, modbus_bench, profile_of

from schwung.clock import SteppedClock, WallClock
from schwung.errors import BusError, NodeLostError, RegisterError
from schwung.fieldbus.modbus import ModbusLink, ModbusOptions
from schwung_sim.modbus_bench import ModbusBench

VENDOR, CONTROLWORD, MODE, POSITION = 0, 100, 104, 200


@contextmanager
def a_line(
    transport: str = "tcp", unit: int = 1, timeout_s: float = 0.15, **options: object
) -> Iterator[tuple[ModbusBench, ModbusLink]]:
    clock = SteppedClock()
    with modbus_bench(transport, clock, seed=1, **options) as bench:
        link = ModbusLink(
            line_options(bench, timeout_s), unit, profile_of().modbus, clock=clock, line=bench.line
        )
        try:
            yield bench, link
        finally:
            link.close()


@pytest.mark.parametrize("transport", ["tcp", "rtu"])
def test_registers_are_read_and_written(transport: str) -> None:
    with a_line(transport) as (_, link):
        assert link.read(VENDOR, 4) == (0x5357, 0x4E47, 0x0000, 0x4D42)  # "SWNG", "MB"
        link.write(MODE, (0, 1))
        assert link.read(MODE, 2) == (0, 1)


@pytest.mark.parametrize(
    ("address", "words", "problem"),
    [
        (VENDOR + 1, None, "no such register"),  # half of a parameter
        (30_000, None, "no such register"),
        (VENDOR, (1, 2), "no such register"),  # read-only
        (MODE, (0, 3), "does not take this value"),
        (MODE, (7, 1), "does not take this value"),  # wider than its type
    ],
)
def test_a_refusal_is_told_in_words(address: int, words: tuple[int, ...] | None, problem: str) -> None:
    with a_line() as (_, link):
        with pytest.raises(RegisterError, match=problem) as caught:
            _ = link.read(address, 2) if words is None else link.write(address, words)
        assert caught.value.code in (2, 3)
        assert f"register{'s' if words else ''} {address}" in str(caught.value) or "registers" in str(
            caught.value
        )


@pytest.mark.parametrize("code", [1, 4, 6, 11])
def test_every_exception_code_has_its_words(code: int) -> None:
    with a_line(faults=f"exception={POSITION}:{code}") as (_, link):
        with pytest.raises(RegisterError, match=rf"exception {code}\)"):
            link.read(POSITION, 2)
        assert link.read(VENDOR, 2)  # the line goes on


def test_a_silent_register_is_read_twice_and_written_once() -> None:
    with a_line(faults=f"silent={CONTROLWORD}") as (bench, link):
        before = bench.server.requests
        with pytest.raises(RegisterError, match=r"did not answer within 0\.15 s") as caught:
            link.read(CONTROLWORD, 2)
        assert caught.value.code is None
        assert bench.server.requests == before + 2
        with pytest.raises(RegisterError, match="did not answer"):
            link.write(CONTROLWORD, (0, 6))
        assert bench.server.requests == before + 3
        assert link.read(VENDOR, 2) == (0x5357, 0x4E47)


def test_another_unit_does_not_answer() -> None:
    with a_line("rtu", unit=2) as (bench, link):
        with pytest.raises(RegisterError, match="unit 2 did not answer"):
            link.read(VENDOR, 2)
        assert bench.server.requests == 0


@pytest.mark.parametrize("transport", ["tcp", "rtu"])
def test_a_late_answer_is_not_taken_for_that_to_the_next_request(transport: str) -> None:
    """0.25 s late, given up after 0.15 s: what arrives then belongs to the request before."""
    with a_line(transport, faults="slow=0.25") as (_, link):
        for _ in range(2):
            with pytest.raises(RegisterError, match="did not answer"):
                link.write(MODE, (0, 1))
        with link.patience(1.0):
            assert link.read(VENDOR, 2) == (0x5357, 0x4E47)


def test_garbled_answers_on_a_serial_line_are_asked_for_again_or_refused() -> None:
    read = refused = 0
    with a_line("rtu", timeout_s=0.05, faults="garble=0.5") as (_, link):
        for _ in range(12):
            try:
                assert link.read(VENDOR, 2) == (0x5357, 0x4E47)  # never a wrong value
                read += 1
            except RegisterError:
                refused += 1
    assert read > 0


def test_after_a_lost_connection_the_first_thing_on_the_new_one_is_ours_to_choose() -> None:
    with a_line() as (bench, link):
        said: list[tuple[int, ...]] = []
        link.on_reconnect = lambda: said.append(link.read(VENDOR, 2))
        assert link.read(POSITION, 2) == (0, 0)
        assert not said
        bench.server.drop()
        assert link.read(POSITION, 2) == (0, 0)  # a read may be asked again
        assert said == [(0x5357, 0x4E47)]
        assert link.losses == 1


def test_a_write_that_meets_a_lost_connection_is_not_repeated() -> None:
    with a_line() as (bench, link):
        link.read(VENDOR, 2)
        bench.server.drop()
        before = bench.server.requests
        with pytest.raises(NodeLostError, match="connection was lost"):
            link.write(MODE, (0, 1))
        assert link.read(MODE, 2) == (0, 0)
        assert bench.server.requests == before + 1  # the read alone


def test_where_the_greeting_fails_it_is_owed_still() -> None:
    with a_line(faults=f"exception={CONTROLWORD}:6") as (bench, link):
        tries: list[int] = []

        def greet() -> None:
            tries.append(1)
            if len(tries) < 3:
                link.write(CONTROLWORD, (0, 2))

        link.on_reconnect = greet
        link.read(VENDOR, 2)
        bench.server.drop()
        for _ in range(2):
            with pytest.raises(RegisterError, match="busy"):
                link.read(VENDOR, 2)
        assert link.read(VENDOR, 2) == (0x5357, 0x4E47)
        assert len(tries) == 3


@pytest.mark.long
@pytest.mark.parametrize("transport", ["tcp", "rtu"])
def test_a_socket_and_a_serial_port_of_this_computer_carry_the_same(transport: str) -> None:
    """On the wall's clock, which pymodbus' own clients go by."""
    tcp = ("127.0.0.1", 0) if transport == "tcp" else None
    with ModbusBench(tcp=tcp, seed=1, faults=f"silent={CONTROLWORD}") as bench:
        link = ModbusLink(line_options(bench), 1, profile_of().modbus, clock=WallClock())
        link.write(MODE, (0, 1))
        assert link.read(MODE, 2) == (0, 1)
        with pytest.raises(RegisterError, match="no such register"):
            link.read(30_000, 2)
        with pytest.raises(RegisterError, match=r"did not answer within 0\.5 s"):
            link.write(CONTROLWORD, (0, 6))
        with link.patience(5.0):
            assert link.read(VENDOR, 2) == (0x5357, 0x4E47)
        link.close()


def test_nobody_there() -> None:
    with pytest.raises(BusError, match="cannot be opened"):
        ModbusLink(ModbusOptions("tcp", host="127.0.0.1", port=1), 1, profile_of().modbus, clock=WallClock())
    with pytest.raises(BusError, match="cannot be opened"):
        ModbusLink(
            ModbusOptions("rtu", device="/dev/no-such-line"), 1, profile_of().modbus, clock=WallClock()
        )


def test_the_pause_that_a_drive_wants_is_kept() -> None:
    modbus = profile_of().modbus.model_copy(update={"silence_s": 0.02})
    clock = SteppedClock()
    with modbus_bench("rtu", clock) as bench:
        link = ModbusLink(line_options(bench), 1, modbus, clock=clock, line=bench.line)
        link.read(VENDOR, 2)
        began = clock.now()
        for _ in range(5):
            link.read(VENDOR, 2)
        link.close()
        assert clock.now() - began >= 5 * 0.02
