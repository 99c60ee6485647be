"""The CiA 402 state machine of a Modbus drive: looked at, climbed, left; and halted after a lost connection.

A controlword is written once, and one that starts something never over a connection that came back. Whoever waits here
notices a fault, a halt and a lost connection, and raises.
"""

from __future__ import annotations

import contextlib
import threading
import time
from collections.abc import Callable

from schwung.errors import DriveError, DriveFaultError, NodeLostError, StateError
from schwung.fieldbus import cia402
from schwung.fieldbus.cia402 import State
from schwung.fieldbus.modbus.registers import Registers
from schwung.fieldbus.profile import ObjectRef
from schwung.fieldbus.profile import State as StateRegisters

POLL_S = 0.005
_CLIMB_S = 5.0  # a brake takes its time
_STANDSTILL_S = 3.0
_STILL_FOR_S = 0.05


class StateMachine:
    """The state machine of one drive. `on_halt` is called with every quick stop of ours: the generator goes off."""

    def __init__(self, registers: Registers, state: StateRegisters, on_halt: Callable[[], None]) -> None:
        self._registers, self._state, self._on_halt = registers, state, on_halt
        self._place = f"unit {registers.link.unit}"
        self._may_move = False
        self._losses_seen = 0
        self._halted = threading.Event()
        registers.link.on_reconnect = self._after_loss

    # ── looking ──────────────────────────────────────────────────────────────────────────────────────────────────

    def statusword(self) -> int:
        """As the drive tells it now. Raises RegisterError, NodeLostError."""
        return self._registers.integer(self._state.statusword)

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
        if state in (State.FAULT, State.FAULT_REACTION):
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

    # ── moving between states ────────────────────────────────────────────────────────────────────────────────────

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
        link = self._registers.link
        with link.alone():
            self.require_undisturbed()
            if self._halted.is_set():
                raise StateError(self._place, "was halted", "Enable it again.")
            self._registers.put(ref, value)

    def enable(self) -> None:
        """Operation enabled. Raises StateError naming what is missing, DriveFaultError."""
        self._losses_seen = self._registers.link.losses
        self._halted.clear()
        deadline, sent = time.monotonic() + _CLIMB_S, -1
        while True:
            word = self.statusword()
            self.require_undisturbed()
            state = cia402.decode(word)
            if state is State.OPERATION_ENABLED:
                return
            step = cia402.next_controlword(state, State.OPERATION_ENABLED)
            if step is None or time.monotonic() > deadline or self._halted.is_set():
                raise self._stuck(word, sent, State.OPERATION_ENABLED)
            if step != sent:
                self._may_move = True
                self.advance(step)
                sent = step
            time.sleep(POLL_S)

    def _stuck(self, word: int, sent: int, wanted: State) -> DriveError:
        reason = cia402.why_stuck(word, max(sent, 0), wanted, error=self.error_text())
        faulty = cia402.decode(word) in (State.FAULT, State.FAULT_REACTION)
        return (DriveFaultError if faulty else StateError)(self._place, reason.problem, reason.remedy)

    def halt(self) -> None:
        """Quick stop, and everything off that moves it. Never raises; from any thread."""
        self._halted.set()
        with contextlib.suppress(Exception):
            self.command(cia402.QUICK_STOP)
        with contextlib.suppress(Exception):
            self._on_halt()

    def disable(self, position: Callable[[], int]) -> None:
        """Power stage off, after standstill. A fault is left as it is."""
        state = cia402.decode(self.statusword())
        if state in (State.FAULT, State.FAULT_REACTION):
            self._await_standstill(position)
            self._may_move = False
            return
        if state not in cia402.ENERGISED and not self._may_move:
            return  # nothing is on by our doing, nor at all
        if state is State.OPERATION_ENABLED:
            self.command(cia402.QUICK_STOP)
        self._await_standstill(position)
        self.command(cia402.DISABLE_VOLTAGE)
        deadline = time.monotonic() + _CLIMB_S
        while cia402.decode(word := self.statusword()) in cia402.ENERGISED:
            if time.monotonic() > deadline:
                raise self._stuck(word, cia402.DISABLE_VOLTAGE, State.SWITCH_ON_DISABLED)
            time.sleep(POLL_S)
        self._may_move = False

    @staticmethod
    def _await_standstill(position: Callable[[], int]) -> None:
        """Until the position has not changed by more than a few counts for a while, or it takes too long."""
        deadline = time.monotonic() + _STANDSTILL_S
        at, since = position(), time.monotonic()
        while time.monotonic() < deadline and time.monotonic() - since < _STILL_FOR_S:
            time.sleep(POLL_S)
            now = position()
            if abs(now - at) > 50:
                at, since = now, time.monotonic()

    def reset_fault(self) -> None:
        """Acknowledge a fault. Ends in Switch on disabled. Raises StateError where it stays."""
        self.command(cia402.DISABLE_VOLTAGE)
        self.command(cia402.FAULT_RESET)
        self.command(cia402.DISABLE_VOLTAGE)
        deadline = time.monotonic() + 1.0
        while cia402.decode(word := self.statusword()) in (State.FAULT, State.FAULT_REACTION):
            if time.monotonic() > deadline:
                raise self._stuck(word, cia402.FAULT_RESET, State.SWITCH_ON_DISABLED)
            time.sleep(POLL_S)

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
