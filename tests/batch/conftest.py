"""These tests run the command line, and take the sessions of the report's tests."""

import sys
from pathlib import Path

sys.path += [str(Path(__file__).parents[1] / room) for room in ("cli", "report")]
