"""The command line run within the test's process, and the least of a machine file."""

from __future__ import annotations

import pytest

from schwung.cli import main

RIGID_MACHINE = """\
name = "m"
[motor]
inertia = 0.012
viscous_friction = 0.2
peak_torque = 233.0
[load]
viscous_friction = 0.1
inertia = 0.11
"""


def invoke(capsys: pytest.CaptureFixture[str], *arguments: str) -> tuple[int, str, str]:
    """Exit code, stdout and stderr."""
    with pytest.raises(SystemExit) as ended:
        main(list(arguments))
    out, err = capsys.readouterr()
    return int(ended.value.code or 0), out, err
