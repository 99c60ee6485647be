"""What goes out with the next SYNC: a frame that is held, a playback, or a stop that nothing overwrites."""

from __future__ import annotations

from dataclasses import dataclass

from schwung.clock import Clock
from schwung.errors import StateError
from schwung.fieldbus import cia402
from schwung.fieldbus.canopen.pdo import Layout
from schwung.fieldbus.profile import CanopenProfile


@dataclass(frozen=True)
class StopFrame:
    """How an RPDO frame becomes one that stops: the target stays, so that a drive that takes it first does not step."""

    controlword: slice
    torque_added: slice | None

    @classmethod
    def of(cls, profile: CanopenProfile, rpdo: Layout) -> StopFrame:
        """As a profile's RPDO is laid out."""
        added = profile.quantities.torque_added
        carried = added is not None and rpdo.carries(added.object)
        return cls(rpdo.place("6040:00"), rpdo.place(added.object) if added is not None and carried else None)

    def frame(self, last: bytes, controlword: int) -> bytes:
        """The frame `last` with another controlword and no injected torque."""
        stopping = bytearray(last)
        stopping[self.controlword] = controlword.to_bytes(2, "little")
        if self.torque_added is not None:
            stopping[self.torque_added] = bytes(self.torque_added.stop - self.torque_added.start)
        return bytes(stopping)

    def enables(self, frame: bytes) -> bool:
        """Whether a frame's controlword enables operation."""
        return cia402.enables_operation(int.from_bytes(frame[self.controlword], "little"))


@dataclass(frozen=True)
class Outgoing:
    """One frame and the setpoint in it; -1: it is held."""

    frame: bytes
    setpoint: int


class Output:
    """Frames for a producer that sends one after another; may be changed from any thread.

    After `latch` nothing that enables operation goes out until `release`, whoever asks for it.
    """

    def __init__(self, clock: Clock, stop_frame: StopFrame, place: str) -> None:
        self.last = b""  # what went out last, as the producer says by `sent`
        self._stop_frame, self._place = stop_frame, place
        self._lock = clock.lock()
        self._held = b""
        self._frames: list[bytes] = []
        self._after = b""
        self._position = 0
        self._latched = False

    @property
    def playing(self) -> bool:
        """A playback is under way."""
        return bool(self._frames)

    def over(self) -> bool:
        """No playback is under way."""
        return not self._frames

    @property
    def coming(self) -> int | None:
        """The setpoint whose turn is next; None: none is."""
        with self._lock:
            return self._position if self._position < len(self._frames) else None

    def hold(self, frame: bytes) -> None:
        """Hold this frame; a playback is given up. Raises StateError for one that enables after a stop."""
        with self._lock:
            self._require_free(frame)
            self._held, self._frames = frame, []

    def play(self, frames: list[bytes], after: bytes) -> None:
        """Frames one by one, then `after`. Raises StateError after a stop."""
        with self._lock:
            self._require_free(after)
            self._frames, self._after, self._position = frames, after, 0

    def latch(self, controlword: int) -> bytes:
        """The frame that went out last, with this controlword and no injected torque, from now on; returns it, and
        nothing where none has been given yet."""
        with self._lock:
            last = self.last or self._held
            self._held = self._stop_frame.frame(last, controlword) if last else b""
            self._frames, self._latched = [], True
            return self._held

    def enables(self, frame: bytes) -> bool:
        """Whether this frame enables operation."""
        return self._stop_frame.enables(frame)

    def overtakes(self, frame: bytes) -> bool:
        """Whether a stop has come since this frame was taken, which enables operation."""
        return self._latched and self.enables(frame)

    def release(self) -> None:
        """What is asked for goes out again."""
        with self._lock:
            self._latched = False

    def next(self) -> Outgoing:
        """The frame whose turn it is."""
        with self._lock:
            if self._frames and self._position >= len(self._frames):
                self._held, self._frames = self._after, []
            setpoint = self._position if self._frames else -1
            self._position += 1
            return Outgoing(self._frames[setpoint] if self._frames else self._held, setpoint)

    def sent(self, outgoing: Outgoing) -> None:
        """It went out: a stop begins from here."""
        with self._lock:
            self.last = outgoing.frame

    def _require_free(self, frame: bytes) -> None:
        if self.overtakes(frame):
            raise StateError(self._place, "was stopped on request (halt)", "Start it anew.")
