"""One bench, one service, one browser for all tests of the page; left out where there is no Chromium."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

import pytest
from page_process import CHROMIUM, Served, browser_process, serving, visiting


@pytest.fixture(scope="session")
def served(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Served]:
    if CHROMIUM is None:
        pytest.skip("there is no Chromium here: apt-get install chromium")
    pytest.importorskip("playwright.sync_api")
    with serving(tmp_path_factory.mktemp("service")) as service:
        yield service


@pytest.fixture(scope="session")
def browser(served: Served) -> Iterator[Any]:
    with browser_process() as process:
        yield process


@pytest.fixture
def page(browser: Any, served: Served) -> Iterator[Any]:
    with visiting(browser, served) as visit:
        yield visit
    served.settle()  # whatever became of the test
