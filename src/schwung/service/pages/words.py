"""What drives, runs and verdicts are called on the page, and how grave that is."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from schwung.service.pages.markup import Safe, Tone, tag

#: CiA 402 states, in lower case, as what they mean for who stands next to the machine.
_STATES: Mapping[str, tuple[Tone, str]] = {
    "not ready to switch on": ("off", "the drive starts up"),
    "switch on disabled": ("off", "power stage off"),
    "ready to switch on": ("off", "power stage off, may be switched on"),
    "switched on": ("doubtful", "power stage ready, no torque"),
    "operation enabled": ("live", "power stage on: the drive holds or moves the axis"),
    "quick stop active": ("doubtful", "stopping, or stopped with torque"),
    "fault reaction active": ("unusable", "stopping because of a fault"),
    "fault": ("unusable", "power stage off because of a fault"),
}
_RUNS: Mapping[str, Tone] = {
    "queued": "",
    "running": "live",
    "done": "good",
    "failed": "unusable",
    "cancelled": "doubtful",
    "interrupted": "doubtful",
}
_KINDS = {
    "plan": "Plan",
    "commission": "Commissioning",
    "estimate": "Estimate",
    "explain": "Explanation",
    "doctor": "Check of the drive",
    "scan": "Scan of the bus",
    "bode": "Frequency response",
    "propose_bode": "Frequency response, planned",
    "propose_play": "Optimised motion, planned",
    "salvage": "Interrupted recording kept",
    "secure": "Drive looked at and switched off",
    "optimise": "Optimal motion",
    "play": "Optimised motion played",
    "export": "Export",
    "propose_export": "Export, proposed",
    "verify": "Motion before and after",
    "backup": "Backup",
    "restore": "Restore",
    "propose_restore": "Restore, proposed",
    "reset_fault": "Fault reset",
    "import": "Import",
    "import_as": "Import with confirmed columns",
    "diff": "Configurations compared",
    "convert": "Session in another format",
    "check_profile": "Device profile checked",
    "draft_profile": "Device profile drafted",
    "batch": "The archive worked through",
    "reproduce": "The paper's figures",
}
VERDICTS: Mapping[str, tuple[Tone, str]] = {
    "good": ("good", "good"),
    "doubtful": ("doubtful", "doubtful"),
    "unusable": ("unusable", "unusable"),
    "consistent": ("good", "consistent"),
    "explained": ("good", "explained"),
    "partly_explained": ("doubtful", "partly explained"),
    "unexplained": ("unusable", "unexplained"),
}


def cia402_tone(state: str) -> Tone:
    """How grave a state is."""
    return _STATES.get(state.lower(), ("", ""))[0]


def cia402_meaning(state: str) -> str:
    """What a state means."""
    return _STATES.get(state.lower(), ("", ""))[1]


def run_tag(state: str) -> Safe:
    """A run's state."""
    return tag(state, _RUNS.get(state, ""))


def kind_name(kind: str) -> str:
    """A kind of run, as people call it."""
    return _KINDS.get(kind, kind.replace("_", " ").capitalize())


#: Ends of field names, longest first, and the unit that each stands for.
_UNITS = {
    "_rad_s3": "rad/s³", "_rad_s": "rad/s", "_kgm2": "kg·m²", "_rad": "rad", "_nm": "N·m", "_hz": "Hz", "_s": "s",
}  # fmt: skip


def field_text(name: str, value: Any) -> tuple[str, str]:
    """A field of a request as people read it: its name without the unit, its value with it."""
    end = next((end for end in _UNITS if name.endswith(end)), "")
    unit = f" {_UNITS[end]}" if end else ""
    label = name.removesuffix(end).replace("_", " ").capitalize()
    return label, f"{_plain(value)}{unit}"


def _plain(value: Any) -> str:
    if isinstance(value, Mapping):
        return ", ".join(" ".join(field_text(k, v)).lower() for k, v in value.items() if v is not None) or "–"
    if isinstance(value, list):
        return ", ".join(_plain(item) for item in value)
    if isinstance(value, bool):
        return "yes" if value else "no"
    return f"{value:.6g}" if isinstance(value, float) else str(value)


def verdict_tag(verdict: Any) -> Safe | None:
    """A verdict; None where there is none."""
    if not verdict:
        return None
    tone, word = VERDICTS.get(str(verdict), ("", str(verdict)))
    return tag(word, tone)
