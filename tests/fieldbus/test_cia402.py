"""The state machine against the tables of CiA 402-2, over all statuswords and every pair of states."""

from __future__ import annotations

import itertools

import pytest

from schwung.fieldbus import cia402
from schwung.fieldbus.cia402 import State

# A statusword of each state, as the standard prints it, with remote and voltage.
WORDS = {
    State.NOT_READY: 0x0000,
    State.SWITCH_ON_DISABLED: 0x0240,
    State.READY: 0x0231,
    State.SWITCHED_ON: 0x0233,
    State.OPERATION_ENABLED: 0x0237,
    State.QUICK_STOP_ACTIVE: 0x0217,
    State.FAULT_REACTION: 0x021F,
    State.FAULT: 0x0218,
}


class Drive:
    """The transitions of the standard (figure "power drive system FSA"), written out."""

    def __init__(self, state: State) -> None:
        self.state = state
        self.last = 0

    def take(self, word: int) -> None:
        edge = word & 0x80 and not self.last & 0x80
        self.last = word
        s = self.state
        if s is State.FAULT:
            self.state = State.SWITCH_ON_DISABLED if edge else s
        elif s in (State.FAULT_REACTION, State.NOT_READY):
            self.state = State.FAULT if s is State.FAULT_REACTION else State.SWITCH_ON_DISABLED
        elif word & 0x87 == 0x06:  # shutdown
            self.state = State.READY if s is not State.QUICK_STOP_ACTIVE else s
        elif word & 0x82 == 0x00:  # disable voltage
            self.state = State.SWITCH_ON_DISABLED
        elif word & 0x86 == 0x02:  # quick stop
            stops = s in (State.OPERATION_ENABLED, State.QUICK_STOP_ACTIVE)
            self.state = State.QUICK_STOP_ACTIVE if stops else State.SWITCH_ON_DISABLED
        elif word & 0x8F == 0x07:  # switch on, disable operation
            self.state = State.SWITCHED_ON if s is not State.SWITCH_ON_DISABLED else s
        elif word & 0x8F == 0x0F:  # enable operation
            self.state = State.OPERATION_ENABLED if s in (
                State.SWITCHED_ON, State.OPERATION_ENABLED, State.QUICK_STOP_ACTIVE) else s  # fmt: skip


@pytest.mark.parametrize(("state", "word"), WORDS.items())
def test_states_are_decoded_whatever_the_other_bits_say(state: State, word: int) -> None:
    free = 0x10 | 0x80 | 0xFF00  # bits that do not tell the state
    for extra in (0x0000, 0x0010, 0x0080, 0x1000, 0xFF00, 0xFF90):
        assert cia402.decode((word & ~free) | extra) is state


def test_all_65536_statuswords_have_a_state() -> None:
    for word in range(0x10000):
        assert cia402.decode(word) in State


WANTED = (
    State.OPERATION_ENABLED, State.SWITCHED_ON, State.READY, State.SWITCH_ON_DISABLED, State.QUICK_STOP_ACTIVE,
)  # fmt: skip


@pytest.mark.parametrize(("begin", "wanted"), list(itertools.product(WORDS, WANTED)))
def test_the_controlwords_lead_to_the_wanted_state(begin: State, wanted: State) -> None:
    drive, energised_after_fault = Drive(begin), False
    for _ in range(8):
        if drive.state is wanted:
            break
        word = cia402.next_controlword(drive.state, wanted)
        if word is None:
            break
        assert not word & 0x80, "a fault is never reset on the way"
        drive.take(word)
        energised_after_fault |= begin in (State.FAULT, State.FAULT_REACTION)
    if begin in (State.FAULT, State.FAULT_REACTION):
        assert not energised_after_fault
        assert drive.state is begin
    elif wanted is State.QUICK_STOP_ACTIVE and begin is not State.OPERATION_ENABLED:
        assert drive.state in (State.SWITCH_ON_DISABLED, State.QUICK_STOP_ACTIVE)  # nothing to stop
    else:
        assert drive.state is wanted


def test_quick_stop_is_never_left_straight_into_motion() -> None:
    word = cia402.next_controlword(State.QUICK_STOP_ACTIVE, State.OPERATION_ENABLED)
    assert word == cia402.DISABLE_VOLTAGE


def test_fault_reset_ends_in_switch_on_disabled() -> None:
    drive = Drive(State.FAULT)
    for word in (cia402.DISABLE_VOLTAGE, cia402.FAULT_RESET, cia402.DISABLE_VOLTAGE):
        drive.take(word)
    assert drive.state is State.SWITCH_ON_DISABLED


@pytest.mark.parametrize(
    ("status", "word", "seen", "facts", "named"),
    [
        (0x0218, 0x00, 0x00, {"error": "0x8611 following error"}, "0x8611"),
        (0x0250, 0x06, 0x06, {"nmt": "PRE-OPERATIONAL"}, "PRE-OPERATIONAL"),
        (0x0250, 0x06, 0x00, {}, "drive holds 0x0000"),
        (0x0050, 0x06, 0x06, {}, "remote"),
        (0x0221, 0x07, 0x07, {}, "voltage"),
        (0x0221, 0x07, 0x07, {"tells_voltage": False}, "statusword 0x0221"),  # bit 4 is the power stage
        (0x0217, 0x00, 0x00, {}, "quick stop is active"),
        (0x0233, 0x0F, 0x0F, {"mode": 8, "mode_display": 1}, "6061"),
        (0x0233, 0x010F, 0x010F, {}, "halt bit"),
        (0x0233, 0x0F, 0x0F, {}, "statusword 0x0233"),
    ],
)
def test_a_drive_that_sticks_has_its_missing_precondition_named(
    status: int, word: int, seen: int, facts: dict[str, str], named: str
) -> None:
    reason = cia402.why_stuck(status, word, State.OPERATION_ENABLED, controlword_seen=seen, **facts)  # type: ignore[arg-type]
    assert named in reason.problem
    assert cia402.decode(status).value in reason.problem
    assert reason.remedy


@pytest.mark.parametrize("word", [0x0001, 0x0003, 0x0013, None])
def test_what_the_standard_does_not_list_is_unknown_and_not_off(word: int | None) -> None:
    assert cia402.decode(word) is State.UNKNOWN
    assert State.UNKNOWN not in cia402.OFF


def test_only_a_controlword_with_all_four_bits_enables() -> None:
    enabling = [word for word in range(0x200) if cia402.enables_operation(word)]
    assert {word & 0x0F for word in enabling} == {0x0F}
    assert len(enabling) == 0x200 // 16
