"""What there is to choose of how a machine is commissioned, and how a table goes into its drive."""

from __future__ import annotations

from schwung.commissioning import ExportChoice, parse_choice
from schwung.commissioning.ways import MAX_JITTER_SHARE, InjectionChoice, ModeChoice, SamplingChoice

__all__ = [
    "MAX_JITTER_SHARE",
    "ExportChoice",
    "InjectionChoice",
    "ModeChoice",
    "SamplingChoice",
    "parse_choice",
]
