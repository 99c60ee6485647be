"""The power drive state machine of CiA 402 (IEC 61800-7-201 clause 6), with its option codes.

Pure: it knows the controlword, the option codes and an axis that it can energise, stop and coast. What else keeps a
drive out of operation, or from following, is here too, and off unless somebody asks for it: safe torque off, a holding
brake, local control, reasons of the drive's own.
"""

from __future__ import annotations

from collections.abc import Callable
from enum import Enum
from typing import Protocol

from schwung_sim.drives.brake import BrakedMotor, HoldingBrake
from schwung_sim.drives.dictionary import ObjectDictionary

STOP_MARGIN_S = 1.0  # a stopping ramp that takes so much longer than it should is given up: power off


class Power(Enum):
    """States, by their bits in the statusword (mask 0x6F)."""

    SWITCH_ON_DISABLED = 0x40
    READY_TO_SWITCH_ON = 0x21
    SWITCHED_ON = 0x23
    OPERATION_ENABLED = 0x27
    QUICK_STOP_ACTIVE = 0x07
    FAULT_REACTION_ACTIVE = 0x0F
    FAULT = 0x08


_ENERGISED = (Power.OPERATION_ENABLED, Power.QUICK_STOP_ACTIVE, Power.FAULT_REACTION_ACTIVE)
VOLTAGE_ENABLED, REMOTE = 1 << 4, 1 << 9
HALT = 1 << 8
_HALT = "halt"


class Motor(BrakedMotor, Protocol):
    """What the state machine asks of the axis."""

    def energise(self, on: bool) -> None: ...

    def quick_stop(self, deceleration_rad_s2: float) -> None: ...

    @property
    def standstill(self) -> bool: ...

    @property
    def speed_rad_s(self) -> float: ...


class PowerStage:
    """Follows the controlword; carries out stops to their end.

    `ramp(object)` gives the deceleration (rad/s²) that object 6084 or 6085 holds. `clear_faults` is called at
    fault reset and says whether the cause is gone.
    """

    def __init__(
        self,
        dictionary: ObjectDictionary,
        motor: Motor,
        ramp: Callable[[int], float],
        clear_faults: Callable[[], bool],
    ) -> None:
        self._dictionary, self._motor, self._ramp, self._clear_faults = dictionary, motor, ramp, clear_faults
        self.state = Power.SWITCH_ON_DISABLED
        self.local = False  # the controlword is not processed
        self.awaited: list[Callable[[], bool]] = []  # what needs time to go on: a late controlword, a brake
        self.at_power_off: list[Callable[[], None]] = []
        self._held: set[str] = set()  # why set-points are not followed: halt, or reasons of the drive's own
        self._torque_off: dict[str, Power] = {}  # what allows no torque, and where that leads
        self._brake: HoldingBrake | None = None
        self._releasing = False
        self._word = 0
        self._after_stop: Power | None = None  # where a running stop leads; the same state: it stays there
        self._give_up_s = 0.0
        self._coasting = False

    @property
    def coming_to_rest(self) -> bool:
        """Something is under way that needs no SYNC to go on: a stop, coasting, a brake, a late controlword."""
        if self._after_stop is not None or self._coasting:
            return True
        if not self.awaited:
            return False
        return any(under_way() for under_way in self.awaited)

    @property
    def enabled(self) -> bool:
        """Setpoints are followed: operation enabled, no stop or halt under way, nothing that holds the axis."""
        return self.state is Power.OPERATION_ENABLED and self._after_stop is None and not self._held

    @property
    def halted(self) -> bool:
        """Bit 8 of the controlword holds the axis."""
        return _HALT in self._held

    @property
    def energised(self) -> bool:
        """The motor has power."""
        return self._releasing or self.state in _ENERGISED

    @property
    def status(self) -> int:
        """The statusword's bits that belong to the state machine."""
        status = self.state.value
        if not self._torque_off:
            status |= VOLTAGE_ENABLED
        return status if self.local else status | REMOTE

    # -- The controlword --------------------------------------------------------------------------

    def control(self, word: int) -> None:
        """Follow a controlword (table 31 of the standard)."""
        rising, self._word = word & ~self._word, word
        if self.state is Power.FAULT:
            if rising & 0x80 and Power.FAULT not in self._torque_off.values() and self._clear_faults():
                self.state = Power.SWITCH_ON_DISABLED
            return
        if self.state is Power.FAULT_REACTION_ACTIVE:
            return
        if not word & 0x02:
            self._disable_voltage()
        elif not word & 0x04:
            self._quick_stop_command()
        elif not word & 0x80:
            self._climb(word)
        self._follow_halt(word)

    def _disable_voltage(self) -> None:  # transitions 7, 9, 10, 12
        self._off(Power.SWITCH_ON_DISABLED)

    def _quick_stop_command(self) -> None:  # transitions 7, 10, 11
        if self.state is Power.OPERATION_ENABLED:
            self.quick_stop()
        elif self.state is not Power.QUICK_STOP_ACTIVE:
            self._off(Power.SWITCH_ON_DISABLED)

    def quick_stop(self) -> None:
        """Transition 11, with the reaction of 605A."""
        option = self._dictionary.number(0x605A)
        if option == 0:
            self._off(Power.SWITCH_ON_DISABLED)
            return
        self.state = Power.QUICK_STOP_ACTIVE
        stays = option in (5, 6)
        self._stop(
            self._ramp(0x6084 if option in (1, 5) else 0x6085),
            Power.QUICK_STOP_ACTIVE if stays else Power.SWITCH_ON_DISABLED,
        )

    def _climb(self, word: int) -> None:
        shutdown, switch_on, enable = word & 0x07 == 0x06, word & 0x0F == 0x07, word & 0x0F == 0x0F
        state = self.state
        if state is Power.SWITCH_ON_DISABLED and shutdown:
            if not self._torque_off:
                self.state = Power.READY_TO_SWITCH_ON
        elif state is Power.READY_TO_SWITCH_ON and (switch_on or enable):
            self.state = Power.SWITCHED_ON  # with "enable" set the next transition follows at once (3 + 4)
            self._climb(word)
        elif state is Power.SWITCHED_ON and shutdown:
            self._off(Power.READY_TO_SWITCH_ON)
        elif state is Power.SWITCHED_ON and enable:
            if not self._releasing:
                self._enable()
        elif state is Power.SWITCHED_ON and self._releasing:
            self._off(Power.SWITCHED_ON)
        elif state is Power.OPERATION_ENABLED:
            if shutdown:
                self._leave(0x605B, Power.READY_TO_SWITCH_ON)
            elif switch_on:
                self._leave(0x605C, Power.SWITCHED_ON)
        elif state is Power.QUICK_STOP_ACTIVE and enable and self._dictionary.number(0x605A) in (5, 6):
            self._enable()  # transition 16

    def _enable(self) -> None:
        self._after_stop, self._coasting = None, False
        self._held.discard(_HALT)
        self._motor.energise(True)
        if self._brake is None or self._brake.is_open:
            self.state = Power.OPERATION_ENABLED
        else:
            self._releasing = True
            self._brake.tell(closed=False)

    def _leave(self, option_code: int, target: Power) -> None:
        """Out of operation: at once, or after the slow-down ramp (605B, 605C)."""
        if self._after_stop is target:
            return
        kept = self._brake is not None and self._motor.standstill  # power stays until the brake has closed
        if self._dictionary.number(option_code) == 0 and not kept:
            self._off(target)
        else:
            self._stop(self._ramp(0x6084), target)

    def _follow_halt(self, word: int) -> None:
        halted = bool(word & HALT) and self.state is Power.OPERATION_ENABLED
        if halted and not self.halted:
            self._motor.quick_stop(self._ramp(0x6085 if self._dictionary.number(0x605D) == 2 else 0x6084))
            self._held.add(_HALT)
        elif not halted:
            self._held.discard(_HALT)

    # -- Faults and stops -------------------------------------------------------------------------

    def fault(self) -> None:
        """Transition 13, with the reaction of 605E; 14 follows when it has been carried out."""
        if self.state in (Power.FAULT, Power.FAULT_REACTION_ACTIVE):
            return
        option = self._dictionary.number(0x605E)
        if not self.energised or option == 0:
            self._off(Power.FAULT)
            return
        self.state = Power.FAULT_REACTION_ACTIVE
        self._stop(self._ramp(0x6084 if option == 1 else 0x6085), Power.FAULT)

    def connection_lost(self) -> bool:
        """The reaction of 6007; true where it is a fault, which the caller reports."""
        option = self._dictionary.number(0x6007)
        if self.state not in (Power.FAULT, Power.FAULT_REACTION_ACTIVE):
            if option == 2:
                self._disable_voltage()
            elif option == 3:
                self._quick_stop_command()  # also while a brake still opens: that is not operation yet
        return option == 1 and self.energised

    def power_off(self) -> None:
        """As at power-on: the motor coasts, nothing is remembered."""
        into = self._torque_off.values()
        self._off(Power.FAULT if Power.FAULT in into else Power.SWITCH_ON_DISABLED)
        self._word = 0
        for forget in self.at_power_off:
            forget()

    def poll(self) -> None:
        """Finish what is under way: a brake, a stop that has come to standstill, or that takes too long."""
        if self._brake is not None:
            self._brake.poll()
            if self._releasing and self._brake.is_open:
                self._releasing, self.state = False, Power.OPERATION_ENABLED
        if self._coasting and self._motor.standstill:
            self._coasting = False
        if self._after_stop is None:
            return
        if self._motor.standstill or self._motor.time_s > self._give_up_s:
            self._at_rest(self._after_stop)

    def _at_rest(self, target: Power) -> None:
        if target is Power.QUICK_STOP_ACTIVE:
            self._after_stop = None
        elif self._brake is not None and not self._brake.closed:
            self._brake.tell(closed=True)
        else:
            self._off(target)

    def _stop(self, deceleration_rad_s2: float, then: Power) -> None:
        self._motor.quick_stop(deceleration_rad_s2)
        self._after_stop = then
        duration_s = abs(self._motor.speed_rad_s) / deceleration_rad_s2
        self._give_up_s = self._motor.time_s + duration_s + STOP_MARGIN_S

    def _off(self, target: Power) -> None:
        if self.energised:
            self._motor.energise(False)
            self._coasting = True
            if self._brake is not None:
                self._brake.tell(closed=True)
        self._after_stop, self._releasing = None, False
        self._held.discard(_HALT)
        self.state = target

    # -- What keeps it from operation -------------------------------------------------------------

    def take_torque(self, by: str, into: Power) -> None:
        """Safe torque off (IEC 61800-5-2 4.2.3.2), or an enable input: no torque from now on, whatever the option codes
        say.

        It leads into Switch on disabled (transitions 7, 9, 10, 12: the high-level power is gone), or into Fault,
        which is not reset before torque is allowed again.
        """
        self._torque_off[by] = into
        self._off(Power.FAULT if self.state in (Power.FAULT, Power.FAULT_REACTION_ACTIVE) else into)

    def give_torque(self, by: str) -> None:
        """By this, torque is allowed again; nothing energises by itself."""
        self._torque_off.pop(by, None)

    def fit_brake(self, delay_s: float) -> None:
        """Give the motor a holding brake that takes so long to open, and to close."""
        self._brake = brake = HoldingBrake(self._motor, delay_s, closed=not self.energised)
        self.awaited.append(lambda: brake.moving)

    def hold(self, reason: str) -> None:
        """From now on the axis does not follow: it comes to rest on the quick-stop ramp and is held there."""
        if self.enabled:
            self._motor.quick_stop(self._ramp(0x6085))
        self._held.add(reason)

    def release(self, reason: str) -> None:
        """This reason to hold is gone."""
        self._held.discard(reason)
