"""Kernels: plain functions of numbers and arrays, which numba compiles where it is installed (the extra `[fast]`).

Without numba they run as they are: the same numbers, later, and as silent where one is infinite. With it nothing is
imported, let alone compiled, before a kernel is first called: a command that computes nothing does not wait for it.

Compiled code is cached on disk. numba ties it to the file that a function stands in; a kernel that inlines a function
of another file would go on running that function's old text after an edit. So the stamp here covers every file that a
kernel takes something from.

What may not take too long asks `computing_s`: a kernel is compiled once for a computer, whoever calls it first.
"""

from __future__ import annotations

import hashlib
import sys
import threading
import time
from collections.abc import Callable, Iterator
from functools import cached_property, partial, update_wrapper
from importlib.util import find_spec
from pathlib import Path
from types import FunctionType, ModuleType
from typing import Any, TypeVar, cast

import numpy as np

F = TypeVar("F", bound=Callable[..., Any])

#: Whether kernels are compiled here.
IS_FAST = find_spec("numba") is not None


def compiled(function: F) -> F:
    """Compile with numba under numpy's error model (no check of every division: three times faster)."""
    return _kernel(function) if IS_FAST else np.errstate(all="ignore")(function)


def inlined(function: F) -> F:
    """`compiled`, and put wherever it is called: for small functions whose arguments are many."""
    return _kernel(function, forceinline=True) if IS_FAST else function


def compiled_fastmath(function: F) -> F:
    """`compiled`, and sums may be taken in any order: several at once."""
    return _kernel(function, fastmath=True) if IS_FAST else function


def compiled_or(plain: F, *, fastmath: bool = False) -> Callable[[F], F]:
    """`compiled`, or without numba another function of the same arguments and values, which works on whole arrays."""

    def choose(function: F) -> F:
        return _kernel(function, fastmath=fastmath) if IS_FAST else plain

    return choose


def _kernel(function: F, **options: bool) -> F:
    return cast(F, Kernel(cast(FunctionType, function), options))


class Kernel:
    """A function that is compiled when it is first called, or when one that calls it is."""

    def __init__(self, function: FunctionType, options: dict[str, bool]) -> None:
        update_wrapper(self, function)
        self.py_func = function
        self._options = options
        self._run: Callable[..., Any] = partial(_first, self)

    def __call__(self, *arguments: Any) -> Any:
        return self._run(*arguments)

    @cached_property
    def dispatcher(self) -> Any:
        """What numba makes of it.

        The stamp is set through numba's private `_cache_file`; a numba without it merely has the coarser cache.
        """
        import numba  # noqa: PLC0415  (a tenth of a second)

        _COMPILING.heed()
        made = numba.njit(cache=True, error_model="numpy", **self._options)(self.py_func)
        file: Any = getattr(getattr(made, "_cache", None), "_cache_file", None)
        if hasattr(file, "_source_stamp"):
            file._source_stamp = (file._source_stamp, stamp(self.py_func))
        self._run = made
        return made

    @property
    def _numba_type_(self) -> Any:
        """By which numba knows what a kernel calls when it calls another."""
        return self.dispatcher._numba_type_


def computing_s() -> float:
    """Time that this thread has had of a processor (s), since some instant, but for compiling.

    While it waits, or others have the processors, other threads of this process among them, this stands still.
    """
    return time.thread_time() - _COMPILING.taken_s


class _Compiling(threading.local):
    """What numba's compiling has taken of a thread's processor: kernels that others call are compiled within theirs."""

    heeded = False  # in all threads

    def __init__(self) -> None:
        self.taken_s, self._began_s, self._deep = 0.0, 0.0, 0

    def heed(self) -> None:
        """From now on, whenever numba compiles."""
        if not _Compiling.heeded:
            from numba.core import event  # noqa: PLC0415  (see above)

            event.register("numba:compile", _listener(event.Listener, self))
            _Compiling.heeded = True

    def begin(self) -> None:
        """Another kernel."""
        if self._deep == 0:
            self._began_s = time.thread_time()
        self._deep += 1

    def end(self) -> None:
        """The last begun."""
        self._deep -= 1
        if self._deep == 0:
            self.taken_s += time.thread_time() - self._began_s


def _listener(base: Any, compiling: _Compiling) -> Any:
    """What numba tells of it: of its own type, which is known once numba is there."""

    class Listener(base):  # type: ignore[misc]
        def on_start(self, _event: object) -> None:
            compiling.begin()

        def on_end(self, _event: object) -> None:
            compiling.end()

    return Listener()


_COMPILING = _Compiling()


def _first(kernel: Kernel, *arguments: Any) -> Any:
    return kernel.dispatcher(*arguments)


def stamp(function: FunctionType) -> str:
    """A digest of every file that a compiled function takes other functions or classes from, its own included."""
    digest = hashlib.sha1(usedforsecurity=False)
    for file in sorted(files_of(function)):
        digest.update(Path(file).read_bytes())
    return digest.hexdigest()


def files_of(function: FunctionType) -> set[str]:
    """Where a function stands, what it calls, and so on."""
    files, todo, done = set(), [function], set()
    while todo:
        one = todo.pop()
        done.add(one)
        files.add(one.__code__.co_filename)
        for named in _named(one):
            if isinstance(named, Kernel):
                todo += [] if named.py_func in done else [named.py_func]
            elif isinstance(named, type) and named.__module__.startswith(__package__):
                files.add(str(sys.modules[named.__module__].__file__))
    return files


def _named(function: FunctionType) -> Iterator[Any]:
    """The globals that a function names, and what it names of those that are modules."""
    for name in function.__code__.co_names:
        value = function.__globals__.get(name)
        yield value
        if isinstance(value, ModuleType):
            yield from (vars(value).get(attribute) for attribute in function.__code__.co_names)
