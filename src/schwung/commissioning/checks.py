"""One thing looked at and put in words; and those that doctor and preflight judge alike."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from typing import Literal

from schwung.fieldbus.drive import ENERGISED, DriveLimits, DriveState

Severity = Literal["ok", "note", "warning", "stop"]

#: Part of each limit that the simulated motion may use before a warning is due.
COMFORT = 0.8
_NEGATIVE, _POSITIVE, _INTERLOCK = 1 << 0, 1 << 1, 1 << 3  # of 60FD (CiA 402-2)
_POSITION_TURNED, _SPEED_TURNED = 1 << 7, 1 << 6  # of 607E


@dataclass(frozen=True)
class Check:
    """One thing looked at: what was found and, where it is not well, what to do.

    Attributes: `name`, `severity` ("ok", "note", "warning" or "stop"), `text` and `remedy`: words, with units where
    they tell quantities; no arrays. Raises nothing.

    >>> schwung.Check("speed", "ok", "up to 20.6 of 628 rad/s").severity
    'ok'
    """

    name: str
    severity: Severity
    text: str
    remedy: str = ""


def worst(checks: Sequence[Check]) -> Severity:
    """The gravest severity among the checks."""
    order: tuple[Severity, ...] = ("ok", "note", "warning", "stop")
    return max((check.severity for check in checks), key=order.index, default="ok")


def share_check(name: str, value: float, limit: float, text: str, remedy: str) -> Check:
    """How much of a limit is used: a stop beyond it, a warning where it comes near."""
    if value > limit:
        return Check(name, "stop", text, remedy)
    return Check(
        name, "warning" if value > COMFORT * limit else "ok", text, remedy if value > COMFORT * limit else ""
    )


def energised_check(state: DriveState) -> Check | None:
    """A drive that is on before anything was commanded is somebody else's; None where it is off."""
    if state.cia402.lower() not in ENERGISED:
        return None
    return Check(
        "drive state",
        "stop",
        f"the drive is energised already ({state.cia402})",
        "Switch it off in whatever holds it; after a crash of ours, `schwung restore` does.",
    )


def ready_checks(state: DriveState) -> Iterator[Check]:
    """What keeps a drive from being commissioned though it answers: another master, STO, local control, an end."""
    if state.others:
        yield Check(
            "other master", "stop", f"somebody else sends {state.others} on this bus",
            "Stop the PLC or the vendor's tool: a bus has one master.",
        )  # fmt: skip
    if state.voltage is False:
        yield Check(
            "supply", "stop", "the power stage has no voltage (statusword bit 4 is 0)",
            "Switch the power supply on, and release STO and the enable input.",
        )  # fmt: skip
    if state.remote is False:  # some drives take controlwords, and say so, in the NMT state operational only
        yield Check(
            "remote", "stop" if state.nmt == "OPERATIONAL" else "warning",
            "the drive does not take controlwords (statusword bit 9 is 0)",
            "Release local control at the drive or in the vendor's tool.",
        )  # fmt: skip
    inputs = state.inputs or 0
    pressed = [name for bit, name in ((_NEGATIVE, "negative"), (_POSITIVE, "positive")) if inputs & bit]
    if pressed:
        yield Check(
            "limit switches", "stop", f"the {' and the '.join(pressed)} limit switch is active (60FD)",
            "Move the axis away, or mend the wiring.",
        )  # fmt: skip
    if inputs & _INTERLOCK:
        yield Check(
            "interlock",
            "stop",
            "the interlock input is active (60FD bit 3)",
            "Release STO or the enable input.",
        )


def meaning_checks(limits: DriveLimits) -> Iterator[Check]:
    """What is easily overlooked: how the drive stops, whether a brake holds it, and what turns or shifts its units."""
    if limits.quick_stop_option == 0:
        yield Check(
            "quick stop", "stop",
            "on a quick stop the drive lets the axis coast (605A is 0), and cannot be told otherwise",
            "Set 605A to 2 or 6 in the vendor's tool, or in a profile that extends this one (stop.quick_stop_option).",
        )  # fmt: skip
    if limits.brake_closed:
        yield Check(
            "brake", "stop", "the holding brake is closed by an output that the bus rules (60FE bit 0)",
            "Leave the brake to the drive (clear bit 0 of 60FE:02), or open it.",
        )  # fmt: skip
    turned = [
        name
        for bit, name in ((_POSITION_TURNED, "position"), (_SPEED_TURNED, "speed"))
        if limits.polarity & bit
    ]
    if turned:
        yield Check(
            "polarity", "warning",
            f"{' and '.join(turned)} {'are' if len(turned) > 1 else 'is'} turned (607E is 0x{limits.polarity:02X}), "
            "torque (6077, 60B2) is not",
            "Set 607E to 0, or give the torques the other sign in a profile that extends this one; the creep tells.",
        )  # fmt: skip
    if limits.home_offset_rad:
        yield Check(
            "home offset", "note",
            f"607C is {limits.home_offset_rad:.4g} rad: drives differ in whether that shifts 607D",
        )  # fmt: skip
    if limits.range_rad is not None:
        low, high = limits.range_rad
        yield Check("position range", "note", f"positions wrap at {low:.4g} and {high:.4g} rad (607B)")
