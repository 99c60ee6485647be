"""What the site makes of code and command line; the site itself is built by .ci/run."""

import importlib
import re
from pathlib import Path
from types import ModuleType

import pytest

import schwung

DOCS = Path(__file__).parent.parent / "docs"


@pytest.fixture
def parts(monkeypatch: pytest.MonkeyPatch) -> ModuleType:
    pytest.importorskip("docutils", reason="the site needs the extra [docs]")
    monkeypatch.syspath_prepend(str(DOCS / "_ext"))
    return importlib.import_module("site_parts")


def test_every_public_name_is_in_the_reference(parts: ModuleType) -> None:
    page = parts.names_page()
    for name in set(schwung.__all__) - {"__version__"}:
        assert re.search(rf":: schwung\.{name}\n", page), name


def test_every_command_and_option_is_in_the_reference(parts: ModuleType) -> None:
    page = parts.commands_page()
    for words in (
        "## schwung commission",
        "## schwung profile new",
        "`--phases`",
        "`--dry-run`",
        "`SESSION`",
    ):
        assert words in page
    assert "[bold]" not in page


def test_a_formula_is_a_picture_that_can_be_read_out(parts: ModuleType) -> None:
    drawn = parts.formula(r"\frac{J_l s^2 + k}{s}")
    assert drawn.startswith('<svg class="math"')
    assert 'aria-label="\\frac{J_l s^2 + k}{s}"' in drawn
    assert "currentColor" in drawn
    assert "patch_1" not in drawn  # no ground of its own


def test_links_that_leave_the_site_keep_their_words(parts: ModuleType) -> None:
    source = ["[delay.py](../../src/delay.py), [files](../files.md), [names](names.md)"]
    parts.without_links_out(None, "tutorials/page", source)
    assert source == ["delay.py, [files](../files.md), [names](names.md)"]


def test_every_page_has_a_place_in_the_site() -> None:
    pages = {
        path.relative_to(DOCS).with_suffix("").as_posix()
        for path in DOCS.rglob("*.md")
        if "_build" not in path.parts
    }
    named: set[str] = {"index", "reference/names", "reference/commands"}
    for page in DOCS.rglob("*.md"):
        for tree in re.findall(r"```\{toctree\}\n(.*?)```", page.read_text(encoding="utf-8"), re.DOTALL):
            for entry in tree.split():
                if not entry.startswith(":"):
                    named |= {found for found in pages if (page.parent / entry).resolve() == DOCS / found}
                    named |= {found for found in pages if entry == "0*" and found.startswith("decisions/0")}
    assert pages <= named, f"in no toctree: {sorted(pages - named)}"
