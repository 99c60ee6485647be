"""A line in simulated time: bytes take as long as they do on a real one, and nothing else takes any.

The tool's end, `SteppedLine`, knows plain verbs: open, send, take, close. Who waits for an answer lets the clock's time
pass, and looks again.
"""

from __future__ import annotations

from collections.abc import Callable

from schwung_sim.drives.modbus.faults import RTU_DROP_S
from schwung_sim.drives.modbus.server import Clock, ModbusServer, Session

#: From one end of a network to the other (s): a switch and two protocol stacks.
LATENCY_S = 0.2e-3
#: A character is 11 bits, and a frame ends with a silence of 3.5 of them, 1.75 ms above 19200 bit/s
#: (Modbus over Serial Line 1.02, 2.5.1 and 2.5.1.1).
_CHARACTER_BITS, _SILENT_CHARACTERS = 11, 3.5
_FIXED_SILENCE_ABOVE, _FIXED_SILENCE_S = 19200, 1.75e-3
USUAL_BITRATE = 115200


class SteppedLine:
    """The tool's end of a line to a drive, TCP or serial. On TCP there is one connection at a time."""

    def __init__(self, clock: Clock, server: ModbusServer, bitrate: int | None = None) -> None:
        self._clock, self._server = clock, server
        self._serial = server.transport == "rtu"
        self.bitrate = bitrate or USUAL_BITRATE
        self._session: Session | None = None
        self._came = b""
        self._cut_until_s = self._free_s = 0.0
        self.hung_up = False  # the other end has closed the connection
        server.drop = self.drop

    # ── the tool's end ───────────────────────────────────────────────────────────────────────────────────────────

    def open(self) -> bool:
        """Connect. False where nobody takes the connection."""
        self._came, self.hung_up = b"", False
        session = self._server.session(lambda data: self._carry(data, session, self._arrived, 0.0))
        self._session = session
        return True

    def close(self) -> None:
        """End the connection; what is under way is lost."""
        self._session = None

    def send(self, data: bytes) -> None:
        """Bytes for the drive; on a connection that the other end has closed they are lost."""
        session = self._session
        if session is not None and not self.hung_up:
            self._carry(data, session, session.receive, self._silence_s)

    @property
    def waiting(self) -> bool:
        """Something has come that was not taken."""
        return bool(self._came)

    def take(self) -> bytes:
        """All that has come."""
        came, self._came = self._came, b""
        return came

    # ── the line ─────────────────────────────────────────────────────────────────────────────────────────────────

    def _arrived(self, data: bytes) -> None:
        self._came += data

    def _carry(
        self, data: bytes, session: Session, deliver: Callable[[bytes], None], silence_s: float
    ) -> None:
        """Deliver when the last byte has passed, and on a serial line the silence that ends a frame."""
        now = self._clock.now()
        if now < self._cut_until_s:
            return
        if self._serial:
            self._free_s = max(self._free_s, now) + len(data) * _CHARACTER_BITS / self.bitrate
            arrives_s = self._free_s + silence_s
        else:
            arrives_s = now + LATENCY_S

        def arrive() -> None:
            alive = self._session is session and not self.hung_up
            if alive and self._clock.now() >= self._cut_until_s:
                deliver(data)

        self._clock.later(arrives_s - now, arrive)

    @property
    def _silence_s(self) -> float:
        if self.bitrate > _FIXED_SILENCE_ABOVE:
            return _FIXED_SILENCE_S
        return _SILENT_CHARACTERS * _CHARACTER_BITS / self.bitrate

    def drop(self) -> None:
        """Cut the line: TCP is closed by the other end, a serial line is silent for a while."""
        if self._serial:
            self._cut_until_s = self._clock.now() + RTU_DROP_S
        else:
            self.hung_up = True
