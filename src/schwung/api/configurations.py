"""A drive's whole configuration: read, kept, compared, and written back."""

from __future__ import annotations

from pathlib import Path

from schwung.commissioning import ExportChoice, export_table, export_values, read_backup, restore_backup
from schwung.commissioning.backup import Written, plan_restore, read_snapshot, require_power_off, write_plan
from schwung.commissioning.compare import Comparison, Configuration, Difference
from schwung.commissioning.configuration_files import (
    Format,
    fitting_dictionary,
    for_this_drive,
    load_both,
    load_configuration,
    save_configuration,
)
from schwung.commissioning.export import Worth, worth_of
from schwung.commissioning.journal import ParameterJournal, first_values
from schwung.drivetrain import InertiaTable
from schwung.fieldbus.configuration import Skipped, dictionary_of, select
from schwung.fieldbus.dcf import dictionary_lookup, write_dcf
from schwung.fieldbus.drive import ParameterValue, RawValue
from schwung.fieldbus.eds import EdsFile, byte_size, read_eds
from schwung.fieldbus.profile import load_canopen_profile
from schwung.fieldbus.si import SiScales

__all__ = [
    "Comparison",
    "Configuration",
    "Difference",
    "EdsFile",
    "ExportChoice",
    "Format",
    "ParameterJournal",
    "ParameterValue",
    "RawValue",
    "SiScales",
    "Skipped",
    "Worth",
    "Written",
    "byte_size",
    "dictionary_of",
    "export_table",
    "export_values",
    "first_values",
    "fitting_dictionary",
    "for_this_drive",
    "load_both",
    "load_configuration",
    "plan_restore",
    "read_backup",
    "read_eds",
    "read_snapshot",
    "require_power_off",
    "restore_backup",
    "save_configuration",
    "select",
    "worth_of",
    "write_export",
    "write_plan",
]


def write_export(
    path: Path,
    family: str,
    table: InertiaTable,
    choice: ExportChoice,
    *,
    node: int = 1,
    motor_inertia_kgm2: float | None = None,
) -> int:
    """An inertia table as a DCF (CiA 306) for a family's EDS, without a drive; returns how many parameters it holds.

    Raises InputError where the family has no such target, or its unit is known to the drive alone.
    """
    profile = load_canopen_profile(family)
    lookup = dictionary_lookup(profile.eds_path, node)
    values = export_values(lookup, profile, table, choice, motor_inertia_kgm2=motor_inertia_kgm2)
    write_dcf(profile.eds_path, node, values, path)
    return len(values)
