"""What strangers install: no extra is needed to begin with, and nothing that Windows and macOS lack.

The wheel itself is built, installed and run by `benchmarks/package.py --check`.
"""

import re
import subprocess
import sys
import tomllib
from pathlib import Path

import numpy as np

import schwung
from schwung.extras import EXTRAS
from schwung.session import Run, SessionWriter

ROOT = Path(__file__).parent.parent
PROJECT = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))["project"]

#: Modules that some platform lacks, and names of the socket module that only Linux has.
ELSEWHERE_ABSENT = (
    "fcntl",
    "termios",
    "tty",
    "pty",
    "resource",
    "pwd",
    "grp",
    "crypt",
    "syslog",
    "winreg",
    "msvcrt",
)
#: Names of os that only some platforms have.
OF_OS = (
    "sched_getaffinity", "sched_setaffinity", "sched_setscheduler", "sched_param", "nice", "fork", "getuid", "geteuid",
    "killpg", "setsid", "O_DIRECTORY", "O_NOFOLLOW", "memfd_create", "eventfd", "mkfifo", "getloadavg", "ttyname",
    "openpty", "fchmod", "chown",
)  # fmt: skip
WITHOUT_PLATFORM = f"""
import importlib, os, pkgutil, select, signal, socket, sys

class Absent:
    def find_spec(self, name, path=None, target=None):
        frame = sys._getframe(1)
        while "importlib" in frame.f_code.co_filename:
            frame = frame.f_back
        if name in {ELSEWHERE_ABSENT!r} and frame.f_globals.get("__name__", "").startswith("schwung"):
            raise ModuleNotFoundError(name + " is not there on every platform", name=name)

for name in {ELSEWHERE_ABSENT!r}:
    sys.modules.pop(name, None)
for name in [n for n in dir(socket) if n.startswith(("AF_CAN", "PF_CAN", "CAN_"))]:
    delattr(socket, name)
for module, names in (
    (signal, ("SIGHUP", "SIGALRM", "SIGUSR1", "SIGKILL", "setitimer", "pthread_sigmask")),
    (os, {OF_OS!r}),
    (select, ("epoll",)),
):
    for name in names:
        if hasattr(module, name):
            delattr(module, name)
sys.meta_path.insert(0, Absent())
import schwung, schwung_sim
for package in (schwung, schwung_sim):
    for module in pkgutil.walk_packages(package.__path__, package.__name__ + "."):
        if not module.name.endswith("__main__"):
            importlib.import_module(module.name)
from schwung.cli import main
for command in ("profile list", "doctor -i virtual -c nobody -n 1 --json"):
    try:
        main(command.split())
    except SystemExit as ended:
        print("exit code", ended.code, file=sys.stderr)
"""
COLUMNS = "--position a --speed b --torque c"
#: Commands, and the extra that each asks for.
NEEDING = {
    "demo": "bench",
    "demo --plant two-mass": "bench",
    "bench --tcp 127.0.0.1:0": "bench",
    "bench --list": "bench",
    "serve --demo": "web",
    "optimise -m machine.toml --distance 1 --duration 0.2": "optimise",
    "batch estimate .": "batch",
    "batch explain .": "batch",
    "convert session.h5 session.mf4": "logs",
    "convert session.h5 session.parquet": "logs",
    f"import x.mf4 {COLUMNS}": "logs",
    f"import x.parquet {COLUMNS}": "logs",
    f"import x.log --dbc y.dbc {COLUMNS}": "logs",
    "explain session.h5 --belief model.fmu --map map.toml": "fmi",
    "scan -i virtual -c nobody --can-log frames.mf4": "logs",
}
WITHOUT_EXTRAS = f"""
import sys
for name in {sorted({"dask", "pandas", *(module for modules in EXTRAS.values() for module in modules)})!r}:
    sys.modules[name] = None
from schwung.cli import main
for command in {list(NEEDING)!r}:
    try:
        main(command.split())
    except SystemExit as ended:
        print("exit code", ended.code, file=sys.stderr)
"""


def _python(code: str, folder: Path) -> subprocess.CompletedProcess[str]:
    return subprocess.run(
        [sys.executable, "-c", code], cwd=folder, capture_output=True, text=True, check=False
    )


def test_nothing_is_imported_that_windows_or_macos_lack(tmp_path: Path) -> None:
    done = _python(WITHOUT_PLATFORM, tmp_path)
    assert done.returncode == 0, done.stderr
    codes = [line for line in done.stderr.splitlines() if line.startswith("exit code")]
    assert codes == ["exit code 0", "exit code 3"], done.stderr


def test_a_command_that_needs_an_extra_says_which(tmp_path: Path) -> None:
    (tmp_path / "x.log").write_text("(0.0) can0 181#0102030405060708\n", encoding="utf-8")
    (tmp_path / "x.mf4").write_bytes(b"MDF     4.10    ")
    (tmp_path / "x.parquet").write_bytes(b"PAR1")
    for name in ("y.dbc", "model.fmu", "map.toml", "machine.toml"):
        (tmp_path / name).touch()
    rest = np.zeros(50)
    with SessionWriter(tmp_path / "session.h5", source="test") as writer:
        writer.append(Run("reference", 0, 1000.0, np.arange(50) / 1e3, rest, rest, rest))
    done = _python(WITHOUT_EXTRAS, tmp_path)
    assert "Traceback" not in done.stderr
    sentences = [line for line in done.stderr.splitlines() if line.startswith("Error: ")]
    assert len(sentences) == len(NEEDING), done.stderr
    for sentence, (command, extra) in zip(sentences, NEEDING.items(), strict=True):
        told = rf'Error: .+: needs .+, not installed here\. Run pip install "schwung\[{extra}\]"\.'
        assert re.fullmatch(told, sentence), (command, sentence)
    assert done.stderr.count("exit code 2") == len(NEEDING)


POSIX_ONLY = re.compile(
    r"SIGKILL|SIGHUP|SIGSTOP|send_signal|AF_UNIX|openpty|st_mode\) == |os\.fork|get_context\(\"fork"
)


def test_tests_that_windows_cannot_run_are_marked() -> None:
    """Each file with such a word marks what needs it `posix`; tests/vcan is skipped where there is no kernel CAN."""
    for file in (ROOT / "tests").rglob("*.py"):
        text = file.read_text("utf-8")
        if POSIX_ONLY.search(text) and file.parent.name != "vcan" and file.name.startswith("test_"):
            assert "mark.posix" in text or file == Path(__file__), file


def test_the_core_needs_no_heavy_library() -> None:
    core = {re.split(r"[><=,\[]", need)[0] for need in PROJECT["dependencies"]}
    assert not core & {
        "mujoco",
        "numba",
        "casadi",
        "toppra",
        "nicegui",
        "fmpy",
        "asammdf",
        "pandas",
        "distributed",
        "sphinx",
    }


def test_version_changelog_and_citation_agree() -> None:
    assert PROJECT["version"] == schwung.__version__
    assert f"\n## {schwung.__version__}" in (ROOT / "CHANGELOG.md").read_text(encoding="utf-8")
    citation = (ROOT / "CITATION.cff").read_text(encoding="utf-8")
    assert f"\nversion: {schwung.__version__}\n" in citation
    assert f"\nlicense: {PROJECT['license']['text']}\n" in citation
