"""How a drive speaks Modbus: word order, pauses, function codes, and the objects of its operation."""

from __future__ import annotations

from typing import Literal

from pydantic import Field

from schwung.fieldbus.profile.parts import Part, Positive, Ref


class RegisterIdentity(Part):
    """A parameter that tells drive families apart; a drive that answers otherwise is refused."""

    object: Ref
    """Where it is read."""
    value: int
    """What this family answers."""
    mask: int = 0xFFFFFFFF
    """Bits that count."""


class Modbus(Part):
    """How registers make parameters, and how the drive wants to be asked."""

    word_order: Literal["high_first", "low_first"]
    """Which half of a 32-bit parameter is at the lower address."""
    unit_id: int = Field(default=1, ge=0, le=247)
    """Address of the drive; on TCP often without meaning."""
    silence_s: float = Field(default=0.0, ge=0.0, le=1.0)
    """Pause that the drive wants between an answer and the next request."""
    timeout_s: Positive = 1.0
    """How long an answer may take."""
    chunk: int = Field(default=120, ge=1, le=125)
    """Registers that one request may read."""
    read_function: Literal[3, 4] = 3
    """3: holding registers; 4: input registers."""
    write_function: Literal[6, 16] = 16
    """16: several registers at once; 6: one by one, for 16-bit parameters only."""
    tcp_port: int = Field(default=502, ge=1, le=65535)
    """Port on TCP."""
