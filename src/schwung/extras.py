"""Libraries that only some commands need: which extra of ours brings them, and one sentence where one is not there."""

from __future__ import annotations

from importlib.util import find_spec

from schwung.errors import InputError

#: By extra: modules that it brings, and what they are called.
EXTRAS = {
    "batch": {"distributed": "Dask"},
    "bench": {"mujoco": "MuJoCo", "numba": "Numba"},
    "fast": {"numba": "Numba"},
    "fmi": {"fmpy": "FMPy"},
    "logs": {"asammdf": "asammdf", "cantools": "cantools", "pyarrow": "PyArrow"},
    "optimise": {"casadi": "CasADi", "toppra": "TOPP-RA"},
    "web": {
        "nicegui": "NiceGUI", "fastapi": "FastAPI", "uvicorn": "Uvicorn", "python_multipart": "python-multipart",
        "prometheus_client": "prometheus-client",
    },
}  # fmt: skip


class MissingLibraryError(InputError):
    """Something was asked for that needs a library which is not installed; nothing has been touched."""

    def __init__(self, place: str, libraries: str, install: str) -> None:
        super().__init__(place, f"needs {libraries}, not installed here", f'Run pip install "{install}".')


def require(place: str, extra: str, *modules: str) -> None:
    """Raise MissingLibraryError where one of these modules, or of all those of an extra, is not installed."""
    brought = EXTRAS[extra]
    missing = [name for name in modules or brought if find_spec(name) is None]
    if missing:
        *first, last = [brought[name] for name in missing]
        named = f"{', '.join(first)} and {last}" if first else last
        raise MissingLibraryError(place, named, f"schwung[{extra}]")
