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

    from schwung.api.recordings import draw_import, guess_imports, write_session
    from schwung.errors import InputError

    if len(files) != 1:
        raise InputError("--guess", f"is given {len(files)} files", "Give one file at a time.")
    path = files[0]
    guessed = guess_imports(path, given, joint)
    documents: list[dict[str, Any]] = []
    imports: list[tuple[Imported, Path]] = []
    for number, one in enumerate(guessed):
        proposal, imported = one.proposal, one.imported
        target = out if len(guessed) == 1 else _named(out, proposal.name)
        imports.append((imported, target))
        picture = target.with_name(f"{target.stem}-guess.png")
        draw_import(proposal, imported.session, path.name, picture)
        if len(guessed) > 1:
            terminal.say(f"[bold]Axis {number + 1} of {len(guessed)}: {escape(proposal.name)}[/]")
        _show(terminal, proposal)
        _show_runs(terminal, imported)
        terminal.say(f"Picture: [bold]{escape(str(picture))}[/]")
        command = proposal.command(str(path), str(target), one.carried)
        if not yes:
            terminal.say(f"Nothing is written yet. This does it, and so does --yes:\n  {escape(command)}")
        documents.append(one.to_json() | {"command": command, "picture": str(picture)})
    if yes:
        for imported, target in imports:
            write_session(imported.session, target, overwrite)
            terminal.say(f"Session: [bold]{escape(str(target))}[/]")
    terminal.result(
        {"proposals": documents, "written": [str(target) for _, target in imports] if yes else []}
    )


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
