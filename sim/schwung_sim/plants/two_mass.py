"""The two-mass machine of method.md with every concealed effect, integrated by one compiled kernel.

    T_m − C − b_r ω_r = J_r dω_r/dt
    T_l + C − b_l ω_l = J_l(θ_l) dω_l/dt + ½ J_l'(θ_l) ω_l²          C = b (ω_r − ω_l) + k (θ_r − θ_l)

Runge-Kutta of fourth order, four sub-steps in each control tick of 125 µs. Dry friction is real: it holds the
shaft until the other torques exceed it, and a sub-step in which the shaft would turn back ends at rest.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np

from schwung_sim.compiled import compiled
from schwung_sim.errors import BenchError
from schwung_sim.plants.concealed import Concealed, Scale
from schwung_sim.plants.effects import (
    PARAMETERS,
    STATE,
    coupling_torque,
    dry_friction,
    load_disturbance,
    load_inertia,
    motor_disturbance,
    rest_on_reversal,
    sliding_direction,
    speed_friction,
    third_mass_torque,
    true_torque,
)
from schwung_sim.plants.foreign import (
    apply_foreign,
    faded_torque,
    hidden_coupling_torque,
    hidden_load_torque,
    presliding_torque,
)
from schwung_sim.plants.profile import PROFILES, Array, Profile, ProfileName, Samples

#: The drive's control tick (s): torque is held over it.
TICK_S = 125e-6
_SUBSTEPS = 4
_DIVERGED_RAD_S = 1e5


@dataclass(frozen=True)
class TwoMassMachine:
    """Table 1 of the paper (doi 10.1007/s44245-024-00036-9); SI."""

    rotor_inertia_kgm2: float = 0.012
    rotor_viscous_nms: float = 0.2
    stiffness_nm_rad: float = 24963.0
    damping_nms: float = 8.62
    load_viscous_nms: float = 0.1
    peak_torque_nm: float = 233.0


class Tables(NamedTuple):
    """What depends on the load angle: inertia (kg·m²) and load torque (N·m)."""

    inertia: Samples
    load_torque: Samples


@compiled
def _accelerations(p: Any, s: Any, tables: Any, held: Any, at: Any) -> Any:
    """Angular accelerations (rad/s²) of motor, load and third mass.

    `held` over the sub-step: motor torque, sliding direction, foreign torque on the load. `at`: seconds into it,
    angle and speed of each.
    """
    torque, direction, on_load = held
    later, motor, motor_speed, angle, speed, third, third_speed = at
    shaft = coupling_torque(p, motor - angle, motor_speed - speed)
    motor_acceleration = 0.0
    if direction != 0.0:
        motor_torque = torque - shaft + speed_friction(p, motor_speed)
        motor_torque += motor_disturbance(p, s.time_s + later, motor)
        motor_torque -= direction * dry_friction(p, s, motor, motor_speed, direction)
        motor_acceleration = motor_torque / p.rotor_inertia_kgm2
    third_shaft = 0.0
    third_acceleration = 0.0
    if p.third_inertia_kgm2 > 0.0:
        third_shaft = third_mass_torque(p, angle - third, speed - third_speed)
        third_acceleration = third_shaft / p.third_inertia_kgm2
    j, j_slope = load_inertia(p, tables.inertia, angle)
    load_torque = shaft - third_shaft - p.load_viscous_nms * speed - 0.5 * j_slope * speed**2
    load_torque += load_disturbance(p, tables.load_torque, s.motion_time_s + later, angle) + on_load
    return motor_acceleration, load_torque / j, third_acceleration


@compiled
def _substep(p: Any, s: Any, tables: Any, command_nm: float) -> None:
    """One Runge-Kutta step; a, b, c, d are its four points, x angles, v speeds, k accelerations."""
    h = p.substep_s
    g = 0.5 * h
    torque = true_torque(p, s, command_nm, h)
    on_load = 0.0
    if p.foreign != 0.0:
        hidden = hidden_coupling_torque(p, s, h)
        on_load = hidden + hidden_load_torque(p, s, h)
        torque = faded_torque(p, s, torque, h) - hidden + presliding_torque(p, s, h)
    x0, v0, x1, v1, x2, v2 = s.motor_rad, s.motor_rad_s, s.load_rad, s.load_rad_s, s.third_rad, s.third_rad_s
    others = torque - coupling_torque(p, x0 - x1, v0 - v1) + motor_disturbance(p, s.time_s, x0)
    direction = sliding_direction(p, s, x0, v0, others)
    held = (torque, direction, on_load)
    ka0, ka1, ka2 = _accelerations(p, s, tables, held, (0.0, x0, v0, x1, v1, x2, v2))
    vb0, vb1, vb2 = v0 + g * ka0, v1 + g * ka1, v2 + g * ka2
    b = (g, x0 + g * v0, vb0, x1 + g * v1, vb1, x2 + g * v2, vb2)
    kb0, kb1, kb2 = _accelerations(p, s, tables, held, b)
    vc0, vc1, vc2 = v0 + g * kb0, v1 + g * kb1, v2 + g * kb2
    c = (g, x0 + g * vb0, vc0, x1 + g * vb1, vc1, x2 + g * vb2, vc2)
    kc0, kc1, kc2 = _accelerations(p, s, tables, held, c)
    vd0, vd1, vd2 = v0 + h * kc0, v1 + h * kc1, v2 + h * kc2
    d = (h, x0 + h * vc0, vd0, x1 + h * vc1, vd1, x2 + h * vc2, vd2)
    kd0, kd1, kd2 = _accelerations(p, s, tables, held, d)
    w = h / 6.0
    s.motor_rad = x0 + w * (v0 + 2 * vb0 + 2 * vc0 + vd0)
    s.load_rad = x1 + w * (v1 + 2 * vb1 + 2 * vc1 + vd1)
    s.third_rad = x2 + w * (v2 + 2 * vb2 + 2 * vc2 + vd2)
    s.motor_rad_s = rest_on_reversal(p, s, v0 + w * (ka0 + 2 * kb0 + 2 * kc0 + kd0), direction)
    s.load_rad_s = v1 + w * (ka1 + 2 * kb1 + 2 * kc1 + kd1)
    s.third_rad_s = v2 + w * (ka2 + 2 * kb2 + 2 * kc2 + kd2)
    s.time_s += h
    if s.motion_time_s >= 0.0:
        s.motion_time_s += h


@compiled
def two_mass_tick(p: Any, s: Any, tables: Any, command_nm: float) -> None:
    """One control tick with the commanded torque held."""
    for _ in range(p.substeps):
        _substep(p, s, tables, command_nm)


@compiled
def _one_tick(ps: Any, ss: Any, tables: Any, command_nm: float) -> None:
    two_mass_tick(ps[0], ss[0], tables, command_nm)


class TwoMassPlant:
    """Motor, coupling and a load whose inertia depends on its angle; starts at rest at angle 0."""

    name = "two-mass"

    def __init__(
        self,
        machine: TwoMassMachine | None = None,
        inertia: Profile | ProfileName = "slider-crank",
        concealed: Concealed | None = None,
        seed: int = 0,
        foreign: Mapping[str, Mapping[str, float]] | None = None,
    ) -> None:
        self.machine = machine or TwoMassMachine()
        self.inertia = inertia if isinstance(inertia, Profile) else PROFILES[inertia]()
        self.concealed = concealed or Concealed()
        self.parameters = np.zeros(1, PARAMETERS)
        self.state = np.zeros(1, STATE)
        self.state["motion_time_s"] = -1.0
        for field in ("rotor_inertia_kgm2", "rotor_viscous_nms", "stiffness_nm_rad", "damping_nms",
                      "load_viscous_nms"):  # fmt: skip
            self.parameters[field] = getattr(self.machine, field)
        self.parameters["substeps"] = _SUBSTEPS
        self.parameters["substep_s"] = TICK_S / _SUBSTEPS
        apply_foreign(self.parameters, foreign or {})
        load_torque = self.concealed.apply(self.parameters, self.scale, seed)
        self.tables = Tables(self.inertia.samples, load_torque.samples)
        self.sensor = self.concealed.sensor(self.scale)

    @property
    def scale(self) -> Scale:
        """How big things are on this machine, for the concealed effects' defaults."""
        return Scale(
            torque_nm=self.machine.peak_torque_nm,
            stiffness_nm_rad=self.machine.stiffness_nm_rad,
            damping_nms=self.machine.damping_nms,
            inertia_kgm2=float(np.mean(self.inertia.samples.values)),
        )

    @property
    def rotor_inertia_kgm2(self) -> float:
        """J_r."""
        return self.machine.rotor_inertia_kgm2

    @property
    def motor_rad(self) -> float:
        """True motor angle."""
        return float(self.state["motor_rad"][0])

    def step(self, torque_nm: float) -> None:
        """One control tick (125 µs) with this torque commanded."""
        _one_tick(self.parameters, self.state, self.tables, torque_nm)
        self.check()

    def check(self) -> None:
        """Raise BenchError where the integration has diverged."""
        if not abs(self.state["motor_rad_s"][0]) < _DIVERGED_RAD_S:
            raise BenchError(
                "plant two-mass", "has diverged", "Conceal less: smaller torques, softer coupling."
            )

    def begin_motion(self) -> None:
        """A motion starts now: events in it are timed from here, drift counts it."""
        self.state["motion_time_s"] = 0.0
        self.state["motions"] += 1.0

    def true_inertia(self, position_rad: Array) -> Array:
        """J_l (n,) at load angles (n,) as this plant really has it, concealed changes included."""
        p = self.parameters[0]
        plain = self.inertia.at(np.asarray(position_rad, dtype=float) + p["inertia_shift_rad"])
        return np.asarray(p["inertia_scale"] * plain + p["inertia_delta_kgm2"])
