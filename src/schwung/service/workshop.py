"""Processes that compute, so that neither the event loop nor a lane waits for the interpreter's lock.

A process is kept for the next work, ends when cancelled or when its parent is gone, and is replaced after `USES`
works, so that nothing that a library forgets to free adds up. On Linux each is a fork of one that has nothing but the
libraries: they are imported once, and the next process is there at once.
"""

from __future__ import annotations

import contextlib
import gc
import multiprocessing
import os
import signal
import sys
import threading
import traceback
from collections.abc import Callable, Mapping
from multiprocessing import forkserver
from multiprocessing.connection import Connection
from multiprocessing.process import BaseProcess
from typing import Any

from schwung.errors import SchwungError

#: What may be computed: a function of a module, with keyword arguments, `tell` among them; its result is JSON-ready.
Compute = Callable[..., dict[str, Any]]
#: What is being done, and the share done of all, 0…1.
Tell = Callable[[str, float], None]

USES = 50
_LOOK_S = 0.05
_NICE = 5  # what moves goes first
_ENDED_WITHIN_S = 2.0
_FORKS = sys.platform == "linux"  # elsewhere the system's own libraries do not outlive a fork
#: What most works need. What is not installed is left out.
_LIBRARIES = ["schwung.service.work.computing", "schwung.report.html", "numba"]


class ComputeError(SchwungError):
    """A computation ended without a result: a defect of ours, or the system ended it (memory)."""


class Workshop:
    """Runs functions in processes of its own; `run` may be called from several threads at a time."""

    def __init__(self) -> None:
        self._idle: list[_Process] = []
        self._busy: set[_Process] = set()
        self._warming = False
        self._lock = threading.Lock()
        self._closed = False

    def warm(self) -> None:
        """Have a process ready, its libraries loaded, before it is needed; returns at once."""
        with self._lock:
            if self._idle or self._warming or self._closed:
                return
            self._warming = True
        threading.Thread(target=self._add_process, name="schwung warming", daemon=True).start()

    def _add_process(self) -> None:
        process = _Process()
        with self._lock:
            self._warming = False
            keep = not self._idle and not self._closed
            if keep:
                self._idle.append(process)
        if not keep:
            process.end()

    def run(
        self,
        function: Compute,
        arguments: Mapping[str, Any],
        tell: Tell,
        cancelled: Callable[[], bool],
        *,
        alone: bool = False,
    ) -> Any:
        """Run `function(**arguments, tell=…)` elsewhere and wait for it. `alone`: in a process that ends with it,
        and may have processes of its own.

        Raises what it raises where that is a SchwungError, KeyboardInterrupt when `cancelled` says so, ComputeError
        else.
        """
        with self._lock:
            if self._closed:
                raise KeyboardInterrupt
            process = self._idle.pop() if self._idle and not alone else None
        process = process or _Process(alone=alone)
        with self._lock:
            self._busy.add(process)  # which `close` ends, but for one that came too late for that
            closed = self._closed
        keep = False
        try:
            if closed:
                raise KeyboardInterrupt
            result = process.run(function, arguments, tell, cancelled)
            keep = process.uses < USES
            return result
        except SchwungError as error:
            keep = not isinstance(error, ComputeError)
            raise
        finally:
            with self._lock:
                self._busy.discard(process)
                keep = keep and not alone and not self._closed and not self._idle
                if keep:
                    self._idle.append(process)
            if not keep:
                process.end()

    def close(self) -> None:
        """End all processes; whoever waits in `run` gets KeyboardInterrupt."""
        with self._lock:
            self._closed = True
            idle, self._idle = self._idle, []
            busy = list(self._busy)
        for process in (*idle, *busy):
            process.end()


class _Process:
    def __init__(self, *, alone: bool = False) -> None:
        context = _context(alone)
        self._ours, theirs = context.Pipe()
        self._process: BaseProcess = context.Process(
            target=_serve, args=(theirs,), name="schwung compute", daemon=not alone
        )
        self._process.start()
        theirs.close()
        self.uses = 0

    def run(
        self, function: Compute, arguments: Mapping[str, Any], tell: Tell, cancelled: Callable[[], bool]
    ) -> Any:
        self.uses += 1
        try:
            self._ours.send((function, dict(arguments)))
            while True:
                while not self._ours.poll(_LOOK_S):
                    if cancelled():
                        raise KeyboardInterrupt
                word, *content = self._ours.recv()
                if word == "tell":
                    tell(*content)
                elif word == "done":
                    return content[0]
                else:
                    raise content[0]
        except (EOFError, OSError) as error:
            if cancelled():
                raise KeyboardInterrupt from None
            self._process.join(_ENDED_WITHIN_S)
            raise ComputeError(
                "computation", f"its process ended (exit code {self._process.exitcode})",
                "Was there enough memory? What was recorded is kept; try again.",
            ) from error  # fmt: skip

    def end(self) -> None:
        """End it, whatever it does."""
        self._process.terminate()
        self._process.join(_ENDED_WITHIN_S)
        if self._process.is_alive():
            self._process.kill()
            self._process.join(_ENDED_WITHIN_S)
        with contextlib.suppress(OSError):
            self._ours.close()


def _context(alone: bool) -> Any:
    """How a process begins: one that has processes of its own as a program of its own, others by a fork."""
    if alone or not _FORKS:
        return multiprocessing.get_context("spawn")
    context = multiprocessing.get_context("forkserver")
    context.set_forkserver_preload(_LIBRARIES)
    before = signal.pthread_sigmask(signal.SIG_BLOCK, {signal.SIGINT})  # inherited: Ctrl-C is for the service
    try:
        forkserver.ensure_running()
    finally:
        signal.pthread_sigmask(signal.SIG_SETMASK, before)
    return context


def _serve(pipe: Connection) -> None:
    """The life of a process: work after work, until nobody is there any more."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)  # Ctrl-C is for the service, which ends us
    if hasattr(os, "nice"):
        os.nice(_NICE)
    threading.Thread(target=_end_with_parent, daemon=True).start()
    import schwung.api.computing  # noqa: F401, PLC0415  # what most works need, before the first one comes

    while True:
        try:
            function, arguments = pipe.recv()
        except (EOFError, OSError):
            return
        try:
            answer = (
                "done",
                function(**arguments, tell=lambda text, share: pipe.send(("tell", text, share))),
            )
        except SchwungError as error:
            answer = ("failed", error)
        except Exception as error:
            trouble = ComputeError(
                "computation", f"failed: {error}", "This is a defect of Schwung's; please report it."
            )
            trouble.add_note(traceback.format_exc())
            answer = ("failed", trouble)
        pipe.send(answer)
        del answer
        gc.collect()  # now that nobody waits: a figure is one large cycle, and the collector would come seldom


def _end_with_parent() -> None:
    parent = multiprocessing.parent_process()
    if parent is not None:
        parent.join()
        os._exit(1)
