"""Ways in which drives differ, and what keeps them from following: put on one drive by name (faults.py has the syntax).

Each is a behaviour that a manual somewhere describes, and that a tool which knows one drive only does not expect.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

from schwung_sim.drives.dictionary import key
from schwung_sim.drives.latency import Late, Watch
from schwung_sim.drives.operation import HOME_SWITCH, NEGATIVE_SWITCH, POSITIVE_SWITCH
from schwung_sim.drives.parameters import Cut
from schwung_sim.drives.pdo import EMCY_RPDO_TIMEOUT
from schwung_sim.drives.power import Power
from schwung_sim.drives.servo import CanopenServo

#: "Safe torque off" of ABB's ACS880, in the class of device hardware (CiA 301 table 26). CiA 402 has no code of its
#: own for it, and every vendor another: maxon's EPOS4 has 0x8A88.
STO_ERROR = 0x5091

#: kind -> default value; None: a value has to be given
TRAITS: dict[str, float | None] = {
    "late-controlword": None, "controlword-task": None, "late-setpoint": None,
    "first-rpdo": 0, "lost-rpdo": 1, "late-rpdo": 1, "rpdo-timeout": None,
    "sto": STO_ERROR, "sto-fault": STO_ERROR, "enable-input": 0, "brake": 0.15, "not-following": 0, "local": 0,
    "negative-limit": 0, "positive-limit": 0, "home-switch": 0,
    "set-up": None, "torque-polarity": 5, "demand-polarity": 0, "limits-from-zero": 0, "store-power-cut": 0,
}  # fmt: skip
#: those that can end
PASSING = frozenset({
    "sto", "sto-fault", "enable-input", "not-following", "local", "negative-limit", "positive-limit", "home-switch",
})  # fmt: skip
#: those that a drive has from the start, or has not
FROM_THE_START = frozenset({"set-up", "torque-polarity", "demand-polarity", "limits-from-zero"})
#: those whose value is a time, and not 0
TAKES_TIME = frozenset({"late-controlword", "controlword-task", "late-setpoint", "rpdo-timeout"})
#: highest value, where it is one of a few
HIGHEST: dict[str, float] = {"store-power-cut": 2, "torque-polarity": 7, "not-following": 1}

_SWITCHES = {"negative-limit": NEGATIVE_SWITCH, "positive-limit": POSITIVE_SWITCH, "home-switch": HOME_SWITCH}
_CUTS: tuple[Cut, ...] = ("before", "defaults", "stored")


class Traits:
    """Puts traits on a drive and takes them off it. `poll` has to be called whenever its axis has advanced."""

    def __init__(self, servo: CanopenServo) -> None:
        self._servo = servo
        self._polls: list[Callable[[], None]] = []
        self._sto_error: int | None = None
        self._pressed = 0

    def begin(self, kind: str, value: float, extra: int) -> None:
        """From now on the drive is so."""
        number, servo = int(value), self._servo
        actions: dict[str, Callable[[], Any]] = {
            "late-controlword": lambda: self._delay_words(value, task=False),
            "controlword-task": lambda: self._delay_words(value, task=True),
            "late-setpoint": lambda: self._delay_setpoints(value),
            "first-rpdo": self._keep_first,
            "lost-rpdo": lambda: self._miss(number, late=False),
            "late-rpdo": lambda: self._miss(number, late=True),
            "rpdo-timeout": lambda: self._watch(value),
            "sto": lambda: self._open_sto(number, Power.SWITCH_ON_DISABLED),
            "sto-fault": lambda: self._open_sto(number, Power.FAULT),
            "enable-input": lambda: servo.power.take_torque(kind, Power.SWITCH_ON_DISABLED),
            "brake": lambda: servo.power.fit_brake(value),
            "not-following": lambda: servo.operation.hold(kind, limit=bool(number)),
            "local": lambda: self._local(True),
            "set-up": lambda: self._set_up(number, extra),
            "torque-polarity": lambda: self._understand(torque_bit=1 << number),
            "demand-polarity": lambda: self._understand(demand_only=True),
            "limits-from-zero": self._limits_from_zero,
            "store-power-cut": lambda: servo.store.cut_power(_CUTS[number], servo.reset_node),
        }
        if kind in _SWITCHES:
            self._press(self._pressed | _SWITCHES[kind])
        else:
            actions[kind]()

    def end(self, kind: str) -> None:
        """What can end has ended."""
        if kind in _SWITCHES:
            self._press(self._pressed & ~_SWITCHES[kind])
        elif kind == "local":
            self._local(False)
        elif kind == "enable-input":
            self._servo.power.give_torque(kind)
        elif kind == "not-following":
            self._servo.operation.release(kind)
        else:
            self._close_sto()

    def poll(self) -> None:
        """Let happen what is due."""
        for poll in self._polls:
            poll()

    # -- Order and loss of what comes -------------------------------------------------------------

    def _before(self, k: int, stand: Callable[[Callable[[Any], None], Callable[[], float]], Any]) -> Any:
        """Put something before the writer of an object, for SDO and PDO."""
        servo = self._servo
        placed = stand(servo.dictionary.writers[k], lambda: servo.axis.time_s)
        servo.dictionary.writers[k] = placed
        for rpdo in servo.pdo.rpdos:
            rpdo.rebind()
        return placed

    def _delay(self, k: int, delay_s: float, task: bool) -> Late:
        late: Late = self._before(k, lambda act, time_s: Late(act, time_s, delay_s, task=task))
        self._polls.append(late.poll)
        self._servo.power.at_power_off.append(late.forget)
        return late

    def _delay_words(self, delay_s: float, task: bool) -> None:
        late = self._delay(key(0x6040), delay_s, task)
        self._servo.power.awaited.append(lambda: late.waiting)

    def _delay_setpoints(self, delay_s: float) -> None:
        for k in self._servo.operation.setpoints:
            self._delay(k, delay_s, task=False)

    def _keep_first(self) -> None:
        for rpdo in self._servo.pdo.rpdos:
            rpdo.keeps_first = True

    def _miss(self, count: int, late: bool) -> None:
        """The next RPDOs do not come in time: never, or only behind their SYNC."""
        self._servo.pdo.misses = [late] * count

    def _watch(self, limit_s: float) -> None:
        servo = self._servo
        watch: Watch = self._before(servo.operation.setpoints[0], Watch)

        def poll() -> None:
            if not servo.operation.follows_cycles:
                watch.came_s = servo.axis.time_s
            elif servo.axis.time_s - watch.came_s > limit_s + 1e-9:
                servo.fault(EMCY_RPDO_TIMEOUT)

        self._polls.append(poll)

    # -- What keeps it from following -------------------------------------------------------------

    def _open_sto(self, error: int, into: Power) -> None:
        self._sto_error = error
        self._servo.power.take_torque("sto", into)
        self._tell_sto()
        self._polls.append(self._tell_sto)

    def _tell_sto(self) -> None:
        """Object 603F and EMCY; anew after a reset, which forgets them."""
        servo, error = self._servo, self._sto_error
        if error is not None and error not in servo.emergency.active:
            servo.dictionary.values[key(0x603F)] = error
            servo.emergency.report(error)

    def _close_sto(self) -> None:
        self._servo.power.give_torque("sto")
        self._polls.remove(self._tell_sto)
        if self._servo.power.state is not Power.FAULT:  # else fault reset clears it
            self._servo.emergency.clear(self._sto_error)
        self._sto_error = None

    def _local(self, on: bool) -> None:
        self._servo.power.local = on
        if on:
            self._servo.operation.hold("local")
        else:
            self._servo.operation.release("local")

    def _press(self, switches: int) -> None:
        self._pressed = switches
        self._servo.operation.press(switches)

    # -- How it was set up, and what it makes of that ---------------------------------------------

    def _set_up(self, k: int, value: int) -> None:
        """An object holds this value from the factory, as it were: also after a reset, and where the EDS lacks it."""
        servo = self._servo
        servo.dictionary.defaults[k] = servo.dictionary.values[k] = value
        servo.pdo.load()
        servo.operation.load()
        servo.vendor.load()

    def _understand(self, torque_bit: int = 0, demand_only: bool = False) -> None:
        scales = self._servo.operation.scales
        scales.torque_bit |= torque_bit
        scales.demand_only |= demand_only
        self._servo.operation.load()

    def _limits_from_zero(self) -> None:
        self._servo.operation.limits_from_zero = True
        self._servo.operation.load()
