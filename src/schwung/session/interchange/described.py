"""Everything of a session but its samples, as JSON that goes along with them, and back."""

from __future__ import annotations

import json
from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
from pydantic import ValidationError

from schwung.errors import InputError
from schwung.motion import Array, Excitation, Motion
from schwung.session.hdf5 import FIELDS, FORMAT, VERSION, unit_of
from schwung.session.model import Run, Session

_ARRAY = "__array__"


def describe(session: Session) -> str:
    """JSON that says all of a session but its samples; units beside each dataset's name."""
    names = {name for run in session.runs for name in run.datasets()}
    document = {
        "format": FORMAT,
        "version": VERSION,
        "created": session.created,
        "source": session.source,
        "axis": session.axis,
        "effort": session.effort,
        "drive": session.drive,
        "partial_reasons": session.partial_reasons,
        "extra": session.extra,
        "units": {name: unit_of(name, session.axis, session.effort) for name in FIELDS if name in names},
        "runs": [
            {
                "role": run.role,
                "repeat": run.repeat,
                "sample_rate_hz": run.sample_rate_hz,
                "motion": run.motion and run.motion.model_dump(mode="json", exclude_none=True),
                "excitation": run.excitation and run.excitation.model_dump(mode="json", exclude_none=True),
                "name": run.name,
                "extra": run.extra,
            }
            for run in session.runs
        ],
    }
    return json.dumps(document, ensure_ascii=False, default=_plain)


def rebuild(text: str | bytes, samples: Sequence[Mapping[str, Array]], place: str) -> Session:
    """The session again, of its description and the samples of each run, by dataset.

    Raises InputError naming the place where they do not belong together, or break what a session demands.
    """
    try:
        document = json.loads(text, object_hook=_revived)
        told = document["runs"]
        if document["format"] != FORMAT or document["version"] != VERSION:
            raise InputError(place, f"holds {document['format']} version {document['version']}",
                             f"This Schwung reads {FORMAT} version {VERSION}.")  # fmt: skip
        if len(told) != len(samples):
            raise InputError(
                place, f"describes {len(told)} runs and holds {len(samples)}", "Convert the session again."
            )
        runs = tuple(
            _run(each, own, f"{place}: run {k:04d}")
            for k, (each, own) in enumerate(zip(told, samples, strict=True))
        )
        return Session(
            runs=runs,
            created=document["created"],
            source=document["source"],
            axis=document["axis"],
            effort=document.get("effort", "torque"),
            drive=document["drive"],
            partial_reasons=tuple(document["partial_reasons"]),
            extra=document["extra"],
        )
    except (ValueError, KeyError, TypeError, AttributeError, ValidationError) as error:
        reason = str(error).splitlines()[0] if str(error) else type(error).__name__
        raise InputError(place, f"its description of the session is damaged ({reason})",
                         "Convert the session again.") from None  # fmt: skip


def _run(told: Mapping[str, Any], samples: Mapping[str, Array], place: str) -> Run:
    missing = [name for name in ("time", "position", "speed", "torque") if name not in samples]
    if missing:
        raise InputError(f"{place}/{missing[0]}", "is missing", "Convert the session again.")
    arrays: dict[str, Any] = {FIELDS[name]: values for name, values in samples.items() if name in FIELDS}
    return Run(
        role=told["role"],
        repeat=told["repeat"],
        sample_rate_hz=told["sample_rate_hz"],
        motion=None if told["motion"] is None else Motion.model_validate(told["motion"]),
        excitation=None if told["excitation"] is None else Excitation.model_validate(told["excitation"]),
        name=place,
        extra=told["extra"],
        **arrays,
    )


def _plain(value: Any) -> Any:
    if isinstance(value, np.ndarray):
        return {_ARRAY: value.tolist(), "dtype": value.dtype.str}
    if isinstance(value, np.generic):
        return value.item()
    if isinstance(value, Mapping):
        return dict(value)
    return str(value)


def _revived(value: dict[str, Any]) -> Any:
    return np.array(value[_ARRAY], dtype=value["dtype"]) if _ARRAY in value else value
