"""The next experiment: the motion that best tells apart what a session leaves confused, as a plan, and made."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

from schwung.api.drives import Connection
from schwung.api.folders import make_folder, planned_folder
from schwung.api.moving import Confirm, Plan, Silent, ask
from schwung.commissioning import Observer, renewed
from schwung.commissioning.experiments import (
    SURE,
    Experiment,
    Setting,
    faint,
    next_experiments,
    setting_of,
    told_apart,
)
from schwung.commissioning.limits import tighter
from schwung.commissioning.plan_file import read_plan, write_plan
from schwung.commissioning.until_explained import (
    BUDGET,
    UntilExplained,
    record_until_explained,
    require_budget,
)
from schwung.drivetrain import Machine
from schwung.errors import RefusedError
from schwung.explain.plausibility import examine
from schwung.explain.weighing.experiment import Rival, Rivals
from schwung.explain.weighing.weigh import Posterior, posterior_of
from schwung.files import json_text, replace_file
from schwung.session import Session
from schwung.session.gains import with_recorded_gains

__all__ = [
    "BUDGET",
    "NextMotion",
    "UntilExplained",
    "commission_until_explained",
    "next_motion",
    "read_plan",
    "require_budget",
    "tighter",
    "until_explained_json",
]


@dataclass(frozen=True, eq=False)
class NextMotion:
    """What is still likely, and the motion that tells it apart; no experiment: none is wanted, or none would tell."""

    rivals: tuple[Rival, ...]
    experiment: Experiment | None
    setting: Setting
    machine: str
    faint: str = ""  # names that hardly stand out from what has none

    @property
    def sentence(self) -> str:
        """What the motion separates and by how much, or why there is none."""
        said = told_apart(self.rivals)
        if self.experiment is not None:
            return self.experiment.sentence
        if self.rivals[0].probability >= SURE:
            return f"{said}: {self.faint or 'nothing is confused'}, no further motion tells more"
        return f"{said}: no motion within the limits would tell them apart"

    def write(self, path: str | Path) -> None:
        """As a plan for `schwung commission --plan`. Raises RefusedError where there is none,
        InputError where it cannot be written.
        """
        if self.experiment is None:
            raise RefusedError("next motion", self.sentence, "There is no plan to write.")
        setting = self.setting
        wishes = replace(self.experiment.wishes, because=(self.experiment.sentence,))
        write_plan(
            Path(path),
            self.machine,
            wishes,
            setting.limits,
            setting.start_position_rad,
        )

    def to_json(self) -> dict[str, Any]:
        """JSON-ready."""
        return {
            "rivals": [_rival(one) for one in self.rivals],
            "sentence": self.sentence,
            "experiment": None if self.experiment is None else _experiment(self.experiment),
        }


def next_motion(session: Session, machine: Machine, posterior: Posterior | None = None) -> NextMotion:
    """The motion that best tells apart what a session leaves confused, within its limits.

    `posterior`: of the session, where it was weighed already. Raises InputError where the session does not say which
    motion was made, or nobody knows the drive's gains.
    """
    machine = with_recorded_gains(machine, session)
    setting = setting_of(session, machine)
    posterior = posterior or posterior_of(session, machine, steady=examine(session, machine).steady)
    rivals = Rivals.of(posterior)
    sure = rivals.best >= SURE
    found = [] if sure else next_experiments(rivals, setting)
    first = found[0] if found else None
    return NextMotion(rivals.rivals, first, setting, machine.name, faint(posterior.told, rivals.rivals))


def commission_until_explained(
    connection: Connection,
    plan: Plan,
    out: str | Path | None = None,
    *,
    budget: int = BUDGET,
    confirm: Confirm = ask,
    observer: Observer | None = None,
) -> UntilExplained:
    """Carry out a plan, then the motions that tell most, until one answer has 95 % or `budget` motions were made.

    Asks before the first plan and before each further motion, and is as safe as `commission`: it is the same procedure.
    Writes session.h5 with all motions, and explained.json. Raises what `commission` raises; what was recorded is kept.
    """
    require_budget(budget)
    plan.require()
    folder = planned_folder(None if out is None else Path(out))
    if not confirm("The machine will move. Is it clear?"):
        raise RefusedError("commission", "you said no", "Nothing was changed, nothing moved.")
    current = renewed(connection.drive, connection.profile, plan)
    current.preflight.require()
    make_folder(folder)

    def agreed(_prepared: object, experiment: Experiment) -> bool:
        wishes = experiment.wishes
        return confirm(
            f"The next motion: {wishes.distance_rad:.4g} rad in {wishes.duration_s * 1e3:.4g} ms. "
            "The machine will move. Is it clear?"
        )

    found = record_until_explained(
        connection.drive, connection.profile, current, folder, observer or Silent(), budget, agreed
    )
    replace_file(folder / "explained.json", json_text(until_explained_json(found)))
    return found


def until_explained_json(found: UntilExplained) -> dict[str, Any]:
    """What was found and how, JSON-ready."""
    return {
        "session": str(found.session_path),
        "motions": len(found.session.runs),
        "ended": found.ended,
        "sure": found.sure,
        "answers": [_rival(one) for one in found.rivals],
        "names": [
            {
                "name": one.name,
                "probability": one.probability,
                "parameters": {key: vars(value) for key, value in one.parameters.items()},
            }
            for one in found.weighed.names
        ],
        "steps": [
            _experiment(step.experiment) | {"after": [_rival(one) for one in step.after]}
            for step in found.steps
        ],
    }


def _rival(rival: Rival) -> Mapping[str, Any]:
    return {"names": list(rival.names), "probability": rival.probability}


def _experiment(experiment: Experiment) -> dict[str, Any]:
    wishes = experiment.wishes
    return {
        "distance_rad": wishes.distance_rad,
        "duration_s": wishes.duration_s,
        "frequency_hz": wishes.frequency_hz,
        "amplitude_nm": wishes.amplitude_nm,
        "motions": experiment.motions,
        "separates": experiment.sentence,
        "expected": experiment.gain.expected,
        "information_nats": experiment.gain.information,
    }
