"""What stands in the kernel's ring of frames, and what a drive may see of it: a model without I/O, threads or time.

    cycle     one RPDO and the SYNC after it, counted from the start of the exchange and for ever
    slot      where a cycle stands: cycle modulo CYCLES
    setpoints are only ever appended: once written, a cycle keeps its frame, so that no lateness shifts or repeats one
    guard     behind the last setpoint that is written: quick stop, with that setpoint's target and no injected torque
    end       behind the guard the kernel stops by itself, since it was told how many frames to send
    spare     slots behind the end, reached only where a write came late: quick stop, then disable voltage

A frame is held without end, and then every slot has it; while setpoints are played there is always an end. A program
that hangs leaves a drive that was told to stop, then silence. A latched stop is one frame in every slot.
"""

from __future__ import annotations

from collections import deque
from dataclasses import dataclass, field

from schwung.fieldbus import cia402
from schwung.fieldbus.canopen.output import StopFrame

CYCLES = 128
REFILL = 8  # cycles between two refills
SPARE = 16  # cycles by which a write may come late before frames could be repeated
_OFF = 4  # of these, the last ones disable the voltage: what was repeated would find the drive switched off
_SOON = 8  # cycles: a write that begins so shortly before the guard could meet it
_FORMER = 8  # changes of what is held that may be under way at once
_LOST = 8  # cycles of which the echo may be lost in a row


@dataclass(frozen=True)
class Write:
    """What the kernel is told: an RPDO per slot, (CYCLES,), and how many frames to send from now on, each RPDO and each
    SYNC being one (None: without end). `start`: the ring may have ended and has to be started again."""

    slots: tuple[bytes, ...]
    frames: int | None
    start: bool = False


@dataclass(frozen=True, eq=False)
class _Motion:
    frames: list[bytes]
    after: bytes
    first: int  # cycle of the first setpoint

    @property
    def end(self) -> int:
        return self.first + len(self.frames)

    def frame(self, cycle: int) -> bytes:
        return self.frames[cycle - self.first] if cycle < self.end else self.after

    def setpoint(self, cycle: int) -> int:
        return cycle - self.first if cycle < self.end else -1


@dataclass(eq=False)
class _Image:
    """An RPDO per slot, and which setpoint it is; -1: a held one."""

    frames: list[bytes]
    setpoints: list[int] = field(default_factory=lambda: [-1] * CYCLES)


class Ring:
    """See the module. `guard` and `lead` (what is still held when a motion begins to be written) are in cycles.

    `position` always means: the cycle of the last RPDO that the kernel has sent, as far as one knows. It is at least
    `played`, and off by a cycle or a few where echoes are late.
    """

    def __init__(self, stop: StopFrame, held: bytes, guard: int, lead: int) -> None:
        self._stop, self._guard = stop, guard
        self._ahead = CYCLES - SPARE - guard
        self._lead = min(lead, self._ahead)
        self._image = _Image([held] * CYCLES)
        self._former = deque[_Image](maxlen=_FORMER)  # what echoes may still show, oldest first
        self.last = b""  # what went out last, as far as it was seen
        self._motion: _Motion | None = None
        self._guard_from: int | None = None  # cycle; None: without end
        self._written = -1  # value of `played` when the ring was last filled
        self._replaced: int | None = None  # where the guard began that the last write replaced
        self.played = -1  # cycle of the last echo
        self.setpoint = -1  # of the last echo
        self.latched = False
        self.held_up = False  # the guard was met, or might have been

    # ── what the drive shall see ─────────────────────────────────────────────────────────────────────────────────

    def hold(self, frame: bytes, position: int) -> Write:
        """This frame from now on."""
        start = self._guard_from is not None and position + 2 >= self._guard_from + self._guard
        self._former.append(self._image)
        self._image = _Image([frame] * CYCLES)
        self._motion = self._guard_from = self._replaced = None
        return Write(tuple(self._image.frames), None, start)

    def latch(self, controlword: int, position: int) -> Write:
        """The last frame that went out, with this controlword and no injected torque, until `latched` is reset."""
        if self.latched:
            last = self._image.frames[0]
        elif self._guard_from is None or position <= self.played:
            last = self.last or self._image.frames[0]
        else:  # echoes are late
            last = self._image.frames[min(position, self._guard_from - 1) % CYCLES]
        self.latched = True
        return self.hold(self._stop.frame(last, controlword), position)

    def admits(self, frame: bytes) -> bool:
        """False for a frame that would undo a latched stop."""
        return not (self.latched and self._stop.enables(frame))

    def play(self, frames: list[bytes], after: bytes) -> Write:
        """What is held for `lead` cycles, then these frames, then `after`. They follow with the next refills."""
        self._guard_from = self.played + 1
        self._motion = _Motion(frames, after, self._guard_from + self._lead)
        self.held_up = False
        write = self._extend(self._motion.first)
        self._replaced = self._motion.first
        return write

    def refill(self, position: int) -> Write | None:
        """Append what has room now; None: nothing yet. When the last setpoint was sent, `after` is held without end.

        Where the guard was met, or could be before the write arrives, the motion is given up: `held_up`. To be
        followed by `landed`.
        """
        motion, guard_from = self._motion, self._guard_from
        if motion is None or guard_from is None:
            return None
        if position + _SOON >= guard_from:
            return self.give_up(position)
        write = None
        if self.played + 1 >= motion.end:
            write = self.hold(motion.after, position)
        elif self.played - self._written >= REFILL and position - self.played <= SPARE // 2:
            write = self._extend(self.played + 1 + self._ahead)
        if write is not None:
            self._replaced = guard_from
        return write

    def landed(self, position: int) -> Write | None:
        """The kernel has taken a write, at `position` or before. Had it met the guard meanwhile, the stop that this
        write undid; else None."""
        if self._replaced is not None and position + _SOON // 2 >= self._replaced:
            self._guard_from = self._replaced
            return self.give_up(position)
        if position - self.played > SPARE:
            self._written = self.played - REFILL  # the end may be too far: refill again at once
        return None

    def give_up(self, position: int) -> Write:
        """Quick stop, latched."""
        self.held_up = True
        return self.latch(cia402.QUICK_STOP, position)

    def again(self) -> Write:
        """The frame that is held, started anew."""
        return Write(tuple(self._image.frames), None, start=True)

    def _extend(self, guard_from: int) -> Write:
        """Append up to `guard_from`, and guard all behind it."""
        motion, image, begin = self._motion, self._image, self._guard_from
        assert motion is not None
        assert begin is not None
        for cycle in range(max(begin, motion.first), guard_from):
            image.frames[cycle % CYCLES] = motion.frame(cycle)
            image.setpoints[cycle % CYCLES] = motion.setpoint(cycle)
        last = image.frames[(guard_from - 1) % CYCLES]
        quick, off = (self._stop.frame(last, word) for word in (cia402.QUICK_STOP, cia402.DISABLE_VOLTAGE))
        beyond = self.played + 1 + CYCLES
        for cycle in range(guard_from, beyond):
            image.frames[cycle % CYCLES] = quick if cycle < beyond - _OFF else off
            image.setpoints[cycle % CYCLES] = -1
        self._guard_from, self._written = guard_from, self.played
        # Of the cycle that was seen last, the SYNC may still be to come.
        return Write(tuple(image.frames), 2 * (guard_from + self._guard - self.played) - 1)

    # ── what the drive has seen ──────────────────────────────────────────────────────────────────────────────────

    @property
    def playing(self) -> bool:
        """True while setpoints, or what is held before and behind them, have an end."""
        return self._motion is not None

    @property
    def over(self) -> bool:
        """True when nothing is played, or its last setpoint and one frame more were sent."""
        return self._motion is None or self.played >= self._motion.end

    @property
    def met_guard(self) -> bool:
        """True where the last echo was one that stops the drive."""
        return self._guard_from is not None and self.played >= self._guard_from

    @property
    def unfed(self) -> int:
        """Cycles since the last refill."""
        return self.played - self._written

    def sent(self, data: bytes) -> bool:
        """An RPDO was seen on the bus; False where it is none of ours. Cycles of which it was not seen are skipped."""
        for cycle in range(self.played + 1, self.played + 2 + _LOST):
            slot = cycle % CYCLES
            for image in (self._image, *reversed(self._former)):
                if image.frames[slot] == data:
                    while self._former and self._former[0].frames[slot] != data:
                        self._former.popleft()
                    self.played, self.setpoint, self.last = cycle, image.setpoints[slot], data
                    return True
        return False
