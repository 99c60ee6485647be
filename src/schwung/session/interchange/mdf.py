"""ASAM MDF 4: a channel group per run, with names and units; the rest of the session as an attachment."""

from __future__ import annotations

import gc
import io
import sys
from datetime import UTC, datetime
from pathlib import Path
from typing import Any

import numpy as np

from schwung.errors import InputError
from schwung.extras import require
from schwung.files import replace_file
from schwung.motion import Array
from schwung.session.hdf5 import unit_of
from schwung.session.interchange.described import describe, rebuild
from schwung.session.model import Session

ATTACHMENT = "schwung-session.json"
_VERSION = "4.10"  # what tools of the last ten years read
_DEFLATE = 2  # asammdf's number of it, with transposition


def library() -> Any:
    """asammdf. Raises InputError where it is not installed."""
    require("MDF", "logs", "asammdf")
    import asammdf  # noqa: PLC0415  (an extra, and slow to import)

    return asammdf


def write_mdf(session: Session, path: Path) -> None:
    """Write a session as MDF 4.10, whole or not at all. Raises InputError where it cannot be written."""
    asammdf = library()
    with asammdf.MDF(version=_VERSION) as file:
        file.start_time = datetime.fromisoformat(session.created).astimezone(UTC)
        file.header.comment = session.source
        for number, run in enumerate(session.runs):
            signals = [
                asammdf.Signal(
                    samples=values,
                    timestamps=run.time_s,
                    name=name,
                    unit=unit_of(name, session.axis, session.effort),
                )
                for name, values in run.datasets().items()
                if name != "time"
            ]
            title = f"run {number:04d} {run.role} {run.repeat}"
            file.append(signals, acq_name=title, comment=title, common_timebase=True)
        file.attach(describe(session).encode(), file_name=ATTACHMENT, mime="application/json")
        image = io.BytesIO()
        try:
            file.save(image, compression=_DEFLATE)
        except TypeError:  # pragma: no cover  (a version that wants a path)
            raise InputError(str(path), "this asammdf cannot write it", "Update asammdf.") from None
    replace_file(path, image.getvalue())


def read_mdf_session(path: Path) -> Session | None:
    """The session that `write_mdf` wrote; None where the file is somebody else's. Raises InputError where it is no MDF,
    or does not hold what it says."""
    with opened(path) as file:
        told = told_by(file)
        if told is None:
            return None
        groups = [_samples(file, number) for number in range(len(file.groups))]
    return rebuild(told, groups, str(path))


def opened(path: Path) -> Any:
    """An MDF file, to be closed. Raises InputError where it is none."""
    asammdf = library()
    try:
        return asammdf.MDF(path)
    except Exception as error:  # asammdf raises nearly anything for damaged files
        reason = str(error).splitlines()[0] if str(error) else type(error).__name__
    hook, sys.unraisablehook = sys.unraisablehook, lambda _: None
    gc.collect()  # its unfinished object complains as it goes; what is to be said, we say better
    sys.unraisablehook = hook
    raise InputError(str(path), f"is no MDF that could be read ({reason})", "Export it again.")


def told_by(file: Any) -> bytes | None:
    """What `write_mdf` attached to an MDF; None where somebody else wrote it."""
    for index, each in enumerate(getattr(file, "attachments", ())):
        if Path(str(each.file_name)).name == ATTACHMENT:
            return bytes(file.extract_attachment(index=index)[0])
    return None


def _samples(file: Any, group: int) -> dict[str, Array]:
    """The datasets of one run."""
    found: dict[str, Array] = {}
    master = file.masters_db.get(group)
    for index, channel in enumerate(file.groups[group].channels):
        signal = file.get(group=group, index=index)
        name = "time" if index == master else channel.name
        found[name] = np.ascontiguousarray(signal.samples, dtype=np.float64)
    return found
