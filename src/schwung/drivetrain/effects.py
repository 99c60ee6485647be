"""The physics that a plain two-mass belief leaves out: names and parameters of every term.

Names and keys are the file contract's (`[[physics]]` of machine.toml, names of explanation.json). Every term has a
neutral value at which it is not there. What they do is in `physics`.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from difflib import get_close_matches
from typing import NamedTuple

import numpy as np

from schwung.drivetrain.physics_term import PhysicsTerm
from schwung.drivetrain.residual import inertia_points, law_of, load_torque_table, residuals_of
from schwung.drivetrain.residual_plane import planes_of
from schwung.errors import InputError


class Effects(NamedTuple):
    """Every term's parameters, neutral by default; SI, motor side unless it says load."""

    coulomb_positive_nm: float = 0.0
    coulomb_negative_nm: float = 0.0
    stribeck_rise_nm: float = 0.0  # breakaway minus Coulomb
    stribeck_speed_rad_s: float = 1.0
    stribeck_exponent: float = 2.0  # × exp(−|ω/ω_s|^exponent)
    local_friction_nm: float = 0.0
    local_centre_rad: float = 0.0
    local_width_rad: float = 1.0  # from end to end of a raised cosine
    local_sharpness: float = 1.0  # the raised cosine to this power: flat below 1, peaked above
    drift_nm: float = 0.0  # of dry friction, from first run to last
    drift_settling: float = (
        0.0  # so many time constants of its settling are in the session; 0: it drifts evenly
    )
    viscous_nms: float = 0.0
    load_viscous_nms: float = 0.0  # behind the coupling
    viscous_difference_nms: float = 0.0  # of the viscous coefficient, positive direction minus negative
    drag_nms2: float = 0.0
    load_drag_nms2: float = 0.0  # behind the coupling
    viscous_drift_nms: float = 0.0  # of the viscous coefficient, from first run to last
    offset_drift_nm: float = 0.0  # of the offset likewise
    carried_share: float = 0.0  # friction over the torque that the shaft carries
    load_coulomb_nm: float = 0.0  # dry friction behind the coupling
    presliding_nm: float = 0.0  # friction that is a spring before it slides: when it slides
    presliding_stiffness_nm_rad: float = 1.0
    load_amplitude_nm: float = 0.0  # × sin(θ_l + phase), on the load
    load_phase_rad: float = 0.0
    end_high_nm_rad: float = 0.0  # a spring that pushes the load back beyond an angle
    end_high_rad: float = 0.0
    end_low_nm_rad: float = 0.0  # likewise below one
    end_low_rad: float = 0.0
    offset_nm: float = 0.0
    event_time_s: float = 0.0  # after the motion leaves rest
    event_duration_s: float = 1.0
    event_peak_nm: float = 0.0  # raised cosine, on the load
    event_sharpness: float = 1.0  # as of a tight spot
    periodic_frequency_hz: float = 1.0
    periodic_amplitude_nm: float = 0.0
    periodic_phase_rad: float = 0.0  # at the run's time 0
    cogging_order: float = 1.0
    cogging_amplitude_nm: float = 0.0  # × sin(order·θ + phase)
    cogging_phase_rad: float = 0.0
    cogging_second_nm: float = 0.0  # of twice the order
    cogging_second_phase_rad: float = 0.0
    torque_gain: float = 1.0  # true over reported
    torque_drop: float = (
        0.0  # of the torque constant, as a share at `torque_drop_at_nm`, as the torque to the order's power
    )
    torque_drop_at_nm: float = 1.0
    torque_drop_order: float = 1.0
    torque_fade: float = 0.0  # of the torque constant, as a share where `torque_fade_at_nm` lasts: `fade.py`
    torque_fade_at_nm: float = 1.0
    torque_fade_s: float = 1.0
    torque_fade_start: float = 0.0  # heat at first
    ripple_share: float = 0.0  # torque × share·sin(order·θ + phase)
    ripple_order: float = 1.0
    ripple_phase_rad: float = 0.0
    torque_lag_s: float = 0.0
    torque_filter_s: float = 0.0  # of what is reported alone
    torque_limit_nm: float = np.inf
    speed_delay_s: float = 0.0
    eccentricity_rad: float = 0.0  # reported angle = θ + amplitude·sin(θ + phase)
    eccentricity_phase_rad: float = 0.0
    harmonic_rad: float = 0.0  # likewise + amplitude·sin(order·θ + phase)
    harmonic_order: float = 1.0
    harmonic_phase_rad: float = 0.0
    gap_rad: float = 0.0
    rotor_inertia_kgm2: float = 0.0  # in place of the motor's; 0: the motor's
    stiffness_nm_rad: float = 0.0  # in place of the coupling's; 0: the coupling's
    damping_nms: float = -1.0  # in place of the coupling's; negative: the coupling's
    cubic_nm_rad3: float = 0.0
    stiffness_share: float = 0.0  # stiffness × (1 + share·sin(order·θ + phase)), θ the motor's angle
    stiffness_order: float = 1.0
    stiffness_phase_rad: float = 0.0
    kinematic_rad: float = 0.0  # the coupling is driven by θ + amplitude·sin(order·θ + phase)
    kinematic_order: float = 1.0
    kinematic_phase_rad: float = 0.0
    kinematic_second_rad: float = 0.0  # of twice the order
    kinematic_second_phase_rad: float = 0.0
    hysteresis_nm: float = 0.0  # beside the coupling's spring, what yields: `hysteresis.py`
    hysteresis_stiffness_nm_rad: float = 1.0
    hysteresis_exponent: float = 2.0
    third_inertia_kgm2: float = 0.0  # behind the load
    third_stiffness_nm_rad: float = 0.0
    third_damping_nms: float = 0.0
    third_speed_share: float = 0.0  # its stiffness grows by inertia · share · ω_l²
    inertia_delta_kgm2: float = 0.0
    inertia_scale: float = 1.0
    inertia_shift_rad: float = 0.0  # true J_l(θ) = believed J_l(θ + shift)

    @property
    def cogging_waves(self) -> tuple[tuple[float, float, float], ...]:
        """Amplitude (N·m, not 0), order and phase (rad) of each wave of the cogging."""
        waves = (
            (self.cogging_amplitude_nm, self.cogging_order, self.cogging_phase_rad),
            (self.cogging_second_nm, 2 * self.cogging_order, self.cogging_second_phase_rad),
        )
        return tuple(wave for wave in waves if wave[0] != 0.0)


_NOT_NEGATIVE = 0.0
_POSITIVE = 1e-300
#: By so much of itself any error of an angle may change its speed: both of an encoder's together never turn it round.
_SPEED_SHARE = 0.5


@dataclass(frozen=True)
class Key:
    """A parameter of a term, the Effects field that it sets, its unit on a rotary axis, and what is allowed."""

    field: str
    unit: str
    lowest: float = -np.inf
    optional: float | None = None  # the value where the key is absent
    highest: float = np.inf

    @property
    def wanted(self) -> str:
        """What is allowed, in words."""
        if self.highest < np.inf:
            low = "more than 0" if self.lowest == _POSITIVE else f"{self.lowest:g} or more"
            return f"{low} and at most {self.highest:g}{f' {self.unit}' if self.unit else ''}"
        return "positive" if self.lowest > 0 else "zero or more"


#: Name of a term -> its keys. Names and keys are those of the file contract.
PHYSICS: Mapping[str, Mapping[str, Key]] = {
    "coulomb_friction": {"torque_nm": Key("coulomb", "N·m")},
    "stribeck_friction": {
        "coulomb_torque_nm": Key("coulomb", "N·m"),
        "breakaway_torque_nm": Key("stribeck_rise_nm", "N·m"),
        "stribeck_speed_rad_s": Key("stribeck_speed_rad_s", "rad/s", _POSITIVE),
        "exponent": Key("stribeck_exponent", "", _POSITIVE, optional=2.0, highest=10.0),
    },
    "asymmetric_friction": {
        "torque_positive_nm": Key("coulomb_positive_nm", "N·m"),
        "torque_negative_nm": Key("coulomb_negative_nm", "N·m"),
        "coefficient_difference_nms": Key("viscous_difference_nms", "N·m·s/rad", optional=0.0),
    },
    "friction_over_angle": {},
    "viscous_friction": {
        "coefficient_nms": Key("viscous_nms", "N·m·s/rad", optional=0.0),
        "load_coefficient_nms": Key("load_viscous_nms", "N·m·s/rad", optional=0.0),
    },
    "viscous_drift": {"change_nms": Key("viscous_drift_nms", "N·m·s/rad")},
    "load_dependent_friction": {"share": Key("carried_share", "", _NOT_NEGATIVE, highest=0.9)},
    "load_side_friction": {"torque_nm": Key("load_coulomb_nm", "N·m", _NOT_NEGATIVE)},
    "presliding_friction": {
        "torque_nm": Key("presliding_nm", "N·m", _NOT_NEGATIVE),
        "stiffness_nm_rad": Key("presliding_stiffness_nm_rad", "N·m/rad", _POSITIVE),
    },
    "quadratic_drag": {
        "coefficient_nms2": Key("drag_nms2", "N·m·s²/rad²", optional=0.0),
        "load_coefficient_nms2": Key("load_drag_nms2", "N·m·s²/rad²", optional=0.0),
    },
    "local_friction": {
        "torque_nm": Key("local_friction_nm", "N·m"),
        "centre_rad": Key("local_centre_rad", "rad"),
        "width_rad": Key("local_width_rad", "rad", _POSITIVE),
        "sharpness": Key("local_sharpness", "", _POSITIVE, optional=1.0, highest=100.0),
    },
    "friction_drift": {
        "change_nm": Key("drift_nm", "N·m"),
        "settling": Key("drift_settling", "", -50.0, optional=0.0, highest=50.0),
    },
    "load_torque": {
        "amplitude_nm": Key("load_amplitude_nm", "N·m"),
        "phase_rad": Key("load_phase_rad", "rad"),
    },
    "direction_dependent_load": {},
    "end_spring": {
        "stiffness_nm_rad": Key("end_nm_rad", "N·m/rad", _NOT_NEGATIVE),
        "position_rad": Key("end_rad", "rad"),
        "side": Key("end_side", "", -1.0, optional=1.0, highest=1.0),
    },
    "torque_offset": {"torque_nm": Key("offset_nm", "N·m")},
    "offset_drift": {"change_nm": Key("offset_drift_nm", "N·m")},
    "load_event": {
        "time_s": Key("event_time_s", "s"),
        "duration_s": Key("event_duration_s", "s", _POSITIVE),
        "peak_nm": Key("event_peak_nm", "N·m"),
        "sharpness": Key("event_sharpness", "", _POSITIVE, optional=1.0, highest=100.0),
    },
    "periodic_disturbance": {
        "frequency_hz": Key("periodic_frequency_hz", "Hz", _POSITIVE),
        "amplitude_nm": Key("periodic_amplitude_nm", "N·m"),
        "phase_rad": Key("periodic_phase_rad", "rad", optional=0.0),
    },
    "cogging": {
        "order": Key("cogging_order", "1/rev", _POSITIVE),
        "amplitude_nm": Key("cogging_amplitude_nm", "N·m"),
        "phase_rad": Key("cogging_phase_rad", "rad"),
        "second_amplitude_nm": Key("cogging_second_nm", "N·m", optional=0.0),
        "second_phase_rad": Key("cogging_second_phase_rad", "rad", optional=0.0),
    },
    "torque_constant": {"gain": Key("torque_gain", "", _POSITIVE, highest=100.0)},
    "torque_constant_drop": {
        "share_at_peak": Key("torque_drop", "", _NOT_NEGATIVE, highest=0.5),
        "peak_nm": Key("torque_drop_at_nm", "N·m", _POSITIVE),
        "order": Key("torque_drop_order", "", _POSITIVE, optional=1.0, highest=10.0),
    },
    "torque_constant_fade": {
        "share_at_peak": Key("torque_fade", "", _NOT_NEGATIVE),
        "peak_nm": Key("torque_fade_at_nm", "N·m", _POSITIVE),
        "time_constant_s": Key("torque_fade_s", "s", _POSITIVE),
        "start_heat": Key("torque_fade_start", "", _NOT_NEGATIVE, optional=0.0),
    },
    "torque_ripple": {
        "order": Key("ripple_order", "1/rev", _POSITIVE),
        "share": Key("ripple_share", "", -0.9, highest=0.9),
        "phase_rad": Key("ripple_phase_rad", "rad"),
    },
    "torque_filter": {"time_constant_s": Key("torque_filter_s", "s", _NOT_NEGATIVE, highest=1.0)},
    "torque_lag": {"time_constant_s": Key("torque_lag_s", "s", _NOT_NEGATIVE, highest=1.0)},
    "torque_saturation": {"limit_nm": Key("torque_limit_nm", "N·m", _POSITIVE)},
    "measurement_delay": {"delay_s": Key("speed_delay_s", "s", _NOT_NEGATIVE, highest=1.0)},
    "encoder_eccentricity": {
        "amplitude_rad": Key("eccentricity_rad", "rad", -_SPEED_SHARE, highest=_SPEED_SHARE),
        "phase_rad": Key("eccentricity_phase_rad", "rad", optional=0.0),
    },
    "encoder_harmonic": {
        "order": Key("harmonic_order", "1/rev", _POSITIVE),
        "amplitude_rad": Key("harmonic_rad", "rad", -0.5, highest=0.5),
        "phase_rad": Key("harmonic_phase_rad", "rad"),
    },
    "backlash": {"gap_rad": Key("gap_rad", "rad", _NOT_NEGATIVE, highest=2 * np.pi)},
    "motor_inertia": {"inertia_kgm2": Key("rotor_inertia_kgm2", "kg·m²", _POSITIVE)},
    "coupling_stiffness": {"stiffness_nm_rad": Key("stiffness_nm_rad", "N·m/rad", _POSITIVE)},
    "coupling_damping": {"damping_nms": Key("damping_nms", "N·m·s/rad", _NOT_NEGATIVE)},
    "nonlinear_stiffness": {"cubic_nm_rad3": Key("cubic_nm_rad3", "N·m/rad³")},
    "coupling_hysteresis": {
        "torque_nm": Key("hysteresis_nm", "N·m", _NOT_NEGATIVE),
        "stiffness_nm_rad": Key("hysteresis_stiffness_nm_rad", "N·m/rad", _POSITIVE),
        "exponent": Key("hysteresis_exponent", "", _POSITIVE, optional=2.0, highest=20.0),
    },
    "stiffness_over_angle": {
        "order": Key("stiffness_order", "1/rev", _POSITIVE),
        "share": Key("stiffness_share", "", -0.9, highest=0.9),
        "phase_rad": Key("stiffness_phase_rad", "rad"),
    },
    "kinematic_error": {
        "order": Key("kinematic_order", "1/rev", _POSITIVE),
        "amplitude_rad": Key("kinematic_rad", "rad", -0.5, highest=0.5),
        "phase_rad": Key("kinematic_phase_rad", "rad"),
        "second_amplitude_rad": Key("kinematic_second_rad", "rad", -0.5, highest=0.5, optional=0.0),
        "second_phase_rad": Key("kinematic_second_phase_rad", "rad", optional=0.0),
    },
    "extra_compliance": {
        "inertia_kgm2": Key("third_inertia_kgm2", "kg·m²", _POSITIVE),
        "stiffness_nm_rad": Key("third_stiffness_nm_rad", "N·m/rad", _POSITIVE),
        "damping_nms": Key("third_damping_nms", "N·m·s/rad", _NOT_NEGATIVE),
        "speed_share": Key("third_speed_share", "", _NOT_NEGATIVE, optional=0.0),
    },
    "load_inertia": {
        "delta_kgm2": Key("inertia_delta_kgm2", "kg·m²", optional=0.0),
        "scale": Key("inertia_scale", "", _POSITIVE, optional=1.0),
    },
    "inertia_profile_shift": {"shift_rad": Key("inertia_shift_rad", "rad")},
    "inertia_profile": {},
    "residual": {},
}

#: Terms that change the coupling, and so need one.
_OF_COUPLING = (
    "backlash",
    "coupling_stiffness",
    "coupling_damping",
    "nonlinear_stiffness",
    "coupling_hysteresis",
    "stiffness_over_angle",
    "kinematic_error",
    "load_side_friction",
)

#: Names of keys that are so much alike are one, misspelled.
ALIKE = 0.75
#: Fields that several terms add to; the others are set by one term alone.
_ADDED = (
    "coulomb_positive_nm",
    "coulomb_negative_nm",
    "viscous_nms",
    "load_viscous_nms",
    "drag_nms2",
    "load_drag_nms2",
    "offset_nm",
    "inertia_delta_kgm2",
)


def check_physics(terms: Sequence[PhysicsTerm], rigid: bool) -> None:
    """Raises InputError for terms that make no sense, alone, together, or on a machine without a coupling."""
    effects_of(terms)
    load_torque_table(terms)
    residuals_of(terms)
    planes_of(terms)
    inertia_points(terms)
    for term in terms:
        over = term.parameters.get("coordinate") if term.name == "residual" else None
        if rigid and (law_of(term) in _OF_COUPLING or over == "wind_up"):
            raise InputError(
                f"physics.{term.name}",
                "needs a coupling, and the machine has none",
                "Add [coupling] with stiffness and damping, or leave the term out.",
            )


def effects_of(terms: Sequence[PhysicsTerm]) -> Effects:
    """All terms together. Tables are not among them (`residuals_of`, `load_torque_table`, `inertia_added`).

    Raises InputError that names term and key for an unknown name, a missing or impossible number, a term given twice
    that cannot be added to itself, or a motor that is too hot to hold anything.
    """
    values: dict[str, float] = {}
    for term in terms:
        for field, value in _fields(term).items():
            if field in values and field not in _ADDED:
                raise InputError(
                    f"physics.{term.name}", "is given twice", "Put it once; only its torques would add."
                )
            values[field] = values.get(field, 0.0) + value
    effects = Effects(**values)
    lost = effects.torque_fade * effects.torque_fade_start
    if lost >= 1:
        raise InputError(
            "physics.torque_constant_fade",
            f"leaves nothing of the torque at first: share_at_peak times start_heat is {lost:g}",
            "Give a start_heat that is smaller; 1 is the heat at which the peak torque lasts.",
        )
    return effects


def _check_spelling(term: PhysicsTerm, keys: Mapping[str, Key]) -> None:
    """A key that may be left out and is misspelled would be left out: what is kept beside a law may have any other
    name."""
    left_out = [name for name in keys if name not in term.parameters]
    for name in term.parameters:
        near = get_close_matches(name, left_out, 1, ALIKE) if name not in keys else []
        if near:
            raise InputError(
                f"physics.{term.name}", f"has {name}, which is no key of it", f"Is it {near[0]}?"
            )


def _fields(term: PhysicsTerm) -> dict[str, float]:
    law = law_of(term)
    keys = PHYSICS.get(law)
    if keys is None:
        raise InputError(f"physics.{law}", "is not a known physics term", f"There are {', '.join(PHYSICS)}.")
    if law == "load_torque" and "table" in term.parameters:
        if "amplitude_nm" in term.parameters:
            raise InputError("physics.load_torque", "has amplitude_nm beside table", "Keep one of the two.")
        return {}
    _check_spelling(term, keys)
    if keys and all(key.optional is not None and name not in term.parameters for name, key in keys.items()):
        first, *others = keys
        instead = "".join(f", or {name}" for name in others)
        raise InputError(
            f"physics.{term.name}", f"{first} is missing", f"Give it as a finite number{instead}."
        )
    values: dict[str, float] = {}
    for name, key in keys.items():
        absent = key.optional is not None and name not in term.parameters
        value = key.optional if absent else term.number(name)
        assert value is not None
        if not key.lowest <= value <= key.highest:
            raise InputError(f"physics.{term.name}", f"{name} is {value:g}", f"It has to be {key.wanted}.")
        if key.field == "coulomb":
            values["coulomb_positive_nm"] = values["coulomb_negative_nm"] = value
        else:
            values[key.field] = value
    if law == "stribeck_friction":
        values["stribeck_rise_nm"] -= values["coulomb_positive_nm"]
    if law in ("encoder_harmonic", "kinematic_error"):
        order = values[keys["order"].field]
        second = 2 * order * abs(values.get("kinematic_second_rad", 0.0))
        what = "order times amplitude_rad" + (
            ", and twice order times second_amplitude_rad," if second else ""
        )
        _check_speed(term.name, what, order * abs(values[keys["amplitude_rad"].field]) + second)
    return _at_its_end(values) if law == "end_spring" else values


def _at_its_end(values: Mapping[str, float]) -> dict[str, float]:
    """An end spring's fields: a machine may have one at either end."""
    side = values["end_side"]
    if abs(side) != 1.0:
        raise InputError(
            "physics.end_spring",
            f"side is {side:g}",
            "It has to be 1 (acts beyond position_rad) or -1 (acts below it).",
        )
    end = "end_high" if side > 0 else "end_low"
    return {f"{end}_nm_rad": values["end_nm_rad"], f"{end}_rad": values["end_rad"]}


def _check_speed(name: str, what: str, share: float) -> None:
    """As far off as with an eccentric encoder: where an angle ran backwards, many others would be the same."""
    if abs(share) > _SPEED_SHARE:
        raise InputError(
            f"physics.{name}",
            f"{what} is {share:g}: by that share a speed is off",
            f"It has to be -{_SPEED_SHARE:g} or more and at most {_SPEED_SHARE:g}.",
        )
