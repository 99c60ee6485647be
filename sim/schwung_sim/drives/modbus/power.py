"""The CiA 402 state machine of the Modbus drive: its controlword switches it, its watchdog and its faults stop it."""

from __future__ import annotations

from enum import Enum

from schwung_sim.drives.axis import ServoAxis


class State(Enum):
    """States, by their bits in the statusword (mask 0x6F)."""

    SWITCH_ON_DISABLED = 0x40
    READY = 0x21
    SWITCHED_ON = 0x23
    ENABLED = 0x27
    QUICK_STOP = 0x07
    FAULT_REACTION = 0x0F
    FAULT = 0x08


ENERGISED = (State.ENABLED, State.QUICK_STOP, State.FAULT_REACTION)
_VOLTAGE_AND_REMOTE = 0x0210
STOP_TIME_S = 2.0  # a stop that takes longer is given up: power off


class PowerStage:
    """Follows the controlword; quick stop keeps the axis held, a fault lets go of it once it stands."""

    def __init__(self, axis: ServoAxis) -> None:
        self._axis = axis
        self.state = State.SWITCH_ON_DISABLED
        self.error = 0
        self.stop_rate_rad_s2 = 1000.0
        self._word = 0
        self._give_up_s = 0.0

    @property
    def status(self) -> int:
        """Statusword without the bits of the mode."""
        return self.state.value | _VOLTAGE_AND_REMOTE

    @property
    def energised(self) -> bool:
        """The power stage is on."""
        return self.state in ENERGISED

    def control(self, word: int) -> int:
        """Follow a controlword; returns the bits that have risen."""
        rising, self._word = word & ~self._word, word
        if self.state is State.FAULT:
            if rising & 0x80:
                self.state, self.error = State.SWITCH_ON_DISABLED, 0
        elif self.state is not State.FAULT_REACTION:
            if not word & 0x02:
                self._off(State.SWITCH_ON_DISABLED)
            elif not word & 0x04:
                self._quick_stop()
            else:
                self._climb(word & 0x0F)
        return rising

    def _climb(self, low: int) -> None:
        if self.state is State.SWITCH_ON_DISABLED and low == 0x06:
            self.state = State.READY
        elif self.state is State.READY and low in (0x07, 0x0F):
            self.state = State.SWITCHED_ON
        elif self.state is State.SWITCHED_ON and low == 0x0F:
            self.state = State.ENABLED
            self._axis.energise(True)
        elif self.state in (State.SWITCHED_ON, State.ENABLED) and low in (0x06, 0x07):
            self._off(State.READY if low == 0x06 else State.SWITCHED_ON)

    def _quick_stop(self) -> None:
        if self.state is State.ENABLED:
            self._stop(State.QUICK_STOP)
        elif self.state is not State.QUICK_STOP:
            self.state = State.SWITCH_ON_DISABLED

    def fail(self, error: int) -> None:
        """A fault: stop, then power off."""
        if self.state in (State.FAULT, State.FAULT_REACTION):
            return
        self.error = error
        if self.energised:
            self._stop(State.FAULT_REACTION)
        else:
            self.state = State.FAULT

    def poll(self) -> None:
        """End a fault's stop at standstill."""
        stands = self._axis.standstill or self._axis.time_s > self._give_up_s
        if self.state is State.FAULT_REACTION and stands:
            self._off(State.FAULT)

    def _stop(self, into: State) -> None:
        self.state = into
        self._give_up_s = self._axis.time_s + STOP_TIME_S
        self._axis.quick_stop(self.stop_rate_rad_s2)

    def _off(self, into: State) -> None:
        if self.energised:
            self._axis.energise(False)
        self.state = into
