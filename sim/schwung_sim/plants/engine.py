"""MuJoCo without its renderer: nothing here draws, and to look for a window system takes half of its import's time."""

from __future__ import annotations

import os

_RENDERER = "MUJOCO_GL"
_chosen = os.environ.get(_RENDERER)
os.environ[_RENDERER] = _chosen or "disable"
try:
    import mujoco
finally:
    if _chosen is None:
        del os.environ[_RENDERER]

__all__ = ["mujoco"]
