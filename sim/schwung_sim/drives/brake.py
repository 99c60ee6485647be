"""A holding brake on the motor's shaft, which a drive opens and closes: both take their time.

Power is on before it opens, and stays on until it has closed: otherwise the load would fall meanwhile. Where power is
taken away at once it closes alone, and until then the axis coasts.
"""

from __future__ import annotations

from typing import Protocol

HOLDING_TORQUE_NM = (
    120.0  # of the bench's machine: well above its motor's rated torque, as holding brakes have it
)


class BrakedMotor(Protocol):
    """What a brake asks of the axis."""

    def close_brake(self, holding_nm: float) -> None: ...

    @property
    def time_s(self) -> float: ...


class HoldingBrake:
    """Opens and closes `delay_s` after it was told; until then it is as it was."""

    def __init__(self, motor: BrakedMotor, delay_s: float, closed: bool) -> None:
        self._motor, self._delay_s = motor, delay_s
        self.closed = self._told_closed = closed
        self._due_s = 0.0
        motor.close_brake(HOLDING_TORQUE_NM if closed else 0.0)

    @property
    def moving(self) -> bool:
        """It is not yet what it was told to be."""
        return self.closed != self._told_closed

    @property
    def is_open(self) -> bool:
        """It has let go, and shall not close."""
        return not (self.closed or self._told_closed)

    def tell(self, closed: bool) -> None:
        """Begin to close, or to open; to be told again changes nothing."""
        if closed != self._told_closed:
            self._told_closed, self._due_s = closed, self._motor.time_s + self._delay_s

    def poll(self) -> None:
        """Grip or let go where the time has come."""
        if self.moving and self._motor.time_s >= self._due_s - 1e-9:
            self.closed = self._told_closed
            self._motor.close_brake(HOLDING_TORQUE_NM if self.closed else 0.0)
