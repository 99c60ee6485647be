"""The procedure: plan, preflight, move and record, export, restore. The only room that moves a machine."""

from schwung.commissioning.as_planned import await_rest, renewed
from schwung.commissioning.checks import Check
from schwung.commissioning.commission import (
    Commissioned,
    KeptSession,
    Prepared,
    Wishes,
    carry_out,
    contrast_of,
    prepare,
    record_prepared,
    repeat_reference,
    wishes_of,
)
from schwung.commissioning.export import ExportChoice, Exported, export_table, export_values, parse_choice
from schwung.commissioning.host_played import HostPlayed, host_played
from schwung.commissioning.journal import (
    Backup,
    Change,
    ParameterJournal,
    read_backup,
    restore_backup,
)
from schwung.commissioning.limits import Limits, LimitWishes
from schwung.commissioning.plan import Plan
from schwung.commissioning.preflight import Preflight
from schwung.commissioning.procedure import Observer, Recorded
from schwung.commissioning.runs import following_error, following_error_rms
from schwung.commissioning.survey import Survey

__all__ = [
    "Backup",
    "Change",
    "Check",
    "Commissioned",
    "ExportChoice",
    "Exported",
    "HostPlayed",
    "KeptSession",
    "LimitWishes",
    "Limits",
    "Observer",
    "ParameterJournal",
    "Plan",
    "Preflight",
    "Prepared",
    "Recorded",
    "Survey",
    "Wishes",
    "await_rest",
    "carry_out",
    "contrast_of",
    "export_table",
    "export_values",
    "following_error",
    "following_error_rms",
    "host_played",
    "parse_choice",
    "prepare",
    "read_backup",
    "record_prepared",
    "renewed",
    "repeat_reference",
    "restore_backup",
    "wishes_of",
]
