"""The machine as the monitor sees it: the truth, which stands in the hall."""

from __future__ import annotations

from typing import Any, Protocol

from schwung_sim.drives.power import Power

#: A drive whose processor stood finds the targets of now, far from those of then; its own limits see to the way there.
CATCHING_UP_S = 0.3
#: How often it is looked at.
LOOK_S = 0.001


class Machine(Protocol):
    """What is looked at."""

    @property
    def position_rad(self) -> float: ...

    @property
    def speed_rad_s(self) -> float: ...

    @property
    def torque_nm(self) -> float: ...

    @property
    def energised(self) -> bool: ...

    @property
    def operating(self) -> bool:
        """In Operation enabled."""
        ...

    @property
    def stepped_down(self) -> bool:
        """In Ready to switch on or Switched on, where only a command leads from operation (transitions 5 and 8)."""
        ...

    @property
    def mode(self) -> int: ...

    @property
    def count_rad(self) -> float:
        """What one of its position is worth now: of a setting that was never stored, a restart leaves another."""
        ...

    @property
    def deaf_until_s(self) -> float:
        """When its processor, if it stood, heard what had come meanwhile."""
        ...

    @property
    def stands(self) -> bool:
        """Its processor does."""
        ...

    @property
    def excused(self) -> bool:
        """It can neither brake nor react: its processor stands, or its motor gives no torque."""
        ...


class Motor:
    """The motor of a bench, whatever bus its drive is on."""

    def __init__(self, bench: Any) -> None:
        self._servo, self._axis, self._state = bench.servo, bench.axis, bench.plant.state
        self.weak = False  # it gives no torque

    @property
    def position_rad(self) -> float:
        return float(self._state["motor_rad"][0])

    @property
    def speed_rad_s(self) -> float:
        return float(self._state["motor_rad_s"][0])

    @property
    def torque_nm(self) -> float:
        return float(self._axis.torque_demand_nm)


class BenchMachine(Motor):
    """The bench's drive, axis and plant as the monitor sees them."""

    def __init__(self, bench: Any) -> None:
        super().__init__(bench)
        self.held: set[str] = set()  # why it holds the axis, whatever it is told
        self.deaf_until_s = self._caught_up_s = float("-inf")

    @property
    def energised(self) -> bool:
        return bool(self._axis.energised)

    @property
    def operating(self) -> bool:
        return self._servo.power.state is Power.OPERATION_ENABLED

    @property
    def stepped_down(self) -> bool:
        return self._servo.power.state in (Power.READY_TO_SWITCH_ON, Power.SWITCHED_ON)

    @property
    def mode(self) -> int:
        return int(self._servo.operation.mode)

    @property
    def count_rad(self) -> float:
        return float(self._servo.operation.units.demand_rad)

    @property
    def stands(self) -> bool:
        return bool(self._servo.stalled)

    @property
    def excused(self) -> bool:
        now = float(self._axis.time_s)
        if self._servo.stalled:
            self.deaf_until_s = now + LOOK_S
        if self._servo.stalled or self.held:
            self._caught_up_s = now + CATCHING_UP_S
        return self.weak or now < self._caught_up_s
