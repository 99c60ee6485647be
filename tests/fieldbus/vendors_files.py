"""The manufacturers' files from which our families were made, by family; a test that has none is skipped."""

from __future__ import annotations

from pathlib import Path

import pytest
from real_eds import MISSING, real_eds_files

VENDORS_FILE = {
    "maxon-epos4": "epos4_50_15_can_ec90flat_gp52c_mile800_node1.dcf",
    "maxon-epos2": "epos2_347717.eds",
    "faulhaber-cc": "605.3150.51-V-EK-2-60.eds",
    "wittenstein-simco": "simco.eds",
    "elmo-gold": "Elmo.dcf",
    "schunk-erb": "Schunk_0_63.dcf",
    "trinamic-tmcm1636": "TMCM-1636-CANopen_Hw1.1_Fw1.12.eds",
    "zeroerr-erob": "ZeroErr_Driver_V1.5.eds",
}


def vendors_file(family: str) -> Path:
    """The file; skips the test where it is not on this computer."""
    for path in real_eds_files():
        if path.name == VENDORS_FILE[family]:
            return path
    pytest.skip(MISSING)
