"""Pages for tests that read their words."""

from html import escape

import pytest

from schwung.report import html


@pytest.fixture
def undrawn(monkeypatch: pytest.MonkeyPatch) -> None:
    """Pictures are made and named, but not drawn: that takes most of a page's time.

    For what stands in headings, verdict and tables. What is nowhere on a page may stand in no picture, either.
    """

    def sketch(_figure: object, name: str, title: str) -> str:
        return f'<svg id="{name}" role="img" aria-label="{escape(title)}"></svg>'

    monkeypatch.setattr(html, "to_svg", sketch)
