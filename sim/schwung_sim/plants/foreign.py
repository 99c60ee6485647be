"""Physics that no list of effects has: for sealed tests of a tool that should say when it knows no name.

Only the two-mass plant has it, and no command line offers it. Each effect keeps a state of its own, advanced once in
a sub-step, and what it exerts is held over the sub-step.

    dahl_presliding       motor friction that builds up over an angle: dF/dt = σ ω (1 − F sgn(ω)/F_c)
    hysteretic_coupling   Bouc-Wen beside the spring: dz/dt = κ Δω (1 − ½ |z/Z|² (1 + sgn(z Δω)))
    payload_slosh         a mass that swings on the load, stiffer the faster it turns: k_s + J_s c ω_l²
    torque_ripple         ripple locked to the motor angle and in proportion to the torque
    thermal_fade          torque constant that falls as T² heats the motor, and recovers, within a run
    angle_damping         viscous friction of the load that depends on its angle
    mesh_stiffness        coupling stiffness that depends on the motor angle
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np

from schwung_sim.compiled import compiled
from schwung_sim.errors import BenchError

#: Every foreign effect and its keys; each key's number goes to the PARAMETERS field named beside it.
FOREIGN: Mapping[str, Mapping[str, str]] = {
    "dahl_presliding": {"torque_nm": "dahl_torque_nm", "stiffness_nm_rad": "dahl_stiffness_nm_rad"},
    "hysteretic_coupling": {"torque_nm": "wen_torque_nm", "stiffness_nm_rad": "wen_stiffness_nm_rad"},
    "payload_slosh": {
        "inertia_kgm2": "slosh_inertia_kgm2", "stiffness_nm_rad": "slosh_stiffness_nm_rad",
        "damping_nms": "slosh_damping_nms", "speed_share": "slosh_speed_share",
    },
    "torque_ripple": {"share": "ripple_share", "order": "ripple_order", "phase_rad": "ripple_phase_rad"},
    "thermal_fade": {"loss": "fade_loss", "time_constant_s": "fade_time_s", "torque_nm": "fade_torque_nm"},
    "angle_damping": {
        "coefficient_nms": "angle_damping_nms", "order": "angle_damping_order", "phase_rad": "angle_damping_phase_rad",
    },
    "mesh_stiffness": {"share": "mesh_share", "order": "mesh_order", "phase_rad": "mesh_phase_rad"},
}  # fmt: skip

#: Fields of PARAMETERS and STATE that only foreign effects use; `foreign` is 1 where any is on.
PARAMETER_FIELDS = ("foreign", *(field for keys in FOREIGN.values() for field in keys.values()))
STATE_FIELDS = ("dahl_nm", "wen_nm", "slosh_rad", "slosh_rad_s", "fade_heat")


def apply_foreign(parameters: Any, effects: Mapping[str, Mapping[str, float]]) -> None:
    """Write foreign effects into a PARAMETERS record (1,). Raises BenchError for names that do not exist."""
    for name, values in effects.items():
        if name not in FOREIGN or set(values) != set(FOREIGN[name]):
            raise BenchError("foreign effect", f"{name} with {', '.join(values)} does not exist")
        parameters["foreign"] = 1.0
        for key, value in values.items():
            parameters[FOREIGN[name][key]] = value


@compiled
def faded_torque(p: Any, s: Any, torque_nm: float, duration_s: float) -> Any:
    """What reaches the shaft of the motor's torque: less as it heats, and with a ripple of its own size."""
    if p.fade_loss != 0.0:
        wanted = (torque_nm / p.fade_torque_nm) ** 2
        s.fade_heat += (wanted - s.fade_heat) * duration_s / p.fade_time_s
        torque_nm *= 1.0 - min(p.fade_loss * s.fade_heat, 0.9)
    if p.ripple_share != 0.0:
        torque_nm *= 1.0 + p.ripple_share * np.sin(p.ripple_order * s.motor_rad + p.ripple_phase_rad)
    return torque_nm


@compiled
def presliding_torque(p: Any, s: Any, duration_s: float) -> Any:
    """Dahl friction on the motor shaft."""
    if p.dahl_torque_nm == 0.0:
        return 0.0
    slope = 1.0 - s.dahl_nm * np.sign(s.motor_rad_s) / p.dahl_torque_nm
    s.dahl_nm += p.dahl_stiffness_nm_rad * slope * s.motor_rad_s * duration_s
    return -s.dahl_nm


@compiled
def hidden_coupling_torque(p: Any, s: Any, duration_s: float) -> Any:
    """What the coupling takes from the motor and gives to the load beside its spring and damper."""
    torque = 0.0
    if p.mesh_share != 0.0:
        share = p.mesh_share * np.sin(p.mesh_order * s.motor_rad + p.mesh_phase_rad)
        torque += share * p.stiffness_nm_rad * (s.motor_rad - s.load_rad)
    if p.wen_torque_nm != 0.0:
        rate = s.motor_rad_s - s.load_rad_s
        yielded = 0.5 * (s.wen_nm / p.wen_torque_nm) ** 2 * (1.0 + np.sign(s.wen_nm * rate))
        s.wen_nm += p.wen_stiffness_nm_rad * rate * (1.0 - yielded) * duration_s
        torque += s.wen_nm
    return torque


@compiled
def hidden_load_torque(p: Any, s: Any, duration_s: float) -> Any:
    """Torque on the load: what swings on it, and friction that depends on its angle."""
    torque = 0.0
    if p.slosh_inertia_kgm2 != 0.0:
        stiffness = p.slosh_stiffness_nm_rad + p.slosh_inertia_kgm2 * p.slosh_speed_share * s.load_rad_s**2
        torque = stiffness * (s.slosh_rad - s.load_rad) + p.slosh_damping_nms * (s.slosh_rad_s - s.load_rad_s)
        s.slosh_rad_s -= torque / p.slosh_inertia_kgm2 * duration_s
        s.slosh_rad += s.slosh_rad_s * duration_s
    if p.angle_damping_nms != 0.0:
        share = 0.5 * (1.0 + np.cos(p.angle_damping_order * s.load_rad + p.angle_damping_phase_rad))
        torque -= p.angle_damping_nms * share * s.load_rad_s
    return torque
