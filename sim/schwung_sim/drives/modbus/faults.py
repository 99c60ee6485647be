"""What can go wrong on Modbus, so that a tool can be tried against it.

    exception=100:6          requests that touch register 100 are refused with exception code 6
    busy=0.3                 for 0.3 s every request is refused with exception code 6
    acknowledge=0.3          writes are answered by exception code 5 and carried out 0.3 s later; busy until then
    silent=100               requests that touch register 100 are not answered
    mute                     everything is carried out, nothing is answered any more
    deaf                     nothing is heard any more: the cable is off
    drop                     the connection is cut (TCP: closed, a new one is taken; RTU: 0.3 s of silence)
    slow=0.2                 every answer comes 0.2 s late
    swap                     the words of every parameter change places, as after a wrong word order
    garble=0.1               this share of the answers has a wrong byte (RTU), or is lost (TCP)
    fault=0x4310             the drive goes into fault with this error code
    following-error          the motor gives no torque any more

Joined by commas. `@0.5` is the axis' own time, 0.5 s after the bench's start; `@on+0.5` counts from the moment at
which the power stage is first on, `@moving+0.5` from that at which the first stroke begins.
"""

from __future__ import annotations

import random
from collections.abc import Callable
from dataclasses import dataclass, field

from schwung_sim.drives.modbus.servo import ModbusServo
from schwung_sim.errors import BenchError

#: kind -> default value; None: a value has to be given
KINDS: dict[str, float | None] = {
    "exception": None, "busy": None, "acknowledge": None, "silent": None, "mute": 0, "deaf": 0, "drop": 0,
    "slow": None, "swap": 0, "garble": None, "fault": 0x4310, "following-error": 0,
}  # fmt: skip
RTU_DROP_S = 0.3


@dataclass(frozen=True)
class Fault:
    """One fault; `at_s` None: from the start."""

    kind: str
    value: float = 0.0
    extra: int = 4
    at_s: float | None = None
    after: str = ""  # "on", "moving"


def parse_faults(text: str) -> tuple[Fault, ...]:
    """Read the syntax above. Raises BenchError that names the part and what exists."""
    return tuple(_parse(part.strip()) for part in text.split(",") if part.strip())


def _parse(part: str) -> Fault:
    head, _, when = part.partition("@")
    kind, given, value_text = head.partition("=")
    if kind not in KINDS:
        raise BenchError(f'fault "{part}"', "there is no such fault", f"There are {', '.join(KINDS)}.")
    value_text, _, extra_text = value_text.partition(":")
    try:
        if not given and KINDS[kind] is None:
            raise ValueError
        value = (
            float(int(value_text, 0))
            if value_text.lower().startswith("0x")
            else float(value_text or KINDS[kind] or 0)
        )
        extra = int(extra_text, 0) if extra_text else 4
        after, plus, seconds = when.rpartition("+")
        if plus and after not in ("on", "moving"):
            raise ValueError
        at_s = float(seconds) if when else None
    except ValueError:
        raise BenchError(
            f'fault "{part}"', "its numbers cannot be read", "Write it as name=value@seconds."
        ) from None
    if value < 0 or (at_s is not None and at_s < 0):
        raise BenchError(f'fault "{part}"', "is negative", "Values and times count upwards from 0.")
    return Fault(kind, value, extra, at_s, after)


@dataclass
class Mischief:
    """What is wrong at the moment; the server looks here before it answers."""

    refused: dict[int, int] = field(default_factory=dict)
    silent: set[int] = field(default_factory=set)
    mute: bool = False
    deaf: bool = False
    slow_s: float = 0.0
    busy_until_s: float = 0.0  # the axis' own time
    acknowledge_s: float = 0.0
    garble: float = 0.0


class FaultSchedule:
    """Makes a drive's faults happen when they are due. `drop` is called to cut the connection."""

    def __init__(
        self, servo: ModbusServo, faults: tuple[Fault, ...], drop: Callable[[], None], seed: int
    ) -> None:
        self.now = Mischief()
        self._servo, self._drop = servo, drop
        self._since: dict[str, float] = {"": 0.0}
        self._waiting = [fault for fault in faults if fault.at_s is not None]
        self._luck = random.Random(f"{seed} modbus")
        for fault in faults:
            if fault.at_s is None:
                self.begin(fault)

    def poll(self) -> None:
        """Begin what is due."""
        now = self._servo.axis.time_s
        if self._servo.power.energised:
            self._since.setdefault("on", now)
        if self._servo.moves:
            self._since.setdefault("moving", now)
        for fault in list(self._waiting):
            start = self._since.get(fault.after)
            if start is not None and fault.at_s is not None and now >= start + fault.at_s - 1e-9:
                self._waiting.remove(fault)
                self.begin(fault)

    def garbled(self) -> bool:
        """Whether the answer that goes out now is to be spoilt."""
        return self.now.garble > 0 and self._luck.random() < self.now.garble

    def begin(self, fault: Fault) -> None:
        """Make it happen now."""
        servo, now, number = self._servo, self.now, int(fault.value)
        actions: dict[str, Callable[[], object]] = {
            "exception": lambda: now.refused.update({number: fault.extra}),
            "busy": lambda: setattr(now, "busy_until_s", servo.axis.time_s + fault.value),
            "acknowledge": lambda: setattr(now, "acknowledge_s", fault.value),
            "silent": lambda: now.silent.add(number),
            "mute": lambda: setattr(now, "mute", True),
            "deaf": lambda: setattr(now, "deaf", True),
            "drop": self._drop,
            "slow": lambda: setattr(now, "slow_s", fault.value),
            "swap": lambda: setattr(servo.registers, "high_first", not servo.registers.high_first),
            "garble": lambda: setattr(now, "garble", fault.value),
            "fault": lambda: servo.power.fail(number),
            "following-error": servo.weaken,
        }
        actions[fault.kind]()
