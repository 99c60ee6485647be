"""Recordings of others as sessions."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from schwung.errors import InputError
from schwung.fieldbus.canlog import LogRecipe, import_can_log
from schwung.files import replace_file
from schwung.session import Session
from schwung.session.guess import Guess, Proposal, propose
from schwung.session.imports import (
    Imported,
    import_recordings,
    make_recipe,
    read_recipe,
    read_table,
    write_session,
)
from schwung.session.imports.canframes import log_kind
from schwung.session.imports.units import axis_of, unit
from schwung.session.interchange import FORMATS, read_any, write_any

__all__ = [
    "FORMATS",
    "Guess",
    "Guessed",
    "Imported",
    "LogRecipe",
    "Proposal",
    "Session",
    "draw_import",
    "guess_imports",
    "import_can_log",
    "import_log",
    "import_recordings",
    "log_kind",
    "make_recipe",
    "propose",
    "read_any",
    "read_recipe",
    "read_table",
    "unit",
    "write_any",
    "write_session",
]


def draw_import(proposal: Proposal, session: Session, title: str, path: Path) -> None:
    """What is taken for what, and why, as a PNG. Raises InputError where it cannot be written."""
    from schwung.report.figures_import import import_figure
    from schwung.report.style import to_png

    replace_file(path, to_png(import_figure(proposal, session, title)))


def import_log(
    files: Sequence[Path], eds: Path, node: int | None, profile: str | None, given: Mapping[str, Any]
) -> Imported:
    """A CAN log by an EDS, with options as `schwung import` names them. Raises InputError for those that mean nothing
    there."""
    options = dict(given)
    said = {
        key: options.pop(f"{key}_unit") for key in ("position", "speed", "torque") if f"{key}_unit" in options
    }
    channel = options.pop("channel", None)
    axis = options.pop("axis", None) or axis_of(said.get("position", "")) or "rotary"
    if axis not in ("rotary", "linear"):
        raise InputError("--axis", f'is "{axis}"', "Use rotary or linear.")
    if options:
        option = "--" + next(iter(options)).replace("_", "-")
        raise InputError(option, "means nothing for a CAN log with an EDS", "Leave it out: the log says it.")
    if len(files) != 1:
        raise InputError("schwung import --eds", f"is given {len(files)} logs", "Give one log at a time.")
    units = {
        key: unit(text, key, axis)  # type: ignore[arg-type]  # literals
        for key, text in said.items()
    }
    if any(each.effort == "current" for each in units.values()):
        raise InputError("--torque-unit", "is a current, but a drive reports per mille of its rated torque",
                         "Write permille=RATED, the motor's rated torque in N·m.")  # fmt: skip
    scales = {key: each.factor for key, each in units.items()}
    return import_can_log(files[0], LogRecipe(eds, node, channel, profile, scales, axis))


#: Options that a guess says itself; the others of the user go along.
_GUESSED = (
    "time", "position", "speed", "torque", "position_demand", "time_unit", "position_unit", "speed_unit", "torque_unit",
    "position_scale", "speed_scale", "torque_scale", "axis", "rate",
)  # fmt: skip


@dataclass(frozen=True, eq=False)
class Guessed:
    """How one axis of a file seems to want to be imported, and what that makes of it; `carried`: options that are not
    guessed and go along."""

    proposal: Proposal
    imported: Imported
    carried: Mapping[str, Any]

    def to_json(self) -> dict[str, Any]:
        """Name, guesses with their evidence, what should be confirmed, and how the recording is cut into runs."""
        return {
            "name": self.proposal.name,
            "guesses": [
                {
                    "what": guess.what,
                    "column": guess.column,
                    "unit": guess.unit,
                    "evidence": guess.evidence,
                    "alternatives": list(guess.alternatives),
                    "sure": guess.sure,
                    "options": dict(guess.options),
                }
                for guess in self.proposal.guesses
            ],
            "questions": list(self.proposal.questions),
            "cut": list(self.imported.cut),
        }


def guess_imports(path: Path, given: Mapping[str, Any], joint: str | None = None) -> tuple[Guessed, ...]:
    """What the columns of a file seem to be, one value per axis in it. `given`: options that are known already, as
    `schwung import` names them; `joint`: one axis of several, by its name or number.

    Raises InputError for what cannot be guessed, and for an axis that is not there.
    """
    dbc = given.get("dbc")
    table = read_table(path, Path(dbc) if dbc else None, given.get("channel"))
    proposals = propose(table, dict(given))
    if joint is not None:
        proposals = (_chosen(proposals, joint),)
    carried = {key: value for key, value in given.items() if key not in _GUESSED}
    return tuple(
        Guessed(
            one,
            import_recordings([path], make_recipe(carried | one.options, "schwung import --guess")),
            carried,
        )
        for one in proposals
    )


def _chosen(proposals: tuple[Proposal, ...], joint: str) -> Proposal:
    named = [proposal for proposal in proposals if proposal.name == joint]
    if named:
        return named[0]
    if joint.isdigit() and 1 <= int(joint) <= len(proposals):
        return proposals[int(joint) - 1]
    listed = ", ".join(f"{k} ({proposal.name})" for k, proposal in enumerate(proposals, start=1))
    raise InputError(f"--joint {joint}", "there is no such axis in the file", f"There are: {listed}.")
