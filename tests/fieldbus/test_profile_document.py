"""docs/profiles.md documents every field of a profile, in the code's own words."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path

import pytest
from pydantic import BaseModel

from schwung.fieldbus.profile import document
from schwung.fieldbus.profile.parts import Part

PAGE = Path(__file__).parents[2] / "docs" / "profiles.md"


def parts(model: type[BaseModel] = Part) -> Iterator[type[BaseModel]]:
    for part in model.__subclasses__():
        yield part
        yield from parts(part)


def test_every_field_has_a_description() -> None:
    bare = [
        f"{part.__name__}.{name}"
        for part in parts()
        for name in part.model_fields
        if name not in document.meanings(part)
    ]
    assert bare == []


def test_the_page_holds_what_the_code_says() -> None:
    told = PAGE.read_text(encoding="utf-8").partition(document.BEGIN)[2].partition(document.END)[0]
    assert told.strip() == document.fields_markdown().strip(), (
        "run: python -m schwung.fieldbus.profile.document docs/profiles.md"
    )


def test_every_key_of_every_part_is_on_the_page() -> None:
    text = document.fields_markdown()
    for part in parts():
        if part.__name__ == "ObjectRef":
            continue  # written as text, "6064:00"
        for name in part.model_fields:
            assert name == "folder" or f"| `{name}` |" in text, f"{part.__name__}.{name}"


def test_a_field_without_description_is_refused(monkeypatch: pytest.MonkeyPatch) -> None:
    class Bare(Part):
        """A part whose field nobody has described."""

        value: int

    fields = {"value": Bare.model_fields["value"]}
    monkeypatch.setattr(document, "_parts", lambda: iter([("`[bare]`", Bare, fields)]))
    with pytest.raises(ValueError, match=r"Bare\.value has no description"):
        document.fields_markdown()


def test_the_page_is_brought_up_to_date_in_place(tmp_path: Path) -> None:
    page = tmp_path / "page.md"
    page.write_text(f"before\n{document.BEGIN}\nstale words\n{document.END}\nafter\n", encoding="utf-8")
    assert document.write_page(page)
    text = page.read_text(encoding="utf-8")
    assert text.startswith("before\n")
    assert text.endswith("after\n")
    assert "stale words" not in text
    assert not document.write_page(page)
