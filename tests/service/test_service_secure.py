"""A drive that an interrupted run has left is switched off where it is on, or may be."""

from __future__ import annotations

from types import SimpleNamespace
from typing import Any

import pytest

from schwung.service.work.looking import secure


class Drive:
    """Shows a state until it is switched off."""

    def __init__(self, shown: str) -> None:
        self.shown, self.told = shown, list[str]()

    def state(self) -> Any:
        return SimpleNamespace(cia402=self.shown)

    def halt(self) -> None:
        self.told.append("halt")

    def disable(self) -> None:
        self.told.append("disable")
        self.shown = "Switch on disabled"


@pytest.mark.parametrize(
    ("shown", "told"),
    [
        ("Operation enabled", ["halt", "disable"]), ("unknown", ["halt", "disable"]),
        ("Switch on disabled", []), ("Fault", []),
    ],
)  # fmt: skip
def test_unknown_is_not_off(shown: str, told: list[str]) -> None:
    """A statusword that is refused, or means nothing: it was left as it was."""
    drive = Drive(shown)
    task: Any = SimpleNamespace(
        phase=lambda text: None,
        connect=lambda: SimpleNamespace(drive=drive),
        store=SimpleNamespace(unsettled=lambda drive_id: []),
        trail=SimpleNamespace(add=lambda *_, **__: None),
        run=SimpleNamespace(who="Ada", id="1"),
        drive_record=SimpleNamespace(id="2"),
    )
    assert secure(task)["found"] == shown
    assert drive.told == told
