"""SDO abort codes (CiA 301 table 22), and the ways in which a transfer ends without its data."""

from __future__ import annotations

ABORT_CODES = {
    0x05030000: "toggle bit not alternated", 0x05040000: "SDO protocol timed out",
    0x05040001: "command specifier unknown", 0x05040002: "invalid block size",
    0x05040003: "invalid sequence number", 0x05040004: "CRC error", 0x05040005: "out of memory",
    0x06010000: "unsupported access", 0x06010001: "cannot be read: it is write-only",
    0x06010002: "cannot be written: it is read-only", 0x06020000: "object does not exist",
    0x06040041: "object cannot be mapped to a PDO", 0x06040042: "mapped objects exceed the PDO length",
    0x06040043: "parameter incompatibility", 0x06040047: "internal incompatibility",
    0x06060000: "hardware error", 0x06070010: "data type or length does not match",
    0x06070012: "data too long", 0x06070013: "data too short", 0x06090011: "sub-index does not exist",
    0x06090030: "value out of range", 0x06090031: "value too high", 0x06090032: "value too low",
    0x06090036: "maximum is less than minimum", 0x060A0023: "resource not available",
    0x08000000: "general error", 0x08000020: "data cannot be transferred or stored",
    0x08000021: "data cannot be stored because of local control",
    0x08000022: "data cannot be stored in the present device state",
    0x08000023: "object dictionary generation failed", 0x08000024: "no data available",
}  # fmt: skip
REMEDIES = {
    0x08000022: "Disable the drive, or put the node in pre-operational, and try again.",
    0x06010002: "Leave it out of what is written.",
    0x06020000: "Is this the EDS of this drive and of its firmware?",
    0x06090011: "Is this the EDS of this drive and of its firmware?",
}

TOGGLE, TIMED_OUT, COMMAND = 0x05030000, 0x05040000, 0x05040001
BLOCK_SIZE, SEQUENCE, CRC = 0x05040002, 0x05040003, 0x05040004
LENGTH, GENERAL = 0x06070010, 0x08000000
NO_OBJECT, NO_SUBINDEX = 0x06020000, 0x06090011
#: A frame was lost or late: no refusal, the transfer is tried again.
TRANSIENT = (TOGGLE, TIMED_OUT)


class AbortedError(Exception):
    """The server ended the transfer with this abort code."""

    def __init__(self, code: int) -> None:
        super().__init__(f"{ABORT_CODES.get(code, 'unknown abort code')} (0x{code:08X})")
        self.code = code


class BrokenError(Exception):
    """What came cannot be right. `told` is the abort code with which the server is told so."""

    def __init__(self, problem: str, told: int = GENERAL) -> None:
        super().__init__(problem)
        self.told = told


class SilenceError(Exception):
    """The server did not answer in time."""


class PreemptedError(Exception):
    """Another transfer, a stop as a rule, talks to the server now; this one may be repeated."""


class OverruledError(Exception):
    """Another transfer wrote the same object meanwhile: to repeat this one would undo it."""
