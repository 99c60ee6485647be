"""Workers: processes of this computer, or those of a Dask scheduler by its address.

One process does one session at a time, in one thread: what a session kills is that session's work alone, or is done
again, and the linear algebra of small matrices gains nothing from a second thread. On Linux a worker is a fork of a
process that has nothing but the libraries: they are imported once, and while the archive is looked through.
"""

from __future__ import annotations

import itertools
import logging
import multiprocessing
import os
import signal
import sys
import time
from collections import deque
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import CancelledError
from contextlib import contextmanager
from multiprocessing import forkserver
from statistics import median
from typing import Any

import dask
import distributed.utils
from distributed import Client, Future, LocalCluster, as_completed
from distributed.scheduler import KilledWorker

from schwung import __version__
from schwung.batch.archive import Item, Wish
from schwung.batch.work import Outcome, carry_out, code_version, failed
from schwung.errors import InputError

Tell = Callable[[str], None]

#: A task is as many sessions as take so long (s): what Dask does for each task, 8 ms of this computer's processors, is
#: shared by them, and an interrupt or a worker's death costs no more than that.
TASK_S = 1.0
_TASKS_PER_THREAD = 2  # under way or next
_PATIENCE_S = 10.0
_ONE_THREAD = dict.fromkeys(("OMP_NUM_THREADS", "MKL_NUM_THREADS", "OPENBLAS_NUM_THREADS"), "1")
_FORKS = sys.platform == "linux"  # elsewhere the system's own libraries do not outlive a fork
_SETTINGS = {
    "distributed.scheduler.allowed-failures": 1,  # a session with which two workers died is not tried again
    "distributed.scheduler.worker-saturation": 1.0,  # no session waits on a worker that another one kills
    "distributed.nanny.pre-spawn-environ": _ONE_THREAD,
    "distributed.worker.multiprocessing-method": "forkserver" if _FORKS else "spawn",
    # What Dask does beside the work, for a dashboard that is not there: it would cost a tenth of the processors.
    "distributed.worker.profile.enabled": False,
    "distributed.worker.memory.monitor-interval": "1s",
    "distributed.scheduler.work-stealing": False,  # nothing waits on a worker
    "distributed.scheduler.active-memory-manager.start": False,
    "distributed.admin.tick.interval": "1s",
    "distributed.admin.tick.cycle": "1s",
    "distributed.admin.system-monitor.interval": "5s",
    # Ctrl-C reaches every process of a terminal; the one that was started ends the others.
    "distributed.worker.preload": ["import signal\nsignal.signal(signal.SIGINT, signal.SIG_IGN)\n"],
    "distributed.admin.system-monitor.gil.enabled": False,
}


def cores() -> int:
    """How many of this computer's processors we may use."""
    if hasattr(os, "sched_getaffinity"):
        return len(os.sched_getaffinity(0))
    return os.cpu_count() or 1


def begin_start() -> None:
    """Have the libraries of this computer's workers loaded; returns at once, and does nothing the second time."""
    if not _FORKS:
        return
    # Dask would have the fork server load pandas as well, and this process with it.
    distributed.utils._forkserver_preload_set = True
    context = multiprocessing.get_context("forkserver")
    context.set_forkserver_preload(["distributed.nanny", "schwung.batch.work"])
    os.environ.update(
        _ONE_THREAD
    )  # read when the libraries are loaded; the nanny's own setting comes too late for that
    before = signal.pthread_sigmask(signal.SIG_BLOCK, {signal.SIGINT})  # inherited: Ctrl-C is not for workers
    try:
        forkserver.ensure_running()
    finally:
        signal.pthread_sigmask(signal.SIG_SETMASK, before)


@contextmanager
def workers(scheduler: str | None, jobs: int, tell: Tell) -> Iterator[Client]:
    """Workers for the block: `jobs` processes of this computer, or those of a scheduler.

    `tell` hears of every worker that is lost, and of one that has another Schwung. Raises InputError where the
    scheduler does not answer, has no workers, or one of them has no Schwung.
    """
    with dask.config.set(_SETTINGS):
        if scheduler is None:
            begin_start()
            with (
                LocalCluster(
                    n_workers=jobs,
                    threads_per_worker=1,
                    processes=True,
                    host="127.0.0.1",
                    scheduler_kwargs={"dashboard": False, "dashboard_address": "127.0.0.1:0"},
                    silence_logs=logging.CRITICAL,
                ) as cluster,
                Client(cluster) as client,
                _watched(client, tell),
            ):
                yield client
            return
        with _remote(scheduler) as client:
            _require_ready(client, scheduler, tell)
            with _watched(client, tell):
                yield client


@contextmanager
def _remote(scheduler: str) -> Iterator[Client]:
    try:
        client = Client(scheduler, timeout=_PATIENCE_S, set_as_default=False)
    except (OSError, TimeoutError, ValueError) as error:
        reason = str(error).splitlines()[0] if str(error) else "it does not answer"
        raise InputError(
            f"scheduler {scheduler}",
            f"cannot be reached ({reason})",
            "Start `dask scheduler`; check the address.",
        ) from None
    with client:
        yield client


def _require_ready(client: Client, scheduler: str, tell: Tell) -> None:
    try:
        versions: dict[str, str] = client.run(code_version)
    except Exception as error:  # whatever a worker raises where it has no Schwung, or half of one
        raise InputError(
            f"scheduler {scheduler}", f"a worker has no Schwung ({error})", "Install schwung[batch] there."
        ) from None
    if not versions:
        raise InputError(f"scheduler {scheduler}", "has no workers", f"Start `dask worker {scheduler}`.")
    for worker, version in versions.items():
        if version != __version__:
            tell(f"Worker {worker} has Schwung {version}, this is {__version__}")


@contextmanager
def _watched(client: Client, tell: Tell) -> Iterator[None]:
    """Tell of workers that are lost: the scheduler says so to everybody who listens."""

    def heard(event: tuple[float, Any]) -> None:
        _, message = event
        if isinstance(message, dict) and message.get("action") == "remove-worker" and not message["expected"]:
            again = "what it was doing is done again" if message.get("processing-tasks") else "it was idle"
            tell(f"Worker {message['worker']} was lost; {again}")

    client.subscribe_topic("all", heard)
    try:
        yield
    finally:
        client.unsubscribe_topic("all")  # else the scheduler would tell it of its own going, in vain


def outcomes(
    client: Client, work: Sequence[tuple[Item, str]], wish: Wish
) -> Iterator[tuple[Item, str, Outcome]]:
    """Carry out all work, pairs of session and key; yields each with its outcome when that is there, in any order.

    A task is one session or several, as many as take `TASK_S`, going by those before; towards the end fewer, so that
    all workers end together. A session dies alone: those of a task that two workers have died of are tried one by one.
    """
    left, alone = deque(work), deque[tuple[Item, str]]()
    threads = max(sum(client.nthreads().values()), 1)
    paces: deque[float] = deque(maxlen=2 * threads)  # s per session, the latest ones
    tasks: dict[str, tuple[Future, Sequence[tuple[Item, str]]]] = {}
    ended = as_completed(loop=client.loop)
    numbers = itertools.count()

    def hand_out() -> None:
        if alone:
            pairs = [alone.popleft()]
        else:
            most = TASK_S / max(median(paces), 1e-3) if len(paces) == paces.maxlen else 1
            pairs = [left.popleft() for _ in range(max(1, min(int(most), len(left) // (2 * threads))))]
        key = f"schwung-{wish.kind}-{next(numbers)}-{pairs[0][1]}"
        future = client.submit(carry_out_each, pairs, wish, key=key, pure=False)
        tasks[future.key] = future, pairs
        ended.add(future)

    def fill() -> None:
        while (left or alone) and len(tasks) < _TASKS_PER_THREAD * threads:
            hand_out()

    fill()
    try:
        for future in ended:
            _, pairs = tasks.pop(future.key)
            try:
                found = _outcomes(future, pairs)
            except KilledWorker:
                alone.extend(pairs)
                found = []
            fill()  # first: a worker shall not wait for what we do with the results
            for (item, key), (took_s, outcome) in zip(pairs, found, strict=False):
                if outcome.error is None:
                    paces.append(took_s)
                yield item, key, outcome
            future.release()  # the results are kept elsewhere
    finally:
        client.cancel([future for future, _ in tasks.values()], force=True)


def carry_out_each(pairs: Sequence[tuple[Item, str]], wish: Wish) -> list[tuple[float, Outcome]]:
    """What one worker does with one task: sessions after another, each with how long it took (s)."""
    found = []
    for item, key in pairs:
        began = time.perf_counter()
        outcome = carry_out(item, wish, key)
        found.append((time.perf_counter() - began, outcome))
    return found


def _outcomes(future: Future, pairs: Sequence[tuple[Item, str]]) -> list[tuple[float, Outcome]]:
    """What came of a task. Raises KilledWorker where one of its several sessions has killed two workers."""
    try:
        found: list[tuple[float, Outcome]] = future.result()
    except KilledWorker:
        if len(pairs) > 1:
            raise
        item = pairs[0][0]
        return [
            (
                0.0,
                failed(
                    f"{item.session}: two workers died of it, of too little memory or of a library's defect"
                ),
            )
        ]
    except (Exception, CancelledError) as error:  # of the cluster, not of the session
        return [
            (0.0, failed(f"{item.session}: the cluster let us down ({type(error).__name__}: {error})"))
            for item, _ in pairs
        ]
    return found
