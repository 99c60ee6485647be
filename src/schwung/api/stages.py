"""Commissioning in stages, for who lets a person look in between: prepare, show, look again, record; estimate later.

`moving` is the same in one call.
"""

from __future__ import annotations

from schwung.commissioning import (
    LimitWishes,
    Plan,
    Prepared,
    Survey,
    Wishes,
    following_error_rms,
    prepare,
    record_prepared,
    repeat_reference,
    wishes_of,
)
from schwung.commissioning.as_planned import rechecked, require_there
from schwung.commissioning.bode import PreparedBode, prepare_bode, record_bode
from schwung.commissioning.bode_excitation import BodeWishes
from schwung.commissioning.commission import settings_of
from schwung.commissioning.ways import MAX_JITTER_SHARE
from schwung.drivetrain import Simulated

__all__ = [
    "MAX_JITTER_SHARE",
    "BodeWishes",
    "LimitWishes",
    "Plan",
    "Prepared",
    "PreparedBode",
    "Simulated",
    "Survey",
    "Wishes",
    "following_error_rms",
    "prepare",
    "prepare_bode",
    "rechecked",
    "record_bode",
    "record_prepared",
    "repeat_reference",
    "require_there",
    "settings_of",
    "wishes_of",
]
