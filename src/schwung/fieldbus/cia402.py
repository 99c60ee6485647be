"""The CiA 402 state machine, without any I/O: what a statusword means, which controlword comes next, why it sticks.

    Not ready → Switch on disabled ⇄ Ready to switch on ⇄ Switched on ⇄ Operation enabled ⇄ Quick stop active
                        ↑ fault reset (explicit, nothing else)                     ↓ anything
                      Fault ←──────────────────────────────────────── Fault reaction active

A fault reset leads to Switch on disabled and is only ever sent on request; nothing here energises after it.
Source: CiA 402-2 (IEC 61800-7-201), statusword and controlword tables.
"""

from __future__ import annotations

from dataclasses import dataclass
from enum import Enum


class State(Enum):
    """States by the names that the standard prints."""

    NOT_READY = "Not ready to switch on"
    SWITCH_ON_DISABLED = "Switch on disabled"
    READY = "Ready to switch on"
    SWITCHED_ON = "Switched on"
    OPERATION_ENABLED = "Operation enabled"
    QUICK_STOP_ACTIVE = "Quick stop active"
    FAULT_REACTION = "Fault reaction active"
    FAULT = "Fault"
    UNKNOWN = "unknown"  # a pattern that the standard does not list, or no answer: never to be taken for off


# Controlwords (bits: 0 switch on, 1 enable voltage, 2 no quick stop, 3 enable operation, 7 fault reset)
DISABLE_VOLTAGE = 0x0000
QUICK_STOP = 0x0002
SHUTDOWN = 0x0006
SWITCH_ON = 0x0007
ENABLE_OPERATION = 0x000F
FAULT_RESET = 0x0080
NEW_SET_POINT = 0x0010  # profile position: bit 4, on its rising edge
CHANGE_AT_ONCE = 0x0020  # profile position: bit 5
HALT_BIT = 0x0100

# Statusword bits
VOLTAGE_ENABLED = 0x0010
REMOTE = 0x0200
TARGET_REACHED = 0x0400
INTERNAL_LIMIT = 0x0800
SET_POINT_ACKNOWLEDGE = 0x1000  # profile position
FOLLOWS_COMMAND = 0x1000  # cyclic position, the same bit
FOLLOWING_ERROR = 0x2000

_PATTERNS = (
    (0x4F, 0x00, State.NOT_READY),
    (0x4F, 0x40, State.SWITCH_ON_DISABLED),
    (0x6F, 0x21, State.READY),
    (0x6F, 0x23, State.SWITCHED_ON),
    (0x6F, 0x27, State.OPERATION_ENABLED),
    (0x6F, 0x07, State.QUICK_STOP_ACTIVE),
    (0x4F, 0x0F, State.FAULT_REACTION),
    (0x4F, 0x08, State.FAULT),
)

_TOWARDS_ENABLED = {
    State.NOT_READY: DISABLE_VOLTAGE,
    State.SWITCH_ON_DISABLED: SHUTDOWN,
    State.READY: SWITCH_ON,
    State.SWITCHED_ON: ENABLE_OPERATION,
    State.OPERATION_ENABLED: ENABLE_OPERATION,
    State.QUICK_STOP_ACTIVE: DISABLE_VOLTAGE,  # never straight back into motion
}

#: The power stage is on.
ENERGISED = (State.OPERATION_ENABLED, State.QUICK_STOP_ACTIVE, State.FAULT_REACTION)
#: The power stage is off, and stays so whatever a single controlword that enables operation says.
OFF = (State.SWITCH_ON_DISABLED, State.NOT_READY, State.FAULT)

#: Values of 605A with which it stays in Quick stop active, from where one word leads into operation.
STAY_STOPPED = (5, 6, 7, 8)

#: The power stage is off, and could be switched on.
WAITING = (State.SWITCH_ON_DISABLED, State.READY)

_ABOVE_READY = (State.SWITCHED_ON, State.OPERATION_ENABLED)


def decode(statusword: int | None) -> State:
    """State of a statusword. A pattern that the standard does not know is `UNKNOWN`, as is one that was refused (None):
    neither says that the power stage is off."""
    if statusword is not None:
        for mask, pattern, state in _PATTERNS:
            if statusword & mask == pattern:
                return state
    return State.UNKNOWN


def enables_operation(controlword: int) -> bool:
    """True for a controlword that switches the power stage on, or leaves it on (bits 0 to 3)."""
    return controlword & ENABLE_OPERATION == ENABLE_OPERATION


def next_controlword(state: State, wanted: State) -> int | None:
    """Controlword of the next step from `state` towards `wanted`; None where no step leads there without a reset.

    `wanted` is Operation enabled, Switched on, Ready to switch on, Switch on disabled or Quick stop active.
    """
    if state in (State.FAULT, State.FAULT_REACTION):
        return None
    downwards = {
        State.SWITCH_ON_DISABLED: DISABLE_VOLTAGE,
        State.QUICK_STOP_ACTIVE: QUICK_STOP,
        State.READY: SHUTDOWN if state in _ABOVE_READY else None,
        State.SWITCHED_ON: SWITCH_ON if state in _ABOVE_READY else None,
    }
    down = downwards.get(wanted)
    return _TOWARDS_ENABLED.get(state) if down is None else down


@dataclass(frozen=True)
class Reason:
    """Why the state machine stands still, and what to do about it."""

    problem: str
    remedy: str


def why_stuck(
    statusword: int | None,
    controlword: int,
    wanted: State,
    *,
    nmt: str = "OPERATIONAL",
    mode: int | None = None,
    mode_display: int | None = None,
    controlword_seen: int | None = None,
    error: str = "",
    tells_voltage: bool = True,
) -> Reason:
    """The missing precondition, the likeliest first.

    controlword: the one last sent; controlword_seen: 6040 read back, where it could be read: another value than
    the one sent means that the PDO does not reach the object. mode, mode_display: 6060 wanted and 6061 shown.
    error: the decoded error code, where the drive reports one. statusword None: it was refused. tells_voltage: bit 4
    says that the power stage is supplied, as in the standard; False where it says that it is on.
    """
    if statusword is None:
        return Reason("does not show its statusword (6041)", "Is this the profile of this drive?")
    state = decode(statusword)
    faulty = state in (State.FAULT, State.FAULT_REACTION)
    waiting = state in WAITING
    told = f" ({error})" if error else ""
    preconditions = (
        (not faulty, f"a fault is present{told}", "Remove its cause, then reset the fault."),
        (
            nmt == "OPERATIONAL",
            f"the node is {nmt}, so that it takes no PDO",
            "Start the node; look for another NMT master.",
        ),
        (
            controlword_seen in (None, controlword),
            f"controlword 0x{controlword:04X} was sent, the drive holds 0x{controlword_seen or 0:04X}",
            "The PDO is not mapped, SYNC does not come, or another master writes it.",
        ),
        (
            bool(statusword & REMOTE),
            "the remote bit (statusword bit 9) is 0, the drive does not take controlwords",
            "Release local control at the drive or in its vendor's tool.",
        ),
        (
            bool(statusword & VOLTAGE_ENABLED) or not waiting or not tells_voltage,
            "voltage is not enabled (statusword bit 4 is 0)",
            "Switch the power supply on, release STO and the enable input.",
        ),
        (
            state is not State.QUICK_STOP_ACTIVE,
            "quick stop is active",
            "Disable the drive first; look at 605A.",
        ),
        (
            mode is None or mode_display is None or mode == mode_display,
            f"mode {mode} was asked for, the drive shows {mode_display} (6061)",
            "Choose a mode that 6502 lists.",
        ),
        (not controlword & HALT_BIT, "the halt bit (controlword bit 8) is set", "Clear the halt bit."),
        (
            False,
            f"controlword 0x{controlword:04X}, statusword 0x{statusword:04X}",
            "Look for an enable input, STO or a brake that is not released.",
        ),
    )
    missing = next((problem, remedy) for holds, problem, remedy in preconditions if not holds)
    return Reason(f'is in "{state.value}" and does not reach "{wanted.value}": {missing[0]}', missing[1])
