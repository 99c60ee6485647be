"""Defects that the tool once had, put back one at a time: does the campaign find them?

Each is the smallest change that makes the tool do again what it did. They name the tool's own parts and are meant to
break when those change: then the defect has to be put back in another place.
"""

from __future__ import annotations

import contextlib
import sys
from collections.abc import Callable
from typing import Any

from schwung.commissioning import procedure
from schwung.errors import DriveError, StateError
from schwung.fieldbus import cia402, walker
from schwung.fieldbus.canopen import nmt, setup, sync
from schwung.fieldbus.canopen.dialogue import Dialogue
from schwung.fieldbus.canopen.exchange import Exchange
from schwung.fieldbus.canopen.operation import Operation
from schwung.fieldbus.canopen.output import Output
from schwung.fieldbus.canopen.stopping import Stopping
from schwung.fieldbus.cia402 import State
from schwung.fieldbus.modbus import link, state_machine
from schwung.fieldbus.modbus.state_machine import StateMachine

_LOOKED_S = 0.05


def _not_latched() -> None:
    """The frame that stops is held, but what is played goes on, and what is held next overwrites it."""

    def latch(self: Any, controlword: int) -> bytes:
        self._held = self._stop_frame.frame(self.last or self._held, controlword)
        return self._held

    Output.latch = latch  # type: ignore[method-assign]


def _target_of_the_start() -> None:
    """The frame that stops has the target that was held before the motion."""

    def latch(self: Any, controlword: int) -> bytes:
        self._held = self._stop_frame.frame(self._held, controlword)
        self._frames, self._latched = [], True
        return self._held

    Output.latch = latch  # type: ignore[method-assign]


def _refused_statusword_is_off() -> None:
    """6041 that is refused counts as 0."""
    shown = Dialogue.statusword
    Dialogue.statusword = lambda self: shown(self) or 0  # type: ignore[method-assign]


def _unknown_is_off() -> None:
    """A statusword of no known state counts as Not ready to switch on."""
    decode = cia402.decode

    def decoded(word: int | None) -> State:
        state = decode(word)
        return State.NOT_READY if state is State.UNKNOWN and word is not None else state

    cia402.decode = decoded


def _refused_position_is_zero() -> None:
    """6064 that is refused counts as 0; what commands a drive without power asks for it where PDOs are not answered."""

    def position(self: Any) -> int:
        found = self.cyclic.position if self.cyclic is not None else None
        return found if found is not None else self._sdo.read_integer(0x6064, 0, "INTEGER32") or 0

    def target(self: Any, cyclic: Any) -> int:
        at_rest = self.state() in (*cia402.OFF, State.READY, State.SWITCHED_ON)
        held: int | None = cyclic.target
        return position(self) if at_rest or held is None else held

    Dialogue.position = position  # type: ignore[method-assign]
    Dialogue._target = target  # type: ignore[method-assign]


def _reaction_is_off() -> None:
    """Fault reaction active counts as off."""
    cia402.OFF = (*cia402.OFF, State.FAULT_REACTION)  # type: ignore[assignment]


def _deaf_to_another_127() -> None:
    """Nobody listens for another master that beats as we do."""
    nmt.OtherMasters.require_none = lambda self: None  # type: ignore[method-assign]
    nmt.OtherMasters._on_heartbeat = lambda self, message: None  # type: ignore[method-assign]


def _mode_seen_too_late() -> None:
    """6061 is looked at when the drive is energised already."""
    require = Operation._require_mode

    def enable(self: Any) -> None:
        cyclic, _ = self._running()
        self._dialogue.walker.climb(State.OPERATION_ENABLED, self._require_untroubled)
        require(self, cyclic)

    Operation.enable = enable  # type: ignore[method-assign]


def _no_approach() -> None:
    """The first setpoint is given at once, however far it is."""
    Operation._approach = lambda self, cyclic, first, *, armed: None  # type: ignore[method-assign]


def _no_consumer() -> None:
    """The drive is not told to watch our heartbeat."""
    heartbeats = setup._heartbeats
    setup._heartbeats = lambda *given: [wanted for wanted in heartbeats(*given) if wanted[0] != 0x1016]


def _not_put_back() -> None:
    """After an error the parameters stay as they are."""
    leave = procedure._leave

    def left(drive: Any, journal: Any) -> list[str]:
        if sys.exc_info()[0] is not None:
            journal.restore = lambda: None
        return leave(drive, journal)

    procedure._leave = left


def _quick_stop_by_sdo_first() -> None:
    """The SDO's quick stop comes before an RPDO that the drive still holds: the one that stops waits for its turn, the
    SDO does not wait for the SYNC after it, and that SYNC goes out whatever came since the RPDO before it, and where it
    is not answered as well."""

    def latch(self: Any, word: int) -> None:
        self._output.latch(word)
        raise StateError("defect", "what waits for the SYNC is skipped")

    sync._PythonProducer.latch = latch  # type: ignore[method-assign]
    sync._PythonProducer._is_last_wanted = lambda _self: True  # type: ignore[method-assign]
    sync._PythonProducer.send_awaited_sync = lambda _self: True  # type: ignore[method-assign]
    Stopping._end_unanswered = lambda _self, _outcome: None  # type: ignore[method-assign]


def _stops_when_somebody_looks() -> None:
    """Trouble is noted, and what goes out goes on until the one who has to see to it does."""

    def report(self: Any, error: DriveError) -> None:
        if self.trouble is None:
            self.trouble = error

    Exchange.report = report  # type: ignore[method-assign]


def _brought_up_again() -> None:
    """A drive that falls back on its way up is brought up again."""

    def climb(self: Any, wanted: State, check: Callable[[], None], sent: int = -1) -> None:
        access, previous, since = self._access, None, self._clock.now()
        while True:
            word = access.statusword()
            state = cia402.decode(word)
            check()
            if state is wanted:
                return
            if state is not previous:
                previous, since = state, self._clock.now()
            step = cia402.next_controlword(state, wanted)
            hopeless = step is None and state is not State.UNKNOWN
            if hopeless or self._clock.now() - since > self._patience_s:
                raise access.stuck(word, max(sent, 0), wanted)
            if step is None or step == sent:
                access.pause()
            else:
                access.command(step)
                sent = step

    walker.Walker.climb = climb  # type: ignore[method-assign]


def _stops_from_what_was_not_sent() -> None:
    """The frame that stops has the target of one that could not be sent; as it was when trouble was looked for twenty
    times a second, while one frame after another was not sent: today the first of them latches the stop."""
    _stops_when_somebody_looks()
    waiting = sync.wait_while_playing

    def looking(over: Callable[[], bool], exchange: Any, *rest: Any) -> None:
        while not exchange.link.clock.wait(over, _LOOKED_S) and exchange.trouble is None:
            pass
        waiting(over, exchange, *rest)

    sync.wait_while_playing = looking
    following = Output.next

    def next_(self: Any) -> Any:
        outgoing = following(self)
        self.last = outgoing.frame
        return outgoing

    Output.next = next_  # type: ignore[method-assign]


def _one_quick_stop() -> None:
    """A halt writes its quick stop once, and swallows what becomes of it; as it was when busy was a refusal: today the
    link asks a busy drive again."""
    _busy_is_a_refusal()

    def stop_moving(self: Any) -> None:
        with contextlib.suppress(Exception):
            self.command(cia402.QUICK_STOP)
        with contextlib.suppress(Exception):
            self._on_halt()

    StateMachine._stop_moving = stop_moving  # type: ignore[method-assign]


def _busy_is_a_refusal() -> None:
    """Exceptions 5 and 6 end a request as any other does."""
    link.ACKNOWLEDGE = link.BUSY = -1


def _standstill_in_counts() -> None:
    """An axis that has turned by 50 counts or less in 50 ms stands, whatever a count is worth."""
    state_machine._STILL_RAD = 50.0
    made = StateMachine.__init__

    def make(self: Any, *given: Any) -> None:
        made(self, *given[:-1], lambda: 1.0)

    StateMachine.__init__ = make  # type: ignore[method-assign]


DEFECTS: dict[str, Callable[[], None]] = {
    "not-latched": _not_latched,
    "target-of-the-start": _target_of_the_start,
    "refused-statusword-is-off": _refused_statusword_is_off,
    "unknown-is-off": _unknown_is_off,
    "refused-position-is-zero": _refused_position_is_zero,
    "reaction-is-off": _reaction_is_off,
    "deaf-to-another-127": _deaf_to_another_127,
    "mode-seen-too-late": _mode_seen_too_late,
    "no-approach": _no_approach,
    "no-consumer": _no_consumer,
    "not-put-back": _not_put_back,
    "quick-stop-by-sdo-first": _quick_stop_by_sdo_first,
    "stops-when-somebody-looks": _stops_when_somebody_looks,
    "brought-up-again": _brought_up_again,
    "stops-from-what-was-not-sent": _stops_from_what_was_not_sent,
    # Modbus
    "one-quick-stop": _one_quick_stop,
    "busy-is-a-refusal": _busy_is_a_refusal,
    "standstill-in-counts": _standstill_in_counts,
}
