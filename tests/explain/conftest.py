"""Strangers' machines, which lie with the benchmarks, and the hand-made answer of the report's tests."""

import sys
from pathlib import Path

sys.path.append(str(Path(__file__).parents[2] / "benchmarks"))
sys.path.append(str(Path(__file__).parents[1] / "report"))
