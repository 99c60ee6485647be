"""Whose turn it is to talk to a node's SDO server: one transfer at a time, and a stop before all of them.

A transfer is a `Talk` with the server. It has the turn until it is over, or until a stop takes it away: `Turns.stop`
waits for nobody. What was asked before is then answered in vain, and it is up to its owner to begin anew.

Answers carry no number, only the object, and segments not even that. So what can be known of them is used:
a server answers in the order in which it is asked, and what has come before a frame is sent does not answer it.
"""

from __future__ import annotations

import contextlib
import enum
import struct
from collections import deque
from collections.abc import Callable, Iterator
from typing import TypeVar

import can

from schwung.clock import Clock
from schwung.errors import BusError
from schwung.fieldbus.canopen import abort
from schwung.fieldbus.canopen.abort import (
    AbortedError,
    BrokenError,
    OverruledError,
    PreemptedError,
    SilenceError,
)
from schwung.fieldbus.canopen.link import Link

T = TypeVar("T")
Fits = Callable[[bytes], bool]

ABORT, WRITTEN = 0x80, 0x60  # command specifiers of the server; the client's abort is the same
_NAMELESS = bytes(3)  # some servers do not say which object they abort
_QUIET_S = 0.1  # when a server that sent many frames is silent for so long, no more are under way
_DRAINED_S = 3.0  # the rest of a broken block has passed by at the latest


class Outcome(enum.Enum):
    """What became of a write that was asked for once. True where it was confirmed, and only there."""

    CONFIRMED = "confirmed"
    REFUSED = "refused"
    NOT_ANSWERED = "not answered"  # it may have been carried out all the same

    def __bool__(self) -> bool:
        return self is Outcome.CONFIRMED


class Talk:
    """One transfer's talk with the server about one object; it may take several attempts.

    All that sends or receives raises PreemptedError once the turn has been lost, and what sends BusError.
    """

    def __init__(self, turns: Turns, multiplexer: bytes, *, writes: bool) -> None:
        self.multiplexer, self.writes = multiplexer, writes
        self.timeout_s = 0.0  # how long an answer may take
        self.open = False  # the server may hold a transfer of several frames, which somebody has to end
        self.accepted = False  # the server has taken up this attempt
        self.in_block = False  # and it is a block transfer
        self.begun = self.preempted = self.overruled = False
        self._turns = turns
        self._asked = self._answered = 0  # requests that name the object; the reader alone counts answers
        self._frames: deque[bytes] = deque()
        self._came = turns.clock.event()

    @property
    def unanswered(self) -> int:
        """Requests, of all attempts, whose answer has not come: it may still, or be lost."""
        return self._asked - self._answered

    def request(self, frame: bytes, fits: Fits) -> bytes:
        """Ask for the object; the answer that names it and fits. Raises AbortedError, SilenceError."""
        self._turns.send(self, frame, asks=True)
        answer = self.answer(lambda answer: answer[1:4] == self.multiplexer and fits(answer))
        self.accepted = True
        return answer

    def send(self, frame: bytes) -> None:
        """Go on. Raises AbortedError where the server has ended the transfer; all else that has come is late."""
        while self._frames:
            self.check(self._frames.popleft())
        self._turns.send(self, frame)

    def answer(self, fits: Fits) -> bytes:
        """The next frame that fits; others belong to what went before. Raises AbortedError, SilenceError."""
        now = self._turns.clock.now
        end = now() + self.timeout_s
        while (frame := self.receive(end - now())) is not None:
            self.check(frame)
            if fits(frame):
                return frame
        raise SilenceError("no SDO response")

    def receive(self, timeout_s: float) -> bytes | None:
        """The server's next frame of 8 bytes; None where none comes in time."""
        self._came.clear()
        if not self._frames and not self.preempted:
            self._came.wait(timeout_s)
        if self.preempted:
            raise PreemptedError
        return self._frames.popleft() if self._frames else None

    def check(self, frame: bytes) -> None:
        """Raises AbortedError for an abort of this object, or of none."""
        if frame[0] == ABORT and frame[1:4] in (self.multiplexer, _NAMELESS):
            raise AbortedError(struct.unpack_from("<I", frame, 4)[0])

    def carry_out(self, action: Callable[[Talk], T]) -> T:
        """One attempt. On every way out on which the server may still hold the transfer, it is told the end of it.

        Raises what the action raises.
        """
        self.open = self.accepted = self.in_block = False
        try:
            result = action(self)
        except BaseException as error:
            if self.in_block:
                self._turns.noisy = True
            if isinstance(error, BrokenError):
                self._tell(error.told)
            elif isinstance(error, SilenceError):
                self._tell(abort.TIMED_OUT)
            elif self.open and not isinstance(error, AbortedError | PreemptedError):
                self._tell(abort.GENERAL)  # Ctrl-C: the server shall not go on
            raise
        finally:
            self.open = False
        return result

    def drain(self) -> None:
        """Let pass by what is left of a broken block: its segments could be taken for the answers to what follows."""
        now = self._turns.clock.now
        end = now() + _DRAINED_S
        while self.receive(_QUIET_S) is not None and now() < end:
            pass
        self._turns.noisy = False

    def settle(self, patience_s: float) -> None:
        """Wait for the answers to requests that were repeated: the next request of this object could get them."""
        self._turns.clock.wait(lambda: self.unanswered == 0 or self.preempted, patience_s)

    def hear(self, frame: bytes) -> None:
        """The reader has a frame."""
        names_it = frame[1:4] == self.multiplexer or (frame[0] == ABORT and frame[1:4] == _NAMELESS)
        if names_it and self._answered < self._asked:
            self._answered += 1
        self._frames.append(frame)
        self._came.set()

    def ask(self) -> None:
        """A request that names the object is about to be sent."""
        self._asked += 1

    def begin(self) -> None:
        """The turn has been given."""
        self._frames.clear()
        self.begun, self.preempted = True, False

    def interrupt(self) -> None:
        """The turn has been taken away."""
        self.preempted = True
        self._came.set()

    def _tell(self, code: int) -> None:
        with contextlib.suppress(PreemptedError, BusError):
            self._turns.send(self, abort_frame(self.multiplexer, code))


class _Stop:
    """A write that waits for its confirmation; earlier requests of the same object may have answers due before."""

    def __init__(self, clock: Clock, multiplexer: bytes, timeout_s: float) -> None:
        self.over = clock.event()
        self.until_s = clock.now() + timeout_s
        self.outcome = Outcome.NOT_ANSWERED
        self.owed = 0  # answers that are due before
        self.owed_to_writes = False  # so that they look like its own
        self.after_block = False  # segments may still come whose bytes look like anything
        self._multiplexer = multiplexer

    def hears(self, frame: bytes) -> bool:
        """True where the frame was for it, or answers an earlier request of its object."""
        if (
            self.over.is_set()
            or frame[1:4] != self._multiplexer
            or (self.after_block and not _is_plain(frame))
        ):
            return False
        written, aborted = frame[0] == WRITTEN, frame[0] == ABORT
        if self.owed and (self.owed_to_writes or not written):
            self.owed -= 1
            return True
        if written or aborted:
            self.outcome = Outcome.CONFIRMED if written else Outcome.REFUSED
            self.over.set()
        return written or aborted


class Turns:
    """What the talks with one server share. `close` ends listening."""

    def __init__(self, link: Link, node_id: int) -> None:
        self.clock = clock = link.clock
        self.noisy = False  # a block was broken off, of which segments may still come
        self._link, self._node_id = link, node_id
        self._one = clock.lock()  # of several threads' transfers, one at a time
        self._sending = clock.lock()  # held for a frame, never for an answer
        self._turn: Talk | None = None
        self._underway: list[Talk] = []  # have the turn, wait for it, or have lost it
        self._stops: tuple[_Stop, ...] = ()
        link.subscribe(0x580 + node_id, self._on_frame)

    def close(self) -> None:
        """Stop listening."""
        self._link.unsubscribe(0x580 + self._node_id, self._on_frame)

    @contextlib.contextmanager
    def underway(self, talk: Talk) -> Iterator[None]:
        """Within, no other thread's transfer is: it waits at the door. A stop from now on concerns this one."""
        with self._sending:
            self._underway.append(talk)
        try:
            with self._one:
                yield
        finally:
            with self._sending:
                self._underway.remove(talk)
                if self._turn is talk:
                    self._turn = None

    def take(self, talk: Talk) -> None:
        """Give it the turn, when no stop waits for its answer any more.

        One that still has the turn waits further down in this very thread: a timer or a frame has called us. It is
        interrupted as by a stop. Raises OverruledError.
        """
        late: tuple[_Stop, ...] = ()
        while True:
            with self._sending:
                if talk.overruled:
                    raise OverruledError
                ahead = tuple(s for s in self._stops if not s.over.is_set() and s not in late)
                if not ahead:
                    for stop in late:
                        stop.over.set()
                    if self._turn is not talk:
                        self._interrupt(self._turn)
                    self._overrule(talk.multiplexer, lambda other: other.begun and talk.writes, talk)
                    self._turn = talk
                    talk.begin()
                    return
            for stop in ahead:
                stop.over.wait(stop.until_s - self.clock.now())
            late += ahead

    def send(self, talk: Talk, frame: bytes, *, asks: bool = False) -> None:
        """Send a frame in its turn. Raises PreemptedError, BusError."""
        with self._sending:
            if talk.preempted or self._turn is not talk:
                raise PreemptedError
            if asks:
                talk.ask()
            self._send(frame)

    def stop(self, multiplexer: bytes, frame: bytes, timeout_s: float) -> Outcome:
        """Send the frame of an expedited download now, whoever has the turn, and wait for its answer.

        A write of the same object that is under way, or waits to be, is not begun again. Raises BusError.
        """
        talking = self._turn
        if talking is not None:
            talking.preempted = True  # before the lock is waited for: it sends nothing more
        stop = _Stop(self.clock, multiplexer, timeout_s)
        try:
            with self._sending:
                former, self._turn = self._turn, None
                replaced = [talk for talk in self._underway if talk.begun and talk.multiplexer == multiplexer]
                stop.owed = sum(talk.unanswered for talk in replaced)
                stop.owed_to_writes = any(talk.writes for talk in replaced)
                self._stops += (stop,)
                self._overrule(multiplexer, lambda other: True)
                self._interrupt(former)
                stop.after_block = self.noisy
                self._send(frame)
            stop.over.wait(timeout_s)
            return stop.outcome
        finally:
            stop.over.set()
            with self._sending:
                self._stops = tuple(s for s in self._stops if s is not stop)

    def _send(self, frame: bytes) -> None:
        self._link.send(0x600 + self._node_id, frame)

    def _overrule(
        self, multiplexer: bytes, concerns: Callable[[Talk], bool], but: Talk | None = None
    ) -> None:
        for other in self._underway:
            if other is not but and other.writes and other.multiplexer == multiplexer and concerns(other):
                other.overruled = True

    def _interrupt(self, talk: Talk | None) -> None:
        """Take its turn away. A server that holds a transfer of several frames is told its end, for others' sake."""
        if talk is None:
            return
        talk.interrupt()
        self.noisy = self.noisy or talk.in_block
        if talk.open:
            with contextlib.suppress(BusError):
                self._send(abort_frame(talk.multiplexer, abort.GENERAL))

    def _on_frame(self, message: can.Message) -> None:
        frame = bytes(message.data).ljust(8, b"\0")
        if any(stop.hears(frame) for stop in self._stops):
            return
        talk = self._turn
        if talk is not None:
            talk.hear(frame)


def abort_frame(multiplexer: bytes, code: int) -> bytes:
    """SDO abort by the client (CiA 301 clause 7.2.4.3.18)."""
    return bytes([ABORT]) + multiplexer + struct.pack("<I", code)


def _is_plain(frame: bytes) -> bool:
    """An abort, or a confirmation whose reserved bytes are 0 as they shall be."""
    return frame[0] == ABORT or frame[4:] == bytes(4)
