"""How long the tests take that two commits share, and what has come since: from the JUnit files of two runs.

    git worktree add ../before COMMIT                       and the README's first command there
    (cd ../before && .venv/bin/pytest --junitxml=before.xml)
    .venv/bin/pytest --junitxml=now.xml                     right after it, nothing else beside either
    python benchmarks/suite.py before.xml now.xml

What counts is the time of the workers, setting up and tearing down included: pytest's own figure hangs on how many
there are. A test is the same where file, class and name are, parameters included.
"""

from __future__ import annotations

import argparse
import sys
from collections import defaultdict
from pathlib import Path
from xml.etree import ElementTree

SHOWN = 12  # files


def seconds_of(path: Path) -> dict[tuple[str, str], float]:
    """Seconds of every test by file and name."""
    try:
        cases = ElementTree.parse(path).iter("testcase")
    except (OSError, ElementTree.ParseError) as error:
        sys.exit(f"{path}: cannot be read as JUnit ({error}). Make it with pytest --junitxml={path}.")
    took: dict[tuple[str, str], float] = defaultdict(float)
    for case in cases:
        took[case.get("classname", ""), case.get("name", "")] += float(case.get("time", 0.0))
    if not took:
        sys.exit(f"{path}: has no test. Make it with pytest --junitxml={path}.")
    return dict(took)


def tell(before: dict[tuple[str, str], float], now: dict[tuple[str, str], float]) -> None:
    """Print what both have, what one has alone, and in which files new time went."""
    same = before.keys() & now.keys()
    old, new = sum(before[test] for test in same), sum(now[test] for test in same)
    print(f"before: {len(before)} tests, {sum(before.values()):.0f} s of the workers")
    print(f"now:    {len(now)} tests, {sum(now.values()):.0f} s of the workers")
    if same:
        print(f"tests of both: {len(same)}, {old:.0f} s before, {new:.0f} s now: {new / old:.2f} times")
    files: dict[str, float] = defaultdict(float)
    for test in now.keys() - same:
        files[test[0]] += now[test]
    gone = sum(before[test] for test in before.keys() - same)
    print(
        f"gone since: {len(before) - len(same)}, {gone:.0f} s; new: {len(now) - len(same)}, {sum(files.values()):.0f} s"
    )
    for name, seconds in sorted(files.items(), key=lambda file: -file[1])[:SHOWN]:
        print(f"  {seconds:6.1f} s  {name}")


def main() -> None:
    """See the module."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("before", type=Path)
    parser.add_argument("now", type=Path)
    given = parser.parse_args()
    tell(seconds_of(given.before), seconds_of(given.now))


if __name__ == "__main__":
    main()
