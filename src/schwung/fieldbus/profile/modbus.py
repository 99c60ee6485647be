"""How a drive speaks Modbus: word order, pauses, function codes, and the objects of its operation."""

from __future__ import annotations

from typing import Literal

from pydantic import Field

from schwung.fieldbus.profile.parts import Part, Positive, Ref, ScaledObject


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
    registers_per_parameter: Literal[1, 2] = 1
    """2 where every parameter, also one of 16 bits, takes two registers, read and written together."""
    transports: tuple[Literal["tcp", "rtu"], ...] = Field(default=("tcp", "rtu"), min_length=1)
    """Which of the two it speaks."""
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
    baudrate: int | None = Field(default=None, gt=0)
    """Bit rate on RTU as delivered."""
    parity: Literal["N", "E", "O"] | None = None
    """Parity on RTU as delivered."""
    stopbits: Literal[1, 2] | None = None
    """Stop bits on RTU as delivered."""


class State(Part):
    """The CiA 402 state machine in registers; absent where the drive is switched on in another way."""

    controlword: Ref
    """As 6040."""
    statusword: Ref
    """As 6041."""
    mode: Ref | None = None
    """As 6060."""
    mode_display: Ref | None = None
    """As 6061: the mode that is in force."""
    error: Ref | None = None
    """As 603F: why it is in fault."""


class Strokes(Part):
    """What shapes the drive's own positioning (mode "pp"); its target is `quantities.position.demand`."""

    speed: ScaledObject
    """Peak speed, rad/s per count."""
    acceleration: ScaledObject
    """rad/s² per count."""
    deceleration: ScaledObject
    """rad/s² per count."""


class Limits(Part):
    """What the drive enforces by itself; positions in counts of `quantities.position`."""

    position_min: Ref | None = None
    """Lower end of the window; both ends equal: no window."""
    position_max: Ref | None = None
    """Upper end of the window."""
    speed_max: ScaledObject | None = None
    """rad/s per count."""
    torque_max: ScaledObject | None = None
    """N·m per count."""
    rated_torque: ScaledObject | None = None
    """N·m per count."""
    following_error: Ref | None = None
    """Tolerated following error, counts of the position; 0: not watched."""
    following_error_time: ScaledObject | None = None
    """For how long it is tolerated, s per count."""
