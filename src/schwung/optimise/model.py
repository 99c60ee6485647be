"""The machine as the optimiser has it: two masses and what `explain` named, in terms that can be differentiated twice.

method.md (1), (A7); terms as `drivetrain.physics`, but |ω| and the sign of ω are smooth. Every function takes numbers,
arrays or symbols of CasADi.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np

from schwung.drivetrain import InertiaTable, Machine, kernel, plant, residual
from schwung.drivetrain.effects import Effects, effects_of
from schwung.drivetrain.residual_plane import planes_of
from schwung.errors import InputError
from schwung.motion import Array
from schwung.optimise.series import Series, series_of

#: Dry friction changes sign within this share of the mean speed.
SMOOTH_SHARE = 0.01
#: Terms that have no place in a plan: fixed in time, not smooth, by the torque itself, or of the sensor alone.
NOT_PLANNED = (
    "load_event",
    "periodic_disturbance",
    "backlash",
    "torque_lag",
    "measurement_delay",
    "encoder_eccentricity",
    "encoder_harmonic",
    "extra_compliance",
    "load_dependent_friction",
    "torque_constant_drop",
    "torque_constant_fade",
    "torque_ripple",
    "stiffness_over_angle",
    "coupling_hysteresis",
    "kinematic_error",
    "torque_filter",
)
#: Curves that have one, by what they are over; residuals over anything else have none.
PLANNED_OVER = ("position", "speed", "run", "load_position")


@dataclass(frozen=True, eq=False)
class Directed:
    """A learned torque (N·m) forward and backward, each as a series; `pace`: its coordinate is |ω|/(|ω| + pace)."""

    forward: Series
    backward: Series
    pace: float = 0.0

    def at(self, coordinate: Any, direction: Any) -> Any:
        """What it adds, the direction of motion −1…1; smooth in both."""
        where = coordinate / (coordinate + self.pace) if self.pace else coordinate
        forward, backward = self.forward.at(where), self.backward.at(where)
        return direction / 2 * ((1 + direction) * forward - (1 - direction) * backward)


@dataclass(frozen=True, eq=False)
class Model:
    """A drive train with one load; SI. `stiffness_nm_rad` None: rigid, one mass."""

    rotor_inertia_kgm2: float
    motor_friction_nms: float
    load_friction_nms: float
    stiffness_nm_rad: float | None
    damping_nms: float
    inertia: Series
    inertia_slope: Series
    load_torque: Series
    effects: Effects
    smooth_rad_s: float
    torque_max_nm: float  # of the drive, as it is reported
    curves: Mapping[str, Directed] = field(default_factory=dict)

    def load_inertia(self, angle: Any) -> Any:
        """J_l (kg·m²) at a load angle (rad)."""
        return self.inertia.at(angle)

    def load_needs(self, angle: Any, speed: Any) -> Any:
        """Torque (N·m) that the load takes at a speed (rad/s) without accelerating: ½J'ω², friction, its own torque."""
        e, size = self.effects, np.sqrt(speed**2 + self.smooth_rad_s**2)
        own, sign = self.load_torque.at(angle), np.tanh(speed / self.smooth_rad_s)
        own -= e.load_coulomb_nm * sign + (e.load_viscous_nms + e.load_drag_nms2 * size) * speed
        if "load_position" in self.curves:
            own += self.curves["load_position"].at(angle, sign)
        return self.inertia_slope.at(angle) / 2 * speed**2 + self.load_friction_nms * speed - own

    def shaft_torque(self, twist: Any, twist_speed: Any) -> Any:
        """What the coupling passes to the load (N·m) by its wind-up (rad) and the rate of that (rad/s)."""
        assert self.stiffness_nm_rad is not None
        spring = (self.stiffness_nm_rad + self.effects.cubic_nm_rad3 * twist**2) * twist
        return spring + self.damping_nms * twist_speed

    def motor_needs(self, angle: Any, speed: Any) -> Any:
        """Torque (N·m) that friction and cogging take at the motor; `physics.motor_torque` with the sign turned."""
        e, size = self.effects, np.sqrt(speed**2 + self.smooth_rad_s**2)
        sign = np.tanh(speed / self.smooth_rad_s)
        forward, backward = e.coulomb_positive_nm, e.coulomb_negative_nm
        level = (forward + backward) / 2 + sign * (forward - backward) / 2 + e.drift_nm
        level += e.presliding_nm  # as if it slid at once
        if e.stribeck_rise_nm:
            level += e.stribeck_rise_nm * np.exp(-((size / e.stribeck_speed_rad_s) ** e.stribeck_exponent))
        if e.local_friction_nm:
            level += e.local_friction_nm * _tight(e, angle)
        viscous = self.motor_friction_nms + e.viscous_nms + e.viscous_drift_nms
        needed = (viscous + e.drag_nms2 * size) * speed - e.offset_nm - e.offset_drift_nm
        where = {"position": angle, "speed": size, "run": 1.0}
        for over in where.keys() & self.curves.keys():
            needed -= self.curves[over].at(where[over], sign)
        needed += e.viscous_difference_nms / 2 * size + level * sign
        for amplitude, order, phase in e.cogging_waves:
            needed -= amplitude * np.sin(order * angle + phase)
        return needed

    def reported(self, torque: Any) -> Any:
        """The torque (N·m) that the drive reports, and is limited in, for one on the shaft."""
        return torque / self.effects.torque_gain

    @property
    def lightest_kgm2(self) -> float:
        """Smallest load inertia of the stroke, beyond it by no more than the load winds up."""
        return float(np.min(self._inertias()))

    def _inertias(self) -> Array:
        return np.asarray(self.inertia.at(np.linspace(self.inertia.low_rad, self.inertia.high_rad, 400)))


def _tight(e: Effects, angle: Any) -> Any:
    """Raised cosine of the place in the turn (`physics.bump`), by a power that is 0 outside its width."""
    away = angle - e.local_centre_rad
    away = np.arctan2(np.sin(away), np.cos(away)) / e.local_width_rad
    inside = (1 - np.tanh(200 * (away**2 - 0.25))) / 2
    return inside * ((1 + np.cos(2 * np.pi * away)) / 2 + 1e-9) ** e.local_sharpness


def not_planned(machine: Machine) -> tuple[str, ...]:
    """What of the machine's [[physics]] a plan leaves out: names, and of residuals what they are over."""
    left = [law for term in machine.physics if (law := residual.law_of(term)) in NOT_PLANNED]
    for over, curve in residual.residuals_of(machine.physics).items():
        if over not in PLANNED_OVER:
            left.append(f"residual over {over.replace('_', ' ')} (up to {curve.highest_nm:.2g} N·m)")
    for pair, plane in planes_of(machine.physics).items():
        highest = float(np.max(np.abs(plane.torque_nm)))
        left.append(f"residual over {' and '.join(pair).replace('_', ' ')} (up to {highest:.2g} N·m)")
    return tuple(left)


def models_of(
    machine: Machine,
    ends_rad: tuple[float, float],
    mean_speed_rad_s: float,
    torque_max_nm: float,
    payloads_kgm2: tuple[float, ...] = (0.0,),
    band_sigmas: float = 0.0,
) -> tuple[Model, ...]:
    """The machine with every load that a stroke between two ends has to bear; the first is the machine as it is.

    Raises InputError where the inertia is unknown, was found unusable, does not cover the stroke or is not positive.
    """
    require_table(machine, ends_rad)
    nominal = _model(machine, ends_rad, mean_speed_rad_s, torque_max_nm)
    shifts = [payload for payload in payloads_kgm2 if payload != 0.0]
    models = [nominal] + [_heavier(nominal, np.full_like, by) for by in shifts]
    table = machine.load.inertia_table
    if band_sigmas > 0:
        if table is None or table.std_kgm2 is None:
            raise InputError(
                "--robust", "the table has no std_kgm2", "Measure it, or give --payload instead."
            )
        std = InertiaTable(table.position_rad, table.std_kgm2 + 1e-12)
        for sign in (1.0, -1.0):
            models.append(_heavier(nominal, lambda angle, by: by * std.at(angle), sign * band_sigmas))
    return tuple(models)


def require_table(machine: Machine, ends_rad: tuple[float, float]) -> None:
    """Raise InputError where the machine's inertia may not be built upon for a stroke between two ends."""
    if machine.load.trust == "unusable":
        raise InputError(
            f'machine "{machine.name}", load.trust',
            "the inertia table was found unusable",
            "Measure again: more --amplitude, a longer --duration, or --phases 4.",
        )
    inertia = machine.load_inertia
    if not isinstance(inertia, InertiaTable):
        machine.load_inertia_at(np.array(ends_rad))
        return
    low, high = min(ends_rad), max(ends_rad)
    first, last = float(inertia.position_rad[0]), float(inertia.position_rad[-1])
    step = float(np.max(np.diff(inertia.position_rad)))
    if low < first - step or high > last + step:
        raise InputError(
            f'machine "{machine.name}", load.inertia_table',
            f"covers {first:.4g} … {last:.4g} rad, the stroke goes from {ends_rad[0]:.4g} to {ends_rad[1]:.4g} rad",
            "Measure the whole stroke, or shorten it (--distance, --start).",
        )


def _heavier(model: Model, added: Callable[[Array, float], Array], by: float) -> Model:
    low, high = model.inertia.low_rad, model.inertia.high_rad
    inertia = series_of(lambda angle: model.inertia.at(angle) + added(angle, by), low, high)
    heavier = replace(model, inertia=inertia, inertia_slope=inertia.slope())
    if not heavier.lightest_kgm2 > 0:
        raise InputError("--payload", "leaves no inertia", "Give what is added, in kg·m².")
    return heavier


def _model(machine: Machine, ends_rad: tuple[float, float], mean_speed_rad_s: float, limit: float) -> Model:
    body, effects = plant.plant_of(machine, None), effects_of(machine.physics)
    learned = residual.load_torque_table(machine.physics)
    wound = 0.0 if body.rigid else 2 * limit / body.stiffness
    beyond = wound + 0.02 * abs(ends_rad[1] - ends_rad[0])
    low, high = min(ends_rad) - beyond, max(ends_rad) + beyond

    def load_torque(angle: Array) -> Array:
        torque = _values(body.load_torque, angle) + (0.0 if learned is None else learned.at(angle))
        torque = torque + effects.load_amplitude_nm * np.sin(angle + effects.load_phase_rad)
        torque = torque - effects.end_high_nm_rad * np.maximum(angle - effects.end_high_rad, 0.0)
        torque = torque + effects.end_low_nm_rad * np.maximum(effects.end_low_rad - angle, 0.0)
        return np.asarray(torque, dtype=float)

    table = machine.load.inertia_table
    std = 0.0 if table is None or table.std_kgm2 is None else float(np.median(table.std_kgm2))
    inertia = series_of(lambda angle: _values(body.inertia, angle), low, high, std)
    model = Model(
        rotor_inertia_kgm2=body.rotor_inertia,
        motor_friction_nms=body.motor_friction,
        load_friction_nms=body.load_friction,
        stiffness_nm_rad=None if body.rigid else body.stiffness,
        damping_nms=body.damping,
        inertia=inertia,
        inertia_slope=inertia.slope(),
        load_torque=series_of(load_torque, low, high),
        effects=effects,
        smooth_rad_s=SMOOTH_SHARE * mean_speed_rad_s,
        torque_max_nm=min(limit, effects.torque_limit_nm / effects.torque_gain),
        curves=_curves(machine, (low, high), mean_speed_rad_s),
    )
    if not model.lightest_kgm2 > 0:
        raise InputError(
            f'machine "{machine.name}", load.inertia_table',
            "is so ragged that no smooth curve through it stays above 0",
            "Measure again, or smooth it.",
        )
    return model


def _curves(machine: Machine, ends: tuple[float, float], pace: float) -> dict[str, Directed]:
    """Learned curves that a plan can be made with; of a drift over the session what it has come to."""
    found: dict[str, Directed] = {}
    for over, one in residual.residuals_of(machine.physics).items():
        if over not in PLANNED_OVER:
            continue

        def side(direction: float, one: residual.Residual = one, over: str = over) -> Series:
            def curve(x: Array) -> Array:
                where = pace * x / np.maximum(1 - x, 1e-9) if over == "speed" else x
                return np.asarray(one.at(where, np.full_like(where, direction)))

            return series_of(curve, *((0.0, 1.0) if over in ("speed", "run") else ends))

        found[over] = Directed(side(1.0), side(-1.0), pace if over == "speed" else 0.0)
    return found


def _values(curve: kernel.Curve, angle: Array) -> Array:
    return np.array([kernel.value_and_slope(curve, float(x))[0] for x in angle])
