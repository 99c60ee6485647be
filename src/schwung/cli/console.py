"""How the command line speaks: sentences and tables on the terminal, JSON for machines, one place for both."""

from __future__ import annotations

import math
import sys
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from typing import TYPE_CHECKING, Any

from rich.console import Console
from rich.markup import escape
from rich.table import Table

from schwung.errors import RefusedError
from schwung.files import json_text

if TYPE_CHECKING:
    from rich.progress import Progress, TaskID

    from schwung import InertiaTable

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

    def tell_slow(self) -> None:
        """That this takes long, where nothing is compiled, and what makes it fast."""
        from schwung.compiled import IS_FAST

        if not IS_FAST:
            self.say(f"{_SIGNS['note']} Without Numba this takes very long: "
                     + escape('pip install "schwung[fast]" makes it fast.'))  # fmt: skip

    def ask(self, question: str) -> bool:
        """Ask a question of yes or no; anything but y or yes is a no.

        Raises RefusedError where nobody is there to answer.
        """
        self.console.print(f"{escape(question)} {escape('[y/N]')} ", end="", soft_wrap=True)
        answer = sys.stdin.readline() if sys.stdin is not None else ""
        if not answer:
            self.console.print()
            raise RefusedError(
                "confirmation",
                f'"{question}" found nobody to answer',
                "Use --yes where nobody sits in front.",
            )
        return answer.strip().lower() in ("y", "yes")

    def result(self, document: Mapping[str, Any]) -> None:
        """The command's result for machines; silent unless --json was given."""
        if self.json_output:
            print(json_text(document), flush=True)

    def table(self, title: str, columns: Sequence[str], rows: Iterable[Sequence[object]]) -> None:
        """A table for people; title and cells are escaped."""
        table = Table(
            title=escape(title), title_justify="left", title_style="bold", header_style="dim", box=None
        )
        cells = [tuple(map(str, row)) for row in rows]
        texts = [[column, *(row[i] for row in cells)] for i, column in enumerate(columns)]
        for column, width in zip(columns, _widths(texts, self.console.width), strict=True):
            table.add_column(column, overflow="fold", width=width)
        for row in cells:
            table.add_row(*(cell if _is_markup(cell) else escape(cell) for cell in row))
        self.console.print(table)

    def checks(self, rows: Iterable[Sequence[str]], title: str = "Preflight") -> None:
        """Findings of preflight or doctor: (name, severity, text, remedy) each."""
        self.table(
            title,
            ("", "check", "finding"),
            (
                (_SIGNS[severity], name, f"{text}. {remedy}" if remedy else text)
                for name, severity, text, remedy in rows
            ),
        )

    def verdict(self, verdict: str, text: str) -> None:
        """The verdict on trust, in its colour."""
        self.say(f"[bold {_VERDICTS.get(verdict, 'white')}]{verdict}[/]: {escape(text)}")


#: Beyond so many turns an angle was likely meant in degrees.
_MANY_TURNS = 10


def describe_shown(causes: Sequence[str]) -> str:
    """What else a record shows, which was fitted beside the inertia."""
    return f"The record shows {' and '.join(causes)}: found beside the inertia, see the report's notes"


def describe_table(table: InertiaTable, axis: str = "rotary") -> str:
    """An inertia table in one sentence, for the terminal; says so where its angles look like degrees."""
    inertia, position = ("kg·m²", "rad") if axis == "rotary" else ("kg", "m")
    first, last = float(table.position_rad[0]), float(table.position_rad[-1])
    text = (
        f"Load {'inertia' if axis == 'rotary' else 'mass'} {table.inertia_kgm2.min():.4f} … "
        f"{table.inertia_kgm2.max():.4f} {inertia} over {first:.3g} … {last:.3g} {position}"
    )
    if axis == "rotary":
        text += f" ({round(math.degrees(first))} … {round(math.degrees(last))}°)"
        turns = (last - first) / (2 * math.pi)
        if turns > _MANY_TURNS:
            text += f"\n[yellow]![/] These are {turns:.0f} turns: the angles are meant in rad, not in degrees"
    return text


def _widths(texts: Sequence[Sequence[str]], width: int) -> list[int | None]:
    """Of columns with these texts: the widest are cut first, and none to less than its longest word, for half a name is
    none. None: as the library sees fit.
    """
    lines = [
        [line for text in column if not _is_markup(text) for line in text.split("\n")] for column in texts
    ]
    wanted = [max(map(len, column), default=1) for column in lines]
    least = [max((len(word) for line in column for word in line.split()), default=1) for column in lines]
    room = width - 2 * len(texts)
    if sum(wanted) > room:
        for widest in range(max(wanted), 0, -1):
            widths: list[int | None] = [
                max(few, min(many, widest)) for few, many in zip(least, wanted, strict=True)
            ]
            if sum(width or 0 for width in widths) <= room:
                return widths
    return [None] * len(texts)


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
        self._progress.start()  # not before: a question may come first
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
    """A progress display that begins with the first phase and ends with the block."""
    progress = _display(terminal)
    try:
        yield TerminalObserver(terminal, progress)
    finally:
        if progress.live.is_started:
            progress.stop()


@contextmanager
def progress_bar(terminal: Terminal) -> Iterator[Callable[[str, float], None]]:
    """One bar that ends with the block: call it with what is being done and the share done of all, 0…1."""
    with _display(terminal) as progress:
        task = progress.add_task("", total=1.0)

        def tell(text: str, share: float) -> None:
            progress.update(task, description=escape(text), completed=share)

        yield tell


def _display(terminal: Terminal) -> Progress:
    """Spinner, words, bar and the time left."""
    from rich.progress import BarColumn, Progress, SpinnerColumn, TextColumn, TimeRemainingColumn

    return Progress(
        SpinnerColumn(),
        TextColumn("{task.description}"),
        BarColumn(),
        TimeRemainingColumn(compact=True),
        console=terminal.console,
        transient=False,
    )
