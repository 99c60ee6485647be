"""What has been computed already: a folder of scores, one file a method and state of its code.

A method's code is its own module and all that this imports, beside what every estimate goes through; comments and
docstrings do not count, nor does what only judges a finished table. Where it changed, that method is computed again.
"""

from __future__ import annotations

import ast
import hashlib
import importlib.util
import json
from collections.abc import Iterable
from functools import cache
from pathlib import Path
from typing import Any

#: Every estimate goes through it.
_SHARED = "schwung.estimation.estimate"
#: Judges a finished table; packages that gather methods without using them.
_LEFT_OUT = ("schwung.estimation.trust", "schwung.estimation", "schwung.estimation.rivals")


def fingerprint(*modules: str) -> str:
    """Changes with the code of these modules and of all that they import from this repository."""
    seen: set[str] = set()
    waiting = [*modules]
    while waiting:
        name = waiting.pop()
        if name not in seen:
            seen.add(name)
            waiting += _imports(name)
    digest = hashlib.sha256("".join(_code(name) for name in sorted(seen)).encode())
    return digest.hexdigest()[:12]


def method_fingerprint(module: str) -> str:
    """Of a method that is defined in this module."""
    return fingerprint(module, _SHARED)


@cache
def _tree(name: str) -> ast.Module:
    spec = importlib.util.find_spec(name)
    if spec is None or spec.origin is None:
        return ast.Module([], [])
    tree = ast.parse(Path(spec.origin).read_text(encoding="utf-8"))
    for node in ast.walk(tree):
        if isinstance(node, ast.Module | ast.ClassDef | ast.FunctionDef) and ast.get_docstring(node, False):
            node.body = node.body[1:]
    return tree


@cache
def _code(name: str) -> str:
    return ast.dump(_tree(name))


@cache
def _imports(name: str) -> tuple[str, ...]:
    found = []
    for node in ast.walk(_tree(name)):
        if isinstance(node, ast.ImportFrom) and node.module:
            found += [node.module, *(f"{node.module}.{alias.name}" for alias in node.names)]
        elif isinstance(node, ast.Import):
            found += [alias.name for alias in node.names]
    ours = [n for n in found if n.split(".")[0] in ("schwung", "schwung_sim") or n.startswith("estimator_")]
    return tuple(n for n in ours if n not in _LEFT_OUT and _is_module(n))


def _is_module(name: str) -> bool:
    try:
        return importlib.util.find_spec(name) is not None
    except ModuleNotFoundError:  # a name within a module
        return False


class Kept:
    """Rows of one method as lines of JSON; states of its code that are past are removed."""

    def __init__(self, folder: Path, method: str, state: str) -> None:
        folder.mkdir(parents=True, exist_ok=True)
        self._path = folder / f"{method}.{state}.jsonl"
        for stale in folder.glob(f"{method}.*.jsonl"):
            if stale != self._path:
                stale.unlink()

    def rows(self) -> list[dict[str, Any]]:
        """All that is kept; a line cut short by a crash is left out."""
        if not self._path.exists():
            return []
        return [
            json.loads(line)
            for line in self._path.read_text(encoding="utf-8").splitlines()
            if line.endswith("}")
        ]

    def add(self, rows: Iterable[dict[str, Any]]) -> None:
        """Keep more."""
        with self._path.open("a", encoding="utf-8") as file:
            file.writelines(json.dumps(row) + "\n" for row in rows)
