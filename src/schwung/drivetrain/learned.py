"""The compiled inside of the simulation with learned terms: every effect of physics.py in the loop of kernel.py.

Apart from the lean kernel, which stays as fast as it is. The drive commands and reports; the plant obeys a torque
that may be off, clipped or late, and the drive reads an angle that may be off and a speed that may be late.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from schwung.compiled import compiled, inlined
from schwung.drivetrain.effects import Effects
from schwung.drivetrain.fade import faded, heating
from schwung.drivetrain.hysteresis import yielding_rate
from schwung.drivetrain.kernel import Cascade, Curve, Inputs, Plant, command, value_and_slope
from schwung.drivetrain.physics import (
    coupling_torque,
    driven,
    encoder_off,
    load_torque,
    motor_torque,
    stiffness_at,
    third_torque,
    wound_up,
)
from schwung.drivetrain.residual_plane import Sheet, sheet_at
from schwung.motion import Array


class Sided(NamedTuple):
    """Torque (N·m) over a coordinate where the machine moves forward, and where backward."""

    forward: Curve
    backward: Curve


class Curves(NamedTuple):
    """Learned torques that are tables, `drivetrain/residual.py`; over two coordinates `residual_plane.py`."""

    any: bool
    position: Sided
    speed: Sided
    torque: Sided
    run: Sided
    load_position: Sided
    acceleration: Curve
    time_in_motion: Curve
    wind_up: Curve
    any_plane: bool
    position_speed: Sheet
    position_torque: Sheet
    torque_time: Sheet


class Learned(NamedTuple):
    """A plant and what was learned about it; SI. Stiffness, damping and inertia are in the plant already."""

    plant: Plant
    effects: Effects
    load_table: Curve  # learned load torque, beside the plant's own
    curves: Curves
    smoothing: float  # speed within which dry friction changes sign (rad/s)
    leaves_rest: float  # when the motion begins (s)
    share: float  # how far through the session the run is, 0…1


class Masses(NamedTuple):
    """Motor, load, and a third mass behind it: angle (rad) and speed (rad/s); what bent bristles hold, and what yields
    in the coupling (N·m); the motor's heat, 1 where the peak torque lasts."""

    motor_angle: float
    motor_speed: float
    load_angle: float
    load_speed: float
    third_angle: float
    third_speed: float
    bristles: float
    yielding: float
    heat: float


@inlined
def sided(table: Sided, x: float, direction: float) -> float:
    """A learned torque (N·m) at a coordinate, the direction of motion −1…1."""
    if direction >= 0.0:
        return value_and_slope(table.forward, x)[0] * direction
    return -value_and_slope(table.backward, x)[0] * direction


@inlined
def accelerated(curve: Curve, torque: float, inertia: float) -> float:
    """Acceleration a (rad/s²) with inertia·a = torque + curve(a), the curve less steep than that: Newton."""
    a = torque / inertia
    for _ in range(8):
        value, slope = value_and_slope(curve, a)
        a += (torque + value - inertia * a) / max(inertia - slope, 0.1 * inertia)
    return a


@inlined
def _bent(machine: Learned, twist: float) -> float:
    """What a coupling that touches passes on beyond its law, by how far it is wound up (N·m)."""
    if not machine.curves.any:
        return 0.0
    return value_and_slope(machine.curves.wind_up, wound_up(machine.effects, twist))[0]


@inlined
def _rates(machine: Learned, state: Masses, torque: float, time: float) -> Masses:
    """Time derivative of the state: method.md (1), (A7), with everything that was learned."""
    plant, e = machine.plant, machine.effects
    inertia, slope = value_and_slope(plant.inertia, state.load_angle)
    load = value_and_slope(plant.load_torque, state.load_angle)[0]
    load += value_and_slope(machine.load_table, state.load_angle)[0]
    load += load_torque(e, state.load_angle, state.load_speed, time - machine.leaves_rest)
    load -= plant.load_friction * state.load_speed + 0.5 * slope * state.load_speed**2
    third = 0.0
    if e.third_inertia_kgm2 > 0.0:
        passed = third_torque(
            e, state.load_angle - state.third_angle, state.load_speed - state.third_speed, state.load_speed
        )
        load -= passed
        third = passed / e.third_inertia_kgm2
    driving = faded(torque, e.torque_fade, state.heat)
    warming = heating(torque, e.torque_fade_at_nm, e.torque_fade_s, state.heat)
    motor = driving - plant.motor_friction * state.motor_speed - state.bristles
    bending = 0.0
    if e.presliding_nm > 0.0:
        sliding = abs(state.motor_speed) * state.bristles / e.presliding_nm
        bending = e.presliding_stiffness_nm_rad * (state.motor_speed - sliding)
    ahead = float(np.tanh(state.motor_speed / machine.smoothing))
    load_ahead = float(np.tanh(state.load_speed / machine.smoothing))
    load -= e.load_coulomb_nm * load_ahead
    if machine.curves.any:  # taken out here alone: whoever holds them has each of thirty arrays counted
        curves = machine.curves
        motor += sided(curves.position, state.motor_angle, ahead)
        motor += sided(curves.speed, abs(state.motor_speed), ahead)
        motor += sided(curves.torque, abs(torque), ahead)
        motor += sided(curves.run, machine.share, ahead)
        load += sided(curves.load_position, state.load_angle, load_ahead)
        load += value_and_slope(curves.time_in_motion, time - machine.leaves_rest)[0]
    if machine.curves.any_plane:
        curves = machine.curves
        load += sheet_at(curves.position_speed, state.load_angle, state.load_speed)
        motor += sheet_at(curves.position_torque, state.motor_angle, torque)
        motor += sheet_at(curves.torque_time, torque, time - machine.leaves_rest)
    if e.ripple_share != 0.0:
        motor += driving * e.ripple_share * np.sin(e.ripple_order * state.motor_angle + e.ripple_phase_rad)
    motor += motor_torque(
        e,
        state.motor_angle,
        state.motor_speed,
        time,
        e.periodic_phase_rad,
        machine.share,
        machine.smoothing,
    )
    if plant.rigid:
        lost = e.carried_share * ahead * inertia  # |carried| is inertia times |acceleration|
        whole = plant.rotor_inertia + inertia + (lost if motor + load > 0.0 else -lost)
        both = (motor + load) / whole
        if machine.curves.any:
            both = accelerated(machine.curves.acceleration, motor + load, whole)
        return Masses(
            state.motor_speed, both, state.load_speed, both, state.third_speed, third, bending, 0.0, warming
        )
    angle, ratio = driven(e, state.motor_angle)
    twist_speed = ratio * state.motor_speed - state.load_speed
    shaft = coupling_torque(
        e,
        stiffness_at(e, plant.stiffness, state.motor_angle),
        plant.damping,
        angle - state.load_angle,
        twist_speed,
    )
    touches = 1.0 if abs(angle - state.load_angle) >= 0.5 * e.gap_rad else 0.0
    shaft += touches * (state.yielding + _bent(machine, angle - state.load_angle))
    load += shaft
    return Masses(
        state.motor_speed,
        (motor - ratio * shaft - e.carried_share * abs(shaft) * ahead) / plant.rotor_inertia,
        state.load_speed,
        accelerated(machine.curves.acceleration, load, inertia) if machine.curves.any else load / inertia,
        state.third_speed,
        third,
        bending,
        yielding_rate(
            e.hysteresis_nm,
            e.hysteresis_stiffness_nm_rad,
            e.hysteresis_exponent,
            state.yielding,
            touches * twist_speed,
        ),
        warming,
    )


@inlined
def _moved(state: Masses, rates: Masses, by: float) -> Masses:
    return Masses(
        state.motor_angle + by * rates.motor_angle,
        state.motor_speed + by * rates.motor_speed,
        state.load_angle + by * rates.load_angle,
        state.load_speed + by * rates.load_speed,
        state.third_angle + by * rates.third_angle,
        state.third_speed + by * rates.third_speed,
        state.bristles + by * rates.bristles,
        state.yielding + by * rates.yielding,
        state.heat + by * rates.heat,
    )


#: Of Newton's method, at most: it doubles the digits each time.
_REPORTED_STEPS = 50


@inlined
def shaft_torque(e: Effects, reported: float) -> float:
    """What a torque that the drive reports makes of itself on the shaft, once its current loop has settled (N·m)."""
    drop = e.torque_drop * (abs(reported) / e.torque_drop_at_nm) ** e.torque_drop_order
    true = (e.torque_gain - drop) * reported
    return float(min(max(true, -e.torque_limit_nm), e.torque_limit_nm))


def reported_torque(e: Effects, on_shaft: float) -> float:
    """The torque (N·m) that a drive has to report for one on the shaft; as near as it comes."""
    gain, order = e.torque_gain, e.torque_drop_order
    wanted = abs(on_shaft) / gain
    if e.torque_drop == 0.0:
        return on_shaft / gain
    found, most = wanted, e.torque_drop_at_nm * (gain / e.torque_drop / (order + 1.0)) ** (1.0 / order)
    for _ in range(_REPORTED_STEPS):  # Newton's, which comes from below: what is on the shaft bends down
        drop = e.torque_drop * (found / e.torque_drop_at_nm) ** order
        slope = gain - (order + 1.0) * drop
        if found >= most or slope <= 0.0:
            break
        found += (gain * wanted - (gain - drop) * found) / slope
    return float(np.sign(on_shaft) * min(found, most))


@compiled
def _advance(
    machine: Learned, state: Masses, wanted: float, acting: float, time: float, step: float, substeps: int
) -> tuple[Masses, float]:
    """State and shaft torque after so many steps (s) towards the shaft torque `wanted`: classical Runge-Kutta.

    The lag is first-order and solved exactly. Runge-Kutta weighs a torque at its stages as Simpson's rule does: what
    the middle ones get makes that the true mean over the step, however short the lag is beside it.
    """
    lag = machine.effects.torque_lag_s
    behind = acting - wanted if lag > 0.0 else 0.0
    decay = np.exp(-step / lag) if lag > 0.0 else 0.0
    middle = (6.0 * (1.0 - decay) * lag / step - 1.0 - decay) / 4.0
    for i in range(substeps):
        begin = time + i * step
        halfway = wanted + behind * middle
        k1 = _rates(machine, state, wanted + behind, begin)
        k2 = _rates(machine, _moved(state, k1, step / 2), halfway, begin + step / 2)
        k3 = _rates(machine, _moved(state, k2, step / 2), halfway, begin + step / 2)
        behind *= decay
        k4 = _rates(machine, _moved(state, k3, step), wanted + behind, begin + step)
        state = _moved(state, k1, step / 6)
        state = _moved(state, k2, step / 3)
        state = _moved(state, k3, step / 3)
        state = _moved(state, k4, step / 6)
    return state, wanted + behind


@compiled
def _late(speeds: Array, tick: int, ticks_late: float) -> float:
    """A speed so many ticks ago, straight between ticks; before the first it stood as then."""
    at = max(tick - ticks_late, 0.0)
    before = int(at)
    if before >= tick:
        return float(speeds[tick])
    share = at - before
    return float((1.0 - share) * speeds[before] + share * speeds[before + 1])


@compiled
def run_learned(
    machine: Learned, cascade: Cascade, inputs: Inputs, state: Masses, held_torque: float, begin: float
) -> tuple[Array, Array]:
    """Closed loop over n ticks of the drive from the time `begin` (s); as `kernel.run`.

    States (n, 4) are motor angle and speed as the drive reads them, then the load's as they are.
    """
    e = machine.effects
    n = inputs.position.size
    states, torques, speeds = np.empty((n, 4)), np.empty((n, 2)), np.empty(n)
    integral, acting = held_torque, shaft_torque(e, held_torque)
    step, ticks_late = cascade.period / cascade.substeps, e.speed_delay_s / cascade.period
    for i in range(n):
        off, share = encoder_off(e, state.motor_angle)
        angle = state.motor_angle + off
        speeds[i] = state.motor_speed * (1.0 + share)
        speed = _late(speeds, i, ticks_late)
        torque, wanted, integral = command(cascade, inputs, i, angle, speed, integral)
        states[i, 0], states[i, 1] = angle, speed
        states[i, 2], states[i, 3] = state.load_angle, state.load_speed
        torques[i, 0], torques[i, 1] = torque, wanted
        time = begin + i * cascade.period
        state, acting = _advance(
            machine, state, shaft_torque(e, torque), acting, time, step, cascade.substeps
        )
    return states, torques


@compiled
def run_driven(
    machine: Learned, torque: Array, state: Masses, begin: float, period: float, substeps: int
) -> Array:
    """Open loop: motor angle and speed (n, 2) at n instants, each reported torque (n,) held until the next one."""
    states = np.empty((torque.size, 2))
    acting = shaft_torque(machine.effects, torque[0])
    for i in range(torque.size):
        states[i, 0], states[i, 1] = state.motor_angle, state.motor_speed
        wanted = shaft_torque(machine.effects, torque[i])
        state, acting = _advance(
            machine, state, wanted, acting, begin + i * period, period / substeps, substeps
        )
    return states
