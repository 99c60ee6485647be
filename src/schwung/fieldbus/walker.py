"""Walking a drive through the CiA 402 state machine, on whatever bus it is: up to operation, and verifiably off.

Going up stops at the first disturbance. Going off does not: a state that cannot be read or that the standard does not
know is never taken for off; Disable Voltage is sent all the same, and what cannot be verified is raised.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

from schwung.clock import Clock
from schwung.errors import DriveError, EnergisedError, StateError
from schwung.fieldbus import cia402
from schwung.fieldbus.cia402 import State

#: A state that lasts longer than this is stuck (s); a brake that is released takes up to half a second.
PATIENCE_S = 2.0
#: So many times that, and a drive that keeps changing its state is given up: somebody switches it on again.
RESTLESS = 5
#: A drive that has not answered so often, each time for as long as the bus allows, is not waited for any longer.
SILENCES = 2
#: By which controlword of ours alone a drive gets up there.
_ENTERED_BY = {State.OPERATION_ENABLED: cia402.ENABLE_OPERATION, State.SWITCHED_ON: cia402.SWITCH_ON}
#: Steps down that a drive may do on a ramp of its own, before the voltage goes (605B, 605C).
_STEPS_DOWN = {State.OPERATION_ENABLED: cia402.SWITCH_ON, State.SWITCHED_ON: cia402.SHUTDOWN}


@dataclass(frozen=True)
class Access:
    """What a bus lends to the walker."""

    place: str  # "node 3"
    statusword: Callable[[], int | None]  # read now; None where the drive does not show it. Raises DriveError
    command: Callable[[int], None]  # a controlword that the drive is given time for. Raises DriveError
    pause: Callable[[], None]  # between two looks
    stuck: Callable[
        [int | None, int, State], DriveError
    ]  # of statusword, last controlword, wanted state: why


class Walker:
    """One drive's state machine, from outside."""

    def __init__(self, clock: Clock, access: Access, patience_s: float = PATIENCE_S) -> None:
        self._clock, self._access, self._patience_s = clock, access, patience_s

    def state(self) -> State:
        """The state now; `UNKNOWN` where the drive shows none. Raises DriveError where it does not answer."""
        return cia402.decode(self._access.statusword())

    def require_off(self) -> None:
        """Before the first command of ours: raise EnergisedError where the drive is on already. Nothing is sent."""
        state = self.state()
        if state in cia402.ENERGISED:
            raise self._on_by_another(state, "and it is left alone")

    def _on_by_another(self, state: State, then: str) -> EnergisedError:
        return EnergisedError(
            self._access.place,
            f'is in "{state.value}": somebody else has switched it on, {then}',
            "Switch it off there.",
        )

    def climb(self, wanted: State, check: Callable[[], None], sent: int = -1) -> None:
        """Step by step up to a state, by words that only rise: a drive that falls back is not sent up again, also not
        where it was on its way up before this climb. Where it shows the state before it was told to, that is an old
        frame or another's doing: it is waited for. `sent`: the last controlword of the climb that this one goes on.

        `check` raises what has come between. Raises StateError or DriveFaultError naming what is missing, and
        EnergisedError where another has switched it on.
        """
        access, previous, since = self._access, None, self._clock.now()
        while True:
            check()  # first, since it takes its time: the state is the one of now
            word = access.statusword()
            state = cia402.decode(word)
            if state is wanted and sent in (-1, _ENTERED_BY.get(wanted, sent)):
                return
            untold = state is wanted
            if untold:
                state = State.UNKNOWN
            if state is not previous:
                previous, since = state, self._clock.now()
            step = cia402.next_controlword(state, wanted)
            # an unknown state may be one on its way to the next
            hopeless = state is not State.UNKNOWN if step is None else step < sent
            if hopeless or self._clock.now() - since > self._patience_s:
                if untold:
                    raise self._on_by_another(wanted, "for we have not yet")
                raise access.stuck(word, max(sent, 0), wanted)
            if step is None or step == sent:
                access.pause()
            else:
                access.command(step)
                sent = step

    def off(self) -> None:
        """Switch off, and see twice that it is: Switch on disabled, or a fault that has been reacted to. A fault stays.
        One look could be at an old frame that came late.

        Call it when the axis stands: the voltage goes. Raises StateError where the power stage may still be on, or what
        kept the drive from answering; Disable Voltage has been sent then.
        """
        access, word = self._access, None
        began = since = self._clock.now()
        previous: State | None = None
        silences = 0
        while True:
            restless = self._clock.now() - began > RESTLESS * self._patience_s
            overdue = restless or self._clock.now() - since > self._patience_s
            try:
                word = access.statusword()
                state = cia402.decode(word)
                if state in cia402.OFF and state is previous:
                    return
                if state is not previous and not restless:
                    previous, since = state, self._clock.now()
                elif overdue:
                    break
                if (
                    state is State.FAULT_REACTION or state in cia402.OFF
                ):  # the reaction ends by itself, in Fault
                    access.pause()
                else:
                    access.command(_STEPS_DOWN.get(state, cia402.DISABLE_VOLTAGE))
            except DriveError:
                silences += 1
                self._insist()
                if overdue or silences >= SILENCES:
                    raise
        self._insist()
        shown = "no statusword" if word is None else f'statusword 0x{word:04X}, "{cia402.decode(word).value}"'
        raise StateError(
            access.place,
            f"may still be energised ({shown})",
            "Stay clear of the machine, press the emergency stop, then look at the drive.",
        )

    def _insist(self) -> None:
        """Voltage off, unseen: sent, whatever becomes of it."""
        try:
            self._access.command(cia402.DISABLE_VOLTAGE)
        except DriveError:
            self._access.pause()
