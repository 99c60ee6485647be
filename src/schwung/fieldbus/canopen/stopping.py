"""Stopping one drive: quick stop from any thread, fault reset, switching off; and what may follow on it.

A halt that was asked for is answered by `disable`: until then nothing is started again, whoever goes on without having
heard of it.
"""

from __future__ import annotations

import contextlib
from collections.abc import Callable

from schwung.errors import BusError, DriveError, InputError, StateError
from schwung.fieldbus import cia402
from schwung.fieldbus.braking import Slowing, unseen_s
from schwung.fieldbus.canopen import nmt
from schwung.fieldbus.canopen.dialogue import CONTROLWORD, STANDSTILL_S, Dialogue
from schwung.fieldbus.canopen.emcy import describe_code
from schwung.fieldbus.canopen.link import Link
from schwung.fieldbus.canopen.own_means import OwnMeans
from schwung.fieldbus.canopen.sdo import Outcome, SdoChannel
from schwung.fieldbus.cia402 import State
from schwung.fieldbus.drive import DriveLimits
from schwung.fieldbus.walker import PATIENCE_S

_HALT_S = 1.0  # another thread that is at it already is waited for so long
_HALT_TRIES = 3
_BRAKING = (State.QUICK_STOP_ACTIVE, State.FAULT_REACTION)
_SETTLED_S = 0.2  # what is in operation and does not stand within that is stopped before it is switched off


class Stopping:
    """The ways of one drive to rest, and off."""

    def __init__(
        self,
        link: Link,
        sdo: SdoChannel,
        monitor: nmt.NodeMonitor,
        dialogue: Dialogue,
        own_means: OwnMeans,
        read_count_rad: Callable[[], float],
    ) -> None:
        self._read_count_rad = read_count_rad
        self.moved = False  # something has been played since `begin`
        self.fastest_rad_s = 0.0  # of what was to be played
        self._link, self._clock, self._sdo, self._monitor = link, link.clock, sdo, monitor
        self._dialogue, self._own_means, self._place = dialogue, own_means, dialogue.place
        self._lock = self._clock.lock()
        self._halting = False
        self._halts = self._halts_answered = 0  # asked for, and followed by `disable`
        self._stopped_s: float | None = None  # when the first quick stop since `begin` was sent
        self._count_rad: float | None = None
        self._deceleration_rad_s2: float | None = None
        self._stays = False  # in Quick stop active

    @property
    def stopped(self) -> bool:
        """A quick stop has been sent since `begin`."""
        return self._stopped_s is not None

    def begin(self, count_rad: float, limits: DriveLimits) -> None:
        """The exchange starts: nothing has moved, nothing has been stopped. `count_rad`: worth of a position count;
        `limits`: how hard the drive brakes, where it tells, and where that leaves it."""
        self._count_rad, self._deceleration_rad_s2 = count_rad, limits.stop_deceleration_rad_s2
        self._stays = limits.quick_stop_option in cia402.STAY_STOPPED
        self._stopped_s, self.moved, self.fastest_rad_s = None, False, 0.0

    def require_not_halted(self) -> None:
        """Raise StateError where nothing has been switched off since a halt: whoever goes on has not heard of it."""
        if self._halts > self._halts_answered:
            raise StateError(self._place, "was stopped on request (halt)", "Disable it, then start it anew.")

    def halt(self) -> None:
        """Quick stop by RPDO and SDO, until the drive shows that it has left operation. Never raises.

        What goes out is latched: whoever else speaks to the drive meanwhile, nothing enables it again before it has
        been switched off (`disable`) and is started anew, or `reset_fault`.
        """
        with self._lock:
            self._halts += 1
        self.quick_stop()

    def quick_stop(self) -> None:
        """As `halt`, on our own account: no one has asked for it who would have to be answered. Never raises."""
        with self._lock:
            first, self._halting = not self._halting, True
        if not first:
            self._clock.wait(lambda: not self._halting, _HALT_S)
            return
        try:
            self._halt()
        finally:
            self._halting = False

    def _halt(self) -> None:
        cyclic = self._dialogue.cyclic
        if self._stopped_s is None:
            self._stopped_s = self._clock.now()
        if cyclic is not None:  # also while it is being enabled: nothing goes on from here but off
            cyclic.exchange.guarded = False
            cyclic.exchange.report(StateError(self._place, "was stopped on request (halt)", "Start it anew."))
            with contextlib.suppress(Exception):
                cyclic.producer.latch(cia402.QUICK_STOP)
                cyclic.pump(0.0)  # a frame that the drive holds for its SYNC would undo what comes by SDO
        heard = answered = False
        for _ in range(_HALT_TRIES):
            if self._monitor.nmt == "STOPPED" and not answered:  # where neither PDO nor SDO reaches it
                self._command_node(nmt.PRE_OPERATIONAL)
            outcome = Outcome.NOT_ANSWERED
            if cyclic is None or cyclic.producer.send_awaited_sync():
                outcome = self._sdo.write_once(CONTROLWORD, cia402.QUICK_STOP, 0.2)
                self._end_unanswered(outcome)
            answered = outcome is not Outcome.NOT_ANSWERED
            heard = heard or answered
            if cyclic is not None and self._is_to_be_started(outcome):
                self._command_node(
                    nmt.START
                )  # where the RPDO that says the same is heard, ahead of one from before
                with contextlib.suppress(Exception):
                    cyclic.producer.latch(cia402.QUICK_STOP)
            self._own_means.kill()
            if cyclic is None:
                if heard:
                    break
                continue
            with contextlib.suppress(Exception):
                cyclic.pump(0.01)
                if cyclic.answering and self._dialogue.state() is not State.OPERATION_ENABLED:
                    break
        if cyclic is not None:
            if not heard and not cyclic.answering:
                self._sdo.assume_silent()
            else:
                with contextlib.suppress(Exception):
                    self._comes_to_rest(Slowing())

    def _end_unanswered(self, outcome: Outcome) -> None:
        """No SYNC any more, where it was not answered and the quick stop was taken by SDO: a drive that stays in it
        would go back into operation by a frame that it holds for the next SYNC that it hears."""
        cyclic = self._dialogue.cyclic
        if self._stays and outcome is Outcome.CONFIRMED and cyclic is not None and not cyclic.answering:
            cyclic.producer.stop()

    def _is_to_be_started(self, outcome: Outcome) -> bool:
        """A node that takes no RPDO, where the quick stop was not taken by SDO: it has to hear the RPDO. But not where
        it answers that its drive has left operation: it would take our frames as it is set up now, perhaps anew.
        """
        if outcome is Outcome.CONFIRMED or self._monitor.nmt == "OPERATIONAL":
            return False
        if outcome is Outcome.REFUSED:
            with contextlib.suppress(DriveError):
                return self._dialogue.state() in (State.OPERATION_ENABLED, State.UNKNOWN)
        return True

    def _command_node(self, command: int) -> None:
        with contextlib.suppress(BusError):
            nmt.send_command(self._link, command, self._sdo.node_id)

    def reset_fault(self) -> None:
        """Fault reset, then Switch on disabled and nothing more. What is energised comes to rest first.

        A halt that comes meanwhile is not forgotten.
        """
        cyclic, halts = self._dialogue.cyclic, self._halts
        self.disable()
        for word in (cia402.DISABLE_VOLTAGE, cia402.FAULT_RESET, cia402.DISABLE_VOLTAGE):
            self._dialogue.command(word)
        end = self._clock.now() + PATIENCE_S
        while self._dialogue.state() in (State.FAULT, State.FAULT_REACTION):
            if self._halts > halts:
                break
            if self._clock.now() > end:
                code = self._sdo.read_integer(0x603F, 0, "UNSIGNED16") or 0
                raise StateError(
                    self._place, f"the fault cannot be reset, its cause is still there ({describe_code(code)})",
                    "Remove the cause.",
                )  # fmt: skip
            self._dialogue.command(cia402.DISABLE_VOLTAGE)
        with self._lock:
            if self._halts == halts:
                self._stopped_s = None
                if (
                    cyclic is not None and cyclic.exchange.recorder is None
                ):  # else a motion has yet to hear of it
                    cyclic.producer.release()
                    cyclic.exchange.clear()
        self.require_not_halted()

    def disable(self) -> None:
        """Standstill, then power stage off, as the drive shows it. Raises StateError where that is not sure.

        Its own brake gets as long as it needs. Raises CoastingError where the axis turned on and no longer slowed down:
        the power stage is off then.
        """
        cyclic, halts, resting, slowing = self._dialogue.cyclic, self._halts, True, Slowing()
        try:
            if cyclic is not None:
                cyclic.pump(0.0)
            state = self._dialogue.state()
            if state in (State.OPERATION_ENABLED, State.UNKNOWN):
                resting = self.stands(_SETTLED_S, self.troubled)
            elif state in _BRAKING:
                resting = self._comes_to_rest(Slowing())
            if not resting:
                self.quick_stop()
                resting = self._comes_to_rest(slowing) or not self._energised()
        except DriveError:  # unseen it gets as long to come to rest, and is switched off all the same
            resting = True  # as far as one knows
            if self._stopped_s is None:
                self.quick_stop()
            if self.moved and self._stopped_s is not None:
                wait_s = unseen_s(self.fastest_rad_s, self._deceleration_rad_s2)
                self._dialogue.wait(self._stopped_s + wait_s - self._clock.now())
        self._dialogue.walker.off()
        self._halts_answered = halts
        if not resting:
            raise slowing.given_up(self._place, self._worth())

    def stands(self, patience_s: float = STANDSTILL_S, until: Callable[[], bool] | None = None) -> bool:
        """See Dialogue.await_standstill."""
        return self._dialogue.await_standstill(self._worth(), patience_s, until)

    def _comes_to_rest(self, slowing: Slowing) -> bool:
        """As `stands`, for as long as the drive brakes."""
        return self._dialogue.await_standstill(self._worth(), slowing=slowing)

    def _worth(self) -> float | None:
        """Of a position count (rad), asked for where nothing has been started yet; None where nobody tells."""
        if self._count_rad is None:
            with contextlib.suppress(DriveError, InputError):
                self._count_rad = self._read_count_rad()
        return self._count_rad

    def _energised(self) -> bool:
        return self._dialogue.state() not in cia402.OFF

    def troubled(self) -> bool:
        """Something has come up since the exchange was started, a halt among it."""
        cyclic = self._dialogue.cyclic
        return cyclic is not None and cyclic.exchange.trouble is not None
