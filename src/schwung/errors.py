"""Everything that Schwung raises on purpose.

    SchwungError                 one sentence: place, problem, remedy; `exit_code` for the command line
     ├── InputError        (2)   a file, an option, a profile or an EDS is wrong          nothing has been touched
     ├── RefusedError      (3)   preflight or creep found a danger, or something missing  no stroke was begun
     ├── DriveError        (4)   the drive or the bus let us down                         the drive has been stopped
     │    ├── BusError           the adapter or the bus: bus-off, send buffer full, interface down
     │    ├── NodeLostError      no heartbeat, or the node restarted on its own
     │    ├── ParameterError     a parameter was refused, or not answered; names it, and why
     │    │    ├── SdoError      on CANopen: an SDO was aborted or not answered
     │    │    └── RegisterError on Modbus: an exception code, or no answer
     │    ├── StateError         CiA 402 did not advance; names the precondition that is missing
     │    │    ├── CoastingError on a stop it did not come to rest; its power stage is off, it coasts
     │    │    └── EnergisedError somebody else has switched it on; it has been left alone
     │    ├── DriveFaultError    the drive reported a fault or an EMCY; decoded
     │    └── SampleLossError    TPDOs are missing from a recording
     └── InterruptedByUser (130) Ctrl-C; the drive was stopped and what was recorded is on disk

The command line prints the sentence and exits with `exit_code`; a traceback is a defect of ours.
"""

from __future__ import annotations


class SchwungError(Exception):
    """A failure that the user can understand and act upon.

    `place` names where (file and key, node and object), `problem` what, `remedy` what to do about it.
    """

    exit_code = 1

    def __init__(self, place: str, problem: str, remedy: str = "") -> None:
        self.place, self.problem, self.remedy = place, problem, remedy
        super().__init__(place, problem, remedy)

    def __str__(self) -> str:
        sentence = f"{self.place}: {self.problem}"
        return f"{sentence}. {self.remedy}" if self.remedy else sentence


class InputError(SchwungError):
    """A file, option, profile or EDS is wrong; nothing has been touched."""

    exit_code = 2


class RefusedError(SchwungError):
    """Preflight refused, or the creep did: the drive was not enabled, or is off again; no stroke was begun."""

    exit_code = 3


class DriveError(SchwungError):
    """The drive or the bus failed; the drive has been stopped by its own means."""

    exit_code = 4


class BusError(DriveError):
    """The adapter or the bus failed: bus-off, send buffer full, interface down."""


class NodeLostError(DriveError):
    """The node's heartbeat stopped, or the node restarted on its own."""


class ParameterError(DriveError):
    """A parameter was refused by the drive or not answered; `place` names it."""


class SdoError(ParameterError):
    """An SDO transfer was aborted by the drive or not answered."""


class RegisterError(ParameterError):
    """A Modbus request was refused by the drive (exception code) or not answered."""

    def __init__(self, place: str, problem: str, remedy: str = "", code: int | None = None) -> None:
        super().__init__(place, problem, remedy)
        self.code = code  # Modbus exception code; None: there was no answer


class StateError(DriveError):
    """The CiA 402 state machine did not advance; the missing precondition is named."""


class CoastingError(StateError):
    """The drive did not come to rest when it was told to stop; its power stage is off, and it coasts."""


class EnergisedError(StateError):
    """Somebody else has switched the drive on, before any command of ours; it has been left alone."""


class DriveFaultError(DriveError):
    """The drive reported a fault or an emergency (EMCY)."""


class SampleLossError(DriveError):
    """Samples are missing from a recording; they are never bridged."""


class InterruptedByUser(SchwungError):
    """Ctrl-C: the drive was stopped, what was recorded so far is on disk."""

    exit_code = 130
