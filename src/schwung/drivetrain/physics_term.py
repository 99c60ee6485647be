"""One term of physics that a machine file names beyond the two masses, as data; `effects.py` holds what it may say."""

from __future__ import annotations

import math
from typing import Annotated, Any

from pydantic import BaseModel, ConfigDict, Field

from schwung.errors import InputError


class PhysicsTerm(BaseModel):
    """One learned term, `[[physics]]`: a name of files.md's list and its parameters, kept as data."""

    model_config = ConfigDict(frozen=True, extra="allow", strict=True)

    name: Annotated[str, Field(min_length=1)]

    @property
    def parameters(self) -> dict[str, Any]:
        """Everything but the name, as in the file."""
        return dict(self.model_extra or {})

    def number(self, key: str) -> float:
        """One parameter that has to be a finite number. Raises InputError naming term and key."""
        value = self.parameters.get(key)
        if isinstance(value, bool) or not isinstance(value, int | float) or not math.isfinite(value):
            raise InputError(
                f"physics.{self.name}", f"{key} is {value!r}", "Give it as a finite number in SI units."
            )
        return float(value)
