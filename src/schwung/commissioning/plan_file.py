"""A plan as a file: what `schwung explain --next` writes and `schwung commission --plan` takes (docs/files.md)."""

from __future__ import annotations

import json
import os
from pathlib import Path
from typing import Literal

from pydantic import BaseModel, ConfigDict, Field, FiniteFloat, ValidationError

from schwung.commissioning.commission import Wishes
from schwung.commissioning.limits import Limits, LimitWishes
from schwung.errors import InputError
from schwung.files import replace_file

FORMAT = "schwung-plan"
_REMEDY = "Write it with `schwung explain --next`."


class _Limits(BaseModel):
    model_config = ConfigDict(extra="forbid", frozen=True)

    position_min_rad: FiniteFloat | None = None
    position_max_rad: FiniteFloat | None = None
    speed_max_rad_s: float | None = Field(default=None, gt=0, allow_inf_nan=False)
    torque_max_nm: float | None = Field(default=None, gt=0, allow_inf_nan=False)
    following_error_rad: float | None = Field(default=None, gt=0, allow_inf_nan=False)


class PlanFile(BaseModel):
    """`schwung-plan`, version 1; SI."""

    model_config = ConfigDict(extra="forbid", frozen=True)

    format: Literal["schwung-plan"]
    version: Literal[1]
    machine: str = ""
    start_rad: FiniteFloat | None = None
    distance_rad: FiniteFloat
    duration_s: float = Field(gt=0, allow_inf_nan=False)
    kind: str = "third"
    returns: bool = True
    frequency_hz: float | None = Field(default=None, gt=0, allow_inf_nan=False)
    amplitude_nm: float | None = Field(default=None, gt=0, allow_inf_nan=False)
    repeats: int = Field(default=1, ge=1)
    sample_rate_hz: float = Field(default=1000.0, gt=0, allow_inf_nan=False)
    limits: _Limits = _Limits()
    because: tuple[str, ...] = ()


def write_plan(path: Path, machine: str, wishes: Wishes, limits: Limits, start_rad: float) -> None:
    """Write a plan whole or not at all. Raises InputError where the file cannot be written."""
    document = PlanFile(
        format="schwung-plan",
        version=1,
        machine=machine,
        start_rad=start_rad,
        distance_rad=wishes.distance_rad,
        duration_s=wishes.duration_s,
        kind=wishes.kind,
        returns=wishes.returns,
        frequency_hz=wishes.frequency_hz,
        amplitude_nm=wishes.amplitude_nm,
        repeats=wishes.repeats,
        sample_rate_hz=wishes.sample_rate_hz,
        limits=_Limits(**vars(limits)),
        because=wishes.because,
    )
    replace_file(path, json.dumps(document.model_dump(), indent=1, ensure_ascii=False) + "\n")


def read_plan(path: str | os.PathLike[str]) -> Wishes:
    """What a plan's file wishes, its limits among it. Raises InputError naming the key where it is no plan."""
    place = str(path)
    try:
        document = json.loads(Path(path).read_text(encoding="utf-8"))
    except OSError as error:
        reason = (error.strerror or str(error)).lower()
        raise InputError(place, f"cannot be read: {reason}", "Check the path.") from None
    except ValueError:
        raise InputError(place, "is no JSON", _REMEDY) from None
    try:
        plan = PlanFile.model_validate(document)
    except ValidationError as error:
        first = error.errors()[0]
        key = ".".join(str(part) for part in first["loc"]) or "it"
        raise InputError(place, f"{key}: {first['msg'].lower()}", _REMEDY) from None
    return Wishes(
        distance_rad=plan.distance_rad,
        duration_s=plan.duration_s,
        limits=LimitWishes(**plan.limits.model_dump()),
        kind=plan.kind,
        returns=plan.returns,
        frequency_hz=plan.frequency_hz,
        amplitude_nm=plan.amplitude_nm,
        repeats=plan.repeats,
        sample_rate_hz=plan.sample_rate_hz,
        because=plan.because,
        start_rad=plan.start_rad,
    )
