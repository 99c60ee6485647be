"""Machines by chance from another hand: a second generator, to hold the bands against what the first has in common.

Written from docs/files.md and the equations (A1…A7) alone; of the tool it takes only the values that a session is made
of, of the virtual machine room nothing. Two masses by Runge and Kutta's fourth order in quarters of a control tick; a
cascade at 8 kHz whose torque, injection included, stands from one tick to the next; logs of every tick, of every
second, fourth or eighth. Curves of inertia: a four-bar linkage, a cam that rises and dwells, waves of orders that no
turn repeats, a toggle lever, a constant. Drives: speed from counted angles or from a sensor, a filter in the loop or
none, and reports of speed and torque that are late by whole ticks, each by its own number.

`draw_stranger` is sound: the machine file says all but the load's inertia. `draw_hidden` has physics besides that the
file does not mention: dry, falling or angle-dependent friction, weight, play, a lossy gear, a torque constant that
drops, a spring at one end.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field, replace

import numpy as np
from numba import njit
from numpy.typing import NDArray

from schwung.drivetrain.machine import Control, Coupling, Load, Machine, Motor
from schwung.motion import Excitation, Motion
from schwung.session.model import Run, Session

Array = NDArray[np.float64]
Curve = Callable[[Array], Array]
State = tuple[float, float, float, float]

TICK_S, SUBSTEPS = 125e-6, 4
DURATIONS_S = (0.1, 0.15, 0.25, 0.5)
EVERY = (1, 2, 4, 8)  # ticks per logged sample
PHASES = (None, 0.0, np.pi / 2, np.pi, 3 * np.pi / 2)  # None: the reference
REST_S, DWELL_S = 0.2, 0.15
#: The curve's grid reaches so far beyond the stroke (rad), in so many steps.
MARGIN_RAD, STEPS = 1.0, 6000


@dataclass(frozen=True)
class Shaft:
    """Rotor, coupling and frictions (SI), and what is hidden in them; zeros: nothing."""

    rotor: float
    stiffness: float
    damping: float
    rotor_viscous: float
    load_viscous: float
    dry: float = 0.0  # N·m on the motor
    breakaway: float = 0.0  # beyond `dry`, gone at the square of 1 rad/s
    wavy: float = 0.0  # share of the dry friction that goes with cos(1.7 θ)
    weight: float = 0.0  # N·m on the load, times cos(θ + 0.5)
    gap: float = 0.0  # rad, whole play
    loss: float = 0.0  # of the torque that the shaft carries
    drop: float = 0.0  # share of the torque that is missing at the peak, with its square
    spring: float = 0.0  # N·m/rad, over the stroke's last quarter

    def numbers(self, peak_nm: float, end_rad: float) -> Array:
        """In the order in which `_rates` takes them."""
        return np.array([
            self.rotor, self.stiffness, self.damping, self.rotor_viscous, self.load_viscous, self.dry, self.breakaway,
            self.wavy, self.weight, self.gap, self.loss, self.drop / peak_nm**2, self.spring, end_rad,
        ])  # fmt: skip


@dataclass(frozen=True)
class Loop:
    """The drive: its cascade, its sensors, and what it reports of them."""

    position_gain: float  # 1/s
    speed_gain: float  # N·m·s/rad
    reset_s: float
    forward: float  # share of the demanded speed that is fed forward
    peak_nm: float
    count_rad: float  # of the encoder
    from_angle: bool  # speed from the last two counted angles; else a sensor's
    filter_s: float  # of the speed, in the loop and in the report
    torque_filtered: bool  # the reported torque passes the same filter
    speed_late: int  # ticks
    torque_late: int


@dataclass(frozen=True)
class Stranger:
    """A machine by chance, its drive, and how it is recorded."""

    shaft: Shaft
    loop: Loop
    curve: Curve = field(repr=False)
    family: str
    mean_kgm2: float
    stroke_rad: float
    kind: str
    duration_s: float
    every: int
    frequency_hz: float
    amplitude_nm: float
    speed_noise: float
    torque_noise: float
    cause: str = "healthy"
    held_late: int | None = (
        None  # ticks from a sample to when the drive takes what is added; None: added each tick
    )

    @property
    def rate_hz(self) -> float:
        """Of the log."""
        return 1 / (self.every * TICK_S)

    def truth(self, angle_rad: Array) -> Array:
        """Load inertia (kg·m²), (n,)."""
        return self.curve(angle_rad)


def draw_stranger(seed: int, duration_s: float | None = None, every: int | None = None) -> Stranger:
    """A sound machine; motion time and log as given, or by chance."""
    chance = np.random.default_rng([seed, 4177])
    mean = 10 ** chance.uniform(-2.7, 0.0)
    rotor = mean / chance.uniform(2.0, 12.0)
    natural = 2 * np.pi * chance.uniform(50.0, 130.0)  # of the load against a held rotor
    stiffness = mean * natural**2
    total = mean + rotor
    stroke = chance.uniform(0.8, 3.5)
    time = float(chance.choice(DURATIONS_S)) if duration_s is None else duration_s
    ticks = int(chance.choice(EVERY)) if every is None else every
    peak = total * (14.0 * stroke / time**2 + 250.0)
    amplitude = chance.uniform(0.1, 0.25) * peak
    kind = str(chance.choice(["third", "poly5", "scurve"]))
    frequency = round(chance.uniform(0.45, 0.75) * natural / (2 * np.pi))
    ripple = amplitude / (total * 2 * np.pi * frequency)
    families: dict[str, Callable[[np.random.Generator, float, float], Curve]] = {
        "four-bar": _four_bar, "cam": _cam, "waves": _waves, "toggle": _toggle, "constant": _constant,
    }  # fmt: skip
    family = str(chance.choice(list(families)))
    filtered = chance.uniform() < 0.5
    loop = Loop(
        position_gain=chance.uniform(15.0, 50.0),
        speed_gain=chance.uniform(30.0, 90.0) * total,
        reset_s=chance.uniform(0.02, 0.08),
        forward=float(chance.choice([0.0, 1.0])),
        peak_nm=peak,
        count_rad=2 * np.pi / 2 ** int(chance.integers(18, 25)),
        from_angle=bool(chance.uniform() < 0.5),
        filter_s=10 ** chance.uniform(-4.3, -3.5) if filtered else 0.0,
        torque_filtered=bool(chance.uniform() < 0.5),
        speed_late=int(chance.integers(0, 3)),
        torque_late=int(chance.integers(0, 3)),
    )
    return Stranger(
        shaft=Shaft(
            rotor, stiffness, 2 * chance.uniform(0.01, 0.08) * np.sqrt(stiffness * mean), 0.2 * rotor, 0.1 * mean
        ),
        loop=loop,
        curve=families[family](chance, mean, stroke),
        family=family,
        mean_kgm2=mean,
        stroke_rad=stroke,
        kind=kind,
        duration_s=time,
        every=ticks,
        frequency_hz=float(frequency),
        amplitude_nm=amplitude,
        speed_noise=10 ** chance.uniform(-4.0, -1.7) * ripple,
        torque_noise=10 ** chance.uniform(-4.5, -2.0) * amplitude,
    )  # fmt: skip


def draw_hidden(seed: int, duration_s: float | None = None, every: int | None = None) -> Stranger:
    """A machine of `draw_stranger` with one of HIDDEN, each in turn."""
    stranger, chance = draw_stranger(seed, duration_s, every), np.random.default_rng([seed, 4178])
    cause = tuple(HIDDEN)[seed % len(HIDDEN)]
    return replace(stranger, shaft=HIDDEN[cause](stranger, chance), cause=cause)


def _hide(**shares: tuple[float, float]) -> Callable[[Stranger, np.random.Generator], Shaft]:
    """Torques are shares of the injection."""

    def hidden(stranger: Stranger, chance: np.random.Generator) -> Shaft:
        found = {name: stranger.amplitude_nm * chance.uniform(*share) for name, share in shares.items()}
        return replace(stranger.shaft, **found)

    return hidden


def _wavy(stranger: Stranger, chance: np.random.Generator) -> Shaft:
    return replace(_hide(dry=(0.03, 0.2))(stranger, chance), wavy=chance.uniform(0.3, 0.8))


def _play(stranger: Stranger, chance: np.random.Generator) -> Shaft:
    gap = chance.uniform(0.1, 1.0) * stranger.amplitude_nm / stranger.shaft.stiffness
    return replace(stranger.shaft, gap=gap)


def _spring(stranger: Stranger, chance: np.random.Generator) -> Shaft:
    torque = chance.uniform(0.1, 0.5) * stranger.amplitude_nm
    return replace(stranger.shaft, spring=4 * torque / stranger.stroke_rad)


HIDDEN: dict[str, Callable[[Stranger, np.random.Generator], Shaft]] = {
    "dry friction": _hide(dry=(0.03, 0.2)),
    "falling friction": _hide(dry=(0.02, 0.1), breakaway=(0.02, 0.1)),
    "friction over angle": _wavy,
    "weight": _hide(weight=(0.05, 0.4)),
    "play": _play,
    "gear loss": lambda s, chance: replace(s.shaft, loss=chance.uniform(0.01, 0.05)),
    "torque constant drops": lambda s, chance: replace(s.shaft, drop=chance.uniform(0.02, 0.1)),
    "end spring": _spring,
}


def _four_bar(chance: np.random.Generator, mean: float, stroke: float) -> Curve:
    """A rocker behind a crank (r = 1, coupler 3.2, rocker 2.6, ground 3.4): J_0 + m (dψ/dθ)²."""
    share, start = chance.uniform(0.2, 0.6), chance.uniform(0, 2 * np.pi)
    crank, coupler, rocker, ground = 1.0, 3.2, 2.6, 3.4

    def squared(angle: Array) -> Array:
        x, y = crank * np.cos(angle + start) - ground, crank * np.sin(angle + start)
        far = np.hypot(x, y)
        rocked = np.arctan2(y, x) - np.arccos((far**2 + rocker**2 - coupler**2) / (2 * far * rocker))
        bx, by = ground + rocker * np.cos(rocked), rocker * np.sin(rocked)
        along = np.arctan2(by - y, bx - x - ground)
        return np.asarray((crank * np.sin(angle + start - along) / (rocker * np.sin(rocked - along))) ** 2)

    level = float(np.mean(squared(np.linspace(0.0, stroke, 200))))
    return lambda angle: mean * (1 - share + share * squared(angle) / level)


def _cam(chance: np.random.Generator, mean: float, stroke: float) -> Curve:
    """Dwells at two levels, and half a cosine between: its second derivative jumps twice."""
    centre, width = chance.uniform(0.3, 0.7) * stroke, chance.uniform(0.3, 0.7) * stroke
    swing = chance.uniform(-0.35, 0.35)
    return lambda angle: mean * (1 + swing * np.sin(np.pi * np.clip((angle - centre) / width, -0.5, 0.5)))


def _waves(chance: np.random.Generator, mean: float, stroke: float) -> Curve:
    """Four waves of any order up to six per turn, the faster the smaller."""
    orders, phases = chance.uniform(0.4, 6.0, 4), chance.uniform(0, 2 * np.pi, 4)
    sizes = chance.dirichlet(np.ones(4)) * chance.uniform(0.1, 0.5) / np.maximum(orders, 1.0)
    return lambda angle: mean * (1 + np.cos(np.multiply.outer(angle, orders) + phases) @ sizes)


def _toggle(chance: np.random.Generator, mean: float, stroke: float) -> Curve:
    """A lever that comes near its dead centre: 1/(1 + ((θ − θ_0)/w)²)."""
    centre, width = chance.uniform(0.0, 1.0) * stroke, chance.uniform(0.3, 0.8)
    swing = chance.uniform(0.1, 0.6)
    return lambda angle: mean * (1 - swing / 3 + swing / (1 + ((angle - centre) / width) ** 2))


def _constant(chance: np.random.Generator, mean: float, stroke: float) -> Curve:
    return lambda angle: mean * np.ones_like(angle)


@njit(cache=True)
def _inertia(grid: Array, low: float, step: float, angle: float) -> tuple[float, float]:
    """J and dJ/dθ from a cubic through each four points of the curve's grid."""
    place = (angle - low) / step
    i = min(max(int(place), 1), grid.size - 3)
    u = place - i
    a, b, c, d = grid[i - 1], grid[i], grid[i + 1], grid[i + 2]
    first, second, third = (c - a) / 2, a - 2.5 * b + 2 * c - 0.5 * d, (d - a) / 2 + 1.5 * (b - c)
    return b + u * (first + u * (second + u * third)), (first + u * (2 * second + 3 * u * third)) / step


@njit(cache=True)
def _rates(x: State, torque: float, p: Array, grid: Array, low: float, step: float) -> State:
    """d/dt of motor angle and speed, load angle and speed."""
    inertia, slope = _inertia(grid, low, step, x[2])
    twist = x[0] - x[2]
    if p[9] > 0:
        twist = twist - min(max(twist, -p[9] / 2), p[9] / 2)
    shaft = p[1] * twist
    if p[9] == 0 or twist != 0:
        shaft += p[2] * (x[1] - x[3])
    way = np.tanh(x[1] / 0.02)
    dry = p[5] * (1 + p[7] * np.cos(1.7 * x[0])) + p[6] * np.exp(-(x[1] ** 2)) + p[10] * abs(shaft)
    load = p[8] * np.cos(x[2] + 0.5) - p[12] * max(x[2] - 0.75 * p[13], 0.0)
    motor = (torque * (1 - p[11] * torque * torque) - shaft - p[3] * x[1] - dry * way) / p[0]
    return x[1], motor, x[3], (shaft + load - p[4] * x[3] - 0.5 * slope * x[3] * x[3]) / inertia


@njit(cache=True)
def _ahead(x: State, h: float, a: State) -> State:
    """x + h·a. Four numbers and no array: an array each cost half of the time."""
    return x[0] + h * a[0], x[1] + h * a[1], x[2] + h * a[2], x[3] + h * a[3]


@njit(cache=True)
def _mean(h: float, a: float, b: float, c: float, d: float) -> float:
    """Runge and Kutta's, times the step."""
    return h * (a + 2 * b + 2 * c + d) / 6


@njit(cache=True)
def _played(
    demand: Array, added: Array, noise: Array, p: Array, loop: Array, grid: Array, low: float, step: float
) -> Array:
    """Counted angle, speed as the loop has it, and torque of every tick, (n, 3)."""
    position_gain, speed_gain, reset, forward, peak, count, share, from_angle = loop
    n, h = demand.size, TICK_S / SUBSTEPS
    rows, x, integral, speed, last = np.empty((n, 3)), (0.0, 0.0, 0.0, 0.0), 0.0, 0.0, 0.0
    for i in range(n):
        angle = np.rint(x[0] / count) * count
        seen = (angle - last) / TICK_S if from_angle > 0 else x[1]
        last = angle
        speed += share * (seen + noise[i] - speed)
        ahead = forward * (demand[min(i + 1, n - 1)] - demand[i]) / TICK_S
        error = position_gain * (demand[i] - angle) + ahead - speed
        wanted = speed_gain * (error + integral) + added[i]
        torque = min(max(wanted, -peak), peak)
        if torque == wanted:
            integral += error * TICK_S / reset
        rows[i, 0], rows[i, 1], rows[i, 2] = angle, speed, torque
        for _ in range(SUBSTEPS):
            a = _rates(x, torque, p, grid, low, step)
            b = _rates(_ahead(x, 0.5 * h, a), torque, p, grid, low, step)
            c = _rates(_ahead(x, 0.5 * h, b), torque, p, grid, low, step)
            d = _rates(_ahead(x, h, c), torque, p, grid, low, step)
            x = (
                x[0] + _mean(h, a[0], b[0], c[0], d[0]),
                x[1] + _mean(h, a[1], b[1], c[1], d[1]),
                x[2] + _mean(h, a[2], b[2], c[2], d[2]),
                x[3] + _mean(h, a[3], b[3], c[3], d[3]),
            )
    return rows


def _late(values: Array, ticks: int) -> Array:
    return np.concatenate([np.full(ticks, values[0]), values[: values.size - ticks]])


def _filtered(values: Array, share: float) -> Array:
    result = values.copy()
    for i in range(1, values.size):
        result[i] = result[i - 1] + share * (values[i] - result[i - 1])
    return result


def stranger_session(stranger: Stranger, seed: int) -> Session:
    """A reference and four phases."""
    s, loop = stranger, stranger.loop
    chance = np.random.default_rng([seed, 4179])
    motion = Motion(
        kind=s.kind, distance_rad=s.stroke_rad, duration_s=s.duration_s, start_time_s=REST_S, dwell_s=DWELL_S
    )
    time = np.arange(round(motion.total_s / TICK_S)) * TICK_S
    angles, step = np.linspace(-MARGIN_RAD, s.stroke_rad + MARGIN_RAD, STEPS, retstep=True)
    demand = motion.demand(time).position_rad
    share = 1.0 if loop.filter_s == 0 else 1 - np.exp(-TICK_S / loop.filter_s)
    numbers = np.array([
        loop.position_gain, loop.speed_gain, loop.reset_s, loop.forward, loop.peak_nm, loop.count_rad, share,
        float(loop.from_angle),
    ])  # fmt: skip
    runs = []
    for number, phase in enumerate(PHASES):
        sine = None
        if phase is not None:
            sine = Excitation(
                frequency_hz=s.frequency_hz, amplitude_nm=s.amplitude_nm, phase_rad=phase, ramp_s=0.05,
                end_s=motion.total_s,
            )  # fmt: skip
        added = np.zeros_like(time) if sine is None else sine.torque(time)
        told = added[:: s.every]
        if s.held_late is not None and sine is not None:
            sine = sine.model_copy(update={"hold_s": 1 / s.rate_hz})
            sent = sine.torque(time[:: s.every] + 0.5 / s.rate_hz)
            told = np.concatenate([[0.0], sent[:-1]])
            added = np.concatenate([np.zeros(s.held_late), np.repeat(sent, s.every)])[: time.size]
        noise = s.speed_noise * chance.standard_normal((time.size,))
        rows = _played(
            demand, added, noise, s.shaft.numbers(loop.peak_nm, s.stroke_rad), numbers, s.curve(angles),
            -MARGIN_RAD, float(step),
        )  # fmt: skip
        torque = rows[:, 2] + s.torque_noise * chance.standard_normal(time.size)
        if loop.torque_filtered:
            torque = _filtered(torque, share)
        runs.append(
            Run(
                role="reference" if sine is None else "excited",
                repeat=0,
                sample_rate_hz=s.rate_hz,
                time_s=time[:: s.every],
                position_rad=rows[:: s.every, 0].copy(),
                speed_rad_s=_late(rows[:, 1], loop.speed_late)[:: s.every],
                torque_nm=_late(torque, loop.torque_late)[:: s.every],
                torque_added_nm=told,
                motion=motion,
                excitation=sine,
                name=f"stranger {seed}, run {number}",
            )
        )
    return Session(tuple(runs), created="2026-01-01T00:00:00", source="stranger")


def stranger_belief(stranger: Stranger) -> Machine:
    """Data sheets, and a guess of the load that is off by a third."""
    shaft, loop = stranger.shaft, stranger.loop
    return Machine(
        name="stranger",
        motor=Motor(
            inertia_kgm2=shaft.rotor, viscous_friction_nms=shaft.rotor_viscous, peak_torque_nm=loop.peak_nm
        ),
        coupling=Coupling(stiffness_nm_rad=shaft.stiffness, damping_nms=shaft.damping),
        load=Load(viscous_friction_nms=shaft.load_viscous, inertia_kgm2=1.33 * stranger.mean_kgm2),
        control=Control(
            position_gain_per_s=loop.position_gain, speed_gain_nms=loop.speed_gain,
            speed_integral_time_s=loop.reset_s, sample_rate_hz=1 / TICK_S,
        ),
    )  # fmt: skip
