"""python-can without what only its MF4 files need: it loads asammdf, and so pandas and pyarrow, wherever that is
installed, a quarter of a second before the first frame.

Whoever may be the first to need python-can imports it from here: the clock, CANopen, `schwung bench` before the machine
room. Everybody else imports `can` as ever.
"""

from __future__ import annotations

import importlib
import sys

_MF4, _ITS_LIBRARY = "can.io.mf4", "asammdf"

if "can" in sys.modules or _ITS_LIBRARY in sys.modules:
    import can
else:
    sys.modules[_ITS_LIBRARY] = None  # type: ignore[assignment]  # to Python: is not installed
    try:
        import can
    finally:
        del sys.modules[_ITS_LIBRARY]

__all__ = ["can", "with_mf4"]


def with_mf4() -> None:
    """Load the rest: before python-can writes or reads an MF4 file. Its classes stay what they are."""
    if getattr(sys.modules[_MF4], _ITS_LIBRARY) is None:
        importlib.reload(sys.modules[_MF4])
