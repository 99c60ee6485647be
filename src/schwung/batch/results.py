"""One file per result, named by its key: there whole or not at all, so that a second call does what is missing."""

from __future__ import annotations

import json
from dataclasses import dataclass, fields
from pathlib import Path
from typing import Any

from schwung.batch.work import Outcome
from schwung.drivetrain import write_machine
from schwung.files import json_text, replace_file

FORMAT, VERSION = "schwung-batch-result", 1


@dataclass(frozen=True)
class Results:
    """The results below one folder."""

    folder: Path

    def find(self, key: str) -> Outcome | None:
        """The outcome by this key; None where there is none, or only what somebody else has made of the file."""
        try:
            document: dict[str, Any] = json.loads(self._path(key).read_text(encoding="utf-8"))
            if (document.pop("format"), document.pop("version")) != (FORMAT, VERSION):
                return None
            outcome = Outcome(**document)
            return outcome if {"trust", "names"} & set(outcome.document) else None
        except (OSError, ValueError, KeyError, TypeError, AttributeError):
            return None

    def keep(self, key: str, outcome: Outcome) -> None:
        """Write an outcome, and the learned machine where there is one. Raises InputError where that fails."""
        path = self._path(key)
        if outcome.learned is not None:  # first: where the result is, all of it is
            write_machine(outcome.learned, path.with_suffix(".machine.toml"))
        document = {field.name: getattr(outcome, field.name) for field in fields(outcome)}
        del document["learned"]
        head = {"format": FORMAT, "version": VERSION}
        replace_file(path, json_text(head | document))

    def _path(self, key: str) -> Path:
        return self.folder / f"{key}.json"
