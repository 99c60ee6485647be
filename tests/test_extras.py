"""What is not installed is named in one sentence, by the extra of ours that brings it."""

from __future__ import annotations

import re
import sys
import tomllib
from pathlib import Path

import pytest

from schwung.extras import EXTRAS, MissingLibraryError, require

ROOT = Path(__file__).parent.parent
#: Modules whose names differ from their projects'.
PROJECTS = {"python_multipart": "python-multipart", "prometheus_client": "prometheus-client"}


def test_every_library_is_in_its_extra() -> None:
    given = tomllib.loads((ROOT / "pyproject.toml").read_text("utf-8"))["project"]["optional-dependencies"]
    for extra, modules in EXTRAS.items():
        text = " ".join(given[extra])
        wanted = [*re.findall(r"schwung\[(\w+)\]", text), extra]
        brought = {re.split(r"[\[>=<]", line)[0] for name in wanted for line in given[name]}
        assert {PROJECTS.get(name, name) for name in modules} <= brought, extra


def test_the_sentence(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(sys.modules, "casadi", None)
    monkeypatch.setitem(sys.modules, "toppra", None)
    with pytest.raises(MissingLibraryError) as caught:
        require("schwung optimise", "optimise")
    assert str(caught.value) == (
        'schwung optimise: needs CasADi and TOPP-RA, not installed here. Run pip install "schwung[optimise]".'
    )
    require("MDF", "logs")
