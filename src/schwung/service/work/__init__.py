"""What each kind of run does: with the rooms below, as the command line does it; one table for all (`KINDS`)."""

from __future__ import annotations

from dataclasses import dataclass

from schwung.service.jobs import Work
from schwung.service.work.configuring import export, propose_export, propose_restore, restore
from schwung.service.work.estimating import (
    batch,
    check_profile,
    draft_profile,
    estimate,
    explain,
    optimise,
    reproduce,
    salvage,
)
from schwung.service.work.importing import convert, import_as, import_file
from schwung.service.work.looking import backup, diff, doctor, reset_fault, scan, secure
from schwung.service.work.moving import bode, commission, plan, propose_bode
from schwung.service.work.playing import play, propose_play


@dataclass(frozen=True)
class Kind:
    """A kind of run. `on_bus`: in the lane of the bus or drive that it names; `acts`: moves or writes, so that a STOP
    forbids it."""

    work: Work
    on_bus: bool = False
    acts: bool = False


KINDS = {
    "scan": Kind(scan, on_bus=True),
    "doctor": Kind(doctor, on_bus=True),
    "backup": Kind(backup, on_bus=True),
    "secure": Kind(secure, on_bus=True),
    "reset_fault": Kind(reset_fault, on_bus=True, acts=True),
    "plan": Kind(plan, on_bus=True),
    "commission": Kind(commission, on_bus=True, acts=True),
    "propose_bode": Kind(propose_bode, on_bus=True),
    "bode": Kind(bode, on_bus=True, acts=True),
    "propose_export": Kind(propose_export, on_bus=True),
    "export": Kind(export, on_bus=True, acts=True),
    "propose_restore": Kind(propose_restore, on_bus=True),
    "restore": Kind(restore, on_bus=True, acts=True),
    "estimate": Kind(estimate),
    "explain": Kind(explain),
    "optimise": Kind(optimise),
    "propose_play": Kind(propose_play, on_bus=True),
    "play": Kind(play, on_bus=True, acts=True),
    "batch": Kind(batch),
    "diff": Kind(diff, on_bus=True),
    "import": Kind(import_file),
    "import_as": Kind(import_as),
    "convert": Kind(convert),
    "check_profile": Kind(check_profile),
    "draft_profile": Kind(draft_profile),
    "reproduce": Kind(reproduce),
    "salvage": Kind(salvage),
}
