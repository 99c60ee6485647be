"""The fault campaign on Modbus: what befalls a session there, and what its monitor sees beside what every drive shows.

not stopped             somebody asked for a halt, the line carries, and the axis is still in operation
let go                  CiA 402-2, transition 9: Disable voltage lets go of the axis; not while it turns
moved twice             a stroke is begun once for every start that the tool meant; refused ones are none
"""

from __future__ import annotations

import random
import struct
import zlib
from collections.abc import Callable
from dataclasses import dataclass, field
from typing import Any

from schwung_sim.campaign.draw import Incident
from schwung_sim.campaign.incidents import STATUSWORDS
from schwung_sim.campaign.machine import Motor
from schwung_sim.campaign.monitor import Heard, Monitor
from schwung_sim.campaign.side import Side
from schwung_sim.drives.modbus.faults import RTU_DROP_S, Fault

CONTROLWORD, STATUSWORD, POSITION = 100, 102, 200
_WRITES = (0x06, 0x10)  # function codes of the Modbus Application Protocol
#: Registers that are refused or not answered, first what a stop depends on.
_REGISTERS = (102, 100, 200, 406, 108, 106, 104, 110, 210, 504, 506, 508, 600, 300, 310, 400)
_CODES = (2, 3, 4)
_LONGEST_BUSY_S = 1.5
#: From a halt that was asked for, on a line that carries, until the drive has heard of it.
HALTED_WITHIN_S = 0.3
#: What loses requests or answers; so long a tool may wait for one that was lost.
_LOSING = ("drop", "slow", "garble", "deaf", "mute", "unanswered", "unseen-state", "unseen-place")
_ANSWER_S = 1.2
#: Faster than this an axis is not let go of, where it has had less time to come to rest than a tool may wait.
LET_GO_RAD_S, GIVEN_UP_S = 0.5, 2.5


class LineMachine(Motor):
    """Drive, axis and plant as the monitor sees them."""

    mode, deaf_until_s, stands = 1, float("-inf"), False
    count_rad = float("nan")  # no setpoints come by the line

    def __init__(self, bench: Any, now: Callable[[], float]) -> None:
        super().__init__(bench)
        self._now = now
        self.troubles = 0  # of the line, under way
        self._sound_since_s = 0.0

    @property
    def energised(self) -> bool:
        return bool(self._servo.power.energised)

    @property
    def operating(self) -> bool:
        return bool(self._servo.power.state.value == 0x27)

    @property
    def stepped_down(self) -> bool:
        return self._servo.power.state.value in (0x21, 0x23)

    @property
    def excused(self) -> bool:
        return self.weak

    def trouble(self) -> None:
        """Something befalls the line, or the drive's answers."""
        self.troubles += 1

    def carries(self) -> None:
        """It is over."""
        self.troubles -= 1
        self._sound_since_s = max(self._sound_since_s, self._now())

    def waits(self, lasts_s: float) -> None:
        """Somebody may wait for what was lost."""
        self._sound_since_s = max(self._sound_since_s, self._now() + lasts_s)

    @property
    def sound_for_s(self) -> float:
        """Since when the line carries, and the drive answers."""
        return 0.0 if self.troubles else self._now() - self._sound_since_s


@dataclass
class LineMonitor(Monitor):
    """Watches requests instead of frames; every request is a sign of life."""

    machine: LineMachine
    serial: bool = False

    def __post_init__(self) -> None:
        super().__post_init__()
        self._halted_s: float | None = None
        self._stopping_s = float("-inf")

    def halted(self) -> None:
        """Somebody asks the tool to stop."""
        if self._halted_s is None:
            self._halted_s = self.now()

    def requested(self, data: bytes) -> None:
        """The tool sends a request."""
        self.count += 1
        self.digest = zlib.crc32(data, zlib.crc32(struct.pack("<d", self.now()), self.digest))
        if self.frames is not None:
            self.frames.append(Heard(self.now(), "tool", 0, data))
        self._beat_s = self.now()
        request = data[1:-2] if self.serial else data[7:]
        if request[0] not in _WRITES:
            return
        register, value = int.from_bytes(request[1:3], "big"), int.from_bytes(request[6:], "big")
        if register == CONTROLWORD:
            if value == 0x02:
                self._stopping_s = max(self._stopping_s, self.now()) if self._stopped else self.now()
            self._word(value)
            turns = self.machine.energised and abs(self.machine.speed_rad_s) > LET_GO_RAD_S
            if (
                value == 0
                and turns
                and not self.machine.excused
                and self.now() - self._stopping_s < GIVEN_UP_S
            ):
                self._report("let go", f"Disable voltage at {self.machine.speed_rad_s:.2f} rad/s")
        elif self.machine.energised and register not in self.expected.writable:
            self._report("written while on", f"register {register} while the motor is energised")

    def look(self) -> None:
        super().look()
        if self._halted_s is None or not self.machine.operating:
            return
        if min(self.now() - self._halted_s, self.machine.sound_for_s) > HALTED_WITHIN_S:
            asked = self.now() - self._halted_s
            self._report(
                "not stopped", f"still in Operation enabled, {asked:.3f} s after a halt was asked for"
            )


@dataclass(eq=False)
class LineScene:
    """Everybody whom something may befall."""

    clock: Any
    bench: Any
    machine: LineMachine
    tool: Side
    halt: Callable[[], None]  # asks the tool to stop, from another thread
    killed: Callable[[], None]
    happened: list[str] = field(default_factory=list)
    _calm: list[Callable[[], None]] = field(default_factory=list)
    _honest: Callable[[], float] | None = None  # what the drive would show of its statusword

    def befall(self, incident: Incident, seed: str) -> None:
        """Let it happen, now, and end when it is over."""
        self.happened.append(f"{self.clock.now():.6f} s {incident}")
        chance = random.Random(f"{seed} {incident}")
        over = getattr(self, "_" + incident.kind.replace("-", "_"))(incident, chance)
        if over is None:
            return
        self.machine.trouble()
        ended: list[bool] = []

        def end() -> None:
            if not ended:
                ended.append(True)
                over()
                self.machine.carries()
                if incident.kind in _LOSING:
                    self.machine.waits(_ANSWER_S)

        self._calm.append(end)
        self.clock.later(incident.duration_s, end)

    def calm(self) -> None:
        """All of it is over."""
        while self._calm:
            self._calm.pop()()
        self.bench.server.faults.now.busy_until_s = 0.0

    # The line, and what the drive answers ----------------------------------------------------------------

    @property
    def _now(self) -> Any:
        return self.bench.server.faults.now

    def _begin(self, kind: str, value: float = 0.0) -> None:
        self.bench.server.faults.begin(Fault(kind, value))

    def _drop(self, incident: Incident, chance: random.Random) -> Callable[[], None]:
        self._begin("drop")
        self.machine.waits(RTU_DROP_S)
        return lambda: None

    def _slow(self, incident: Incident, chance: random.Random) -> Callable[[], None]:
        self._begin("slow", 1e-3 * 300**incident.size)
        return lambda: setattr(self._now, "slow_s", 0.0)

    def _garble(self, incident: Incident, chance: random.Random) -> Callable[[], None]:
        self._begin("garble", 0.02 + 0.98 * incident.size)
        return lambda: setattr(self._now, "garble", 0.0)

    def _deaf(self, incident: Incident, chance: random.Random) -> Callable[[], None]:
        self._begin("deaf")
        return lambda: setattr(self._now, "deaf", False)

    def _mute(self, incident: Incident, chance: random.Random) -> Callable[[], None]:
        self._begin("mute")
        return lambda: setattr(self._now, "mute", False)

    def _busy(self, incident: Incident, chance: random.Random) -> None:
        lasts_s = min(incident.duration_s, _LONGEST_BUSY_S)
        self._begin("busy", lasts_s)
        self.machine.waits(lasts_s)

    def _acknowledge(self, incident: Incident, chance: random.Random) -> Callable[[], None]:
        self._begin("acknowledge", 0.01 * 30**incident.size)
        return lambda: setattr(self._now, "acknowledge_s", 0.0)

    def _refused(self, incident: Incident, chance: random.Random) -> Callable[[], None]:
        register = self._register(incident)
        self._now.refused[register] = chance.choice(_CODES)
        return lambda: self._now.refused.pop(register, None)

    def _unanswered(self, incident: Incident, chance: random.Random) -> Callable[[], None]:
        return self._unseen(self._register(incident), refused=False)

    def _unseen_state(self, incident: Incident, chance: random.Random) -> Callable[[], None]:
        return self._unseen(STATUSWORD, refused=chance.random() < 0.8)

    def _unseen_place(self, incident: Incident, chance: random.Random) -> Callable[[], None]:
        return self._unseen(POSITION, refused=chance.random() < 0.8)

    def _unseen(self, register: int, *, refused: bool) -> Callable[[], None]:
        if not refused:
            self._now.silent.add(register)
            return lambda: self._now.silent.discard(register)
        self._now.refused[register] = _CODES[0]
        return lambda: self._now.refused.pop(register, None)

    @staticmethod
    def _register(incident: Incident) -> int:
        """One of those that matter, the first of them more often."""
        return _REGISTERS[int(len(_REGISTERS) * (incident.pick % 1000 / 1000) ** 2)]

    def _statusword(self, incident: Incident, chance: random.Random) -> Callable[[], None]:
        cell, word = self.bench.servo.registers.cells[STATUSWORD], chance.choice(STATUSWORDS)
        self._honest = self._honest or cell.read

        def shown() -> float:
            return word

        def over() -> None:
            if cell.read is shown:
                cell.read = self._honest

        cell.read = shown
        return over

    # The drive, and the tool -----------------------------------------------------------------------------

    def _fault(self, incident: Incident, chance: random.Random) -> None:
        self._begin("fault", 0x4310)

    def _weak(self, incident: Incident, chance: random.Random) -> None:
        self.machine.weak = True
        self._begin("following-error")

    def _kill(self, incident: Incident, chance: random.Random) -> None:
        self.tool.kill()
        self.killed()

    def _interrupt(self, incident: Incident, chance: random.Random) -> None:
        self.tool.interrupt()

    def _halt(self, incident: Incident, chance: random.Random) -> None:
        self.tool.at(0.0, self.halt)

    def _stall_tool(self, incident: Incident, chance: random.Random) -> None:
        lasts_s = min(incident.duration_s, 1.5)
        self.tool.stall(lasts_s)
        self.machine.waits(lasts_s)
