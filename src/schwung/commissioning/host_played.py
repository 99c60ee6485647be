"""Feed-forward that the host plays: for drives that hold no inertia, but take a torque beside each setpoint.

Nothing is written into the drive. Whoever moves the machine has to play the same torque; here it is played for the
verification.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from schwung.drivetrain import InertiaTable
from schwung.errors import InputError
from schwung.fieldbus.profile import DeviceProfile
from schwung.motion import Array
from schwung.motion.profiles import Demand


@dataclass(frozen=True, eq=False)
class HostPlayed:
    """The torque that a motion needs by the measured inertia."""

    load_inertia: InertiaTable
    motor_inertia_kgm2: float

    def torque(self, demand: Demand, start_rad: float) -> Array:
        """(J_r + J_l(θ*)) α* + ½ J_l'(θ*) ω*² (N·m) for each setpoint, (n,): the mean over the cycle that leads to it.

        A drive that takes a setpoint at SYNC reaches it one cycle later, and holds the torque meanwhile.
        """
        angle = start_rad + demand.position_rad
        inertia = self.motor_inertia_kgm2 + self.load_inertia.at(angle)
        change = self.load_inertia.slope_at(angle)
        needed = inertia * demand.acceleration_rad_s2 + change * demand.speed_rad_s**2 / 2
        return np.asarray((needed + np.concatenate([needed[:1], needed[:-1]])) / 2)


def host_played(
    profile: DeviceProfile, table: InertiaTable, motor_inertia_kgm2: float, mode: str
) -> HostPlayed:
    """The torque to play. Raises InputError where the drive takes none beside its setpoints."""
    remedy = "Use --export table, mean or max, or take the CSV."
    added, target = profile.quantities.torque_added, profile.export.host_played
    if target is None:
        raise InputError(f"profile {profile.family}", profile.reason("host-played feed-forward"), remedy)
    if added is None or target.object != added.object:
        raise InputError(
            f"profile {profile.family}, export.host_played",
            "is another object than quantities.torque_added, the one that is played with the setpoints",
            "Name that one.",
        )
    if mode != "csp":
        raise InputError("--export host", "needs setpoints over the bus", "Use --mode csp.")
    return HostPlayed(table, motor_inertia_kgm2)
