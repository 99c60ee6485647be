"""The bench and the tool as two processes on a loopback TCP bus."""

from __future__ import annotations

import io
import re
import subprocess
import sys
from collections.abc import Iterator
from contextlib import contextmanager, redirect_stderr, redirect_stdout
from pathlib import Path

import pytest

from schwung.cli import main
from schwung.cli.demo import BELIEF


@contextmanager
def bench_process(*options: str) -> Iterator[list[str]]:
    """A bench in its own process; yields the bus options of the tool."""
    process = subprocess.Popen(
        [sys.executable, "-m", "schwung", "bench", "--tcp", "127.0.0.1:0", "--seconds", "100", *options],
        stdout=subprocess.PIPE, stderr=subprocess.STDOUT, text=True,
    )  # fmt: skip
    try:
        assert process.stdout is not None
        line = process.stdout.readline()
        found = re.search(r"channel=(\S+) host=(\S+) port=(\d+)", line)
        assert found, line + process.stdout.read()
        yield ["-i", "socketcand", "-c", found[1], "--bus", f"host={found[2]}", "--bus", f"port={found[3]}"]
    finally:
        process.terminate()
        process.wait(10)
        assert process.stdout is not None
        process.stdout.close()


def schwung(*arguments: str) -> subprocess.CompletedProcess[str]:
    """Run the tool to its end within this process: a new interpreter takes longer to import than most of it lasts."""
    out, err = io.StringIO(), io.StringIO()
    with redirect_stdout(out), redirect_stderr(err), pytest.raises(SystemExit) as ended:
        main(list(arguments))
    return subprocess.CompletedProcess(arguments, int(ended.value.code or 0), out.getvalue(), err.getvalue())


def commission_arguments(folder: Path, bus: list[str], *more: str) -> list[str]:
    """A commissioning of the bench's machine into folder/out."""
    machine = folder / "machine.toml"
    machine.write_text(BELIEF)
    return [
        "commission", "-m", str(machine), "--distance", "180deg", "--duration", "250ms", "-y",
        "--out", str(folder / "out"), *bus, *more,
    ]  # fmt: skip
