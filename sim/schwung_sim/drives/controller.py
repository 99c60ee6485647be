"""What the drive computes at 8 kHz, compiled: demand, cascade, feed-forward, generator, encoder, trace.

    T_c = K_ps (e + ∫e/T_n)      e = K_pp (θ* − θ) + ω*·feed-forward − ω
    T_f = (J_r + J_l(θ*)) a* + ½ J_l'(θ*) ω*²

One tick is: control law on what was sampled last, plant, sample. After a tick the reported angle belongs to
its end, speed (difference of two angles) and torque (held over the tick) to its middle. Speed and torque then
pass one and the same filter, so that they stay aligned, whatever its time constant.
"""

from __future__ import annotations

from typing import Any

import numpy as np

from schwung_sim.compiled import compiled
from schwung_sim.plants.profile import read_profile
from schwung_sim.plants.two_mass import TICK_S, two_mass_tick

_REALS = (
    # settings
    "position_gain_1_s", "speed_gain_nms_rad", "speed_integral_time_s", "speed_feed_forward",
    "scalar_inertia_kgm2", "rotor_inertia_kgm2", "torque_limit_nm",
    "filter_share", "count_rad", "count_offset", "eccentricity_rad", "speed_delay_ticks",
    "generator_amplitude_nm", "generator_frequency_hz", "generator_phase_rad",
    "standstill_speed_rad_s", "target_window_rad",
    # demand
    "segment_time_s", "extrapolate_s", "blend_rad", "final_rad", "rest_s",
    "demand_rad", "demand_rad_s", "demand_rad_s2",
    "setpoint_rad", "setpoint_rad_s", "before_rad", "before_rad_s",
    # law, generator, measurement
    "integral_nm", "offset_from_nm", "offset_to_nm", "offset_time_s", "offset_over_s",
    "torque_nm", "generator_time_s",
    "position_rad", "speed_rad_s", "reported_speed_rad_s", "reported_torque_nm", "standstill_s",
    "in_window_s",
    # holding brake: what it holds, 0 where it is open, and the angle at which it does
    "brake_nm", "brake_rad",
)  # fmt: skip
_WHOLE = (
    "energised", "feed_forward_mode", "generator_control", "generator_on", "segment", "segments", "cyclic",
    "start_requested", "motion_started", "limited", "counts", "history_at",
    "trace_status", "trace_divider", "trace_wait", "trace_length", "trace_at",
)  # fmt: skip

#: Settings and memory of the controller.
CONTROL = np.dtype([*((n, np.float64) for n in _REALS), *((n, np.int64) for n in _WHOLE)], align=True)

#: A demand is up to four pieces of constant acceleration: rows of duration, position, speed, acceleration.
SEGMENTS_SHAPE = (4, 4)
#: Past speeds (a ring), enough for the longest concealed delay.
HISTORY = 1024
#: What a row of the trace holds: counts, speed, torque, torque added from now on, demanded angle.
TRACE_COLUMNS = 5
#: Added when cycles since the last setpoint are counted: one that is 0.6 of a cycle late follows one that was lost.
_LATENESS = 0.4
#: A demand that has rested this long and moves again starts a new motion (where there is no start command): the
#: strokes of one run are one motion, and it begins where the demand leaves rest.
REST_BETWEEN_MOTIONS_S = 0.15
#: A closed holding brake, as the motor feels it: a stiff and well damped spring that slips beyond what it holds.
BRAKE_STIFFNESS_NM_RAD, BRAKE_DAMPING_NMS = 5000.0, 10.0


@compiled
def update_demand(c: Any, segments: Any) -> None:
    """Evaluate the demand at the present instant; past its last segment it rests at `final_rad`."""
    while c.segment < c.segments - 1 and c.segment_time_s >= segments[c.segment, 0] - 1e-9:
        c.segment_time_s -= segments[c.segment, 0]
        c.segment += 1
    c.demand_rad, c.demand_rad_s, c.demand_rad_s2 = c.final_rad, 0.0, 0.0
    if c.segment >= c.segments:
        return
    duration, start, speed, acceleration = segments[c.segment]
    late = c.segment_time_s - duration
    if late > c.extrapolate_s + 1e-9:
        c.segment = c.segments
        return
    t = min(c.segment_time_s, duration)
    c.demand_rad_s = speed + acceleration * t
    c.demand_rad = start + speed * t + 0.5 * acceleration * t**2
    if late < -1e-9:
        c.demand_rad_s2 = acceleration
    c.demand_rad += c.demand_rad_s * max(late, 0.0) + c.blend_rad * (1.0 - t / duration)


@compiled
def follow_setpoint(cs: Any, segments: Any, position: float, over_s: float) -> None:
    """A cyclic setpoint: the parabola that reaches it after one cycle, see ServoAxis.set_target."""
    c = cs[0]
    present, elapsed = c.demand_rad, c.segment_time_s
    cycles = 1
    if c.cyclic == 0 or c.segment >= c.segments:
        c.before_rad, c.before_rad_s = present, 0.0  # from rest
    elif elapsed > 0.5 * TICK_S:
        c.before_rad, c.before_rad_s = c.setpoint_rad, c.setpoint_rad_s
        cycles = max(int(elapsed / over_s + _LATENESS), 1)
    slope = (position - c.before_rad) / (over_s * cycles)
    acceleration = (slope - c.before_rad_s) / over_s
    start = position - slope * over_s
    segments[0] = over_s, start, slope - 0.5 * acceleration * over_s, acceleration
    c.cyclic, c.setpoint_rad, c.setpoint_rad_s = 1, position, slope
    c.segment, c.segments, c.segment_time_s = 0, 1, 0.0
    c.final_rad, c.extrapolate_s, c.blend_rad = position, over_s, present - start
    update_demand(c, segments)


@compiled
def add_torque(cs: Any, torque: float, interpolate: bool) -> None:
    """Torque added from outside from now on: over a cycle on a straight line, or at once."""
    c = cs[0]
    share = min(c.offset_time_s / c.offset_over_s, 1.0) if c.offset_over_s > 0.0 else 1.0
    c.offset_from_nm += share * (c.offset_to_nm - c.offset_from_nm)
    c.offset_to_nm, c.offset_time_s = torque, 0.0
    c.offset_over_s = c.extrapolate_s if interpolate and c.cyclic != 0 else 0.0


@compiled
def _notice_motion(c: Any) -> None:
    """A motion starts with a start command, or where the demand leaves a rest; armed things start with it."""
    c.motion_started = 0
    moving = c.demand_rad_s != 0.0
    if c.start_requested != 0 or (moving and c.rest_s >= REST_BETWEEN_MOTIONS_S):
        c.start_requested = 0
        c.motion_started = 1
        if c.generator_control == 1:
            c.generator_control = 2
        if c.trace_status == 1:
            c.trace_status, c.trace_at, c.trace_wait = 2, 0, 0
    c.rest_s = 0.0 if moving else c.rest_s + TICK_S


@compiled
def _generator(c: Any) -> Any:
    """The sine generator: its time counts from when it is switched on."""
    if c.generator_control != 2:
        c.generator_on = 0
        return 0.0
    if c.generator_on == 0:
        c.generator_on, c.generator_time_s = 1, 0.0
    angle = 2 * np.pi * c.generator_frequency_hz * c.generator_time_s + c.generator_phase_rad
    c.generator_time_s += TICK_S
    return c.generator_amplitude_nm * np.sin(angle)


@compiled
def _torque_offset(c: Any) -> Any:
    """The torque added from outside: on a straight line to its last value, as the middle of the tick has it."""
    c.offset_time_s += TICK_S
    share = 1.0 if c.offset_over_s <= 0.0 else min((c.offset_time_s - 0.5 * TICK_S) / c.offset_over_s, 1.0)
    return c.offset_from_nm + share * (c.offset_to_nm - c.offset_from_nm)


@compiled
def _feed_forward(c: Any, inertia: Any) -> Any:
    """Torque that the demanded motion takes; the rotor's inertia is always part of it."""
    if c.feed_forward_mode == 0:
        return 0.0
    j, slope = c.scalar_inertia_kgm2, 0.0
    if c.feed_forward_mode == 2:
        j, slope = read_profile(inertia, c.demand_rad)
    return (c.rotor_inertia_kgm2 + j) * c.demand_rad_s2 + 0.5 * slope * c.demand_rad_s**2


@compiled
def _trace(c: Any, trace: Any, added: float) -> None:
    """Store every divider-th sample of a running trace, the first at the trigger: see TRACE_COLUMNS."""
    if c.trace_status != 2:
        return
    if c.trace_wait == 0:
        trace[c.trace_at, 0] = c.counts
        trace[c.trace_at, 1] = c.reported_speed_rad_s
        trace[c.trace_at, 2] = c.reported_torque_nm
        trace[c.trace_at, 3] = added
        trace[c.trace_at, 4] = c.demand_rad
        c.trace_at += 1
        c.trace_wait = c.trace_divider
        if c.trace_at >= c.trace_length:
            c.trace_status = 3
    c.trace_wait -= 1


@compiled
def _brake(c: Any) -> Any:
    """Torque of the closed holding brake on the motor's shaft."""
    held = BRAKE_STIFFNESS_NM_RAD * (c.brake_rad - c.position_rad) - BRAKE_DAMPING_NMS * c.speed_rad_s
    torque = min(max(held, -c.brake_nm), c.brake_nm)
    if torque != held:  # it slips, and will hold where it comes to rest
        c.brake_rad = c.position_rad + torque / BRAKE_STIFFNESS_NM_RAD
    return torque


@compiled
def control_law(c: Any, segments: Any, inertia: Any, trace: Any) -> Any:
    """Torque (N·m) on the motor for the tick that begins now: the controller's, and that of a closed brake.

    The controller integrates only where that does not push into the limit.
    """
    update_demand(c, segments)
    _notice_motion(c)
    added = _generator(c) + _torque_offset(c)
    _trace(c, trace, added)
    c.limited = 0
    if c.energised == 0:
        c.torque_nm, c.integral_nm = 0.0, 0.0
        return _brake(c) if c.brake_nm > 0.0 else 0.0
    error = c.position_gain_1_s * (c.demand_rad - c.position_rad)
    error += c.speed_feed_forward * c.demand_rad_s - c.speed_rad_s
    torque = c.speed_gain_nms_rad * error + c.integral_nm
    torque += _feed_forward(c, inertia) + added
    c.torque_nm = min(max(torque, -c.torque_limit_nm), c.torque_limit_nm)
    if c.torque_nm != torque:
        c.limited = 1
    if c.speed_integral_time_s > 0.0 and (c.limited == 0 or error * torque < 0.0):
        c.integral_nm += c.speed_gain_nms_rad * error * TICK_S / c.speed_integral_time_s
    return c.torque_nm + _brake(c) if c.brake_nm > 0.0 else c.torque_nm


@compiled
def sample(c: Any, segments: Any, history: Any, angle: float) -> None:
    """At the end of a tick: read the encoder, filter, let the demand's time pass."""
    before = c.position_rad
    seen = angle + c.eccentricity_rad * np.sin(angle)
    c.counts = int(np.floor(seen / c.count_rad + c.count_offset))
    c.position_rad = c.counts * c.count_rad
    c.speed_rad_s += c.filter_share * ((c.position_rad - before) / TICK_S - c.speed_rad_s)
    c.reported_torque_nm += c.filter_share * (c.torque_nm - c.reported_torque_nm)
    c.history_at = (c.history_at + 1) % HISTORY
    history[c.history_at] = c.speed_rad_s
    whole = int(np.floor(c.speed_delay_ticks))
    share = c.speed_delay_ticks - whole
    newer, older = history[(c.history_at - whole) % HISTORY], history[(c.history_at - whole - 1) % HISTORY]
    c.reported_speed_rad_s = (1.0 - share) * newer + share * older
    c.segment_time_s += TICK_S
    if c.energised == 0:  # without power the demand follows the axis
        c.segments, c.final_rad = 0, c.position_rad
    update_demand(c, segments)
    c.standstill_s = c.standstill_s + TICK_S if abs(c.speed_rad_s) < c.standstill_speed_rad_s else 0.0
    arrived = c.segment >= c.segments and abs(c.final_rad - c.position_rad) < c.target_window_rad
    c.in_window_s = c.in_window_s + TICK_S if arrived else 0.0


@compiled
def update_demand_tick(cs: Any, segments: Any) -> None:
    """The demand at this instant, after a new plan."""
    update_demand(cs[0], segments)


@compiled
def two_mass_loop(ticks: int, cs: Any, memory: Any, machine: Any) -> None:
    """Closed loop around the two-mass machine, whole ticks without leaving compiled code."""
    segments, inertia, history, trace = memory
    ps, ss, tables = machine
    c, p, s = cs[0], ps[0], ss[0]
    for _ in range(ticks):
        torque = control_law(c, segments, inertia, trace)
        if c.motion_started != 0:
            s.motion_time_s = 0.0
            s.motions += 1.0
        two_mass_tick(p, s, tables, torque)
        sample(c, segments, history, s.motor_rad)
