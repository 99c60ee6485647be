"""What stands in the kernel's ring of frames, and what a drive may see of it: a model without I/O, threads or time.

    cycle     one RPDO and the SYNC after it, counted from the start of the exchange and for ever
    slot      where a cycle stands: cycle modulo CYCLES
    setpoints are only ever appended: once written, a cycle keeps its frame, so that no lateness shifts or repeats one
    guard     behind the last setpoint that is written: quick stop, with that setpoint's target and no injected torque
    end       behind the guard the kernel stops by itself, since it was told how many frames to send
    spare     slots behind the end, reached only where a write came late: quick stop, then disable voltage

Nothing that enables operation goes out without end. While setpoints are played the end lies behind a guard: a program
that hangs, at whatever instant, leaves a drive that was told to stop, then silence. A frame that is held stands in
every slot, which leaves no room for a guard: one that enables ends in silence, unless somebody says in time that it
still holds; one that does not, a latched stop among them, has no end.
"""

from __future__ import annotations

from collections import deque
from dataclasses import dataclass, field

from schwung.fieldbus import cia402
from schwung.fieldbus.canopen.output import StopFrame

CYCLES = 128
REFILL = 8  # cycles between two refills
SPARE = 32  # cycles by which a write may come late before frames could be repeated
OFF = 4  # of these, the last ones disable the voltage: what was repeated would find the drive switched off
STALE = 8  # cycles: echoes that are older are no ground for a refill
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
    """See the module. `guard`, `lead` (what is still held when a motion begins to be written) and `hold` (after which a
    frame that enables is held no longer, unless `refill` is asked) are in cycles.

    `position` always means: the cycle of the last RPDO that the kernel has sent, as far as one knows. It is at least
    `played`, and off by a cycle or a few where echoes are late.
    """

    def __init__(self, stop: StopFrame, held: bytes, guard: int, lead: int, hold: int) -> None:
        self._stop, self._guard, self._hold = stop, guard, hold
        self._ahead = CYCLES - SPARE - guard
        self._lead = min(lead, self._ahead)
        self._image = _Image([held] * CYCLES)
        self._former = deque[_Image](maxlen=_FORMER)  # what echoes may still show, oldest first
        self.last = b""  # what went out last, as far as it was seen
        self._motion: _Motion | None = None
        self._guard_from: int | None = None  # cycle; None: without end
        self._written = -1  # value of `played` when the ring was last filled
        self._replaced: int | None = (
            None  # where the guard began, or the end was, that the last write replaced
        )
        self._held_to: int | None = None  # cycle up to which what is held surely goes out; None: without end
        self.played = -1  # cycle of the last echo
        self.setpoint = -1  # of the last echo
        self.latched = False
        self.held_up = False  # the guard was met, or might have been
        self.unfed = 0  # of these: cycles since the ring was last filled

    # ── what the drive shall see ─────────────────────────────────────────────────────────────────────────────────

    def hold(self, frame: bytes, position: int) -> Write:
        """This frame from now on."""
        end = self._held_to if self._guard_from is None else self._guard_from + self._guard
        self._former.append(self._image)
        self._image = _Image([frame] * CYCLES)
        self._motion = self._guard_from = self._replaced = None
        return self._held(start=end is not None and position + 2 >= end)

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
        self._held_to = None
        self._guard_from = self.played + 1
        self._motion = _Motion(frames, after, self._guard_from + self._lead)
        self.held_up = False
        write = self._extend(self._motion.first)
        self._replaced = self._motion.first
        return write

    def refill(self, position: int) -> Write | None:
        """Append what has room now; None: nothing yet. When the last setpoint was sent, `after` is held; what is held
        is held on.

        Where the guard was met, or could be before the write arrives, or what is held may have ended, it is given up:
        `held_up`. The write is to be looked at by `overdue` before the kernel gets it, and when it has it.
        """
        motion, guard_from = self._motion, self._guard_from
        if motion is None or guard_from is None:
            return self._hold_on(position)
        if position + _SOON >= guard_from:
            return self.give_up(position)
        write = None
        if self.played + 1 >= motion.end:
            write = self.hold(motion.after, position)
        elif self.played - self._written >= REFILL and position - self.played <= STALE:
            write = self._extend(self.played + 1 + self._ahead)
        if write is not None:
            self._replaced = guard_from
        return write

    def overdue(self, position: int) -> Write | None:
        """Asked right before the kernel gets a write, and again when it has it: the stop that has to go out instead,
        where the kernel has met the guard meanwhile, or nearly so, which the write would undo; else None."""
        if self._replaced is not None and position + _SOON // 2 >= self._replaced:
            self._guard_from = self._replaced
            return self.give_up(position)
        if self._motion is not None and position - self.played > SPARE // 2:
            self._written = self.played - REFILL  # the end may be too far: refill again at once
        return None

    def give_up(self, position: int) -> Write:
        """Quick stop, latched."""
        self.held_up, self.unfed = True, position - self._written
        return self.latch(cia402.QUICK_STOP, position)

    def again(self) -> Write:
        """The frame that is held, started anew."""
        return self._held(start=True)

    def _hold_on(self, position: int) -> Write | None:
        end = self._held_to
        if end is None or end - position > self._hold // 2:
            return None
        if position + _SOON >= end:
            return self.give_up(position)
        write = self._held()
        self._replaced = end - self._guard  # as if it were one: from there on it may have ended
        return write

    def _held(self, *, start: bool = False) -> Write:
        """What is held, for as long as it may be."""
        frames = tuple(self._image.frames)
        self._written = self.played
        self._held_to = self.played + self._hold if self._stop.enables(frames[0]) else None
        return Write(frames, None if self._held_to is None else 2 * self._hold, start)

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
            image.frames[cycle % CYCLES] = quick if cycle < beyond - OFF else off
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
