"""Incidents as they happen: to the wire, the drive, the machine, the tool, and by other masters."""

from __future__ import annotations

import random
import struct
from collections.abc import Callable
from dataclasses import dataclass, field
from typing import Any

import can

from schwung_sim.campaign.draw import TARGETS, Incident
from schwung_sim.campaign.machine import BenchMachine
from schwung_sim.campaign.side import Side, SideBus
from schwung_sim.campaign.weather import Squall, Weather
from schwung_sim.drives.dictionary import key
from schwung_sim.drives.servo import encode_controlword
from schwung_sim.traits import STO_ERROR, Traits

#: Objects whose access is refused or not answered, first what a stop depends on.
_OBJECTS = (
    0x6041, 0x6040, 0x6064, 0x6061, 0x6060, 0x603F, 0x1016, 0x1017, 0x605A, 0x607D, 0x6065, 0x6072, 0x1400, 0x1600,
    0x1800, 0x1A00, 0x1005, 0x1006, 0x1019, 0x6007, 0x2200, 0x2100, 0x1010, 0x2300, 0x1018, 0x6081,
)  # fmt: skip
#: Abort codes of CiA 301, table 22: general, does not exist, device state, toggle bit, time-out.
_ABORTS = (0x08000000, 0x06020000, 0x08000022, 0x05030000, 0x05040000)
#: Error codes of CiA 402-2 and 301: short circuit, temperature, following error, heartbeat.
_ERRORS = (0x2320, 0x4310, 0x8611, 0x8130)
#: Statuswords that mean no state, or not the one that is; none of them says that the drive is off.
STATUSWORDS = (0x0001, 0x0003, 0x0013, 0x0205, 0x0273, 0xFFFF, 0x0231, 0x0237, 0x0207, 0x020F)
#: What another master writes into 6040: all of it stops.
_FOREIGN_WORDS = (0x00, 0x02, 0x06, 0x07)
_FOREIGN_PERIOD_S = 0.01
_MOST_MOVED_RAD = 0.05
#: Traits that take the torque: the axis is not held, and nobody is excused.
_TORQUE_OFF = {"sto", "sto-fault", "enable-input"}
#: After its power stage has gone on, a drive's enable input drops within so much (s): before anybody has seen that it
#: is on, or later.
_DROPS_S = (1e-4, 0.1)
_LONGEST_DELAY_S = 0.3


@dataclass(eq=False)
class Scene:
    """Everybody whom something may befall."""

    clock: Any
    weather: Weather
    bench: Any
    machine: BenchMachine
    tool: Side
    tool_bus: SideBus
    other: Any  # an end of the wire that gets nothing
    halt: Callable[[], None]  # asks the tool to stop, from another thread
    killed: Callable[[], None]  # told when the tool is killed
    traits: Traits
    happened: list[str] = field(default_factory=list)
    _calm: list[Callable[[], None]] = field(default_factory=list)
    _present: set[str] = field(default_factory=set)  # traits that have not ended

    def befall(self, incident: Incident, seed: str) -> None:
        """Let it happen, now, and end when it is over."""
        self.happened.append(f"{self.clock.now():.6f} s {incident}")
        chance = random.Random(f"{seed} {incident}")
        over = getattr(self, "_" + incident.kind.replace("-", "_"))(incident, chance)
        if over is not None:
            self._calm.append(over)
            self.clock.later(incident.duration_s, over)

    def calm(self) -> None:
        """All of it is over; a drive that is bus-off or weak is switched off and on again."""
        self.weather.squalls.clear()
        self.bench.servo.store.keep_power()
        while self._calm:
            self._calm.pop()()

    # The wire --------------------------------------------------------------------------------------------

    def _squall(self, incident: Incident, chance: random.Random) -> Callable[[], None]:
        share = 1.0 if chance.random() < 0.6 else 0.02 + 0.98 * incident.size
        delay = 1e-4 * (_LONGEST_DELAY_S / 1e-4) ** incident.size
        squall = Squall(incident.kind, TARGETS[incident.pick % len(TARGETS)], share, delay, chance)
        self.weather.squalls.append(squall)

        def over() -> None:
            if squall in self.weather.squalls:
                self.weather.squalls.remove(squall)

        return over

    _lose = _delay = _double = _reorder = _squall

    # The drive -------------------------------------------------------------------------------------------

    def _sdo_abort(self, incident: Incident, chance: random.Random) -> Callable[[], None]:
        index, code = self._object(incident), chance.choice(_ABORTS)
        self.bench.servo.sdo.aborts[index] = code
        return lambda: self.bench.servo.sdo.aborts.pop(index, None)

    def _sdo_silence(self, incident: Incident, chance: random.Random) -> Callable[[], None]:
        index = self._object(incident)
        self.bench.servo.sdo.silent.add(index)
        return lambda: self.bench.servo.sdo.silent.discard(index)

    @staticmethod
    def _object(incident: Incident) -> int:
        """One of those that matter, the first of them more often."""
        return _OBJECTS[int(len(_OBJECTS) * (incident.pick % 1000 / 1000) ** 2)]

    def _statusword(self, incident: Incident, chance: random.Random) -> Callable[[], None]:
        """What the tool receives of the statusword is wrong: in TPDO 1, in SDO answers, or in both."""
        node, word = self.bench.servo.node_id, chance.choice(STATUSWORDS)
        where = ((0x180 + node,), (0x580 + node,), (0x180 + node, 0x580 + node))[incident.pick % 3]

        def alter(message: can.Message) -> can.Message:
            if message.arbitration_id not in where:
                return message
            at = 0
            if message.arbitration_id == 0x580 + node:
                if bytes(message.data[:4]) != b"\x4b\x41\x60\x00":
                    return message
                at = 4
            message.data[at : at + 2] = struct.pack("<H", word)
            return message

        self.tool_bus.alter = alter

        def over() -> None:
            if self.tool_bus.alter is alter:
                self.tool_bus.alter = None

        return over

    def _unseen_state(self, incident: Incident, chance: random.Random) -> Callable[[], None]:
        return self._unseen((0x6041,), incident, chance)

    def _unseen_place(self, incident: Incident, chance: random.Random) -> Callable[[], None]:
        return self._unseen((0x6064,), incident, chance)

    def _unseen(
        self, objects: tuple[int, ...], incident: Incident, chance: random.Random
    ) -> Callable[[], None]:
        """PDOs do not come, and SDO answers for these are refused or missing."""
        squall = Squall("lose", "TPDO", 1.0, 0.0, chance)
        self.weather.squalls.append(squall)
        sdo = self.bench.servo.sdo
        refused = chance.random() < 0.8
        for index in objects:
            if refused:
                sdo.aborts[index] = _ABORTS[incident.pick % 2]
            else:
                sdo.silent.add(index)

        def over() -> None:
            if squall in self.weather.squalls:
                self.weather.squalls.remove(squall)
            for index in objects:
                sdo.aborts.pop(index, None)
                sdo.silent.discard(index)

        return over

    def _reset(self, incident: Incident, chance: random.Random) -> None:
        self.bench.servo.reset_node()

    def _fault(self, incident: Incident, chance: random.Random) -> None:
        self.bench.servo.fault(chance.choice(_ERRORS))

    def _sto(self, incident: Incident, chance: random.Random) -> Callable[[], None]:
        return self._passing(("sto", "sto-fault")[incident.pick % 2], STO_ERROR)

    def _enable_input(self, incident: Incident, chance: random.Random) -> None:
        """Soon after the power stage has gone on, the drive's own enable input drops, and comes back: no fault, no
        EMCY. Switching on pulls the supply down that holds the relay, say.
        """
        first, last = _DROPS_S
        after_s = first * (last / first) ** incident.size

        def drop() -> None:
            over = self._passing("enable-input", 0)
            self._calm.append(over)
            self.clock.later(incident.duration_s, over)

        def watch() -> None:
            if self.machine.energised:
                watching.close()
                self.clock.later(after_s, drop)

        watching = self.clock.every(_DROPS_S[0], watch)
        self._calm.append(watching.close)

    def _not_following(self, incident: Incident, chance: random.Random) -> Callable[[], None]:
        return self._passing("not-following", incident.pick % 2)

    def _local(self, incident: Incident, chance: random.Random) -> Callable[[], None]:
        return self._passing("local", 0)

    def _limit_switch(self, incident: Incident, chance: random.Random) -> Callable[[], None]:
        return self._passing(("negative-limit", "positive-limit")[incident.pick % 2], 0)

    def _passing(self, kind: str, value: int) -> Callable[[], None]:
        """A trait that ends."""
        if kind in self._present:
            return lambda: None
        self._present.add(kind)
        self.machine.held = self._present - _TORQUE_OFF
        self.traits.begin(kind, value, 0)

        def over() -> None:
            if kind in self._present:
                self._present.discard(kind)
                self.machine.held = self._present - _TORQUE_OFF
                self.traits.end(kind)

        return over

    def _lost_rpdo(self, incident: Incident, chance: random.Random) -> None:
        self.traits.begin("lost-rpdo", 1 + int(20 * incident.size**2), 0)

    def _late_rpdo(self, incident: Incident, chance: random.Random) -> None:
        self.traits.begin("late-rpdo", 1 + int(20 * incident.size**2), 0)

    def _store_power_cut(self, incident: Incident, chance: random.Random) -> None:
        self.traits.begin("store-power-cut", incident.pick % 3, 0)

    def _heartbeat_stop(self, incident: Incident, chance: random.Random) -> Callable[[], None]:
        heartbeats = self.bench.servo.heartbeats
        heartbeats.muted = True
        return lambda: setattr(heartbeats, "muted", False)

    def _drive_bus_off(self, incident: Incident, chance: random.Random) -> Callable[[], None]:
        """It neither sends nor receives, and reacts as to a lost connection."""
        squalls = [Squall("lose", target, 1.0, 0.0, chance) for target in ("to drive", "from drive")]
        self.weather.squalls[:0] = squalls
        self.bench.servo.bus_failed()

        def over() -> None:
            self.weather.squalls[:] = [s for s in self.weather.squalls if s not in squalls]

        return over

    def _stall_drive(self, incident: Incident, chance: random.Random) -> Callable[[], None]:
        self.bench.servo.stall(True)
        return lambda: self.bench.servo.stall(False)

    def _weak(self, incident: Incident, chance: random.Random) -> None:
        self.machine.weak = True
        self.bench.servo.vendor.weaken()

    def _mode(self, incident: Incident, chance: random.Random) -> None:
        """The drive is in another mode than it was told."""
        if self.machine.energised:  # then it would be another master's motion
            return
        dictionary = self.bench.servo.dictionary
        other = 1 if dictionary.number(0x6060) == 8 else 8
        dictionary.writer(key(0x6060))(other)

    def _moved(self, incident: Incident, chance: random.Random) -> None:
        """Somebody turns the machine, where it is not held."""
        if not self.machine.energised:
            way = _MOST_MOVED_RAD * (2 * incident.size - 1)
            state = self.bench.plant.state
            state["motor_rad"] += way
            state["load_rad"] += way

    # The tool --------------------------------------------------------------------------------------------

    def _tool_bus_off(self, incident: Incident, chance: random.Random) -> Callable[[], None]:
        self.tool_bus.bus_off = True
        if incident.pick % 2:  # some adapters tell it by an error frame, others when one sends
            told = can.Message(arbitration_id=0x40, is_error_frame=True, dlc=8, data=bytes(8))
            self.tool_bus.bus_off = False
            self.tool_bus.stepped.arrived(told, self.clock.date())
            self.tool_bus.bus_off = True
        return lambda: setattr(self.tool_bus, "bus_off", False)

    def _buffer_full(self, incident: Incident, chance: random.Random) -> Callable[[], None]:
        self.tool_bus.buffer_full = True
        return lambda: setattr(self.tool_bus, "buffer_full", False)

    def _kill(self, incident: Incident, chance: random.Random) -> None:
        self.tool.kill()
        self.killed()

    def _interrupt(self, incident: Incident, chance: random.Random) -> None:
        self.tool.interrupt()
        if incident.pick % 3 == 0:  # people press it again
            self.clock.later(incident.duration_s, self.tool.interrupt)

    def _halt(self, incident: Incident, chance: random.Random) -> None:
        self.tool.at(0.0, self.halt)

    def _stall_tool(self, incident: Incident, chance: random.Random) -> None:
        self.tool.stall(min(incident.duration_s, 1.5))

    # Other masters ---------------------------------------------------------------------------------------

    def _foreign_beat(self, incident: Incident, chance: random.Random) -> Callable[[], None]:
        period = 0.02 * (1.5 / 0.02) ** incident.size
        over: Callable[[], None] = self.clock.every(period, lambda: self._say(0x77F, b"\x05")).close
        return over

    def _foreign_command(self, incident: Incident, chance: random.Random) -> Callable[[], None]:
        node = self.bench.servo.node_id
        word, command = chance.choice(_FOREIGN_WORDS), chance.choice((0x02, 0x80, 0x81, 0x82))
        if incident.pick % 4 == 0:
            self._say(0x000, bytes([command, chance.choice((0, node))]))
            return lambda: None
        request = bytes(encode_controlword(node, word).data)
        frames = {
            1: (0x600 + node, request),
            2: (0x080, b"\x01"),
            3: (0x200 + node, struct.pack("<Hih", word, 0, 0)),
        }
        can_id, data = frames[incident.pick % 4]
        over: Callable[[], None] = self.clock.every(_FOREIGN_PERIOD_S, lambda: self._say(can_id, data)).close
        return over

    def _say(self, can_id: int, data: bytes) -> None:
        message = can.Message(arbitration_id=can_id, data=data, is_extended_id=False)
        self.other.stepped.wire.carry(self.other.stepped, message)
