"""Fast closed-loop simulation of a machine as believed: what a motion will look like before anything moves.

Two masses (or one) with the load's inertia over its angle, under the drive's cascade, sampled and held at
control.sample_rate (method.md (1), A7). Compiled; see `benchmarks/simulation.py` for its speed and error.

All learned terms of the machine (`effects.PHYSICS`) take part; without any, a leaner kernel runs. What it does
not model: encoder counts, speed filter, and a current loop other than `torque_lag`.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.interpolate import CubicSpline

from schwung.drivetrain import kernel, learned, plant
from schwung.drivetrain.effects import check_physics, effects_of
from schwung.drivetrain.inertia import InertiaTable
from schwung.drivetrain.machine import Machine
from schwung.errors import InputError
from schwung.motion import Array, Demand

#: Instants this close to a tick are the tick's own (ticks).
_ON_TICK = 1e-6


@dataclass(frozen=True)
class FeedForward:
    """What the drive adds from the demand by itself; the default is nothing, as in the paper.

    `speed_share`: share (0…1) of the demanded speed given to the speed controller.
    `inertia`: load inertia as the drive has it, a table over the demanded angle or a number (kg·m²). With it
    (J_r + J_l(θ*)) α* + ½ J_l'(θ*) ω*² is added to the torque; None adds no torque at all.
    """

    speed_share: float = 0.0
    inertia: InertiaTable | float | None = None


@dataclass(frozen=True, eq=False)
class Simulated:
    """What the simulated drive would report, arrays (n,) at the instants asked for; angles are absolute."""

    time_s: Array
    demand_position_rad: Array
    position_rad: Array
    speed_rad_s: Array
    torque_nm: Array  # controller, feed-forward and injection together, clipped
    load_position_rad: Array
    load_speed_rad_s: Array
    clipped: NDArray[np.bool_]  # peak torque was not enough somewhere between this sample and the next

    @property
    def following_error_rad(self) -> Array:
        """Demand minus motor angle."""
        return self.demand_position_rad - self.position_rad

    @property
    def peak_following_error_rad(self) -> float:
        """Highest following error, unsigned."""
        return float(np.max(np.abs(self.following_error_rad)))

    @property
    def rms_following_error_rad(self) -> float:
        """Root mean square of the following error over the whole run."""
        return float(np.sqrt(np.mean(self.following_error_rad**2)))

    @property
    def peak_speed_rad_s(self) -> float:
        """Highest motor speed, unsigned."""
        return float(np.max(np.abs(self.speed_rad_s)))

    @property
    def peak_torque_nm(self) -> float:
        """Highest motor torque, unsigned."""
        return float(np.max(np.abs(self.torque_nm)))

    @property
    def lowest_position_rad(self) -> float:
        """Lower end of the motor's travel."""
        return float(np.min(self.position_rad))

    @property
    def highest_position_rad(self) -> float:
        """Upper end of the motor's travel."""
        return float(np.max(self.position_rad))


def simulate(
    machine: Machine,
    demand: Demand,
    time: Array,
    torque_added_nm: Array | None = None,
    *,
    feed_forward: FeedForward | None = None,
    inertia: InertiaTable | float | None = None,
    start_rad: float = 0.0,
    hold_torque_added: bool = False,
    substeps: int | None = None,
    session_share: float = 0.0,
) -> Simulated:
    """Simulate the machine under its drive, from rest at the first demand.

    Args:
        machine: with [control]; its load inertia may be unknown where `inertia` is given.
        demand: at `time`, (n,); straight between samples, as a drive interpolates.
        time: increasing instants (s), (n,); the drive's ticks start at the first.
        torque_added_nm: injected torque at `time`, (n,); straight between samples like a drive's own sine
            generator, or with `hold_torque_added` held, like a torque offset that is sent once per sample.
        feed_forward: what the drive adds by itself; None: nothing.
        inertia: load inertia J_l (kg·m²) in place of the machine's; terms that change the load's inertia change this.
        start_rad: absolute motor angle of demand 0 (`Motion.demand` starts from 0); tables are over absolute
            angles.
        substeps: Runge-Kutta steps per tick; None: as many as coupling and friction need.
        session_share: how far through a session this run is, 0 (first) … 1 (last); only `friction_drift` asks.

    At a tick the drive reads angle and speed and sets the torque that acts until the next tick: the torque
    sample belongs to the interval that begins with it. Angle, speed and torque of the motor are as the drive has
    them, in its loop too: a learned `encoder_eccentricity`, `measurement_delay` or `torque_constant` stands between
    them and the truth. Raises InputError for a machine that cannot be simulated (unknown inertia, no control, terms
    that do not fit it) and for arrays that do not fit.
    """
    control = machine.required_control()
    added = np.zeros_like(time) if torque_added_nm is None else torque_added_nm
    _check_arrays(demand, time, added)
    if substeps is not None and substeps < 1:
        raise InputError("substeps", f"is {substeps}", "Give 1 or more, or leave it out.")
    if not 0.0 <= session_share <= 1.0:
        raise InputError(
            "session_share", f"is {session_share:g}", "Give 0 for the first run … 1 for the last."
        )
    check_physics(machine.physics, rigid=machine.coupling is None)
    period = 1.0 / control.sample_rate_hz
    in_ticks = (time - time[0]) * control.sample_rate_hz
    ticks = time[0] + period * np.arange(int(np.ceil(in_ticks[-1] - _ON_TICK)) + 1)
    at_tick = Demand(
        np.interp(ticks, time, demand.position_rad) + start_rad,
        np.interp(ticks, time, demand.speed_rad_s),
        np.interp(ticks, time, demand.acceleration_rad_s2),
    )
    if hold_torque_added:
        added = added[np.searchsorted(time, ticks + _ON_TICK * period, side="right") - 1]
    else:
        added = np.interp(ticks, time, added)
    inputs = _inputs(machine, at_tick, added, feed_forward or FeedForward())
    body = plant.plant_of(machine, inertia)
    top_speed = float(np.max(np.abs(at_tick.speed_rad_s)))
    cascade = kernel.Cascade(
        control.position_gain_per_s,
        control.speed_gain_nms,
        control.speed_integral_time_s,
        machine.motor.peak_torque_nm,
        period,
        substeps or plant.substeps(machine, body, period, top_speed, session_share),
    )
    if machine.physics:
        known = plant.learned_of(machine, body, ticks, at_tick, session_share)
        rest = plant.learned_rest(known, inputs.position[0])
        states, torques = learned.run_learned(known, cascade, inputs, *rest, float(time[0]))
    else:
        states, torques = kernel.run(body, cascade, inputs, *plant.rest(body, inputs.position[0]))
    if not np.all(np.isfinite(states)):
        raise InputError(
            f'machine "{machine.name}"',
            f"does not stay finite with {cascade.substeps} sub-steps per tick",
            "Leave their number to the simulation.",
        )
    clipped = torques[:, 0] != torques[:, 1]
    reported = _filtered(torques[:, 0], effects_of(machine.physics).torque_filter_s / period)
    tick = np.floor(in_ticks + _ON_TICK).astype(np.int64)  # whose torque acts at each instant
    on_ticks = np.allclose(in_ticks, tick, rtol=0, atol=_ON_TICK)
    states = states[tick] if on_ticks else CubicSpline(ticks, states)(time)
    return Simulated(
        time_s=time,
        demand_position_rad=demand.position_rad + start_rad,
        position_rad=states[:, 0],
        speed_rad_s=states[:, 1],
        torque_nm=reported[tick],
        load_position_rad=states[:, 2],
        load_speed_rad_s=states[:, 3],
        clipped=np.logical_or.reduceat(clipped, tick),
    )


def _filtered(torque: Array, ticks: float) -> Array:
    """What a drive reports of held torques (n,) through a first-order filter of so many ticks; as they are with 0."""
    if ticks <= 0:
        return torque
    decay = float(np.exp(-1.0 / ticks))
    later = np.append(torque[0], torque[:-1])  # what acted until each tick
    from scipy.signal import lfilter  # noqa: PLC0415  (slow to import, and only a filtered torque needs it)

    reported, _ = lfilter([1.0 - decay], [1.0, -decay], later, zi=[decay * torque[0]])
    return np.asarray(reported)


def _check_arrays(demand: Demand, time: Array, torque_added: Array) -> None:
    if time.ndim != 1 or time.size < 2 or not np.all(np.diff(time) > 0):
        raise InputError("time", "does not increase over two samples or more", "Use Motion.time.")
    arrays = {
        "demand.position_rad": demand.position_rad,
        "demand.speed_rad_s": demand.speed_rad_s,
        "demand.acceleration_rad_s2": demand.acceleration_rad_s2,
        "torque_added_nm": torque_added,
    }
    for name, values in arrays.items():
        if values.shape != time.shape or not np.all(np.isfinite(values)):
            raise InputError(name, "is not finite, or not one value per instant", "Sample it at `time`.")


def _inputs(machine: Machine, demand: Demand, added: Array, forward: FeedForward) -> kernel.Inputs:
    """What reaches the drive; the torque added from the demand is the inverse of the rigid machine."""
    rotor, load = machine.motor.inertia_kgm2, forward.inertia
    position, speed, acceleration = demand.position_rad, demand.speed_rad_s, demand.acceleration_rad_s2
    if load is None:
        torque = np.zeros_like(position)
    elif isinstance(load, InertiaTable):
        torque = (rotor + load.at(position)) * acceleration + load.slope_at(position) * speed**2 / 2
    else:
        torque = (rotor + load) * acceleration
    return kernel.Inputs(position, forward.speed_share * speed, torque, added)
