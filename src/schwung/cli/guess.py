"""`schwung import --guess`: what columns seem to be, and why, before anything is written; `--picture` of any import."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from schwung.api.recordings import Imported, Proposal
    from schwung.cli.console import Terminal


def guess(
    terminal: Terminal, files: list[Path], given: dict[str, Any], out: Path, joint: str | None, *, yes: bool,
    overwrite: bool,
) -> None:  # fmt: skip
    """Propose an import for each axis in a file; with `yes`, do it. Raises InputError for what cannot be guessed."""
    from rich.markup import escape

    from schwung.api.recordings import draw_import, propose, read_table, write_session
    from schwung.errors import InputError

    if len(files) != 1:
        raise InputError("--guess", f"is given {len(files)} files", "Give one file at a time.")
    path = files[0]
    dbc = given.get("dbc")
    table = read_table(path, Path(dbc) if dbc else None, given.get("channel"))
    proposals = propose(table, given)
    if joint is not None:
        proposals = (_chosen(proposals, joint),)
    carried = {key: value for key, value in given.items() if key not in _GUESSED}
    documents: list[dict[str, Any]] = []
    imports: list[tuple[Imported, Path]] = []
    for number, proposal in enumerate(proposals):
        target = out if len(proposals) == 1 else _named(out, proposal.name)
        imported = _imported(path, proposal, carried)
        imports.append((imported, target))
        picture = target.with_name(f"{target.stem}-guess.png")
        draw_import(proposal, imported.session, path.name, picture)
        if len(proposals) > 1:
            terminal.say(f"[bold]Axis {number + 1} of {len(proposals)}: {escape(proposal.name)}[/]")
        _show(terminal, proposal)
        _show_runs(terminal, imported)
        terminal.say(f"Picture: [bold]{escape(str(picture))}[/]")
        command = proposal.command(str(path), str(target), carried)
        if not yes:
            terminal.say(f"Nothing is written yet. This does it, and so does --yes:\n  {escape(command)}")
        documents.append(_document(proposal, command, picture) | {"cut": list(imported.cut)})
    if yes:
        for imported, target in imports:
            write_session(imported.session, target, overwrite)
            terminal.say(f"Session: [bold]{escape(str(target))}[/]")
    terminal.result(
        {"proposals": documents, "written": [str(target) for _, target in imports] if yes else []}
    )


#: Options that the proposal says itself; the others of the user go along.
_GUESSED = (
    "time", "position", "speed", "torque", "position_demand", "time_unit", "position_unit", "speed_unit", "torque_unit",
    "position_scale", "speed_scale", "torque_scale", "axis", "rate",
)  # fmt: skip


def picture_of(files: list[Path], given: dict[str, Any], imported: Imported, picture: Path) -> None:
    """The same picture of an import that was given column by column. Raises InputError where nothing can be shown."""
    from schwung.api.recordings import draw_import, propose, read_table

    dbc = given.get("dbc")
    table = read_table(files[0], Path(dbc) if dbc else None, given.get("channel"))
    draw_import(propose(table, given)[0], imported.session, files[0].name, picture)


def _named(out: Path, joint: str) -> Path:
    """The session of one axis of several."""
    plain = "".join(char if char.isalnum() or char in "-_." else "_" for char in joint).strip("_")
    return out.with_name(f"{out.stem}-{plain}{out.suffix}")


def _chosen(proposals: tuple[Proposal, ...], joint: str) -> Proposal:
    from schwung.errors import InputError

    named = [proposal for proposal in proposals if proposal.name == joint]
    if named:
        return named[0]
    if joint.isdigit() and 1 <= int(joint) <= len(proposals):
        return proposals[int(joint) - 1]
    listed = ", ".join(f"{k} ({proposal.name})" for k, proposal in enumerate(proposals, start=1))
    raise InputError(f"--joint {joint}", "there is no such axis in the file", f"There are: {listed}.")


def _imported(path: Path, proposal: Proposal, carried: dict[str, Any]) -> Imported:
    from schwung.api.recordings import import_recordings, make_recipe

    return import_recordings([path], make_recipe(carried | proposal.options, "schwung import --guess"))


def _show(terminal: Terminal, proposal: Proposal) -> None:
    from rich.markup import escape

    for guess in proposal.guesses:
        unit = f" in {guess.unit}" if guess.unit else ""
        doubt = "" if guess.sure else "  [yellow]please confirm[/]"
        terminal.say(f"[bold]{guess.what}[/]: {escape(guess.column or 'none')}{escape(unit)}{doubt}")
        terminal.say(f"  {escape(guess.evidence)}")
        if guess.alternatives:
            terminal.say(f"  or else: {escape('; '.join(guess.alternatives))}")


def _show_runs(terminal: Terminal, imported: Imported) -> None:
    from rich.markup import escape

    terminal.say("[bold]runs[/]")
    for told in imported.cut:
        terminal.say(f"  {escape(told)}")


def _document(proposal: Proposal, command: str, picture: Path) -> dict[str, Any]:
    return {
        "name": proposal.name,
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
            for guess in proposal.guesses
        ],
        "questions": list(proposal.questions),
        "command": command,
        "picture": str(picture),
    }
