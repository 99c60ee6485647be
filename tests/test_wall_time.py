"""Which tests wait by the wall: those that pyproject.toml allows `time`, which is the list, and those that start
processes, which are named here. All others meet the bench on the stepped clock, where nothing waits.

That `time`, `threading` and `datetime.now` are used nowhere else is ruff's to see (TID251).
"""

from __future__ import annotations

import ast
import fnmatch
import itertools
import re
import tomllib
from dataclasses import dataclass
from pathlib import Path

ROOT = Path(__file__).parents[1]
TESTS = sorted((ROOT / "tests").rglob("*.py"))
#: Who starts a process and waits for what it says; beside the tests of processes (test_*_process.py) mostly a program
#: of a few lines: what it imports, whether it computes the same.
WITH_PROCESSES = {
    "tests/api/test_public_names.py",
    "tests/batch/test_batch.py",
    "tests/bench/bench_process.py",
    "tests/bench/test_bench_process.py",
    "tests/bench/test_can_log_written.py",
    "tests/bench/test_commission_process.py",
    "tests/bench/test_modbus_process.py",
    "tests/campaign/test_campaign_replay.py",
    "tests/cli/test_cli.py",
    "tests/estimation/test_without_numba.py",
    "tests/report/test_report_page.py",
    "tests/service/browser/page_process.py",
    "tests/session/test_hdf5.py",
    "tests/simulators/foreign_fmus.py",
    "tests/simulators/test_model_languages.py",
    "tests/test_compiled.py",
    "tests/test_packages.py",
}


def _name(path: Path) -> str:
    return path.relative_to(ROOT).as_posix()


def _allowed() -> list[str]:
    """Patterns of the tests that pyproject.toml lets have the time."""
    ruff = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))["tool"]["ruff"]
    ignores = ruff["lint"]["per-file-ignores"]
    return [
        one
        for pattern, rules in ignores.items()
        if "TID251" in rules and pattern.startswith("tests/")
        for one in _expanded(pattern)
    ]


def _expanded(pattern: str) -> list[str]:
    """a{b,c}d as abd and acd."""
    parts = re.split(r"\{([^}]*)\}", pattern)
    return ["".join(chosen) for chosen in itertools.product(*(part.split(",") for part in parts))]


@dataclass(frozen=True)
class Seen:
    """What a file imports, from wherever, by its own name; whether it takes the wall's clock, or python-can's bus of
    threads, which has no other.
    """

    imports: frozenset[str]
    goes_by_the_wall: bool


def _read(tree: ast.AST) -> Seen:
    imports, wall = set(), False
    for node in ast.walk(tree):
        if isinstance(node, ast.Import | ast.ImportFrom):
            imports |= {alias.name for alias in node.names}
            if isinstance(node, ast.ImportFrom) and node.module:
                imports.add(node.module)
        elif isinstance(node, ast.Name):
            wall = wall or node.id == "WallClock"
        elif isinstance(node, ast.keyword) and node.arg == "interface":
            wall = wall or (isinstance(node.value, ast.Constant) and node.value.value == "virtual")
    return Seen(frozenset(imports), wall)


SEEN = {_name(path): _read(ast.parse(path.read_text(encoding="utf-8"))) for path in TESTS}


def test_who_goes_by_the_wall_is_listed() -> None:
    allowed = _allowed()
    by_the_wall = {name for name, seen in SEEN.items() if seen.goes_by_the_wall}
    assert len(by_the_wall) > 3
    assert {name for name in by_the_wall if not any(fnmatch.fnmatch(name, one) for one in allowed)} == set()


def test_who_is_listed_needs_it() -> None:
    """A list of exceptions that nobody needs any more would let the next one in unseen."""
    needing = {
        name
        for name, seen in SEEN.items()
        if seen.imports & {"time", "threading", "datetime"} or seen.goes_by_the_wall
    }
    assert [one for one in _allowed() if not fnmatch.filter(needing, one)] == []


def test_who_starts_processes_is_named() -> None:
    started = {name for name, seen in SEEN.items() if seen.imports & {"subprocess", "multiprocessing"}}
    assert {
        name for name in started if not name.startswith(("tests/vcan/", "tests/peers/"))
    } == WITH_PROCESSES
