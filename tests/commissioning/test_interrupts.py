"""One interrupt gets through, none is lost, and nobody is deaf to the next one afterwards, whenever it comes."""

from __future__ import annotations

import itertools
import signal
import sys
from collections.abc import Callable, Iterator
from types import FrameType
from typing import Any

import pytest

from schwung.clock import Clock, SteppedClock, WallClock
from schwung.commissioning.interrupts import _WATCHED, OneInterrupt

WATCHED = (signal.SIGINT, signal.SIGTERM)


def _interrupt(number: int, frame: FrameType | None) -> None:
    raise KeyboardInterrupt


@pytest.fixture(autouse=True)
def handlers() -> Iterator[None]:
    """As the command line has them; and as they were afterwards."""
    before = {number: signal.getsignal(number) for number in WATCHED}
    for number in WATCHED:
        signal.signal(number, _interrupt)
    yield
    for number, handler in before.items():
        signal.signal(number, handler)


def heard() -> bool:
    """All handlers are as they were."""
    return all(signal.getsignal(number) is _interrupt for number in WATCHED)


def comes(monkeypatch: pytest.MonkeyPatch, at: int, number: signal.Signals) -> None:
    """The signal comes right after the so-manieth handler has been set."""
    install, calls = signal.signal, []

    def installing(which: int, handler: Any) -> Any:
        before = install(which, handler)
        calls.append(which)
        if len(calls) == at:
            signal.raise_signal(number)
        return before

    monkeypatch.setattr(signal, "signal", installing)


def within(work: Callable[[OneInterrupt], None] = lambda _: None) -> None:
    with OneInterrupt() as interrupt:
        work(interrupt)


@pytest.mark.parametrize("number", WATCHED)
@pytest.mark.parametrize("at", range(1, 2 * len(_WATCHED) + 1))
def test_one_that_comes_while_the_handlers_are_changed_gets_through_and_leaves_none_deaf(
    number: signal.Signals, at: int, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Amid entering or leaving: the handlers stayed, and every later Ctrl-C, or kill, did nothing."""
    comes(monkeypatch, at, number)
    with pytest.raises(KeyboardInterrupt):
        within()
    monkeypatch.undo()
    assert heard()


@pytest.mark.parametrize("clock", [WallClock(), SteppedClock()])
def test_the_first_gets_through_to_who_waits_and_no_other(clock: Clock) -> None:
    def work(_: OneInterrupt) -> None:
        signal.raise_signal(signal.SIGINT)
        done.append("goes on")
        try:
            clock.sleep(0.001)
            done.append("waited")
        finally:
            signal.raise_signal(signal.SIGINT)
            clock.sleep(0.001)
            done.append("stopped")

    done: list[str] = []
    with pytest.raises(KeyboardInterrupt):
        within(work)
    assert done == ["goes on", "stopped"]
    assert heard()


def test_who_waits_hears_of_it_soon() -> None:
    clock = WallClock()
    waits = (
        lambda: clock.sleep(60),
        lambda: clock.wait(lambda: False, 60),
        lambda: clock.event().wait(60),
    )
    for wait in waits:
        began = clock.now()
        task = clock.later(0.05, lambda: signal.raise_signal(signal.SIGINT))
        with pytest.raises(KeyboardInterrupt):
            within(lambda _, wait=wait: wait())
        task.close()
        assert 0.04 < clock.now() - began < 20


@pytest.mark.parametrize("at", range(40))
def test_an_interrupt_amid_a_wait_leaves_no_lock_held(at: int) -> None:
    """The program then waited for itself, for good, while its heartbeat went on and the drive stayed on."""
    clock, lines = WallClock(), itertools.count()
    event, done = clock.event(), clock.event()

    def on_line(frame: FrameType, kind: str, _: object) -> Any:
        if kind == "line" and frame.f_globals["__name__"] == "threading" and next(lines) == at:
            signal.raise_signal(signal.SIGINT)
        return on_line

    def work(_: OneInterrupt) -> None:
        traced = sys.gettrace()
        sys.settrace(on_line)
        try:
            for _ in range(20):
                event.clear()
                event.wait(0.0)
                event.set()
        finally:
            sys.settrace(traced)

    with pytest.raises(KeyboardInterrupt):
        within(work)

    def as_the_reader() -> None:
        event.set()
        done.set()

    clock.later(0.0, as_the_reader)
    assert clock.wait(done.is_set, 5.0)


def test_one_that_was_held_off_is_not_forgotten() -> None:
    def work(interrupt: OneInterrupt) -> None:
        interrupt.hold_off()
        signal.raise_signal(signal.SIGTERM)
        done.append(True)

    done: list[bool] = []
    with pytest.raises(KeyboardInterrupt):
        within(work)
    assert done
    assert heard()


def test_what_is_ignored_stays_so() -> None:
    signal.signal(signal.SIGTERM, signal.SIG_IGN)
    within(lambda _: signal.raise_signal(signal.SIGTERM))
    assert signal.getsignal(signal.SIGTERM) is signal.SIG_IGN
