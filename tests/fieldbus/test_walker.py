"""The walker against a drive of the standard's state table, one that is slow, one that lies, and one that is silent."""

from __future__ import annotations

from contextlib import nullcontext

import pytest

from schwung.clock import SteppedClock
from schwung.errors import DriveError, DriveFaultError, EnergisedError, SdoError, StateError
from schwung.fieldbus import cia402
from schwung.fieldbus.cia402 import State
from schwung.fieldbus.walker import PATIENCE_S, Access, Walker

WORDS = {
    State.NOT_READY: 0x0000, State.SWITCH_ON_DISABLED: 0x0240, State.READY: 0x0231, State.SWITCHED_ON: 0x0233,
    State.OPERATION_ENABLED: 0x0237, State.QUICK_STOP_ACTIVE: 0x0217, State.FAULT_REACTION: 0x021F, State.FAULT: 0x0218,
}  # fmt: skip


class TableDrive:
    """CiA 402-2 table 31, and no ramps. `delay_s` passes before a controlword acts."""

    def __init__(self, state: State = State.SWITCH_ON_DISABLED, delay_s: float = 0.0) -> None:
        self.clock, self.state, self.delay_s = SteppedClock(), state, delay_s
        self.shown: int | None = -1  # -1: what is true
        self.silent = False
        self.sent: list[int] = []
        access = Access("node 5", self.statusword, self.command, lambda: self.clock.sleep(0.005), self.stuck)
        self.walker = Walker(self.clock, access)

    def statusword(self) -> int | None:
        if self.silent:
            raise SdoError("node 5", "no answer")
        return WORDS[self.state] if self.shown == -1 else self.shown

    def command(self, word: int) -> None:
        self.sent.append(word)
        if self.silent:
            raise SdoError("node 5", "no answer")
        self.clock.later(self.delay_s, lambda: self._act(word))
        self.clock.sleep(0.005)

    def _act(self, word: int) -> None:
        s = self.state
        if s in (State.FAULT, State.FAULT_REACTION, State.NOT_READY):
            return
        if not word & 2:
            self.state = State.SWITCH_ON_DISABLED
        elif not word & 4:
            self.state = State.QUICK_STOP_ACTIVE if s is State.OPERATION_ENABLED else State.SWITCH_ON_DISABLED
        elif word & 7 == 6:
            self.state = State.READY
        elif word & 0xF == 7 and s in (State.READY, State.OPERATION_ENABLED):
            self.state = State.SWITCHED_ON
        elif word & 0xF == 0xF and s is State.SWITCHED_ON:
            self.state = State.OPERATION_ENABLED

    @staticmethod
    def stuck(word: int | None, sent: int, wanted: State) -> DriveError:
        reason = cia402.why_stuck(word, sent, wanted)
        kind = DriveFaultError if cia402.decode(word) is State.FAULT else StateError
        return kind("node 5", reason.problem, reason.remedy)


def fine() -> None: ...


@pytest.mark.parametrize("state", State, ids=lambda state: state.name)
def test_a_drive_that_is_on_before_our_first_command_is_somebody_elses(state: State) -> None:
    drive = TableDrive(State.FAULT if state is State.UNKNOWN else state)
    on = state in (State.OPERATION_ENABLED, State.QUICK_STOP_ACTIVE, State.FAULT_REACTION)
    with pytest.raises(EnergisedError, match="left alone") if on else nullcontext():
        drive.walker.require_off()
    assert drive.sent == []


@pytest.mark.parametrize("delay_s", [0.0, 0.3, 1.5])
def test_up_and_off_each_controlword_once_on_the_way_up(delay_s: float) -> None:
    drive = TableDrive(delay_s=delay_s)
    drive.walker.climb(State.OPERATION_ENABLED, fine)
    assert drive.state is State.OPERATION_ENABLED
    assert drive.sent == [cia402.SHUTDOWN, cia402.SWITCH_ON, cia402.ENABLE_OPERATION]
    drive.walker.off()
    assert drive.state is State.SWITCH_ON_DISABLED


def test_a_drive_that_stays_put_is_stuck_for_a_reason() -> None:
    drive = TableDrive(State.NOT_READY)
    with pytest.raises(StateError, match="Not ready to switch on"):
        drive.walker.climb(State.OPERATION_ENABLED, fine)
    assert PATIENCE_S < drive.clock.now() < PATIENCE_S + 0.1


def test_a_fault_ends_the_climb_at_once() -> None:
    drive = TableDrive(State.FAULT)
    with pytest.raises(DriveFaultError):
        drive.walker.climb(State.OPERATION_ENABLED, fine)
    assert drive.sent == []


def test_a_drive_that_falls_back_is_not_sent_up_again_though_this_climb_has_not_said_the_lower_words() -> (
    None
):
    """An enable input that went for 7 ms: it was led up anew from Switched on (campaign seed 695105)."""
    drive = TableDrive(delay_s=0.3)
    drive.walker.climb(State.SWITCHED_ON, fine)
    drive.sent.clear()
    drive.clock.later(0.1, lambda: setattr(drive, "state", State.SWITCH_ON_DISABLED))
    with pytest.raises(StateError):
        drive.walker.climb(State.OPERATION_ENABLED, fine)
    assert drive.sent == [cia402.ENABLE_OPERATION]


def test_a_disturbance_ends_the_climb() -> None:
    drive = TableDrive()

    def check() -> None:
        if drive.state is State.SWITCHED_ON:
            raise StateError("node 5", "was halted")

    with pytest.raises(StateError, match="halted"):
        drive.walker.climb(State.OPERATION_ENABLED, check)
    assert cia402.ENABLE_OPERATION not in drive.sent


@pytest.mark.parametrize("word", [0x0001, 0x0003, 0x0013, None], ids=str)
def test_unknown_is_never_off(word: int | None) -> None:
    """A drive that shows no state of the standard's, or refuses to show any, may be energised."""
    drive = TableDrive(State.OPERATION_ENABLED)
    drive.shown = word
    with pytest.raises(StateError, match="may still be energised"):
        drive.walker.off()
    assert drive.sent[-1] == cia402.DISABLE_VOLTAGE
    assert drive.state is State.SWITCH_ON_DISABLED  # it was sent, and acted


def test_an_unknown_state_that_clears_up_is_verified() -> None:
    drive = TableDrive(State.OPERATION_ENABLED)
    drive.shown = 0x0001
    drive.clock.later(0.5, lambda: setattr(drive, "shown", -1))
    drive.walker.off()
    assert drive.state is State.SWITCH_ON_DISABLED


def test_fault_reaction_is_waited_out_and_the_fault_stays() -> None:
    drive = TableDrive(State.FAULT_REACTION)
    drive.clock.later(1.0, lambda: setattr(drive, "state", State.FAULT))
    drive.walker.off()
    assert drive.clock.now() >= 1.0
    assert drive.state is State.FAULT
    assert drive.sent == []


def test_a_fault_reaction_without_end_is_not_off() -> None:
    drive = TableDrive(State.FAULT_REACTION)
    with pytest.raises(StateError, match="Fault reaction active"):
        drive.walker.off()
    assert drive.sent[-1] == cia402.DISABLE_VOLTAGE


def test_silence_is_raised_after_disable_voltage_was_tried() -> None:
    drive = TableDrive(State.OPERATION_ENABLED)
    drive.silent = True
    with pytest.raises(SdoError, match="no answer"):
        drive.walker.off()
    assert set(drive.sent) == {cia402.DISABLE_VOLTAGE}


def test_quick_stop_active_is_left_by_disable_voltage_alone() -> None:
    """0x000F would lead back into operation (605A 5 and 6)."""
    drive = TableDrive(State.QUICK_STOP_ACTIVE)
    drive.walker.off()
    assert set(drive.sent) == {cia402.DISABLE_VOLTAGE}


def test_a_state_that_it_was_not_told_to_enter_is_waited_for() -> None:
    """An old frame: after Shutdown alone, Operation enabled was believed, and a setpoint sent."""
    drive = TableDrive()
    drive.clock.later(0.004, lambda: setattr(drive, "shown", WORDS[State.OPERATION_ENABLED]))
    drive.clock.later(0.3, lambda: setattr(drive, "shown", -1))
    drive.walker.climb(State.OPERATION_ENABLED, lambda: None)
    assert drive.sent == [cia402.SHUTDOWN, cia402.SWITCH_ON, cia402.ENABLE_OPERATION]
    assert drive.state is State.OPERATION_ENABLED


def test_a_state_that_another_brought_it_to_is_not_taken_for_ours() -> None:
    drive = TableDrive()
    drive.clock.later(0.004, lambda: setattr(drive, "shown", WORDS[State.OPERATION_ENABLED]))
    with pytest.raises(EnergisedError, match="somebody else"):
        drive.walker.climb(State.OPERATION_ENABLED, lambda: None)
    assert drive.sent == [cia402.SHUTDOWN]
    assert drive.clock.now() >= PATIENCE_S
