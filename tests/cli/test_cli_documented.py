"""Every command line in README, site and help is one that the command line takes: names, options, values."""

from __future__ import annotations

import re
import shlex
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest
import typer

from schwung.cli import app

ROOT = Path(__file__).parents[2]
PAGES = [
    ROOT / "README.md",
    ROOT / "CONTRIBUTING.md",
    *sorted(page for page in (ROOT / "docs").rglob("*.md") if "_build" not in page.parts),
]
#: What a page leaves to the reader.
STANDS_FOR = {"$BUS": "-i socketcan -c can0", "{number}": "1"}
COMMAND_LINE: Any = typer.main.get_command(app)


def lines_of(text: str) -> Iterator[tuple[str, bool]]:
    """Command lines, each on one line; and whether one is in a block, to be typed as it stands, or in a sentence."""
    for line in re.sub(r"\\\n\s*", " ", text).splitlines():
        block = re.match(r"\s*(?:\$ )?(?:[\w./-]*/)?(schwung [a-z][^`]*)$", line)
        if block and (line.startswith(" ") or not line.rstrip().endswith((".", ",", ";", "and", "with"))):
            yield block[1], "…" not in line
    for line in re.findall(r"`(schwung [a-z][^`\n]*)`", text):
        yield line, False


def words_of(line: str) -> list[str]:
    """A command line as the shell would split it, without comment, pipe, or what is said beside it."""
    for name, value in STANDS_FOR.items():
        line = line.replace(name, value)
    line = re.split(r"\s#|\s\||\s2?>|\s&|\s{3,}", line)[0]
    return shlex.split(re.sub(r"(\s-[-\w]+) …", r"\1 x", line).replace("…", " "))[1:]


def refused(line: str, whole: bool = True) -> str | None:
    """Why the command line does not take it; None where it does. Not `whole`: something may be missing."""
    words, command = words_of(line), COMMAND_LINE
    context: Any = None
    try:
        while True:
            name = context.info_name if context else "schwung"
            context = command.make_context(name, list(words), parent=context)
            if not hasattr(command, "resolve_command"):
                return None
            rest = [*getattr(context, "_protected_args", ()), *context.args]
            if not rest:
                return None
            _, command, words = command.resolve_command(context, rest)
    except Exception as error:
        kind = type(error).__name__
        if kind == "Exit" or (kind in ("MissingParameter", "NoArgsIsHelpError") and not whole):
            return None
        return f"{kind}: {getattr(error, 'message', error)}"


def helps(command: Any = COMMAND_LINE) -> Iterator[str]:
    yield command.help or ""
    for each in getattr(command, "commands", {}).values():
        yield from helps(each)


def wrong_in(text: str) -> dict[str, str]:
    return {line: why for line, whole in lines_of(text) if (why := refused(line, whole))}


def test_a_wrong_one_is_noticed() -> None:
    text = "    schwung scan -i x\nSay `schwung diff A` or\nschwung is good.\n"
    assert list(lines_of(text)) == [("schwung scan -i x", True), ("schwung diff A", False)]
    assert refused("schwung diff A", whole=False) is None
    for line in (
        "schwung diff A", "schwung scan --tcp 127.0.0.1", "schwung comission -m machine.toml", "schwung profile shoe x",
        "schwung commission -m machine.toml --max-torque -n 3",
    ):  # fmt: skip
        assert refused(line) is not None, line
    assert refused("schwung scan -i socketcan -c can0   # who is there?") is None


@pytest.mark.parametrize("page", PAGES, ids=lambda page: page.relative_to(ROOT).as_posix())
def test_every_command_line_of_a_page_is_taken(page: Path) -> None:
    assert not wrong_in(page.read_text(encoding="utf-8"))


def test_every_example_in_the_help_is_taken() -> None:
    texts = list(helps())
    assert sum(whole for text in texts for _, whole in lines_of(text)) > 30
    # an example in the help may leave out what stands in the one before it
    assert not {line: why for text in texts for line, _ in lines_of(text) if (why := refused(line, False))}
