"""What each kind of run does: with the rooms below, as the command line does it; one table for all (`KINDS`)."""

from __future__ import annotations

from dataclasses import dataclass

from schwung.service.jobs import Work
from schwung.service.work.estimating import estimate
from schwung.service.work.moving import commission, plan


@dataclass(frozen=True)
class Kind:
    """A kind of run. `on_bus`: in its drive's lane; `acts`: moves or writes, so that a STOP forbids it."""

    work: Work
    on_bus: bool = False
    acts: bool = False


KINDS = {
    "estimate": Kind(estimate),
    "plan": Kind(plan, on_bus=True),
    "commission": Kind(commission, on_bus=True, acts=True),
}
