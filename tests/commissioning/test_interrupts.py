"""One interrupt gets through, none is lost, and nobody is deaf to the next one afterwards, whenever it comes."""

from __future__ import annotations

import signal
from collections.abc import Callable, Iterator
from types import FrameType
from typing import Any

import pytest

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


def test_the_first_gets_through_and_no_other() -> None:
    def work(_: OneInterrupt) -> None:
        try:
            signal.raise_signal(signal.SIGINT)
        finally:
            signal.raise_signal(signal.SIGINT)
            done.append(True)

    done: list[bool] = []
    with pytest.raises(KeyboardInterrupt):
        within(work)
    assert done
    assert heard()


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
