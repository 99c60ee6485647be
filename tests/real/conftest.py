"""Real recordings, where there are any: `SCHWUNG_REAL_DATA`, or a folder shared/data beside the repository."""

from __future__ import annotations

from pathlib import Path

import pytest
from real_recordings import MissingRecordings, RealRecordings


@pytest.fixture(scope="session")
def recordings() -> RealRecordings:
    try:
        return RealRecordings.found(Path(__file__).parents[2])
    except MissingRecordings as missing:
        pytest.skip(str(missing))
