"""Workers: processes of this computer, or those of a Dask scheduler by its address.

One process does one session at a time, in one thread: what a session kills is that session's work alone, and the
linear algebra of small matrices gains nothing from a second thread. On Linux a worker is a fork of a process that has
nothing but the libraries: they are imported once, and while the archive is looked through.
"""

from __future__ import annotations

import logging
import multiprocessing
import os
import signal
import sys
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import CancelledError
from contextlib import contextmanager
from multiprocessing import forkserver
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
    """Carry out all work, pairs of session and key; yields each with its outcome when that is there, in any order."""
    futures = [
        client.submit(carry_out, item, wish, key, key=f"schwung-{wish.kind}-{number}-{key}", pure=False)
        for number, (item, key) in enumerate(work)
    ]
    of = {future.key: pair for future, pair in zip(futures, work, strict=True)}
    try:
        for future in as_completed(futures, loop=client.loop):
            item, key = of[future.key]
            yield item, key, _outcome(future, item)
            future.release()  # the result is kept elsewhere
    finally:
        client.cancel(futures, force=True)


def _outcome(future: Future, item: Item) -> Outcome:
    try:
        outcome: Outcome = future.result()
    except KilledWorker:
        return failed(
            f"{item.session}: two workers died of it, of too little memory or of a library's defect"
        )
    except (Exception, CancelledError) as error:  # of the cluster, not of the session
        return failed(f"{item.session}: the cluster let us down ({type(error).__name__}: {error})")
    return outcome
