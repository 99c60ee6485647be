"""For all tests: one thread for linear algebra, as the command line has it; two workers are enough for two cores.

Byte code is kept also where PYTHONDONTWRITEBYTECODE says otherwise, as in many containers: without it every worker
compiles every test, and every process that a test starts compiles all that it imports, each time.

Temporary folders are in memory, where there is enough for them and programs may lie there: everything that we write is
flushed to the disk, 250 times in tests/service/test_service_story.py alone, and the tests would wait for it.

The garbage collector rests while tests are collected, and never again looks at what was imported by then: a million
objects of libraries that stay until the end, gone through dozens of times.

Ctrl-C interrupts, also where the tests were started in the background of a script, which ignores it and hands that on;
so does a terminal that is closed, which nohup hands on as ignored. What a test does to signals ends with it: the
command line, which has its process for itself, ignores them at its end.
"""

import gc
import os
import signal
import sys
from collections.abc import Generator, Iterator
from pathlib import Path
from typing import Any

import pytest

#: What tests leave in temporary folders, several times over (bytes).
ENOUGH = 4 << 30


def _has_room(folder: str) -> bool:
    """Whether it is there, may be written to and run from, and has room."""
    try:
        found = os.statvfs(folder)
    except (AttributeError, OSError):  # Windows; macOS
        return False
    runs = not found.f_flag & os.ST_NOEXEC
    return runs and os.access(folder, os.W_OK) and found.f_bavail * found.f_frsize > ENOUGH


os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")
if _has_room("/dev/shm"):
    os.environ.setdefault("PYTEST_DEBUG_TEMPROOT", "/dev/shm")
os.environ.pop("PYTHONDONTWRITEBYTECODE", None)
sys.dont_write_bytecode = False
if signal.getsignal(signal.SIGINT) is signal.SIG_IGN:
    signal.signal(signal.SIGINT, signal.default_int_handler)
if os.name == "posix" and signal.getsignal(signal.SIGHUP) is signal.SIG_IGN:
    signal.signal(signal.SIGHUP, signal.SIG_DFL)


@pytest.fixture(autouse=True)
def _signals_as_before() -> Iterator[None]:
    numbers = [getattr(signal, name) for name in ("SIGINT", "SIGTERM", "SIGHUP") if hasattr(signal, name)]
    before = {number: signal.getsignal(number) for number in numbers}
    yield
    for number, handler in before.items():
        if signal.getsignal(number) is not handler:
            signal.signal(number, handler)


#: What comes first. Kernels are compiled once for a computer, by whoever wants them first, and twice where two workers
#: want them at a time: so one worker compiles what most tests need while the other is at what needs none, and what
#: weighing needs while the other is at the browser. Then long files, so that no worker is left with one at the end.
FIRST = (
    "api/test_moving_safely.py", "session/", "fieldbus/", "service/browser/", "real/test_real_explain.py",
    "simulators/test_fmu_belief.py", "sim/test_sealed_cases.py",
)  # fmt: skip
#: Folders of files that take a second or two each. They come last, so that no worker is still at a long file when the
#: others have nothing left to do.
SHORT = ("golden/", "motion/", "sim/")
_HERE = Path(__file__).parent


def _place(item: pytest.Item) -> int:
    """Before and behind all others, which stay in the folders' order."""
    name = item.path.relative_to(_HERE).as_posix()
    for place, first in enumerate(FIRST):
        if name.startswith(first):
            return place
    return len(FIRST) + name.startswith(SHORT)


def pytest_collection_modifyitems(items: list[pytest.Item]) -> None:
    """The order of files; skip what is marked `posix` on Windows."""
    items.sort(key=_place)
    if os.name != "posix":
        for item in items:
            if item.get_closest_marker("posix") is not None:
                item.add_marker(
                    pytest.mark.skip(reason="Windows has no such signals, terminals or file modes")
                )


@pytest.hookimpl(optionalhook=True)
def pytest_xdist_make_scheduler(config: pytest.Config, log: Any) -> Any:
    """Files that share what is slow to come by go to one worker: the browser's a bench, a service and a browser, the
    campaign's what sessions count where nothing goes wrong, and seeds."""
    if config.getoption("dist") != "loadfile":
        return None
    from xdist.scheduler import LoadFileScheduling  # noqa: PLC0415  (only where there are workers)

    class Files(LoadFileScheduling):
        def _split_scope(self, nodeid: str) -> str:
            folder = nodeid.partition("::")[0].rpartition("/")[0]
            return folder if folder.endswith(("/browser", "/campaign")) else super()._split_scope(nodeid)

    return Files(config, log)


@pytest.hookimpl(wrapper=True)
def pytest_collection() -> Generator[None, object, object]:
    """Without garbage collection, and what is there by then is not looked at again."""
    gc.disable()
    try:
        return (yield)
    finally:
        gc.collect()
        gc.freeze()
        gc.enable()
