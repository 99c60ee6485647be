"""Who watches a session: written from CiA 402-2 and the plan alone, with literals of its own.

It sees every frame with its sender, and the machine itself; nothing of the tool. What it must never see is a rule, each
with the clause or the reason that it comes from.

    window, speed, torque   the plan's limits hold while the motor has torque
    re-enabled              CiA 402-2, 6.3: out of Operation enabled leads one way only, off, until somebody asks anew;
                            the words Shutdown, Switch on, Enable operation come before, once
    enable after stop       after Enable operation any other word ends it: nobody sends it again, be it after Quick
                            stop, Disable voltage, or a second time up for a drive that fell back
    undone by SYNC          CiA 301, 7.2.2.2: an RPDO acts with the SYNC after it; Quick stop said by SDO while one that
                            enables still waits would last until then (6.3, transition 16)
    goes on                 who has heard that another master speaks to the drive, enables it no more
    step                    607A moves from RPDO to RPDO no further than the plan's own motion does, stops included
    bend                    and while it enables, its steps change no more than that motion's acceleration makes them
    torque added            60B2 is no more than is injected, and 0 in every frame that does not enable
    controlword             the words of table 27 alone, for this mode; no halt, no fault reset
    mode                    what enters Operation enabled does so in the plan's mode (6061)
    dead man's motion       without our heartbeat: consumer time (1016) plus the quick stop, then it stands: its
                            loop may ring, or its generator shake it, but it goes nowhere
    two that beat           CiA 301, 7.2.8.2.2: a consumer hears the node, not who it is: two of one id
    written while on        with the motor energised the tool writes nothing but what the plan needs then, and does not
                            stop the node before it has told it Disable voltage
    left energised          whoever ends leaves the power stage off, or says that it may be on
"""

from __future__ import annotations

import math
import struct
import zlib
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field

import can

from schwung_sim.campaign.machine import Machine

#: What a controller may overshoot by, and what a look of 1 ms may be late for.
OVERSHOOT_RAD, TORQUE_SLACK, SPEED_SLACK = 0.02, 1.001, 1.1
#: Within so much a loop rings that had to stop, or a generator of the drive shakes the axis; a motion leads out of it.
SWINGS_RAD = 0.1
#: How far from the axis the first target may be: what somebody turned it by while it was enabled.
STANDS_AT_RAD = 0.06
#: How long another master's word may be fought over until the tool has noticed.
FOREIGN_S = 0.1
#: Who hears another's word stops with its very next frame; one may be on its way.
HEARD_S = 0.001
#: So long a drive that left operation by itself may be led back by words that were under way, or in its own queue.
NOTICED_S = 0.1
#: So long a word that enables may lie in a drive's queue after it has come, also where a stop has been said since: no
#: longer than the slowest of them looks at its words.
QUEUED_S = 0.02
#: Another's heartbeat is there as long as it comes this often.
SHARED_FOR_S = 1.0
#: From the end of the consumer time until the drive has looked at its timers, and its loop has settled after braking.
REACTION_S = 0.25

#: A mode that has been wrong for so many looks before the drive is enabled can have been seen.
_LOOKS_AT_MODE = 50
_WORDS = {0x00, 0x02, 0x06, 0x07, 0x0F}
_PP_WORDS = _WORDS | {0x1F, 0x3F}
_STAMP = struct.Struct("<dHB")


@dataclass(frozen=True)
class Expected:
    """The plan in plain numbers; counts and per mille as they are on the wire."""

    node_id: int
    low_rad: float
    high_rad: float
    speed_rad_s: float
    torque_nm: float
    silence_s: float  # 1016
    deceleration_rad_s2: float  # 6085
    step_rad: float  # of 607A between two RPDOs
    bend_rad: float | None  # by how much that changes from one to the next; None: the drive makes the path
    added_counts: int  # of 60B2
    mode: int
    writable: frozenset[int] = frozenset({0x6040})  # objects, while energised

    @property
    def at_rest_s(self) -> float:
        """After our last heartbeat the drive has noticed, and its axis has come to rest."""
        return self.silence_s + self.speed_rad_s / self.deceleration_rad_s2 + REACTION_S


@dataclass(frozen=True)
class Violation:
    """What must not be seen, and was."""

    time_s: float
    rule: str
    saw: str

    def __str__(self) -> str:
        return f"{self.time_s:.6f} s, {self.rule}: {self.saw}"


@dataclass
class Heard:
    """One frame on the wire."""

    time_s: float
    sender: str
    can_id: int
    data: bytes

    def __str__(self) -> str:
        return f"{self.time_s:10.6f}  {self.sender:6}  {self.can_id:03X}  {self.data.hex(' ')}"


@dataclass
class Monitor:
    """Watches; `heard` for every frame, `look` every millisecond."""

    expected: Expected
    machine: Machine
    now: Callable[[], float]
    violations: list[Violation] = field(default_factory=list)
    frames: list[Heard] | None = None  # all of them, where a list is given
    digest: int = 0
    count: int = 0

    def __post_init__(self) -> None:
        self._asked = False  # somebody has asked for one time in operation
        self._enabled = self._stopped = False  # Enable operation was said; and then another word
        # An RPDO that enables waits for its SYNC; and a stop was said by SDO meanwhile.
        self._waits = self._undone = False
        self._foreign_heard_s: float | None = None  # by the tool, while it enabled
        self._operated = False
        self._climbed: set[int] = set()  # controlwords since the power stage was last off
        self._said: set[int] = set()  # controlwords since it was last enabled
        self._last_target: int | None = None
        self._last_step: int | None = None  # while it enabled
        self._beat_s: float | None = None  # the tool's last heartbeat
        self._died_s: float | None = None
        self._rested_rad: tuple[float, float] | None = (
            None  # between which angles it was since it had to rest
        )
        self._foreign_s = self._left_by_itself_s = float("-inf")
        self._enabling_s = float("-inf")  # when the last word that enables has come, or will, to the drive
        self._looked_s = float("-inf")  # the last time
        self._others_beat_s = float(
            "-inf"
        )  # heard by the drive; and by the tool, the last and the first of them
        self._noticeable_s = self._noticeable_since_s = float("-inf")
        self._wrong_mode_looks = 0
        self._was_operating = False
        self._rpdo, self._sdo = 0x200 + self.expected.node_id, 0x600 + self.expected.node_id
        self._heartbeat, self._node_stopped = 0x700 + self.expected.node_id, False
        self._seen: set[str] = set()

    # What happens ----------------------------------------------------------------------------------------

    def asked(self) -> None:
        """Somebody asks for one time in operation, on purpose."""
        self._asked, self._operated, self._climbed = True, False, set()
        self._enabled = self._stopped = False
        self._foreign_heard_s = None

    def died(self) -> None:
        """The tool is no more."""
        self._died_s = self.now()

    def ended(self, told: str) -> None:
        """The tool has ended by itself; `told` is all that it said."""
        if self.machine.energised and "energised" not in told and "power stage" not in told:
            self._report("left energised", f"the motor is energised, and the tool said {told or 'nothing'!r}")

    def heard(self, sender: str, message: can.Message) -> None:
        """Somebody sends a frame."""
        data, can_id = bytes(message.data), message.arbitration_id
        time_s = self.now()
        self.count += 1
        self.digest = zlib.crc32(_STAMP.pack(time_s, can_id, len(sender)) + data, self.digest)
        if self.frames is not None:
            self.frames.append(Heard(time_s, sender, can_id, data))
        if sender != "tool":
            if can_id == self._heartbeat and data:
                self._node_stopped = data[0] & 0x7F == 0x04
            if sender == "other":
                self._foreign_s = time_s
                if can_id == 0x77F:
                    self._others_beat_s = time_s
            return
        if can_id == self._rpdo and len(data) == 8:
            self._command(*struct.unpack("<Hih", data))
        elif can_id == self._sdo and len(data) == 8:
            self._request(data)
        elif can_id == 0x77F:
            self._beat_s = self.now()
        elif can_id == 0x080:
            if self._undone:
                self._report(
                    "undone by SYNC",
                    "Quick stop was said by SDO, and an RPDO that enables waited for its SYNC",
                )
            self._waits = self._undone = False
        elif can_id == 0 and len(data) == 2:
            self._nmt(data[0])

    def reached(self, message: can.Message) -> None:
        """A frame has come to the tool: nobody can be blamed for what was lost on the way."""
        can_id, now = message.arbitration_id, self.now()
        if can_id in (0x080, self._rpdo, self._sdo) and self._enabled and self._foreign_heard_s is None:
            self._foreign_heard_s = now
        if can_id == 0x77F:
            if now - self._noticeable_s > SHARED_FOR_S:
                self._noticeable_since_s = now
            self._noticeable_s = now

    def under_way(self, to: str, message: can.Message, delays: Sequence[float]) -> None:
        """A frame will come to `to` after so many seconds: a word that was late overtakes nobody's stop on purpose."""
        rpdo = message.arbitration_id == self._rpdo and len(message.data) == 8
        if to == "drive" and delays and rpdo and message.data[0] & 0x0F == 0x0F:
            self._enabling_s = max(self._enabling_s, self.now() + max(delays))

    def look(self) -> None:
        """A millisecond has passed."""
        machine, plan = self.machine, self.expected
        operating, excused = machine.operating, machine.excused
        self._keep_queue()
        if not operating and 0x0F not in self._climbed:  # after that word, a brake may still have to open
            self._wrong_mode_looks = self._wrong_mode_looks + 1 if machine.mode != plan.mode else 0
        if operating is not self._was_operating:
            self._operation(operating)
        if not machine.energised:
            self._last_target = None
            return
        angle, speed, torque = machine.position_rad, machine.speed_rad_s, machine.torque_nm
        if excused:
            return
        if not plan.low_rad - OVERSHOOT_RAD <= angle <= plan.high_rad + OVERSHOOT_RAD:
            self._report("window", f"{angle:.4f} rad of {plan.low_rad:.4f} … {plan.high_rad:.4f} rad")
        if abs(speed) > SPEED_SLACK * plan.speed_rad_s:
            self._report("speed", f"{speed:.2f} rad/s of {plan.speed_rad_s:.2f} rad/s")
        if abs(torque) > TORQUE_SLACK * plan.torque_nm:
            self._report("torque", f"{torque:.1f} N·m of {plan.torque_nm:.1f} N·m")
        self._judge_silence(operating, angle)

    # Rules -----------------------------------------------------------------------------------------------

    def _keep_queue(self) -> None:
        """What lies in the queue of a drive whose processor stands gets no older."""
        now = self.now()
        if self.machine.stands:
            self._enabling_s = min(self._enabling_s + now - max(self._looked_s, self._enabling_s), now)
        self._looked_s = now

    def _operation(self, operating: bool) -> None:
        """Operation enabled was entered, or left."""
        self._was_operating = operating
        if not operating:
            self._left_by_itself_s = (
                self.now() if not self._said & {0x00, 0x02, 0x06, 0x07} else float("-inf")
            )
            if not self.machine.stepped_down or self._said & {0x00, 0x02, 0x06, 0x07}:
                self._operated, self._climbed = True, set()
            return  # else by a word of the way up that came late
        self._said = set()
        now = self.now()
        known = now - self._left_by_itself_s > NOTICED_S and now - self._foreign_s > FOREIGN_S
        known &= now - self._enabling_s > QUEUED_S
        if self._operated and known:
            self._report("re-enabled", "Operation enabled again, after a stop and without being asked")
        if not self._asked and not self._operated:
            self._report("re-enabled", "Operation enabled, and nobody had asked for it")
        if self._wrong_mode_looks > _LOOKS_AT_MODE:
            self._report(
                "mode", f"Operation enabled in mode {self.machine.mode}, planned is {self.expected.mode}"
            )

    def _command(self, word: int, target: int, added: int) -> None:
        """An RPDO: controlword, target position, torque offset."""
        plan = self.expected
        enables = self._word(word)
        self._waits, self._undone = enables, False
        self._judge_sharing(enables)
        heard_s = self._foreign_heard_s
        if enables and heard_s is not None and self.now() - heard_s > HEARD_S:
            self._report(
                "goes on", f"Enable operation, {self.now() - heard_s:.3f} s after another master was heard"
            )
        if abs(added) > plan.added_counts or (added and not enables):
            self._report("torque added", f"{added} ‰ beside controlword 0x{word:04X}")
        if not self.machine.energised:
            self._last_target = None
            return
        last, self._last_target = self._last_target, target
        count_rad = self.machine.count_rad
        self._judge_bend(None if last is None or not enables else target - last)
        if last is None and plan.mode != 1:
            off = target * count_rad - self.machine.position_rad
            if abs(off) > STANDS_AT_RAD:
                self._report("step", f"the first target is {off:+.4f} rad from where the axis stands")
        # a drive that makes the way by itself may be told of it from wherever it was turned to meanwhile
        turned = STANDS_AT_RAD / count_rad if plan.mode == 1 else 1
        most = math.ceil(plan.step_rad / count_rad)
        if last is not None and abs(target - last) > most + turned:
            self._report(
                "step",
                f"{target - last:+d} counts in one RPDO with 0x{word:04X}, {most} is the plan's largest",
            )

    def _judge_bend(self, step: int | None) -> None:
        """The step to this target; None where there is none, or it stops."""
        last, self._last_step = self._last_step, step
        bend_rad = self.expected.bend_rad
        if step is None or last is None or bend_rad is None:
            return
        most = math.ceil(bend_rad / self.machine.count_rad)
        if abs(step - last) > most + 2:
            self._report(
                "bend", f"a step of {step:+d} counts after one of {last:+d}, {most} is the plan's most"
            )

    def _word(self, word: int) -> bool:
        """A controlword, by whichever way; True where it enables operation."""
        if word not in (_PP_WORDS if self.expected.mode == 1 else _WORDS):
            self._report("controlword", f"0x{word:04X}")
        enables = word & 0x0F == 0x0F
        if enables and self._stopped:
            self._report("enable after stop", f"0x{word:04X} after it, and then a lower word, had been said")
        if enables and not self._operated and not {0x06, 0x07} <= self._climbed:
            self._report("re-enabled", f"0x{word:04X} without Shutdown and Switch on before it")
        self._stopped |= self._enabled and not enables
        if enables:
            self._enabled, self._enabling_s = True, max(self._enabling_s, self.now())
        self._climbed.add(word & 0x0F)
        self._said.add(word & 0x0F)
        return enables

    def _request(self, data: bytes) -> None:
        """An SDO request of the tool's; downloads change something (CiA 301, 7.2.4.3)."""
        specifier, index = data[0] >> 5, data[1] | data[2] << 8
        if specifier not in (1, 6) or (specifier == 6 and data[0] & 1):
            return
        if index == 0x6040 and data[0] & 0x0F == 0x0B:
            word = data[4] | data[5] << 8
            self._undone = not self._word(word) and word == 0x02 and self._waits
        elif self.machine.energised and index not in self.expected.writable:
            self._report("written while on", f"0x{index:04X}:{data[3]:02X} while the motor is energised")

    def _nmt(self, command: int) -> None:
        reaches = command == 0x80 and self._node_stopped  # neither PDO nor SDO do (CiA 301, 7.3.2.2.4)
        told = 0x00 in self._said  # if it is on all the same, it is not ours to switch off
        if command != 1 and self.machine.energised and not told and not reaches:
            self._report("written while on", f"NMT command 0x{command:02X} while the motor is energised")

    def _judge_sharing(self, enables: bool) -> None:
        """We go on though somebody else beats as our node, and has done so for long enough to be noticed."""
        now = self.now()
        if enables and now - self._noticeable_s < SHARED_FOR_S and now - self._noticeable_since_s > FOREIGN_S:
            self._report("two that beat", "Enable operation, while another master beats as node 127, too")

    def _judge_silence(self, operating: bool, angle: float) -> None:
        since = max(self._beat_s or 0.0, self._others_beat_s, self.machine.deaf_until_s)
        if self._beat_s is None or self.machine.excused:
            return
        silent = self.now() - since
        if silent <= self.expected.at_rest_s:
            self._rested_rad = None
            return
        least, most = self._rested_rad or (angle, angle)
        self._rested_rad = min(angle, least), max(angle, most)
        went = max(angle - least, most - angle)
        if operating or went > SWINGS_RAD:
            state = "in Operation enabled" if operating else f"energised, and {went:.3f} rad further"
            self._report("dead man's motion", f"{silent:.3f} s after our last heartbeat {state}")

    def _report(self, rule: str, saw: str) -> None:
        """Once a rule: what follows from the first is no news."""
        if rule not in self._seen:
            self._seen.add(rule)
            self.violations.append(Violation(self.now(), rule, saw))
