"""What a recording means: which column is what, in which unit. From options, or from a TOML file to repeat it."""

from __future__ import annotations

import difflib
import tomllib
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from pydantic import BaseModel, ConfigDict, Field, ValidationError, field_validator

from schwung.errors import InputError
from schwung.motion import Excitation
from schwung.session.model import Axis, Role

SPLITS = ("auto", "rest", "reverse", "none")


class Recipe(BaseModel):
    """How to read recordings; the keys of the TOML file are these names, each also an option of `schwung import`.

    Columns are named as in the file, or by number from 0; a scale multiplies before the unit is applied and may name
    a single number of the file (MAT). What is None is found in the file, derived, or left out, as `build` says.
    """

    model_config = ConfigDict(frozen=True, extra="forbid")

    position: str
    torque: str
    time: str | None = None
    speed: str | None = None
    position_demand: str | None = None
    torque_added: str | None = None
    axis: Axis | None = None
    time_unit: str | None = None
    position_unit: str | None = None
    speed_unit: str | None = None
    torque_unit: str | None = None
    position_scale: str = "1"
    speed_scale: str = "1"
    torque_scale: str = "1"
    rate: float | None = Field(default=None, gt=0, le=1e7, allow_inf_nan=False)
    resample: bool = False
    unwrap: bool = True
    split: str = "auto"
    role: Role = "reference"
    excitation: Excitation | None = None
    files: tuple[str, ...] = ()
    dbc: str | None = None
    channel: str | None = None

    @field_validator(
        "position", "torque", "time", "speed", "position_demand", "torque_added", "position_scale", "speed_scale",
        "torque_scale", "split", mode="before",
    )  # fmt: skip
    @classmethod
    def _as_text(cls, value: Any) -> Any:
        return str(value) if isinstance(value, int | float) and not isinstance(value, bool) else value

    @property
    def piece_s(self) -> float | None:
        """The length of a run where `split` is a time (`6.24s`), else None."""
        if self.split in SPLITS:
            return None
        text = self.split.strip().lower()
        scale = 1e-3 if text.endswith("ms") else 1.0
        try:
            seconds = float(text.removesuffix("s").removesuffix("m")) * scale
        except ValueError:
            seconds = 0.0
        if not 0 < seconds < 1e6:
            raise InputError(
                "--split", f'is "{self.split}"', "Use auto, rest, reverse, none, or a time such as 6.24s."
            )
        return seconds


def read_recipe(path: Path) -> dict[str, Any]:
    """The keys of a recipe file; `files` and `dbc` are relative to it. Raises InputError for what is not TOML."""
    try:
        data = tomllib.loads(path.read_text(encoding="utf-8"))
    except OSError as error:
        reason = (error.strerror or str(error)).lower()
        raise InputError(str(path), f"cannot be read: {reason}", "Give the path of a recipe.") from None
    except ValueError as error:
        raise InputError(str(path), f"is not TOML: {error}", "Correct that line.") from None
    files = data.get("files")
    if isinstance(files, list) and all(isinstance(name, str) for name in files):
        data["files"] = [str(path.parent / name) for name in files]
    if isinstance(data.get("dbc"), str):
        data["dbc"] = str(path.parent / data["dbc"])
    return data


def make_recipe(options: Mapping[str, Any], place: str = "schwung import") -> Recipe:
    """A recipe from its keys; what is None counts as not given. Raises InputError, naming the key and the remedy."""
    given = {key: value for key, value in options.items() if value is not None}
    try:
        recipe = Recipe.model_validate(given)
    except ValidationError as error:
        raise _explained(error, place) from None
    if recipe.role == "excited" and recipe.excitation is None:
        raise InputError(f"{place}: role", "is excited, but the sine is not known",
                         "Add --excitation FREQUENCY,AMPLITUDE[,PHASE], or a table [excitation].")  # fmt: skip
    if recipe.role == "reference" and recipe.excitation is not None:
        raise InputError(f"{place}: excitation", "is given, but role is reference", "Add --role excited.")
    if recipe.rate and recipe.time and not recipe.resample:
        raise InputError(
            f"{place}: rate", "is given beside time", "Drop one, or add --resample to change the rate."
        )
    _ = recipe.piece_s
    return recipe


def _explained(error: ValidationError, place: str) -> InputError:
    first = error.errors()[0]
    key = ".".join(str(part) for part in first["loc"])
    if first["type"] == "missing":
        return InputError(f"{place}: {key}", "is missing", f"Say which column it is: --{key} NAME.")
    if first["type"] == "extra_forbidden":
        close = difflib.get_close_matches(key, list(Recipe.model_fields), n=1)
        known = f"Did you mean {close[0]}?" if close else f"There are: {', '.join(Recipe.model_fields)}."
        return InputError(f"{place}: {key}", "is no key of a recipe", known)
    wanted = first["msg"].replace("Input should be", "It must be")
    return InputError(f"{place}: {key}", f"is {first['input']!r}", f"{wanted}.")
