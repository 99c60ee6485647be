"""numba.njit with a cache on disk that notices edits in every file of this room's compiled code.

numba ties a cached function to the file that it stands in; a kernel that inlines a function of another file would go on
running that function's old text after an edit. Here the stamp covers all of them.
"""

from __future__ import annotations

import hashlib
from collections.abc import Callable
from pathlib import Path
from typing import Any, TypeVar, cast

import numba

F = TypeVar("F", bound=Callable[..., Any])

_FILES = ("kernel.py", "learned.py", "physics.py")


def _stamp() -> str:
    digest = hashlib.sha1(usedforsecurity=False)
    for name in _FILES:
        digest.update(Path(__file__).with_name(name).read_bytes())
    return digest.hexdigest()


_STAMP = _stamp()


def compiled(function: F) -> F:
    """Compile with numba under numpy's error model (no check of every division: three times faster), cached on disk.

    For code of other rooms that calls this one's compiled functions, too.
    """
    return _stamped(numba.njit(cache=True, error_model="numpy")(function), function)


def inlined(function: F) -> F:
    """`compiled`, and put wherever it is called: for small functions whose arguments are many."""
    return _stamped(numba.njit(cache=True, error_model="numpy", forceinline=True)(function), function)


def _stamped(dispatcher: Any, _: F) -> F:
    """The stamp is set through numba's private `_cache_file`; a numba without it merely has the coarser cache."""
    cache_file: Any = getattr(getattr(dispatcher, "_cache", None), "_cache_file", None)
    if hasattr(cache_file, "_source_stamp"):
        cache_file._source_stamp = (cache_file._source_stamp, _STAMP)
    return cast(F, dispatcher)
