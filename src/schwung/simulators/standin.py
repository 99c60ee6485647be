"""A machine that stands in for an FMU: two masses (or one) fitted to what the FMU did while it was played.

Nobody can look into an FMU, but anybody can measure it, and without noise: played along the recorded motions and with
an injected multisine beside them, it shows its torque T and its motion. Fitted are J_r, k, d, friction, and J_l and T_l
over the angle (cubic splines through nodes), such that the torque that these need for the motion,

    J_r α + b ω + F(ω) + C(motion; k, d, J_l, T_l)        C: the coupling's torque, needed.py

is the FMU's, within the band. The stand-in need not be exact: it says how named physics would show, while what the FMU
asks beyond it is taken off the recording as it is (`belief.py`).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import lru_cache
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.interpolate import CubicSpline
from scipy.optimize import least_squares

from schwung.drivetrain.inertia import InertiaTable, LoadTorqueTable
from schwung.drivetrain.machine import Coupling, Load, Machine, Motor
from schwung.drivetrain.physics_term import PhysicsTerm
from schwung.errors import InputError
from schwung.motion import Array
from schwung.simulators.impedance import Response, two_masses_of
from schwung.simulators.needed import MotorMotion, TwoMasses, can_follow, needed
from schwung.simulators.playing import Played
from schwung.simulators.spectrum import Spectrum

#: The band that is fitted (Hz), and at most this share of the rate at which the FMU was played.
BAND_HZ, BAND_SHARE = 300.0, 0.1
#: As in `followed.py`: the motion keeps more than the band, and the grid more than that.
_MOTION_BAND, _GRID = 3.0, 12.0
#: Slower than this share of the highest speed, dry friction may hold any torque.
_STANDSTILL = 0.02
#: Nodes of the inertia at first, per rad on the way, at least and most; and of the load torque.
_NODES_PER_RAD, _FEWEST, _MOST, _TORQUE_NODES = 6.0, 6, 36, 6
#: Nodes are doubled while that leaves less than the first share of what was left, and more than the second of all the
#: torque is left (the twin takes it off again); up to so many. Fitted at once, so many nodes find no way to where the
#: phase of the swinging is right.
_STILL_BETTER, _NOTHING_LEFT, _FINEST = 0.8, 5e-3, 300
#: How much better two masses have to be than one.
_WORTH = 0.5
#: Of a rigid machine all of the inertia is the load's, but for this share.
_ROTOR_OF_RIGID = 0.01
#: What a bend of the nodes by 1 costs, over a misfit of all the torque: a weak word for what is hardly visited; a
#: tenth of it is the cost of load torque and friction as such.
_SMOOTH = 5e-3
#: Lowest line of a response (Hz).
_LOWEST_HZ = 8.0
#: Steps of a fit at most.
_MOST_STEPS = 25
#: Dry friction above this share of the peak torque is told in the machine.
_RUBS = 0.01
#: The motor's peak torque over the highest that the session needed: the FMU says nothing about it.
_PEAK = 1.25
#: Places of what has one value: logarithms of J_r, k, d; viscous and dry friction.
_ROTOR, _STIFFNESS, _DAMPER, _VISCOUS, _DRY, _LONE = range(6)


@dataclass(frozen=True, eq=False)
class StandIn:
    """The machine, and how much of the FMU's torque it leaves out (RMS, N·m) within the band."""

    machine: Machine
    left_out_nm: float
    torque_nm: float  # RMS of all, for comparison
    band_hz: float


@dataclass(frozen=True, eq=False)
class _Run:
    motion: MotorMotion
    torque_nm: Array
    spectrum: Spectrum
    low: Array
    valid: NDArray[np.bool_]


@dataclass(frozen=True, eq=False)
class _Shape:
    """Where the parameters stand: rotor, stiffness, damping (logarithms), friction, nodes of inertia and torque."""

    nodes_rad: Array
    torque_nodes_rad: Array
    rigid: bool

    @property
    def inertia(self) -> slice:
        return slice(_LONE, _LONE + self.nodes_rad.size)

    @property
    def torque(self) -> slice:
        first = _LONE + self.nodes_rad.size
        return slice(first, first + self.torque_nodes_rad.size)

    @property
    def fitted(self) -> NDArray[np.intp]:
        """Indices of what is fitted."""
        return np.arange(_VISCOUS if self.rigid else _ROTOR, self.torque.stop)

    def finer(self) -> _Shape:
        """With a node between every two."""
        grids = (self.nodes_rad, self.torque_nodes_rad)
        nodes, torque_nodes = (np.linspace(grid[0], grid[-1], 2 * grid.size - 1) for grid in grids)
        return _Shape(nodes, torque_nodes, self.rigid)

    def moved(self, x: Array, to: _Shape) -> Array:
        """The same parameters on other nodes."""
        y = np.zeros(to.torque.stop)
        y[:_LONE] = x[:_LONE]
        y[to.inertia] = CubicSpline(self.nodes_rad, x[self.inertia])(to.nodes_rad)
        y[to.torque] = CubicSpline(self.torque_nodes_rad, x[self.torque])(to.torque_nodes_rad)
        return y

    def masses(self, x: Array) -> TwoMasses:
        """The parameters as equations."""
        inertia = np.tensordot(_splines(tuple(self.nodes_rad)), _exp(x[self.inertia]), axes=1)
        torque = np.tensordot(_splines(tuple(self.torque_nodes_rad)), x[self.torque], axes=1)
        rotor, stiffness, damping = _exp(x[:_VISCOUS])
        return TwoMasses(
            rotor_inertia=float(rotor),
            motor_friction=float(x[_VISCOUS]),
            load_friction=0.0,
            stiffness=0.0 if self.rigid else float(stiffness),
            damping=0.0 if self.rigid else float(damping),
            rigid=self.rigid,
            inertia_knots=self.nodes_rad,
            inertia_coefficients=np.ascontiguousarray(inertia),
            torque_knots=self.torque_nodes_rad,
            torque_coefficients=np.ascontiguousarray(torque),
        )


def _exp(logarithms: Array) -> Array:
    """Values of logarithms, which a step of the fit may throw far off."""
    return np.asarray(np.exp(np.clip(logarithms, -60.0, 60.0)))


@lru_cache(8)
def _splines(nodes_rad: tuple[float, ...]) -> Array:
    """Coefficients of the cubic spline through values at the nodes, per value: (4, n − 1, n)."""
    return np.ascontiguousarray(CubicSpline(nodes_rad, np.eye(len(nodes_rad))).c)


def stand_in(followed: Sequence[Played], probed: Sequence[Played], name: str, *, held: bool) -> StandIn:
    """Fit the machine to motions as recorded and to some that were shaken besides.

    `held`: the torque was held over each step, as of a forward FMU.

    Raises InputError where the FMU did nothing that could be measured.
    """
    played = [*followed, *probed]
    step = played[0].job.step_s
    band = min(BAND_HZ, BAND_SHARE / step)
    runs = [_run(one, band, held) for one in played]
    low, high = _visited(runs)
    nodes = int(np.clip(round(_NODES_PER_RAD * (high - low)), _FEWEST, _MOST))
    rigid = _Shape(np.linspace(low, high, nodes), np.linspace(low, high, _TORQUE_NODES), rigid=True)
    flexible = replace(rigid, rigid=False)
    one_mass = _level(rigid, np.log(_first(runs)))
    two_masses = _level(flexible, two_masses_of(_response(runs[: len(probed)], runs[len(followed) :])))
    fits = [_refined(runs, rigid, one_mass), _refined(runs, flexible, two_masses)]
    left = [_rms(runs, shape, x) for shape, x in fits]
    best, found = fits[1] if left[1] < _WORTH * left[0] else fits[0]
    whole = _torque_rms(runs)
    peak = _PEAK * max(float(np.max(np.abs(one.job.torque_nm))) for one in played)
    return StandIn(_machine(best, found, name, peak), _rms(runs, best, found), whole, band)


def _run(played: Played, band_hz: float, held: bool) -> _Run:
    """One run on the grid, its motion and torque within their bands."""
    n, step = played.torque_nm.size, played.job.step_s
    fine = Spectrum(n, 1 / step, 4 / band_hz)
    every = max(1, int(1 / (step * _GRID * band_hz)))
    wide = fine.low_pass(_MOTION_BAND * band_hz)
    at_instants = np.exp(-0.5 * fine.omega * step)
    if held:
        at_instants = at_instants * np.sinc(fine.frequency_hz * step)
    torque = fine.apply(played.torque_nm, fine.low_pass(band_hz) * at_instants)
    speed = fine.apply(played.speed_rad_s[:n], wide)
    motion = MotorMotion(
        np.ascontiguousarray(fine.apply(played.angle_rad[:n], wide)[::every]),
        np.ascontiguousarray(speed[::every]),
        np.ascontiguousarray(fine.apply(played.speed_rad_s[:n], wide * fine.omega, "slope")[::every]),
        every * step,
    )
    fast = np.abs(motion.speed) > _STANDSTILL * max(float(np.max(np.abs(motion.speed))), 1e-12)
    reach = max(1, round(1.5 / (band_hz * motion.step)))
    near = np.convolve(~fast, np.ones(2 * reach + 1), "same") > 0.5
    valid = ~near
    valid[:reach] = valid[-reach:] = False
    grid = Spectrum(motion.angle.size, 1 / motion.step, 4 / band_hz)
    return _Run(motion, torque[::every], grid, grid.low_pass(band_hz), valid)


def _visited(runs: Sequence[_Run]) -> tuple[float, float]:
    angles = np.concatenate([run.motion.angle for run in runs])
    low, high = float(angles.min()), float(angles.max())
    if not any(run.valid.any() for run in runs) or high - low < 1e-9:
        raise InputError(
            "the FMU",
            "does not move under the recorded torque",
            "Check the variables, units and signs of the map.",
        )
    return low, high


def _residuals(run: _Run, of: TwoMasses, dry_nm: float) -> Array:
    """The FMU's torque minus what the machine needs, within the band, (n,); nothing where that is not compared."""
    motion = run.motion
    if np.min(of.inertia_coefficients[3]) <= 0 or not can_follow(of, motion.step):
        return np.full(run.torque_nm.size, 1e3 * float(np.max(np.abs(run.torque_nm))))
    asked = needed(of, motion) + dry_nm * np.sign(motion.speed)
    return np.where(run.valid, run.torque_nm - run.spectrum.apply(asked, run.low), 0.0)


def _rms(runs: Sequence[_Run], shape: _Shape, x: Array) -> float:
    masses, dry = shape.masses(x), float(x[_DRY])
    squares = sum(float(np.sum(_residuals(run, masses, dry) ** 2)) for run in runs)
    return float(np.sqrt(squares / max(sum(int(run.valid.sum()) for run in runs), 1)))


def _first(runs: Sequence[_Run]) -> float:
    """Torque over acceleration (kg·m²). Raises InputError where that is no inertia."""
    torque = np.concatenate([run.torque_nm[run.valid] for run in runs])
    alpha = np.concatenate([run.motion.acceleration[run.valid] for run in runs])
    omega = np.concatenate([run.motion.speed[run.valid] for run in runs])
    columns = np.column_stack([alpha, omega, np.sign(omega)])
    inertia = float(np.linalg.lstsq(columns, torque, rcond=None)[0][0])
    if not inertia > 0:
        raise InputError(
            "the FMU",
            "asks for less torque the more it is accelerated",
            "Check the signs of torque and motion in the map: one of them has to be -1.",
        )
    return inertia


def _response(plain: Sequence[_Run], shaken: Sequence[_Run]) -> Response:
    """Torque over speed of the difference between a motion and the same one shaken: friction and load torque cancel."""
    band = plain[0].spectrum.rate_hz / _GRID
    longest = max(int(run.valid.sum()) for run in plain)
    size = 1 << (2 * longest - 1).bit_length()
    frequency = np.fft.rfftfreq(size, plain[0].motion.step)
    lines = (frequency > _LOWEST_HZ) & (frequency < 0.9 * band)
    cross, power = np.zeros(int(lines.sum()), complex), np.zeros(int(lines.sum()))
    for calm, other in zip(plain, shaken, strict=True):
        moving = np.flatnonzero(calm.valid)
        if moving.size < 8:
            continue
        part = slice(int(moving[0]), int(moving[-1]) + 1)
        window = np.hanning(part.stop - part.start)
        torque = np.fft.rfft(window * (other.torque_nm - calm.torque_nm)[part], size)[lines]
        speed = np.fft.rfft(window * (other.motion.speed - calm.motion.speed)[part], size)[lines]
        cross += torque * np.conj(speed)
        power += np.abs(speed) ** 2
    impedance = np.asarray(cross / np.maximum(power, 1e-300), dtype=complex)
    return Response(np.asarray(frequency[lines], dtype=float), impedance, power)


def _level(shape: _Shape, logarithms: Array | np.floating[Any]) -> Array:
    """Parameters of a machine with one inertia at all angles: of all its mass, or of J_r, k, d and J_l."""
    x = np.zeros(shape.torque.stop)
    if shape.rigid:
        x[_ROTOR] = np.log(_ROTOR_OF_RIGID) + logarithms
        x[shape.inertia] = logarithms
    else:
        values = np.asarray(logarithms)
        x[: _DAMPER + 1], x[shape.inertia] = values[: _DAMPER + 1], values[_DAMPER + 1]
    return x


def _refined(runs: Sequence[_Run], shape: _Shape, start: Array) -> tuple[_Shape, Array]:
    """A fit with as many nodes as the FMU's curves need, from a start with few."""
    enough = _NOTHING_LEFT * _torque_rms(runs)
    found = _fit(runs, shape, start)
    left = _rms(runs, shape, found)
    while left > enough and 2 * shape.nodes_rad.size <= _FINEST:
        finer = shape.finer()
        better = _fit(runs, finer, shape.moved(found, finer))
        before, left = left, _rms(runs, finer, better)
        if left >= before:
            break
        shape, found = finer, better
        if left > _STILL_BETTER * before:
            break
    return shape, found


def _torque_rms(runs: Sequence[_Run]) -> float:
    torque = np.concatenate([run.torque_nm[run.valid] for run in runs])
    return float(np.sqrt(np.mean(torque**2)))


def _fit(runs: Sequence[_Run], shape: _Shape, start: Array) -> Array:
    """The parameters that leave least, from a start."""
    free = shape.fitted
    size = max(float(np.sqrt(np.mean(np.concatenate([run.torque_nm for run in runs]) ** 2))), 1e-12)

    def whole(values: Array) -> Array:
        x = start.copy()
        x[free] = values
        return x

    def cost(values: Array) -> Array:
        x = whole(values)
        masses, dry = shape.masses(x), float(x[_DRY])
        left = np.concatenate([_residuals(run, masses, dry)[run.valid] for run in runs])
        bends = (np.diff(x[shape.inertia], 2), np.diff(x[shape.torque], 2) / size)
        ridge = x[[_DRY, *range(shape.torque.start, shape.torque.stop)]] / size
        weak = [_SMOOTH * bend for bend in bends]
        return np.concatenate([left / (size * np.sqrt(left.size)), *weak, 0.1 * _SMOOTH * ridge])

    scale = np.where(np.arange(start.size) < _VISCOUS, 1.0, size)
    scale[shape.inertia] = 0.3
    done = least_squares(
        cost, start[free], method="lm", x_scale=scale[free], max_nfev=_MOST_STEPS, ftol=1e-5, xtol=1e-6
    )
    return whole(done.x)


def _machine(shape: _Shape, x: Array, name: str, peak_nm: float) -> Machine:
    masses = shape.masses(x)
    angle = np.linspace(shape.nodes_rad[0], shape.nodes_rad[-1], max(201, 4 * shape.nodes_rad.size - 3))
    inertia = np.maximum(CubicSpline(shape.nodes_rad, _exp(x[shape.inertia]))(angle), 1e-9)
    torque = CubicSpline(shape.torque_nodes_rad, x[shape.torque])(angle)
    dry = float(x[_DRY])
    rubs = PhysicsTerm.model_validate({"name": "coulomb_friction", "torque_nm": dry})
    return Machine(
        name=name,
        motor=Motor(
            inertia_kgm2=masses.rotor_inertia,
            viscous_friction_nms=max(masses.motor_friction, 0.0),
            peak_torque_nm=peak_nm,
        ),
        coupling=None
        if shape.rigid
        else Coupling(stiffness_nm_rad=masses.stiffness, damping_nms=masses.damping),
        load=Load(
            viscous_friction_nms=0.0,
            inertia_table=InertiaTable(angle, inertia),
            torque_table=LoadTorqueTable(angle, torque),
        ),
        physics=(rubs,) if dry > _RUBS * peak_nm else (),
    )
