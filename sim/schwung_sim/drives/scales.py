"""What counts mean on the drive's bus, and what the axis shows there: rad and N·m become counts and per mille here.

Units come from profile and dictionary (units.py), the place of zero and a range from 607C and 607B (frame.py).
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from typing import Any, Protocol

from schwung_sim.drives.dictionary import ObjectDictionary, key
from schwung_sim.drives.eds import REALS
from schwung_sim.drives.frame import Frame, read_frame
from schwung_sim.drives.roles import Roles
from schwung_sim.drives.units import ENCODER_COUNTS, read_units, torque_unit, turned

#: A drive whose position unit is coarser than this many counts a turn has a finer encoder below it.
FINE_TURN = 2**16


class Measured(Protocol):
    """What is shown of the axis; SI, motor side."""

    def configure(self, **changes: Any) -> None: ...

    @property
    def position_counts(self) -> int: ...

    @property
    def position_rad(self) -> float: ...

    @property
    def speed_rad_s(self) -> float: ...

    @property
    def torque_nm(self) -> float: ...

    @property
    def torque_demand_nm(self) -> float: ...

    @property
    def demand_rad(self) -> float: ...

    @property
    def following_error_rad(self) -> float: ...


class Scales:
    """Units and frame as the dictionary holds them at the last `load`, and the live quantities in them.

    `torque_bit` and `demand_only` say how this drive understands 607E: see units.turned.
    """

    def __init__(self, dictionary: ObjectDictionary, axis: Measured, roles: Roles) -> None:
        self._dictionary, self._axis, self._roles = dictionary, axis, roles
        self._encoder = 0
        self.torque_bit, self.demand_only = 0, False
        self.frame: Frame | None = None  # None: the bus has the motor's own positions
        self.load()
        self._bind()

    def load(self) -> None:
        """Take over what the dictionary holds."""
        polarity = self._dictionary.number(0x607E)
        units = read_units(self._roles, self.by_key)
        torque_sign = -1 if polarity & self.torque_bit else 1
        self._per_mille = torque_sign * 1000 / units.rated_torque_nm
        self.played_unit_nm = torque_sign * torque_unit(self._roles.host_played, self.by_key)
        units = turned(units, polarity, self.torque_bit, self.demand_only)
        self.frame = read_frame(self._dictionary.number)
        self.units = units = replace(units, zero=0 if self.frame is None else self.frame.zero)
        turn, before = units.counts_per_turn, self._encoder
        fine = turn >= FINE_TURN and abs(turn - round(turn)) < 1e-6
        self._direct = fine and units.position_rad > 0  # a position count is one of the encoder
        self._encoder = round(turn) if fine else ENCODER_COUNTS
        if self._encoder != before:
            self._axis.configure(encoder_counts=self._encoder)

    @property
    def objects(self) -> set[int]:
        """What units and frame are made of."""
        roles = self._roles
        torques = (roles.torque, roles.torque_added, roles.host_played)
        found = {q.rated for q in torques if q is not None} | {key(0x607C), key(0x607E), key(0x60AA)}
        found |= {key(index, n) for index in (0x607B, 0x608F, 0x6091, 0x6092) for n in (1, 2)}
        return found | ({roles.position.resolution} if roles.position.resolution is not None else set())

    def by_key(self, k: int) -> int:
        """A whole number of the dictionary; 0 where it has none."""
        return int(self._dictionary.real(k))

    def position(self) -> float:
        """The position as it is reported."""
        counts = (
            self._axis.position_counts if self._direct else self._axis.position_rad / self.units.position_rad
        )
        return counts if self.frame is None else self.frame.reported(counts)

    def demand_counts(self) -> int:
        """Where the demand is, in counts of the motor."""
        return round(self._axis.demand_rad / self.units.demand_rad)

    def _demand(self) -> float:
        counts = self._axis.demand_rad / self.units.demand_rad
        return counts if self.frame is None else self.frame.reported(counts)

    def _bind(self) -> None:
        axis, roles = self._axis, self._roles
        for index in (0x6062, 0x60FC):
            self.report(index, self._demand)
        self.report(0x606C, lambda: axis.speed_rad_s / self.units.speed_rad_s)
        self.report(0x6074, lambda: axis.torque_demand_nm * self._per_mille)
        self.report(0x6077, lambda: axis.torque_nm * self._per_mille)
        self.report(0x60F4, lambda: axis.following_error_rad / self.units.position_rad)
        self.report(roles.position.object >> 8, self.position, roles.position.object & 0xFF)
        for quantity, value in (
            (roles.speed, lambda: axis.speed_rad_s / self.units.speed_rad_s),
            (roles.torque, lambda: axis.torque_nm / self.units.torque_nm),
        ):
            if quantity is not None:
                self.report(quantity.object >> 8, value, quantity.object & 0xFF)
        if roles.position.object != key(0x6064):
            self.report(0x6064, self.position)

    def report(self, index: int, value: Callable[[], float], subindex: int = 0) -> None:
        """Show a live quantity, where the EDS has the object, as its type holds it."""
        entry = self._dictionary.entries.get(key(index, subindex))
        if entry is None or entry.size is None:
            return
        low, high = entry.span
        if entry.data_type in REALS:
            self._dictionary.readers[entry.key] = value
        else:

            def counts() -> int:
                whole = round(value())
                return int(low if whole < low else high if whole > high else whole)

            self._dictionary.readers[entry.key] = counts
