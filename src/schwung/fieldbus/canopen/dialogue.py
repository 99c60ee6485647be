"""Looking at one drive and commanding it: by PDO where they are exchanged and answered, by SDO where not."""

from __future__ import annotations

import math
from collections import deque
from collections.abc import Callable

from schwung.errors import DriveError, StateError
from schwung.fieldbus import cia402
from schwung.fieldbus.braking import Slowing
from schwung.fieldbus.canopen import diagnosis, nmt
from schwung.fieldbus.canopen.cyclic import Cyclic
from schwung.fieldbus.canopen.sdo import SdoChannel
from schwung.fieldbus.cia402 import State
from schwung.fieldbus.drive import Parameter, ParameterValue
from schwung.fieldbus.profile import CanopenProfile
from schwung.fieldbus.walker import Access, Walker

CONTROLWORD = Parameter(0x6040, 0, "UNSIGNED16", "Controlword")
_STEP_S = 0.005
STANDSTILL_S = 2.0
_STILL_RAD, _STILL_STEPS = 2e-4, 3  # in a step: slower than 0.04 rad/s for three steps is standstill
_TREMBLES = 40  # steps within which a drive that holds its axis goes no further than so slow a one would


class Dialogue:
    """What one says to a drive and hears of it; `cyclic` is set while PDOs are exchanged."""

    def __init__(self, sdo: SdoChannel, monitor: nmt.NodeMonitor, profile: CanopenProfile) -> None:
        self.cyclic: Cyclic | None = None
        self.place = f"node {sdo.node_id}"
        self._sdo, self._monitor, self._profile = sdo, monitor, profile
        access = Access(self.place, self.statusword, self.command, lambda: self._pause(_STEP_S), self.stuck)
        self.walker = Walker(monitor.clock, access)

    def statusword(self) -> int | None:
        """Read now; None where the drive refuses to show it. Raises SdoError where it does not answer."""
        by_pdo = self.cyclic.statusword if self.cyclic is not None else None
        return by_pdo if by_pdo is not None else self._sdo.read_integer(0x6041, 0, "UNSIGNED16")

    def state(self) -> State:
        """See Walker.state."""
        return self.walker.state()

    def position(self) -> int:
        """Counts. Raises StateError where the drive refuses to show them: 0 would be a place like any other."""
        found = self.cyclic.position if self.cyclic is not None else None
        if found is None:
            ref = self._profile.quantities.position.object
            found = self._sdo.read_integer(ref.index, ref.subindex, "INTEGER32")
        if found is None:
            raise StateError(self.place, "does not show its position", "Is this the profile of this drive?")
        return found

    def command(self, controlword: int) -> None:
        """Send a controlword, by SDO where PDOs are not answered, and give the drive time for it.

        The target stays what it was; on the way up a drive without power gets the place where it is, and holds that
        when enabled. A word that stops leaves it: a drive that only seems to be off would step. One that enables goes
        by PDO alone, where a stop is latched: an SDO could be overtaken by it. Raises StateError where there are none.
        """
        cyclic, enables = self.cyclic, cia402.enables_operation(controlword)
        if cyclic is not None:
            cyclic.producer.hold(cyclic.frame(controlword, self._target(cyclic, controlword)))
        elif enables:
            raise StateError(self.place, "does not exchange PDOs", "Start it before it is enabled.")
        if not enables and (cyclic is None or not cyclic.answering):
            self._sdo.write(ParameterValue(CONTROLWORD, controlword))
        self._pause(_STEP_S)

    def _target(self, cyclic: Cyclic, controlword: int) -> int:
        at_rest = cia402.decode(cyclic.statusword) in (*cia402.OFF, State.READY, State.SWITCHED_ON)
        at_rest &= controlword not in (cia402.DISABLE_VOLTAGE, cia402.QUICK_STOP)
        return self.position() if at_rest or cyclic.target is None else cyclic.target

    def stuck(self, status: int | None, word: int, wanted: State) -> DriveError:
        """Why the drive does not reach a state, in its own words where it has any."""
        mode = self.cyclic.mode if self.cyclic is not None else None
        tells_voltage = self._profile.voltage_bit == "supply"
        return diagnosis.why_stuck(
            self._sdo, self._monitor, status, word, wanted, mode, tells_voltage=tells_voltage
        )

    def await_standstill(
        self,
        count_rad: float | None,
        patience_s: float = STANDSTILL_S,
        until: Callable[[], bool] | None = None,
        slowing: Slowing | None = None,
    ) -> bool:
        """Let time pass until the position, by PDO or SDO, hardly changes, or only trembles; False after so much of the
        drive's time, or `until` then. With `slowing` it is waited for longer, as long as the axis is under power and
        slows down.

        `count_rad`: what one count of the position is worth; None where nobody knows. Raises DriveError where the drive
        does not show it.
        """
        tolerance, clock = 1.0 if count_rad is None else _STILL_RAD / abs(count_rad), self._monitor.clock
        # steps in which the slowest that counts as turning goes on by a count: of a coarse one, fewer show nothing
        shows = min(math.ceil(1 / tolerance), round(patience_s / 2 / _STEP_S))
        self._pause(0.0)
        elapsed, still, last = 0.0, 0, self.position()
        recent: deque[float] = deque(maxlen=max(_TREMBLES, shows))
        trembles = max(max(_TREMBLES, shows) * tolerance, 1.0)
        while still < max(_STILL_STEPS, shows):
            recent.append(last)
            if len(recent) == recent.maxlen and max(recent) - min(recent) <= trembles:
                return True
            slows = slowing is not None and slowing.look(elapsed, last)
            if elapsed >= patience_s and not (slows and self._braking()):
                return False
            began = clock.now()
            self._pause(_STEP_S)
            if until is not None and until():
                return False
            by_pdo = self.cyclic is not None and self.cyclic.answering
            elapsed += _STEP_S if by_pdo else clock.now() - began
            now = self.position()
            still = still + 1 if abs(now - last) <= tolerance else 0
            last = now
        return True

    def _braking(self) -> bool:
        return self.state() not in (*cia402.OFF, State.READY, State.SWITCHED_ON)

    def wait(self, duration_s: float) -> None:
        """Let time pass, also for a drive whose time is SYNC."""
        end = self._monitor.clock.now() + duration_s
        while self._monitor.clock.now() < end:
            self._pause(_STEP_S)

    def _pause(self, duration_s: float) -> None:
        if self.cyclic is not None:
            self.cyclic.pump(duration_s)
        else:
            self._monitor.clock.sleep(duration_s)
