"""numba.njit with a cache on disk that notices edits in any file of compiled code, not just in its own.

numba ties a cached function to the file that it stands in; a kernel that inlines a function of another file
would go on running that function's old text after an edit. Here the stamp covers every file of compiled code.
"""

from __future__ import annotations

import hashlib
from collections.abc import Callable
from pathlib import Path
from typing import Any, TypeVar, cast

try:
    import numba
except ImportError:  # plain Python then: the same numbers, later
    numba = None

F = TypeVar("F", bound=Callable[..., Any])

_ROOM = Path(__file__).parent
_COMPILED_FILES = (
    "compiled.py",
    "plants/effects.py",
    "plants/foreign.py",
    "plants/profile.py",
    "plants/two_mass.py",
    "plants/crank_kernel.py",
    "plants/native.py",
    "drives/crank_loop.py",
    "drives/controller.py",
)


def _stamp() -> str:
    digest = hashlib.sha1(usedforsecurity=False)
    for name in _COMPILED_FILES:
        digest.update((_ROOM / name).read_bytes())
    return digest.hexdigest()


_STAMP = _stamp()


def compiled(function: F) -> F:
    """Compile with numba where it is installed, cached on disk. For functions that make no array.

    Their arrays are the caller's, so nobody needs to count who holds them (`_nrt`, numba's own): counted, at every
    call of a function that takes one, a tick takes more than twice as long. One that makes an array is not compiled
    at all. The stamp is set through numba's private `_cache_file`; a numba without it merely has the coarser cache.
    """
    if numba is None:
        return function
    dispatcher = cast(F, numba.njit(cache=True, error_model="numpy", _nrt=False)(function))
    cache_file: Any = getattr(getattr(dispatcher, "_cache", None), "_cache_file", None)
    if hasattr(cache_file, "_source_stamp"):
        cache_file._source_stamp = (cache_file._source_stamp, _STAMP)
    return dispatcher


def compiled_for(function: F, *arguments: Any) -> F:
    """A compiled function for arguments of these types alone.

    numba asks at every call of which types its arguments are, each array of each of them: as long as a short one takes.
    """
    if numba is None:
        return function
    dispatcher: Any = function
    return cast(F, dispatcher.compile(tuple(numba.typeof(one) for one in arguments)))
