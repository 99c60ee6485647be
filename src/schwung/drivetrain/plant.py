"""From a machine as believed to what the compiled kernels take: equations' constants, standstill, sub-steps."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np
from scipy.interpolate import PchipInterpolator
from scipy.optimize import brentq

from schwung.drivetrain import kernel, learned, physics, residual
from schwung.drivetrain.effects import Effects, effects_of
from schwung.drivetrain.fade import faded
from schwung.drivetrain.inertia import InertiaTable
from schwung.drivetrain.machine import Machine
from schwung.drivetrain.residual_plane import NOTHING, PAIRS, Pair, Plane, planes_of, sheet_at
from schwung.errors import InputError
from schwung.motion import Array, Demand

#: Highest |eigenvalue| × sub-step. With it the paper's machine is off by 2e-6 rad/s at 20 rad/s.
_COUPLING_STEP = 0.1
#: The same with play: where the coupling takes hold its torque has a corner.
_CONTACT_STEP = 0.02
#: The same for smoothed dry friction, which only has to be stable (limit of Runge-Kutta: 2.8).
_FRICTION_STEP = 1.0
#: Dry friction is smoothed within this speed (rad/s).
SMOOTHING_RAD_S = 0.02
_MAX_SUBSTEPS = 20_000


def plant_of(machine: Machine, inertia: InertiaTable | float | None) -> kernel.Plant:
    """The lean plant, with what was learned about stiffness, damping and inertia in place.

    `inertia` (kg·m²) stands in for the machine's. Raises InputError where it is unknown or not positive.
    """
    load, coupling = machine.load, machine.coupling
    effects = effects_of(machine.physics)
    stiffness, damping = (coupling.stiffness_nm_rad, coupling.damping_nms) if coupling else (0.0, 0.0)
    torque = load.torque_table
    return kernel.Plant(
        rotor_inertia=effects.rotor_inertia_kgm2 or machine.motor.inertia_kgm2,
        motor_friction=machine.motor.viscous_friction_nms,
        load_friction=load.viscous_friction_nms,
        stiffness=effects.stiffness_nm_rad or stiffness,
        damping=damping if effects.damping_nms < 0 else effects.damping_nms,
        rigid=coupling is None,
        inertia=_inertia_curve(machine, inertia, effects),
        load_torque=_constant(load.torque_nm or 0.0)
        if torque is None
        else _curve(torque.position_rad, torque.load_torque_nm),
    )


def learned_of(
    machine: Machine, plant: kernel.Plant, ticks: Array, demand: Demand, share: float
) -> learned.Learned:
    """The plant with all its learned terms; demand and its instants `ticks` (s) say when the motion begins."""
    table = residual.load_torque_table(machine.physics)
    moving = (demand.position_rad != demand.position_rad[0]) | (demand.speed_rad_s != 0)
    leaves_rest = float(ticks[max(int(np.argmax(moving)) - 1, 0)]) if np.any(moving) else np.inf
    return learned.Learned(
        plant=plant,
        effects=effects_of(machine.physics),
        load_table=_constant(0.0) if table is None else _curve(table.position_rad, table.load_torque_nm),
        curves=_curves(residual.residuals_of(machine.physics), planes_of(machine.physics)),
        smoothing=SMOOTHING_RAD_S,
        leaves_rest=leaves_rest,
        share=share,
    )


def _curves(
    tables: Mapping[residual.Over, residual.Residual], planes: Mapping[Pair, Plane]
) -> learned.Curves:
    """The learned torques that are tables; what there is none of is nothing anywhere."""
    nothing = _constant(0.0)

    def sided(over: residual.Over) -> learned.Sided:
        one = tables.get(over)
        if one is None:
            return learned.Sided(nothing, nothing)
        return learned.Sided(_curve(one.x, one.forward_nm), _curve(one.x, one.backward_nm))

    return learned.Curves(
        bool(tables), sided("position"), sided("speed"), sided("torque"), sided("run"), sided("load_position"),
        sided("acceleration").forward, sided("time_in_motion").forward, sided("wind_up").forward,
        bool(planes), *(planes[pair].sheet if pair in planes else NOTHING for pair in PAIRS),
    )  # fmt: skip


def _curve(position: Array, values: Array) -> kernel.Curve:
    pieces = PchipInterpolator(position, values)
    return kernel.Curve(np.ascontiguousarray(pieces.x, float), np.ascontiguousarray(pieces.c, float))


def _constant(value: float) -> kernel.Curve:
    return _curve(np.array([0.0, 1.0]), np.array([value, value]))


def _inertia_curve(machine: Machine, inertia: InertiaTable | float | None, effects: Effects) -> kernel.Curve:
    believed = machine.load_inertia if inertia is None else inertia
    if believed is None:
        raise InputError(
            f'machine "{machine.name}"',
            "load.inertia is not known, so nothing can be simulated",
            "Estimate it, or give load.inertia or load.inertia_table.",
        )
    if not (isinstance(believed, InertiaTable) or 0 < believed < np.inf):
        raise InputError("inertia", f"is {believed!r} kg·m²", "An inertia is a positive number.")
    if isinstance(believed, InertiaTable):
        angles, values = believed.position_rad - effects.inertia_shift_rad, believed.inertia_kgm2
    else:
        angles, values = np.array([0.0, 1.0]), np.array([believed, believed])
    true = effects.inertia_scale * values + effects.inertia_delta_kgm2
    curve = _curve(angles, true)
    points = np.unique(residual.inertia_points(machine.physics))
    if points.size:
        curve = _sum(curve, _curve(points, residual.inertia_added(machine.physics, points)))
        true = curve.coefficients[3]
    if not np.min(true) > 0:
        raise InputError(
            "physics.inertia_profile" if points.size else "physics.load_inertia",
            f"makes the load's inertia {np.min(true):g} kg·m²",
            "Correct what is added, or the inertia that it is added to.",
        )
    return curve


def _sum(one: kernel.Curve, other: kernel.Curve) -> kernel.Curve:
    """Both, exactly: between the knots of either, each is one cubic, and constant beyond its own."""
    knots = np.union1d(one.knots, other.knots)
    total = np.zeros((4, knots.size - 1))
    for curve in (one, other):
        middle = (knots[1:] + knots[:-1]) / 2
        inside = (middle > curve.knots[0]) & (middle < curve.knots[-1])
        piece = np.clip(np.searchsorted(curve.knots, middle) - 1, 0, curve.knots.size - 2)
        a, b, c, d = curve.coefficients[:, piece]
        u = np.where(inside, knots[:-1] - curve.knots[piece], 0.0)
        moved = np.stack([a, 3 * a * u + b, (3 * a * u + 2 * b) * u + c, ((a * u + b) * u + c) * u + d])
        ends = [kernel.value_and_slope(curve, float(end))[0] for end in (curve.knots[0], curve.knots[-1])]
        beyond = np.where(middle <= curve.knots[0], ends[0], ends[1])
        total += np.where(inside, moved, np.stack([0 * u, 0 * u, 0 * u, beyond]))
    return kernel.Curve(knots, np.ascontiguousarray(total))


def rest(plant: kernel.Plant, motor_angle: float) -> tuple[kernel.State, float]:
    """Standstill of the lean plant at a motor angle (rad), and the motor torque (N·m) that holds it."""
    load_angle = motor_angle
    for _ in range(100 if plant.stiffness else 0):  # the coupling's wind-up is tiny: this contracts fast
        load_angle = motor_angle + kernel.value_and_slope(plant.load_torque, load_angle)[0] / plant.stiffness
    held = -kernel.value_and_slope(plant.load_torque, load_angle)[0]
    return kernel.State(motor_angle, 0.0, load_angle, 0.0), held


def angle_of(e: Effects, read_angle: float) -> float:
    """The motor angle (rad) at which an encoder reads this one (rad), which only grows with it: by halving."""
    most = abs(e.eccentricity_rad) + abs(e.harmonic_rad)
    low, high = read_angle - most, read_angle + most
    for _ in range(100):
        middle = 0.5 * (low + high)
        if middle + physics.encoder_off(e, middle)[0] < read_angle:
            low = middle
        else:
            high = middle
    return 0.5 * (low + high)


def learned_rest(machine: learned.Learned, read_angle: float) -> tuple[learned.Masses, float]:
    """Standstill where the drive reads this angle (rad), and the torque (N·m) it has to report to hold it.

    Dry friction holds nothing here: it is smooth. Raises InputError where the coupling cannot bear the load's torque.
    """
    e, plant = machine.effects, machine.plant
    motor_angle = angle_of(e, read_angle)

    def load_torque(angle: float) -> float:
        table = kernel.value_and_slope(plant.load_torque, angle)[0]
        table += kernel.value_and_slope(machine.load_table, angle)[0]
        if machine.curves.any:
            table += kernel.value_and_slope(machine.curves.time_in_motion, -np.inf)[0]
            table += kernel.value_and_slope(machine.curves.acceleration, 0.0)[0]
        if machine.curves.any_plane:
            table += sheet_at(machine.curves.position_speed, angle, 0.0)
        return table + physics.load_torque(e, angle, 0.0, -np.inf)

    def pull(angle: float) -> float:
        """What would turn the load from this angle on (N·m)."""
        twist = driven - angle
        stiffness = physics.stiffness_at(e, plant.stiffness, motor_angle)
        carried = physics.coupling_torque(e, stiffness, plant.damping, twist, 0.0)
        if machine.curves.any and abs(twist) >= 0.5 * e.gap_rad:
            carried += kernel.value_and_slope(machine.curves.wind_up, physics.wound_up(e, twist))[0]
        return load_torque(angle) + carried

    driven, ratio = physics.driven(e, motor_angle)
    load_angle = driven
    if not plant.rigid and pull(driven) != 0.0:
        towards = np.sign(pull(driven))
        wound = 0.5 * e.gap_rad + 1e-3 * abs(load_torque(driven)) / plant.stiffness
        while pull(driven + towards * wound) * towards > 0.0:
            wound *= 2.0
            if wound > 100.0:
                raise InputError(
                    "coupling.stiffness",
                    "is too low to bear the load's torque",
                    "Check it, the learned stiffness, and the load torque.",
                )
        load_angle = brentq(pull, driven, driven + towards * wound, xtol=1e-15)
    held = -ratio * load_torque(load_angle) - e.offset_nm - machine.share * e.offset_drift_nm
    for amplitude, order, phase in e.cogging_waves:
        held -= amplitude * np.sin(order * motor_angle + phase)
    state = learned.Masses(motor_angle, 0.0, load_angle, 0.0, load_angle, 0.0, 0.0, 0.0, e.torque_fade_start)
    share = 1.0 + e.ripple_share * np.sin(e.ripple_order * motor_angle + e.ripple_phase_rad)
    share *= faded(1.0, e.torque_fade, e.torque_fade_start)
    on_shaft = held / share
    if machine.curves.any_plane:  # what depends on the torque does so by less than all of it: this contracts
        for _ in range(200):
            more = sheet_at(machine.curves.position_torque, motor_angle, on_shaft)
            more += sheet_at(machine.curves.torque_time, on_shaft, -np.inf)
            on_shaft = (held - more) / share
    return state, learned.reported_torque(e, float(on_shaft))


def substeps(machine: Machine, plant: kernel.Plant, period: float, top_speed: float, share: float) -> int:
    """Runge-Kutta steps per tick (s), from the fastest thing that the plant does at speeds up to `top_speed` (rad/s).

    Raises InputError where that is too fast.
    """
    e, curves = effects_of(machine.physics), residual.residuals_of(machine.physics)
    last, _ = kernel.value_and_slope(plant.inertia, plant.inertia.knots[-1])
    lightest = min(float(np.min(plant.inertia.coefficients[3])), last)
    step = _CONTACT_STEP if e.gap_rad > 0 else _COUPLING_STEP
    if plant.rigid:
        moved, fastest = plant.rotor_inertia + lightest, 0.0
    else:
        moved, mobility = plant.rotor_inertia, 1 / plant.rotor_inertia + 1 / lightest
        stiffness = plant.stiffness + 3.0 * max(e.cubic_nm_rad3, 0.0) * _wound(machine, plant, e) ** 2
        stiffness += abs(e.stiffness_share) * plant.stiffness
        stiffness += max((one.steepest for one in curves.values() if one.over == "wind_up"), default=0.0)
        stiffness += e.hysteresis_stiffness_nm_rad if e.hysteresis_nm > 0 else 0.0
        fastest = max(np.sqrt(stiffness * mobility), plant.damping * mobility)
    if e.third_inertia_kgm2 > 0:
        mobility = 1 / e.third_inertia_kgm2 + 1 / (moved if plant.rigid else lightest)
        stiffer = e.third_inertia_kgm2 * e.third_speed_share * top_speed**2
        third = max(np.sqrt((e.third_stiffness_nm_rad + stiffer) * mobility), e.third_damping_nms * mobility)
        fastest = np.hypot(fastest, third)
    fastest = _at_ends(e, fastest, moved if plant.rigid else lightest, step)
    for amount, order, _ in e.cogging_waves:
        fastest = max(fastest, np.sqrt(abs(amount) * order**2 / moved), order * top_speed)
    for amount, order in (
        (e.ripple_share, e.ripple_order),
        (e.stiffness_share, e.stiffness_order),
        (e.kinematic_rad, e.kinematic_order),
        (e.kinematic_second_rad, 2 * e.kinematic_order),
    ):
        if amount != 0:
            fastest = max(fastest, order * top_speed)
    if e.periodic_amplitude_nm != 0:
        fastest = max(fastest, 2 * np.pi * e.periodic_frequency_hz)
    if e.presliding_nm > 0:
        fastest = max(fastest, np.sqrt(e.presliding_stiffness_nm_rad / moved))
    rubbing = (
        plant.motor_friction
        + max(e.viscous_nms + 0.5 * abs(e.viscous_difference_nms), 0.0)
        + 2.0 * abs(e.drag_nms2) * top_speed
    )
    dry = _dry_level(e, share) + e.carried_share * machine.motor.peak_torque_nm
    behind = e.load_coulomb_nm + (curves["load_position"].highest_nm if "load_position" in curves else 0.0)
    behind /= SMOOTHING_RAD_S
    behind += max(e.load_viscous_nms, 0.0) + 2.0 * abs(e.load_drag_nms2) * top_speed
    directed = (one for over, one in curves.items() if over not in (*residual.UNDIRECTED, "load_position"))
    rubbing += (dry + sum(one.highest_nm for one in directed)) / SMOOTHING_RAD_S
    rubbing += share * max(e.viscous_drift_nms, 0.0)
    rubbing = max(rubbing / moved, behind / lightest)
    for pair, plane in planes_of(machine.physics).items():
        if "speed" in pair:
            rubbing += plane.steepest(pair.index("speed")) / lightest
    if e.presliding_nm > 0:
        rubbing = max(rubbing, top_speed * e.presliding_stiffness_nm_rad / e.presliding_nm)
    heating = 1 / e.torque_fade_s if e.torque_fade > 0 else 0.0
    rubbing = max(rubbing, _yielding(machine, plant, e, fastest), heating)
    needed = int(np.ceil(max(period * fastest / step, period * rubbing / _FRICTION_STEP, 1.0)))
    if needed > _MAX_SUBSTEPS:
        raise InputError(
            f'machine "{machine.name}"',
            f"swings at {max(fastest, rubbing) / (2 * np.pi):.3g} Hz, too fast to simulate",
            "Leave out [coupling] where it is rigid, or check stiffness and inertias.",
        )
    return needed


def _at_ends(e: Effects, fastest: float, mass: float, step: float) -> float:
    """The fastest thing, springs at the ends among them (1/s): their torque has a corner as play's has, but only their
    own swing has to be told so finely.
    """
    met = float(np.sqrt(max(e.end_high_nm_rad, e.end_low_nm_rad) / mass))
    return float(max(np.hypot(fastest, met), met * step / _CONTACT_STEP))


def _yielding(machine: Machine, plant: kernel.Plant, e: Effects, fastest: float) -> float:
    """How fast a coupling with hysteresis yields that swings with the motor's peak torque (1/s)."""
    if e.hysteresis_nm <= 0:
        return 0.0
    twist_speed = fastest * machine.motor.peak_torque_nm / plant.stiffness
    return float(twist_speed * e.hysteresis_exponent * e.hysteresis_stiffness_nm_rad / e.hysteresis_nm)


def _dry_level(e: Effects, share: float) -> float:
    """The most that dry friction can be (N·m)."""
    level = max(e.coulomb_positive_nm, e.coulomb_negative_nm) + physics.drift(e, share)
    return max(level + max(e.stribeck_rise_nm, 0.0) + max(e.local_friction_nm, 0.0), 0.0)


def _wound(machine: Machine, plant: kernel.Plant, e: Effects) -> float:
    """How far the motor's peak torque winds a coupling up that stiffens (rad)."""
    if e.cubic_nm_rad3 <= 0:
        return 0.0
    peak = machine.motor.peak_torque_nm
    return float(min(peak / plant.stiffness, np.cbrt(peak / e.cubic_nm_rad3)))
