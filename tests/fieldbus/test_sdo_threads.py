"""A stop from another thread, by the wall's clock: threads are what is tested here."""

from __future__ import annotations

import queue
import threading
from collections.abc import Callable
from typing import cast

import can
from sdo_desk import CONTROLWORD, STATUSWORD, USER_DATA, Objects, bench_server, content

from schwung.clock import WallClock
from schwung.fieldbus.canopen.link import Link
from schwung.fieldbus.canopen.sdo import Outcome, SdoChannel
from schwung.fieldbus.drive import Parameter

SIZE = 3000


class Threaded:
    """A link whose server and reader are threads, as on a real bus."""

    def __init__(self) -> None:
        self.clock, self.objects = WallClock(), Objects()
        self._requests: queue.SimpleQueue[bytes | None] = queue.SimpleQueue()
        self._callback: Callable[[can.Message], None] = lambda message: None
        self._serve = bench_server(self.objects, self._answer)
        self._thread = threading.Thread(target=self._run)
        self._thread.start()

    def subscribe(self, can_id: int, callback: Callable[[can.Message], None]) -> None:
        self._callback = callback

    def send(self, can_id: int, data: bytes) -> None:
        self._requests.put(bytes(data))

    def close(self) -> None:
        self._requests.put(None)
        self._thread.join()

    def _answer(self, frame: bytes) -> None:
        self._callback(can.Message(arbitration_id=0x585, data=frame.ljust(8, b"\0"), is_extended_id=False))

    def _run(self) -> None:
        while (frame := self._requests.get()) is not None:
            self._serve(frame)


def test_a_thread_that_waits_for_an_answer_holds_up_no_stop() -> None:
    """By the wall's clock too: the stop is confirmed while the read has all the time in the world to wait."""
    link = Threaded()
    serve, answering = link._serve, threading.Event()
    asked = threading.Event()

    def deaf(frame: bytes) -> None:
        if frame[1:4] == b"\x41\x60\0" and not answering.is_set():
            asked.set()
        else:
            serve(frame)

    link._serve = deaf
    sdo = SdoChannel(cast(Link, link), 5, timeout_s=60.0)
    read: list[object] = []
    thread = threading.Thread(target=lambda: read.append(sdo.read(STATUSWORD).raw))
    thread.start()
    try:
        assert asked.wait(5.0)
        asked.clear()
        assert sdo.write_once(CONTROLWORD, 2, 5.0) is Outcome.CONFIRMED
        assert read == []
        assert asked.wait(5.0)  # it is asked for anew, and has still no answer
        answering.set()
        assert sdo.write_once(CONTROLWORD, 0, 5.0) is Outcome.CONFIRMED
        thread.join(5.0)
    finally:
        answering.set()
        link.close()
    assert read == [0x237]
    assert link.objects.written == [(0x6040, b"\2\0"), (0x6040, b"\0\0")]


def test_threads_that_transfer_are_stopped_from_another_one() -> None:
    """The wall's clock, and three threads that are never idle: each of 50 stops is confirmed, each transfer right."""
    link = Threaded()
    link.objects.values[USER_DATA.index, 0] = content(SIZE)
    link.objects.values[0x2011, 0] = b""
    sdo = SdoChannel(cast(Link, link), 5, timeout_s=5.0)
    done = threading.Event()
    wrong: list[object] = []
    counts = [0, 0, 0]
    outcomes: list[Outcome] = []

    def again(number: int, right: Callable[[], bool]) -> None:
        try:
            while not done.is_set():
                if not right():
                    wrong.append(number)
                counts[number] += 1
        except Exception as error:
            wrong.append(error)

    other = Parameter(0x2011, 0, "DOMAIN")

    def wrote() -> bool:
        sdo.download(other, content(200))
        return link.objects.values[0x2011, 0] == content(200)

    transfers: list[Callable[[], bool]] = [
        lambda: sdo.upload(USER_DATA) == content(SIZE),
        lambda: sdo.read(STATUSWORD).raw == 0x237,
        wrote,
    ]
    threads = [threading.Thread(target=again, args=pair) for pair in enumerate(transfers)]
    for thread in threads:
        thread.start()
    try:
        for _ in range(50):
            before = sum(counts)
            outcomes.append(sdo.write_once(CONTROLWORD, 2, 5.0))
            link.clock.wait(lambda before=before: sum(counts) > before or bool(wrong), 5.0)  # type: ignore[misc]
    finally:
        done.set()
        for thread in threads:
            thread.join()
        link.close()
    assert outcomes == [Outcome.CONFIRMED] * 50
    assert [data for index, data in link.objects.written if index == 0x6040] == [b"\2\0"] * 50
    assert wrong == []
