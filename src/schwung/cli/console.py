"""How the command line speaks: sentences and tables on the terminal, JSON for machines, one place for both."""

from __future__ import annotations

import json
import sys
from collections.abc import Iterable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from typing import TYPE_CHECKING, Any

from rich.console import Console
from rich.markup import escape
from rich.table import Table

if TYPE_CHECKING:
    from rich.progress import Progress, TaskID

_SIGNS = {"ok": "[green]✓[/]", "note": "[cyan]i[/]", "warning": "[yellow]![/]", "stop": "[red]✗[/]"}
_VERDICTS = {"good": "green", "doubtful": "yellow", "unusable": "red"}


class Terminal:
    """What a command prints. With `json_output` people's text goes to stderr and one JSON document to stdout."""

    def __init__(self, json_output: bool = False) -> None:
        self.json_output = json_output
        self.console = Console(stderr=json_output, highlight=False)

    def say(self, text: str) -> None:
        """One sentence; rich markup is interpreted."""
        self.console.print(text, soft_wrap=True)

    def result(self, document: Mapping[str, Any]) -> None:
        """The command's result for machines; silent unless --json was given."""
        if self.json_output:
            json.dump(document, sys.stdout, indent=2, default=str)
            sys.stdout.write("\n")

    def table(self, title: str, columns: Sequence[str], rows: Iterable[Sequence[object]]) -> None:
        """A table for people; cells are escaped."""
        table = Table(title=title, title_justify="left", title_style="bold", header_style="dim", box=None)
        for column in columns:
            table.add_column(column, overflow="fold")
        for row in rows:
            table.add_row(*(cell if _is_markup(cell) else escape(str(cell)) for cell in map(str, row)))
        self.console.print(table)

    def checks(self, rows: Iterable[Sequence[str]]) -> None:
        """Preflight's findings: (name, severity, text, remedy) each."""
        self.table(
            "Preflight",
            ("", "check", "finding"),
            (
                (_SIGNS[severity], name, f"{text}. {remedy}" if remedy else text)
                for name, severity, text, remedy in rows
            ),
        )

    def verdict(self, verdict: str, text: str) -> None:
        """The verdict on trust, in its colour."""
        self.say(f"[bold {_VERDICTS.get(verdict, 'white')}]{verdict}[/]: {escape(text)}")


def _is_markup(cell: str) -> bool:
    return cell in _SIGNS.values()


class TerminalObserver:
    """Shows the phases of a procedure and how long the present one still takes."""

    def __init__(self, terminal: Terminal, progress: Progress) -> None:
        self._terminal, self._progress = terminal, progress
        self._task: TaskID | None = None

    def phase(self, text: str) -> None:
        """A new phase; the one before is done."""
        self._close()
        self._task = self._progress.add_task(escape(text), total=None)

    def progress(self, done: int, total: int) -> None:
        """Samples (or nodes, or parameters) done of all."""
        if self._task is not None:
            self._progress.update(self._task, completed=done, total=total)

    def note(self, text: str) -> None:
        """Something worth knowing that stops nothing."""
        self._terminal.say(f"[cyan]i[/] {escape(text)}")

    def _close(self) -> None:
        if self._task is not None:
            self._progress.update(self._task, completed=1, total=1)


@contextmanager
def observing(terminal: Terminal) -> Iterator[TerminalObserver]:
    """A progress display that ends with the block."""
    from rich.progress import BarColumn, Progress, SpinnerColumn, TextColumn, TimeRemainingColumn

    columns = (
        SpinnerColumn(),
        TextColumn("{task.description}"),
        BarColumn(),
        TimeRemainingColumn(compact=True),
    )
    with Progress(*columns, console=terminal.console, transient=False) as progress:
        yield TerminalObserver(terminal, progress)
