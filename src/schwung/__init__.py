"""Schwung commissions servo drives over their fieldbus: it measures the load inertia over angle.

    import schwung

    with schwung.connect("socketcan", "can0", node=3) as connection:
        wishes = schwung.Wishes(distance_rad=3.14, duration_s=0.25)
        plan = schwung.plan(connection, schwung.load_machine("machine.toml"), wishes)
        done = schwung.commission(connection, plan)  # asks before the machine moves
    done.estimate.plot()

Everything is loaded when it is first asked for. docs/python.md shows all of it.
"""

from __future__ import annotations

import sys
from importlib import import_module
from types import ModuleType
from typing import Any

__version__ = "0.1.0"

#: Where each public name is made; __init__.pyi says the same to type checkers.
_PLACES = {
    "schwung.api.computing": (
        "estimate", "example_machine", "load_machine", "read_inertia", "read_session", "simulate",
        "write_inertia", "write_machine",
    ),
    "schwung.api.drives": ("Connection", "connect", "doctor", "scan"),
    "schwung.api.moving": ("Commissioned", "Exported", "Plan", "commission", "export", "plan", "plan_export"),
    "schwung.api.optimising": ("MotionLimits", "Optimised", "Task", "optimise"),
    "schwung.api.reports": ("write_report",),
    "schwung.api.values": (
        "Estimate", "InertiaTable", "Machine", "Run", "Session", "Simulated",
    ),
    "schwung.api.explaining": ("Explanation", "explain"),
    "schwung.commissioning": ("Check", "LimitWishes", "Observer", "Wishes"),
    "schwung.errors": (
        "BusError", "DriveError", "DriveFaultError", "InputError", "InterruptedByUser", "NodeLostError",
        "ParameterError", "RefusedError", "SampleLossError", "SchwungError", "StateError",
    ),
    "schwung.motion": ("Excitation", "Motion"),
}  # fmt: skip
_PLACE_OF = {name: place for place, names in _PLACES.items() for name in names}

__all__ = [  # noqa: PLE0604  # names of strings, as above
    "__version__",
    *sorted(_PLACE_OF),
]


def __getattr__(name: str) -> Any:
    if name not in _PLACE_OF:
        raise AttributeError(f"module 'schwung' has no attribute {name!r}")
    found = getattr(import_module(_PLACE_OF[name]), name)
    globals()[name] = found
    return found


def __dir__() -> list[str]:
    return __all__


def _verb(name: str) -> property:
    """A function that is called like one of the rooms: loading the room does not take its place."""
    return property(
        lambda _package: getattr(import_module(_PLACE_OF[name]), name), lambda _package, _room: None
    )


class _Package(ModuleType):
    explain = _verb("explain")
    optimise = _verb("optimise")


sys.modules[__name__].__class__ = _Package
