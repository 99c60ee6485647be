"""The session file (HDF5), read strictly and written so that a crash costs one recording at the most.

HDF5 itself survives no crash: a process that dies between two metadata writes leaves a file that nothing
opens. So the file on disk is never open for writing. The writer keeps the session as an HDF5 image in memory;
every append writes that image beside the file, syncs it and renames it over the old one, which is atomic.
Sessions are a few MB, so this costs milliseconds per run.
"""

from __future__ import annotations

import json
import os
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from datetime import UTC, datetime
from pathlib import Path
from types import TracebackType
from typing import Any, Self, TypeVar, get_args
from uuid import uuid4

import h5py
import numpy as np
from pydantic import BaseModel, ValidationError

from schwung.errors import InputError, SchwungError
from schwung.files import replace_file
from schwung.motion import Array, Excitation, Motion, MotionKind
from schwung.quantities import Effort
from schwung.session.model import Axis, PartialRun, Run, Session

_Model = TypeVar("_Model", bound=BaseModel)

FORMAT = "schwung-session"
VERSION = 1

_UNITS: dict[str, dict[str, str]] = {
    "rotary": {"position": "rad", "speed": "rad/s", "torque": "N·m"},
    "linear": {"position": "m", "speed": "m/s", "torque": "N"},
}
FIELDS = {
    "time": "time_s",
    "position": "position_rad",
    "speed": "speed_rad_s",
    "torque": "torque_nm",
    "position_demand": "position_demand_rad",
    "torque_added": "torque_added_nm",
}
_REQUIRED = ("time", "position", "speed", "torque")
#: No servo axis is beyond these; a larger number is a wrong unit or a broken file. In the units above and s.
_RANGE = {"time": 1e6, "position": 1e7, "speed": 1e5, "torque": 1e7}
_MAX_RATE_HZ = 1e7
_ATTRIBUTE_CHARACTERS = 15_000  # HDF5 holds attributes up to 64 KiB; UTF-8 takes up to 4 bytes per character
_RUN_ATTRIBUTES = ("role", "repeat", "sample_rate_hz", "motion", "excitation")
_ROOT_ATTRIBUTES = ("format", "version", "created", "source", "axis", "drive", "effort")


def unit_of(dataset: str, axis: Axis = "rotary", effort: Effort = "torque") -> str:
    """The unit in which the file holds a dataset, as written in its `unit` attribute."""
    if dataset == "time":
        return "s"
    if effort == "current" and _quantity(dataset) == "torque":
        return "A"
    return _UNITS[axis][_quantity(dataset)]


def _quantity(dataset: str) -> str:
    return {"position_demand": "position", "torque_added": "torque"}.get(dataset, dataset)


def read_session(path: str | os.PathLike[str]) -> Session:
    """Read a session file, version 1.

    Raises InputError, naming file, place in it and remedy, where the file breaks its contract: not HDF5 or
    truncated, unknown version, missing dataset, wrong unit, non-finite or implausible number, unequal
    lengths, time that does not increase. What this version does not know is kept in `extra`.
    """
    path = Path(path)
    if not path.is_file():
        raise InputError(str(path), "there is no such session file", "Check the path.")
    try:
        with h5py.File(path, "r") as file:
            return _read_root(file, f"{path}: /")
    except SchwungError:
        raise
    except (OSError, RuntimeError, KeyError, ValueError, TypeError) as error:  # h5py raises all of these
        reason = str(error).strip("'\"").splitlines()[0] if str(error) else type(error).__name__
        raise InputError(str(path), f"is not a readable HDF5 file, or is truncated ({reason})",
                         "Copy it again from where it was recorded, or record again.") from error  # fmt: skip


def _read_root(file: h5py.File, root: str) -> Session:
    """`root` is the place of the file's own attributes, "file: /"."""
    if _text(file, "format", root) != FORMAT:
        raise InputError(f"{root}@format", f'is "{_text(file, "format", root)}", not "{FORMAT}"',
                         "Give a session that Schwung recorded or imported.")  # fmt: skip
    version = _number(file, "version", root)
    if version != VERSION:
        raise InputError(f"{root}@version", f"is {version:g}; this Schwung reads version {VERSION}",
                         "Update Schwung, or export the session as version 1.")  # fmt: skip
    created = _text(file, "created", root)
    try:
        datetime.fromisoformat(created)
    except ValueError:
        raise InputError(f"{root}@created", f'"{created}" is not an ISO 8601 date',
                         "Write it like 2024-02-28T09:30:00+01:00.") from None  # fmt: skip
    axis = _text(file, "axis", root) if "axis" in file.attrs else "rotary"
    if axis not in _UNITS:
        raise InputError(f"{root}@axis", f'is "{axis}"', 'Use "rotary" or "linear".')
    known: Axis = "linear" if axis == "linear" else "rotary"
    effort = _text(file, "effort", root) if "effort" in file.attrs else "torque"
    if effort not in ("torque", "current"):
        raise InputError(f"{root}@effort", f'is "{effort}"', 'Use "torque" or "current".')
    made_of: Effort = "current" if effort == "current" else "torque"
    drive = _json(file, "drive", root) if "drive" in file.attrs else None
    runs = file.get("run")
    if not isinstance(runs, h5py.Group):
        raise InputError(f"{root}run", "is missing", "A session holds its runs in /run/0000, /run/0001, …")
    return Session(
        runs=tuple(_read_run(runs, name, known, made_of, root) for name in _numbered(runs)),
        created=created,
        source=_text(file, "source", root),
        axis=known,
        drive=drive,
        partial_reasons=_partial_reasons(file),
        extra=_extra_attributes(file, _ROOT_ATTRIBUTES),
        effort=made_of,
    )


def _numbered(group: h5py.Group) -> list[str]:
    return sorted((name for name in group if name.isdecimal()), key=int)


def _partial_reasons(file: h5py.File) -> tuple[str, ...]:
    group = file.get("partial")
    if not isinstance(group, h5py.Group):
        return ()
    return tuple(str(_plain(group[name].attrs.get("reason", "no reason given"))) for name in _numbered(group))


def _read_run(runs: h5py.Group, name: str, axis: Axis, effort: Effort, root: str) -> Run:
    place = f"{root}run/{name}"
    group = runs.get(name)
    if not isinstance(group, h5py.Group):
        raise InputError(place, "is not a group of datasets", "Each run is a group /run/NNNN.")
    role = _text(group, "role", place)
    if role not in ("reference", "excited"):
        raise InputError(f"{place}@role", f'is "{role}"', 'Use "reference" or "excited".')
    repeat = _number(group, "repeat", place)
    if repeat != int(repeat) or repeat < 0:
        raise InputError(f"{place}@repeat", f"is {repeat:g}", "Count repetitions in whole numbers from 0.")
    rate = _number(group, "sample_rate_hz", place)
    if not 0 < rate <= _MAX_RATE_HZ:
        raise InputError(f"{place}@sample_rate_hz", f"is {rate:g}", "Give the sampling rate in Hz.")
    excitation = _value(group, "excitation", Excitation, place)
    if role == "reference" and excitation is not None:
        raise InputError(f"{place}@excitation", "a reference run cannot have an excitation",
                         'Set role to "excited", or remove the attribute.')  # fmt: skip
    if excitation is not None and excitation.frequency_hz >= rate / 2:
        raise InputError(f"{place}@excitation", f"{excitation.frequency_hz:g} Hz is not seen at {rate:g} Hz",
                         "Correct frequency_hz or sample_rate_hz.")  # fmt: skip
    arrays = {
        field: _dataset(group, dataset, unit_of(dataset, axis, effort), place)
        for dataset, field in FIELDS.items()
        if dataset in _REQUIRED or dataset in group
    }
    extra = _extra_attributes(group, _RUN_ATTRIBUTES)
    for key, item in group.items():
        if key not in FIELDS and isinstance(item, h5py.Dataset):
            extra[key] = _parsed(item[()])
    motion = None
    if _is_foreign(group, place):  # kept as it is, for what it tells: which runs repeat the same
        told = extra["motion"] = _json(group, "motion", place)
        injected = None if excitation is None else excitation.model_dump_json()
        extra.setdefault("same_motion", f"motion {json.dumps(told, sort_keys=True)} {injected}")
    else:
        motion = _value(group, "motion", Motion, place)
    return Run(
        role="excited" if role == "excited" else "reference",
        repeat=int(repeat),
        sample_rate_hz=rate,
        motion=motion,
        excitation=excitation,
        name=place,
        extra=extra,
        **arrays,
    )


def _is_foreign(group: h5py.Group, place: str) -> bool:
    """Whether a run's motion is of a kind that another program knows; the recording says how it went."""
    if "motion" not in group.attrs:
        return False
    kind = _json(group, "motion", place).get("kind")
    return isinstance(kind, str) and kind not in get_args(MotionKind)


def _dataset(group: h5py.Group, name: str, wanted: str, place: str) -> Array:
    """One dataset as float64 (n,); lengths and finiteness are checked by Run."""
    where = f"{place}/{name}"
    item = group.get(name)
    if not isinstance(item, h5py.Dataset):
        raise InputError(where, "is missing", "A run needs time, position, speed and torque.")
    unit = _plain(item.attrs.get("unit", ""))
    if unit != wanted:
        said = f'unit is "{unit}"' if unit else "has no unit attribute"
        raise InputError(where, f'{said}, expected "{wanted}"',
                         "Convert the numbers and correct the attribute.")  # fmt: skip
    if item.dtype.kind != "f" or item.dtype.itemsize != 8 or item.ndim != 1:
        raise InputError(where, f"is {item.dtype} with {item.ndim} dimensions",
                         "Store float64 with one dimension.")  # fmt: skip
    values = np.asarray(item[()], dtype=np.float64)
    limit = _RANGE[_quantity(name)]
    wrong = np.flatnonzero(np.abs(values) > limit)
    if wrong.size and np.isfinite(values[wrong[0]]):
        raise InputError(where, f"sample {wrong[0]} is {values[wrong[0]]:g} {wanted}, beyond ±{limit:g}",
                         "Check the scaling from counts.")  # fmt: skip
    return values


def _plain(value: Any) -> Any:
    """An attribute as Python sees it: text as str, numpy scalars as numbers."""
    if isinstance(value, bytes):
        return value.decode("utf-8", errors="replace")
    if isinstance(value, np.generic):
        return _plain(value.item())
    if isinstance(value, np.ndarray) and value.size == 1:
        return _plain(value.ravel()[0])
    return value


def _attribute(holder: h5py.Group, name: str, place: str) -> Any:
    if name not in holder.attrs:
        raise InputError(f"{place}@{name}", "is missing", "The session file format demands it.")
    return _plain(holder.attrs[name])


def _text(holder: h5py.Group, name: str, place: str) -> str:
    value = _attribute(holder, name, place)
    if not isinstance(value, str):
        raise InputError(f"{place}@{name}", f"is {value!r}, not text", "Write it as a string.")
    return value


def _number(holder: h5py.Group, name: str, place: str) -> float:
    value = _attribute(holder, name, place)
    if isinstance(value, bool) or not isinstance(value, int | float) or not np.isfinite(value):
        raise InputError(f"{place}@{name}", f"is {value!r}, not a finite number", "Write it as a number.")
    return float(value)


def _json(holder: h5py.Group, name: str, place: str) -> dict[str, Any]:
    try:
        value = json.loads(_text(holder, name, place))
    except ValueError as error:
        raise InputError(f"{place}@{name}", f"is not JSON ({error})", "Write it as a JSON object.") from None
    if not isinstance(value, dict):
        raise InputError(f"{place}@{name}", "is JSON, but not an object", 'Write it as {"key": value, …}.')
    return value


def _value(group: h5py.Group, name: str, model: type[_Model], place: str) -> _Model | None:
    if name not in group.attrs:
        return None
    try:
        return model.model_validate(_json(group, name, place))
    except ValidationError as error:
        first = error.errors()[0]
        key = ".".join(str(part) for part in first["loc"])
        raise InputError(f"{place}@{name}: {key}", first["msg"], "Correct this key.") from None


def _extra_attributes(holder: h5py.Group, known: tuple[str, ...]) -> dict[str, Any]:
    return {key: _parsed(holder.attrs[key]) for key in holder.attrs if key not in known}


def _parsed(value: Any) -> Any:
    value = _plain(value)
    if isinstance(value, str) and value.startswith(("{", "[")):
        try:
            return json.loads(value)
        except ValueError:
            return value  # text that merely looks like JSON stays text
    return value


class SessionWriter:
    """A session being recorded; each run is safely on disk once `append` has returned.

    Used as a context manager. The file exists, readable and without runs, from entering on. Raises InputError
    when the path exists and `overwrite` is false, or cannot be written.
    """

    def __init__(
        self,
        path: str | os.PathLike[str],
        *,
        source: str,
        drive: Mapping[str, Any] | None = None,
        axis: Axis = "rotary",
        effort: Effort = "torque",
        created: str | None = None,
        overwrite: bool = False,
    ) -> None:
        self.path = Path(path)
        if self.path.exists() and not overwrite:
            raise InputError(str(self.path), "exists already", "Choose another name, or ask to overwrite it.")
        self._axis, self._effort = axis, effort
        # a name of its own: HDF5 refuses to open one name twice, even in memory
        self._image = h5py.File(f"session-{uuid4().hex}", "w", driver="core", backing_store=False)
        self._image.attrs.update(
            format=FORMAT,
            version=VERSION,
            created=created or datetime.now(UTC).isoformat(timespec="seconds"),
            source=source,
            axis=axis,
        )
        if effort != "torque":
            self._image.attrs["effort"] = effort
        if drive is not None:
            self._image.attrs["drive"] = json.dumps(dict(drive), ensure_ascii=False)
        self._runs = self._image.create_group("run")

    def __enter__(self) -> Self:
        self._publish(InputError)  # a path that cannot be written shall be known before anything moves
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self._image.close()

    def append(self, run: Run) -> None:
        """Add a completed run as /run/NNNN and make it durable."""
        with self._new_group(self._runs) as group:
            self._write(group, run)

    def append_partial(self, run: PartialRun | Run, reason: str) -> None:
        """Add a recording that was cut short as /partial/NNNN, with why; it is not a run of the session."""
        self._append_aside("partial", run, reason=reason)

    def append_creep(self, run: Run, told: str) -> None:
        """Add a small motion made before the first run as /creep/NNNN, with what it told; it is none of the runs."""
        self._append_aside("creep", run, told=told)

    def _append_aside(self, where: str, run: PartialRun | Run, **attributes: str) -> None:
        with self._new_group(self._image.require_group(where)) as group:
            self._write(group, run)
            group.attrs.update(attributes)

    @contextmanager
    def _new_group(self, parent: h5py.Group) -> Iterator[h5py.Group]:
        name = f"{len(parent):04d}"
        try:
            yield parent.create_group(name)
        except BaseException:
            del parent[name]  # half a run shall not be published by the next append
            raise
        self._publish()

    def _write(self, group: h5py.Group, run: PartialRun | Run) -> None:
        group.attrs.update(role=run.role, repeat=run.repeat, sample_rate_hz=run.sample_rate_hz)
        for name, value in (("motion", run.motion), ("excitation", run.excitation)):
            if value is not None:
                group.attrs[name] = value.model_dump_json(exclude_none=True)
        for name, values in run.datasets().items():
            dataset = group.create_dataset(name, data=np.asarray(values, dtype=np.float64))
            dataset.attrs["unit"] = unit_of(name, self._axis, self._effort)
        for key, value in run.extra.items():
            _write_extra(group, key, value)

    def _publish(self, failure: type[SchwungError] = SchwungError) -> None:
        """Put the image on disk as a whole."""
        self._image.flush()
        try:
            replace_file(self.path, self._image.id.get_file_image())
        except InputError as error:
            raise failure(
                error.place, error.problem, "Choose a directory with room that you may write to."
            ) from error


def _write_extra(group: h5py.Group, key: str, value: Any) -> None:
    value = _plain(value)
    if isinstance(value, np.ndarray):
        group.create_dataset(key, data=value)
        return
    if not isinstance(value, str | int | float):
        value = json.dumps(value, ensure_ascii=False, default=str)
    if isinstance(value, str) and len(value) > _ATTRIBUTE_CHARACTERS:
        group.create_dataset(key, data=value)
    else:
        group.attrs[key] = value
