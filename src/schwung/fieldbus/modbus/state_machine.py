"""The CiA 402 state machine of a Modbus drive: looked at, climbed, left; and halted, for good, whatever comes between.

A controlword that starts something is written once, and never over a connection that came back, nor after a halt. One
that stops is repeated until the statusword agrees. Whoever waits here notices a fault, a halt and a lost connection,
and raises.
"""

from __future__ import annotations

import contextlib
import math
from collections.abc import Callable

from schwung.errors import BusError, DriveError, DriveFaultError, NodeLostError, RegisterError, StateError
from schwung.fieldbus import cia402
from schwung.fieldbus.braking import Slowing
from schwung.fieldbus.cia402 import State
from schwung.fieldbus.modbus.registers import Registers
from schwung.fieldbus.profile import ObjectRef
from schwung.fieldbus.profile import State as StateRegisters
from schwung.fieldbus.walker import Access, Walker

POLL_S = 0.005
_HALT_S, _HALT_ATTEMPTS = 2.0, 3  # a drive that follows no quick stop for so long is not reached by one more
_MODE_S = 0.5
_FAULT_S = 2.0  # for a fault's reaction, and for its reset
_STANDSTILL_S = 3.0
_STILL_FOR_S = 0.05
_STILL_RAD = 1e-3  # within _STILL_FOR_S: slower than 0.02 rad/s; of coarse counts as slow, so longer
_FAULTY = (State.FAULT, State.FAULT_REACTION)


class StateMachine:
    """The state machine of one drive. `on_halt` is called with every quick stop of ours: the generator goes off.
    `position` reads where the axis is, and `count_rad` what one count of that is; NaN where that is not known."""

    def __init__(
        self,
        registers: Registers,
        state: StateRegisters,
        on_halt: Callable[[], None],
        position: Callable[[], int],
        count_rad: Callable[[], float],
    ) -> None:
        self._registers, self._state, self._on_halt = registers, state, on_halt
        self._position, self._count_rad = position, count_rad
        self._clock = registers.link.clock
        self._place = f"unit {registers.link.unit}"
        self._may_move = False
        self._losses_seen = 0
        self._halted = self._clock.event()
        self._halts = 0
        registers.link.on_reconnect = self._after_loss

    # ── looking ──────────────────────────────────────────────────────────────────────────────────────────────────

    def statusword(self) -> int:
        """As the drive tells it now. Raises RegisterError, NodeLostError."""
        return self._registers.integer(self._state.statusword)

    def look(self) -> int:
        """The statusword, asked for once. Raises RegisterError, NodeLostError."""
        return self._registers.integer(self._state.statusword, again=False)

    def state(self) -> State:
        """The state now; `UNKNOWN` where the drive refuses to show it, or shows what the standard does not know.

        Raises RegisterError where it does not answer, NodeLostError.
        """
        return cia402.decode(self._shown())

    def _shown(self) -> int | None:
        try:
            return self.statusword()
        except RegisterError as error:
            if error.code is None:
                raise
            return None

    def error_text(self) -> str:
        """The drive's error code in words; empty where it has none."""
        if self._state.error is None:
            return ""
        with contextlib.suppress(DriveError):
            code = self._registers.integer(self._state.error)
            return f"error {code} (0x{code:04X})" if code else ""
        return ""

    def check(self) -> int:
        """The statusword of a drive that is enabled and undisturbed. Raises what has happened to it otherwise."""
        word = self.statusword()
        self.require_undisturbed()
        state = cia402.decode(word)
        if state in _FAULTY:
            told = self.error_text()
            raise DriveFaultError(
                self._place,
                f"went into fault{f': {told}' if told else ''}",
                "Mend its cause, then reset the fault.",
            )
        if state is not State.OPERATION_ENABLED:
            why = "halted by us" if self._halted.is_set() else "by itself, or another master did it"
            raise StateError(
                self._place, f'left operation for "{state.value}" ({why})', "Look for another master."
            )
        return word

    def require_undisturbed(self) -> None:
        """Raise NodeLostError where the connection was lost since the drive was enabled, though it is back."""
        if self._registers.link.losses > self._losses_seen:
            raise NodeLostError(
                self._place,
                "the connection was lost; the drive was halted when it came back",
                "Check cable and network; nothing moves again by itself.",
            )

    # ── up ───────────────────────────────────────────────────────────────────────────────────────────────────────

    def command(self, controlword: int) -> None:
        """Write a controlword that stops or switches off, once."""
        self._registers.put(self._state.controlword, controlword)

    def advance(self, controlword: int) -> None:
        """Write a controlword that switches on or starts, once; as `start`."""
        self.start(self._state.controlword, controlword)

    def start(self, ref: ObjectRef, value: int) -> None:
        """Write what sets something moving, once, and not over a connection that came back meanwhile.

        Raises NodeLostError where the connection was lost since `enable`, StateError after a halt; it is not sent then.
        """
        self._registers.put(ref, value, self._require_free)

    def _require_free(self) -> None:
        self.require_undisturbed()
        if self._halted.is_set():
            raise StateError(self._place, "was halted", "Disable it, then enable it anew.")

    def enable(self, mode: int | None = None) -> None:
        """Operation enabled, in a mode that the drive shows before it is energised.

        Raises StateError naming what is missing, or after a halt that neither `disable` nor `reset_fault` has
        followed, DriveFaultError, EnergisedError where it is on, and not by us.
        """
        self._losses_seen = self._registers.link.losses
        self._require_free()
        if not self._may_move:
            self._walker(self.command).require_off()
        if mode is not None:
            self._require_mode(mode)

        def climb(controlword: int) -> None:
            self._may_move = True
            self.advance(controlword)

        self._walker(climb).climb(State.OPERATION_ENABLED, self._require_free)
        self._may_move = True  # also where it was on already

    def _require_mode(self, mode: int) -> None:
        """Mode display (6061), or where there is none the mode itself, as it is wanted. Raises StateError."""
        ref = self._state.mode_display or self._state.mode
        if ref is None:
            return
        end_s = self._clock.now() + _MODE_S
        while (shown := self._registers.integer(ref)) != mode:
            if self._clock.now() > end_s:
                raise StateError(
                    self._place,
                    f"mode {mode} was asked for, the drive shows {shown} (register {ref.index})",
                    "Write `setup` first; look for another master.",
                )
            self._clock.sleep(POLL_S)

    def _walker(self, command: Callable[[int], None]) -> Walker:
        def pause() -> None:
            self._clock.sleep(POLL_S)

        def commanded(controlword: int) -> None:
            command(controlword)
            pause()

        return Walker(self._clock, Access(self._place, self._shown, commanded, pause, self._stuck))

    def _stuck(self, word: int | None, sent: int, wanted: State) -> DriveError:
        reason = cia402.why_stuck(word, sent, wanted, error=self.error_text())
        faulty = cia402.decode(word) in _FAULTY
        return (DriveFaultError if faulty else StateError)(self._place, reason.problem, reason.remedy)

    # ── down ─────────────────────────────────────────────────────────────────────────────────────────────────────

    def halt(self) -> None:
        """Quick stop, and everything off that moves it, until the drive shows it; from then on nothing is started until
        `disable`. Never raises; from any thread, and from callbacks of the clock."""
        self._halts += 1
        self._halted.set()
        with contextlib.suppress(Exception):
            self._registers.link.when_free(self._stop_moving)

    def _stop_moving(self) -> None:
        """A stop may be repeated, and is, where it is refused, lost or not followed. Never raises."""
        end_s, attempts, stopped, quiet = self._clock.now() + _HALT_S, 0, False, False
        while not (stopped and quiet) and (attempts < _HALT_ATTEMPTS or self._clock.now() < end_s):
            if attempts:
                self._clock.sleep(POLL_S)
            attempts += 1
            try:
                self.command(cia402.QUICK_STOP)
            except (BusError, NodeLostError):
                continue  # nobody is there to be looked at
            except Exception:  # refused, not answered: it may have stopped all the same
                pass
            with contextlib.suppress(Exception):
                stopped = cia402.decode(self.look()) not in (State.OPERATION_ENABLED, State.UNKNOWN)
            if not quiet:
                with contextlib.suppress(Exception):
                    self._on_halt()
                    quiet = True

    def disable(self) -> None:
        """Power stage off, after standstill, and seen to be off. A fault is left as it is.

        Where nothing is on by our doing, a drive that shows so is left alone. Raises StateError where the power stage
        may still be on, or what kept the drive from telling; Disable Voltage has been sent then. Its own brake gets as
        long as it needs: CoastingError where the axis turned on and no longer slowed down, the power stage is off then.
        """
        halts, slowing = self._halts, Slowing()
        resting = self._switch_off(slowing)
        if self._halts == halts:  # one that came meanwhile is not over
            self._halted.clear()
        if not resting:
            raise slowing.given_up(self._place, self._count_rad())

    def _switch_off(self, slowing: Slowing) -> bool:
        """False where it was not at rest."""
        state: State | None = None
        with contextlib.suppress(DriveError):
            state = self.state()
        known = state is not None and state is not State.UNKNOWN
        if known and state not in cia402.ENERGISED and not self._may_move:
            return True
        if state not in (*cia402.OFF, State.QUICK_STOP_ACTIVE, State.FAULT_REACTION):
            self._stop_moving()
        resting = self._await_standstill(slowing)
        self._walker(self.command).off()
        self._may_move = False
        return resting

    def _await_standstill(self, slowing: Slowing) -> bool:
        """Until the axis has not moved for a while, or cannot be told; False where it turns on under power, and no
        longer slows down."""
        clock = self._clock
        end_s, since_s, at = clock.now() + _STANDSTILL_S, clock.now(), math.nan
        count_rad = abs(self._count_rad())
        still, still_for_s = 1.0, _STILL_FOR_S  # counts, and within which time no more
        if count_rad > 0:
            still_rad = max(_STILL_RAD, 1.5 * count_rad)
            still = still_rad / count_rad
            still_for_s = min(still_rad / _STILL_RAD * _STILL_FOR_S, _STANDSTILL_S / 2)
        seen = False
        while clock.now() - since_s < still_for_s:
            now = math.nan
            try:
                now = self._position()
            except (BusError, NodeLostError):
                return True  # nobody is there to be let go of
            except DriveError:
                pass
            seen = seen or not math.isnan(now)
            slows = slowing.look(clock.now(), now)
            if clock.now() >= end_s and not (slows and self._braking()):
                return not seen or not self._braking()
            if not abs(now - at) <= still:
                at, since_s = now, clock.now()
            clock.sleep(POLL_S)
        return True

    def _braking(self) -> bool:
        """It shows that it is under power, or does not show that it is not."""
        with contextlib.suppress(DriveError):
            return self.state() not in (*cia402.OFF, State.READY, State.SWITCHED_ON)
        return True

    def reset_fault(self) -> None:
        """Acknowledge a fault, once it has been reacted to. Ends in Switch on disabled; what moves comes to rest first.

        A halt before it is over with this, one that comes meanwhile is not. Raises StateError where the fault stays.
        """
        halts = self._halts
        if self.state() is not State.FAULT:
            self.disable()
        self._await(lambda state: state is not State.FAULT_REACTION, cia402.DISABLE_VOLTAGE)
        self.command(cia402.DISABLE_VOLTAGE)
        self.command(cia402.FAULT_RESET)
        self.command(cia402.DISABLE_VOLTAGE)
        self._await(lambda state: state is State.SWITCH_ON_DISABLED, cia402.FAULT_RESET)
        if self._halts == halts:
            self._halted.clear()

    def _await(self, reached: Callable[[State], bool], sent: int) -> None:
        end_s = self._clock.now() + _FAULT_S
        while not reached(cia402.decode(word := self._shown())):
            if self._clock.now() > end_s:
                raise self._stuck(word, sent, State.SWITCH_ON_DISABLED)
            self._clock.sleep(POLL_S)

    @property
    def may_move(self) -> bool:
        """The power stage may be on by our doing."""
        return self._may_move

    def _after_loss(self) -> None:
        """First thing on a new connection: what we had set moving stops, whatever became of it meanwhile."""
        if self._may_move:
            self._halted.set()
            self.command(cia402.QUICK_STOP)
            with contextlib.suppress(DriveError):
                self._on_halt()
