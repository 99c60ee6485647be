"""What there is to choose of how a machine is commissioned, and how a table goes into its drive."""

from __future__ import annotations

from schwung.commissioning import ExportChoice, parse_choice
from schwung.commissioning.ways import MAX_JITTER_SHARE, InjectionChoice, ModeChoice, SamplingChoice
from schwung.estimation import Inversion
from schwung.estimation.choice import AUTO
from schwung.estimation.methods import method_named

__all__ = [
    "AUTO",
    "MAX_JITTER_SHARE",
    "ExportChoice",
    "InjectionChoice",
    "Inversion",
    "ModeChoice",
    "SamplingChoice",
    "method_named",
    "parse_choice",
]
