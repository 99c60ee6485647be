"""The machine as equations that Modelica and MATLAB write alike: only what this machine has, one line for each torque.

Names are those of the parameters and states; both languages know + − * / ^, abs, exp, max, min, sin, cos, tanh. The
helpers `curve_value`, `plane_value`, `curve_slope`, `bump`, `sided`, `push`, `nearest` each language has to bring (or
be without).
Equations: method.md (1), (A7), as in `drivetrain/learned.py`.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from schwung.drivetrain.effects import Effects
from schwung.simulators.exported import NO_LIMIT_NM, Exported, Parameter

#: Terms that need several fields: where the first is neutral, the others are of no account.
_GROUPS = (
    ("stribeck_rise_nm", "stribeck_speed_rad_s", "stribeck_exponent"),
    ("local_friction_nm", "local_centre_rad", "local_width_rad", "local_sharpness"),
    ("drift_nm", "drift_settling", "session_share"),
    ("viscous_drift_nms", "session_share"),
    ("offset_drift_nm", "session_share"),
    ("torque_drop", "torque_drop_at_nm", "torque_drop_order"),
    ("torque_fade", "torque_fade_at_nm", "torque_fade_s", "torque_fade_start"),
    ("ripple_share", "ripple_order", "ripple_phase_rad"),
    ("torque_filter_s",),
    ("stiffness_share", "stiffness_order", "stiffness_phase_rad"),
    ("kinematic_rad", "kinematic_order", "kinematic_phase_rad"),
    ("kinematic_second_rad", "kinematic_order", "kinematic_second_phase_rad"),
    ("load_amplitude_nm", "load_phase_rad"),
    ("end_high_nm_rad", "end_high_rad"),
    ("end_low_nm_rad", "end_low_rad"),
    ("event_peak_nm", "event_time_s", "event_duration_s", "event_sharpness", "motion_start_s"),
    ("periodic_amplitude_nm", "periodic_frequency_hz", "periodic_phase_rad"),
    ("cogging_amplitude_nm", "cogging_order", "cogging_phase_rad"),
    ("cogging_second_nm", "cogging_order", "cogging_second_phase_rad"),
    ("eccentricity_rad", "eccentricity_phase_rad"),
    ("harmonic_rad", "harmonic_order", "harmonic_phase_rad"),
    ("presliding_nm", "presliding_stiffness_nm_rad"),
    ("hysteresis_nm", "hysteresis_stiffness_nm_rad", "hysteresis_exponent"),
    ("third_inertia_kgm2", "third_stiffness_nm_rad", "third_damping_nms"),
    ("third_speed_share",),
)


@dataclass(frozen=True)
class Equation:
    """`name` = `expression`; where `derivative`, it is the name's rate."""

    name: str
    expression: str
    comment: str = ""
    derivative: bool = False


@dataclass(frozen=True)
class Equations:
    """A machine in lines, each of which needs only what is above it; states with their values at first."""

    parameters: tuple[Parameter, ...]
    states: tuple[str, ...]
    lines: tuple[Equation, ...]
    read_angle: str
    read_speed: str
    delayed: bool  # the drive reads the speed later, by speed_delay_s
    dry: bool


def equations(told: Exported) -> Equations:
    """The equations of one machine."""
    e = told.effects
    here = _present(told)
    states = ["motor_angle", "motor_speed"]
    states += [] if told.rigid else ["load_angle", "load_speed"]
    states += ["third_angle", "third_speed"] if "third_inertia_kgm2" in here else []
    states += ["bristles"] if "presliding_nm" in here else []
    states += ["yielding"] if "hysteresis_nm" in here else []
    states += ["heat"] if "torque_fade" in here else []
    states += ["acting"] if "torque_lag_s" in here else []
    dry = _dry(here)
    lines = [
        *_shaft_torque(here),
        *_fading(here),
        *(
            [Equation("load_angle", "motor_angle"), Equation("load_speed", "motor_speed")]
            if told.rigid
            else []
        ),
        *([Equation("dry", f"max({dry}, 0)", "dry friction's level, N.m")] if dry else []),
        Equation("friction", _friction(here, bool(dry)), "of the motor, N.m"),
        *_ways(told, here),
        *_ripple(told, here),
        Equation("inertia", _inertia(told, here, "value"), "of the load at its angle, kg.m2"),
        Equation("inertia_slope", _inertia(told, here, "slope"), "kg.m2/rad"),
        Equation("outside", _outside(told, here), "what acts on the load, N.m"),
        *_bristles(here),
        *_third(here),
        *_moving(told, here, e),
    ]
    read_angle, read_speed = _read(here)
    return Equations(
        parameters=tuple(one for one in told.parameters if one.name in here),
        states=tuple(states),
        lines=tuple(lines),
        read_angle=read_angle,
        read_speed=read_speed,
        delayed="speed_delay_s" in here,
        dry=bool(dry),
    )


def _read(here: frozenset[str]) -> tuple[str, str]:
    """Angle and speed as the drive reads them."""
    angle, share = "motor_angle", "1"
    if "eccentricity_rad" in here:
        turned = "motor_angle + eccentricity_phase_rad"
        angle, share = (
            f"{angle} + eccentricity_rad*sin({turned})",
            f"{share} + eccentricity_rad*cos({turned})",
        )
    if "harmonic_rad" in here:
        turned = "harmonic_order*motor_angle + harmonic_phase_rad"
        angle = f"{angle} + harmonic_rad*sin({turned})"
        share = f"{share} + harmonic_rad*harmonic_order*cos({turned})"
    return angle, "motor_speed" if share == "1" else f"motor_speed*({share})"


def _present(told: Exported) -> frozenset[str]:
    """Names of the parameters that do something."""
    e, neutral = told.effects, Effects()
    grouped = {name for group in _GROUPS for name in group}
    here = {
        name for name in Effects._fields if name not in grouped and getattr(e, name) != getattr(neutral, name)
    }
    if e.torque_limit_nm >= NO_LIMIT_NM:
        here -= {"torque_limit_nm"}
    for group in _GROUPS:
        if getattr(e, group[0]) != 0:
            here |= set(group)
    here -= {"torque_filter_s", "torque_fade_start"}  # of the report alone, and of a state at first
    here |= (
        {"session_share"} if told.has("residual_run_forward") or told.has("residual_run_backward") else set()
    )
    timed = ("residual_time_in_motion", "residual_torque_time_in_motion_plane")
    here |= {"motion_start_s"} if any(told.has(table) for table in timed) else set()
    here |= {"motor_inertia_kgm2", "motor_viscous_friction_nms", "load_viscous_friction_nms"}
    if not told.rigid:
        here |= {"coupling_stiffness_nm_rad", "coupling_damping_nms"}
    if told.value("load_torque_nm") != 0:
        here |= {"load_torque_nm"}
    if _dry(frozenset(here)) or _gated(told) or {"carried_share", "load_coulomb_nm"} & here:
        here |= {"smoothing_rad_s"}
    return frozenset(here)


_GATED = ("position", "speed", "torque", "run", "load_position")


def _gated(told: Exported) -> list[str]:
    """Coordinates of the learned tables that ask for the direction of motion."""
    return [
        over
        for over in _GATED
        if told.has(f"residual_{over}_forward") or told.has(f"residual_{over}_backward")
    ]


def _sided(over: str, where: str, way: str) -> str:
    forward, backward = f"residual_{over}_forward_rows", f"residual_{over}_backward_rows"
    return f"curve_value({forward}, {where})*max({way}, 0) + curve_value({backward}, {where})*max(-{way}, 0)"


def _shaft_torque(here: frozenset[str]) -> list[Equation]:
    wanted = "torque_gain*torque" if "torque_gain" in here else "torque"
    if "torque_drop" in here:
        wanted += " - torque_drop*(abs(torque)/torque_drop_at_nm)^torque_drop_order*torque"
    if "torque_limit_nm" in here:
        wanted = f"min(max({wanted}, -torque_limit_nm), torque_limit_nm)"
    if "torque_lag_s" not in here:
        return [Equation("acting", wanted, "torque on the shaft, N.m")]
    lag = Equation("acting", "(wanted - acting)/torque_lag_s", "torque on the shaft, N.m", derivative=True)
    return [Equation("wanted", wanted, "N.m"), lag]


def _fading(here: frozenset[str]) -> list[Equation]:
    if "torque_fade" not in here:
        return []
    return [
        Equation(
            "heat",
            "((acting/torque_fade_at_nm)^2 - heat)/torque_fade_s",
            "of the motor, 1 where the peak torque lasts",
            derivative=True,
        ),
        Equation("driving", "acting*(1 - min(torque_fade*heat, 1))", "what that leaves, N.m"),
    ]


def _driving(here: frozenset[str]) -> str:
    """What turns the motor."""
    return "driving" if "torque_fade" in here else "acting"


def _dry(here: frozenset[str]) -> str:
    parts = []
    sides = [name if name in here else "0" for name in ("coulomb_positive_nm", "coulomb_negative_nm")]
    if sides != ["0", "0"]:
        parts.append(f"sided(motor_speed, {sides[0]}, {sides[1]})")
    if "stribeck_rise_nm" in here:
        parts.append("stribeck_rise_nm*exp(-(abs(motor_speed)/stribeck_speed_rad_s)^stribeck_exponent)")
    if "local_friction_nm" in here:
        away = "away_from(motor_angle, local_centre_rad)"
        parts.append(f"local_friction_nm*bump(0.5 + {away}/local_width_rad, local_sharpness)")
    if "drift_nm" in here:
        parts.append("drift_nm*drifted(session_share, drift_settling)")
    return " + ".join(parts)


def _friction(here: frozenset[str], dry: bool) -> str:
    viscous = ["motor_viscous_friction_nms", *(["viscous_nms"] if "viscous_nms" in here else [])]
    viscous += ["session_share*viscous_drift_nms"] if "viscous_drift_nms" in here else []
    viscous += ["drag_nms2*abs(motor_speed)"] if "drag_nms2" in here else []
    text = f"({' + '.join(viscous)})*motor_speed" if len(viscous) > 1 else f"{viscous[0]}*motor_speed"
    if "viscous_difference_nms" in here:
        text += " + 0.5*viscous_difference_nms*abs(motor_speed)"
    return text + (" + dry*tanh(motor_speed/smoothing_rad_s)" if dry else "")


def _ways(told: Exported, here: frozenset[str]) -> list[Equation]:
    """Directions of motion, where they are asked for."""
    gated = _gated(told)
    lines = []
    if "carried_share" in here or set(gated) - {"load_position"}:
        lines.append(Equation("way", "tanh(motor_speed/smoothing_rad_s)", "direction of the motor, -1 to 1"))
    if "load_coulomb_nm" in here or "load_position" in gated:
        lines.append(Equation("load_way", "tanh(load_speed/smoothing_rad_s)", "direction of the load"))
    return lines


def _ripple(told: Exported, here: frozenset[str]) -> list[Equation]:
    parts = ["offset_nm"] if "offset_nm" in here else []
    parts += ["session_share*offset_drift_nm"] if "offset_drift_nm" in here else []
    if "ripple_share" in here:
        parts.append(f"{_driving(here)}*ripple_share*sin(ripple_order*motor_angle + ripple_phase_rad)")
    where = {
        "position": "motor_angle",
        "speed": "abs(motor_speed)",
        "torque": "abs(acting)",
        "run": "session_share",
    }
    parts += [_sided(over, where[over], "way") for over in _gated(told) if over in where]
    if told.has("residual_position_torque_plane"):
        parts.append("plane_value(residual_position_torque_plane, motor_angle, acting)")
    if told.has("residual_torque_time_in_motion_plane"):
        parts.append("plane_value(residual_torque_time_in_motion_plane, acting, time - motion_start_s)")
    if "cogging_amplitude_nm" in here:
        parts.append("cogging_amplitude_nm*sin(cogging_order*motor_angle + cogging_phase_rad)")
    if "cogging_second_nm" in here:
        parts.append("cogging_second_nm*sin(2*cogging_order*motor_angle + cogging_second_phase_rad)")
    if "periodic_amplitude_nm" in here:
        turned = "6.283185307179586*periodic_frequency_hz*time"
        parts.append(f"periodic_amplitude_nm*sin({turned} + periodic_phase_rad)")
    return [Equation("ripple", " + ".join(parts), "what else acts on the motor, N.m")] if parts else []


def _inertia(told: Exported, here: frozenset[str], what: str) -> str:
    at = "load_angle + inertia_shift_rad" if "inertia_shift_rad" in here else "load_angle"
    text = f"curve_{what}(inertia_rows, {at})"
    if "inertia_scale" in here:
        text = f"inertia_scale*{text}"
    if told.has("inertia_added"):
        text += f" + curve_{what}(inertia_added_rows, load_angle)"
    return f"{text} + inertia_delta_kgm2" if what == "value" and "inertia_delta_kgm2" in here else text


def _outside(told: Exported, here: frozenset[str]) -> str:
    parts = ["load_torque_nm"] if "load_torque_nm" in here else []
    if np.any(told.load_torque[:, 1]):
        parts.append("curve_value(load_torque_rows, load_angle)")
    if np.any(told.learned_load_torque[:, 1]):
        parts.append("curve_value(learned_load_torque_rows, load_angle)")
    if "load_amplitude_nm" in here:
        parts.append("load_amplitude_nm*sin(load_angle + load_phase_rad)")
    if "end_low_nm_rad" in here:
        parts.append("end_low_nm_rad*max(end_low_rad - load_angle, 0)")
    if "event_peak_nm" in here:
        since = "(time - motion_start_s - event_time_s)/event_duration_s"
        parts.append(f"event_peak_nm*bump({since}, event_sharpness)")
    if told.has("residual_time_in_motion"):
        parts.append("curve_value(residual_time_in_motion_rows, time - motion_start_s)")
    if "load_position" in _gated(told):
        parts.append(_sided("load_position", "load_angle", "load_way"))
    if told.has("residual_position_speed_plane"):
        parts.append("plane_value(residual_position_speed_plane, load_angle, load_speed)")
    resisted = " - load_coulomb_nm*load_way" if "load_coulomb_nm" in here else ""
    resisted += " - load_viscous_nms*load_speed" if "load_viscous_nms" in here else ""
    resisted += " - load_drag_nms2*abs(load_speed)*load_speed" if "load_drag_nms2" in here else ""
    resisted += " - end_high_nm_rad*max(load_angle - end_high_rad, 0)" if "end_high_nm_rad" in here else ""
    return (" + ".join(parts) or "0") + resisted


def _bristles(here: frozenset[str]) -> list[Equation]:
    if "presliding_nm" not in here:
        return []
    bending = "presliding_stiffness_nm_rad*(motor_speed - abs(motor_speed)*bristles/presliding_nm)"
    return [Equation("bristles", bending, "friction that is a spring before it slides, N.m", derivative=True)]


def _third(here: frozenset[str]) -> list[Equation]:
    if "third_inertia_kgm2" not in here:
        return []
    stiffness = "third_stiffness_nm_rad"
    if "third_speed_share" in here:
        stiffness = "(third_stiffness_nm_rad + third_inertia_kgm2*third_speed_share*load_speed^2)"
    passed = f"{stiffness}*(load_angle - third_angle) + third_damping_nms*(load_speed - third_speed)"
    return [
        Equation("passed", passed, "to a third mass behind the load, N.m"),
        Equation("third_angle", "third_speed", derivative=True),
        Equation("third_speed", "passed/third_inertia_kgm2", derivative=True),
    ]


def _moving(told: Exported, here: frozenset[str], e: Effects) -> list[Equation]:
    motor = (
        f"{_driving(here)} - friction"
        + (" - bristles" if "presliding_nm" in here else "")
        + (" + ripple" if _ripple(told, here) else "")
    )
    load = "outside - load_viscous_friction_nms*load_speed - 0.5*inertia_slope*load_speed^2"
    load += " - passed" if "third_inertia_kgm2" in here else ""
    angle = Equation("motor_angle", "motor_speed", derivative=True)
    curved = told.has("residual_acceleration")

    def divided(torque: str, inertia: str) -> str:
        if curved:
            return f"accelerated(residual_acceleration_rows, {torque}, {inertia})"
        return f"({torque})/{inertia if inertia.isidentifier() else f'({inertia})'}"

    rotor = "rotor_inertia_kgm2" if e.rotor_inertia_kgm2 > 0 else "motor_inertia_kgm2"
    if told.rigid and "carried_share" in here:
        return [
            Equation("both", f"{motor} + {load}", "on motor and load, N.m"),
            Equation(
                "lost",
                "sided(both, carried_share, -carried_share)*way*inertia",
                "of gears, as an inertia",
            ),
            angle,
            Equation("motor_speed", divided("both", f"{rotor} + inertia + lost"), derivative=True),
        ]
    if told.rigid:
        both = divided(f"{motor} + {load}", f"{rotor} + inertia")
        return [angle, Equation("motor_speed", both, derivative=True)]
    k = "stiffness_nm_rad" if e.stiffness_nm_rad > 0 else "coupling_stiffness_nm_rad"
    if "stiffness_share" in here:
        k = f"({k}*(1 + stiffness_share*sin(stiffness_order*motor_angle + stiffness_phase_rad)))"
    d = "damping_nms" if e.damping_nms >= 0 else "coupling_damping_nms"
    cubic = "cubic_nm_rad3" if "cubic_nm_rad3" in here else "0"
    shaft = f"{k}*twist + {d}*twist_speed" + ("" if cubic == "0" else f" + {cubic}*twist^3")
    if "gap_rad" in here:
        shaft = f"push(twist, twist_speed, {k}, {d}, {cubic}, gap_rad)"
    yielding = []
    if "hysteresis_nm" in here:
        touches = "sided(abs(twist) - 0.5*gap_rad, 1, 0)*" if "gap_rad" in here else ""
        shaft += f" + {touches}yielding"
        share = "(abs(yielding)/hysteresis_nm)^hysteresis_exponent"
        left = f"(1 - sided(yielding*twist_speed, 1, 0)*{share})"
        rate = f"hysteresis_stiffness_nm_rad*{touches}twist_speed*{left}"
        yielding = [Equation("yielding", rate, "in the coupling, which has hysteresis, N.m", derivative=True)]
    if told.has("residual_wind_up"):
        touches = "sided(abs(twist) - 0.5*gap_rad, 1, 0)*" if "gap_rad" in here else ""
        wound = "(twist - min(max(twist, -0.5*gap_rad), 0.5*gap_rad))" if "gap_rad" in here else "twist"
        shaft += f" + {touches}curve_value(residual_wind_up_rows, {wound})"
    lost = " - carried_share*abs(shaft)*way" if "carried_share" in here else ""
    at, turning, felt, ratio = "motor_angle", "motor_speed", "shaft", []
    waves = [
        (amplitude, f"{times}kinematic_order", phase)
        for amplitude, times, phase in (
            ("kinematic_rad", "", "kinematic_phase_rad"),
            ("kinematic_second_rad", "2*", "kinematic_second_phase_rad"),
        )
        if amplitude in here
    ]
    if waves:
        at += "".join(f" + {size}*sin({order}*motor_angle + {phase})" for size, order, phase in waves)
        turning, felt = "ratio*motor_speed", "ratio*shaft"
        slopes = "".join(
            f" + {size}*{order}*cos({order}*motor_angle + {phase})" for size, order, phase in waves
        )
        ratio = [Equation("ratio", f"1{slopes}", "of the gear, about 1")]
    return [
        *ratio,
        Equation("twist", f"{at} - load_angle", "of the coupling, rad"),
        Equation("twist_speed", f"{turning} - load_speed", "rad/s"),
        Equation("shaft", shaft, "torque of the coupling, N.m"),
        *yielding,
        angle,
        Equation("motor_speed", f"({motor} - {felt}{lost})/{rotor}", derivative=True),
        Equation("load_angle", "load_speed", derivative=True),
        Equation("load_speed", divided(f"{load} + shaft", "inertia"), derivative=True),
    ]
