"""Machines by chance for the benchmarks: healthy ones, and such that have something which spoils an estimate.

Every machine has its own rotor, coupling, curve of inertia, motion time, rate and noise, and its drive its own gains,
encoder and speed filter (none in one of three), all by seed. A hard one (`draw_hard`) has one cause of trouble besides,
mild or severe by chance: physics that the machine file does not mention, a wrong number in the file, a poor record.
The estimator is told nothing of it.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field, replace

import numpy as np
from numpy.typing import NDArray

from schwung.drivetrain import Control, Coupling, Load, Machine, Motor
from schwung.motion import Excitation, Motion
from schwung.session import Run, Session
from schwung_sim.drives.axis import AxisSettings, ServoAxis
from schwung_sim.plants import TICK_S, Profile, TwoMassMachine, TwoMassPlant, parse_conceal
from schwung_sim.recording import Noise, play

Array = NDArray[np.float64]
PHASES = (0.0, np.pi / 2, np.pi, 3 * np.pi / 2)


@dataclass(frozen=True)
class Drawn:
    """A machine by chance, how it is recorded, and what is wrong with either."""

    machine: TwoMassMachine
    inertia: Profile
    mean_kgm2: float
    peak_nm: float
    settings: AxisSettings
    motion: Motion
    frequency_hz: float
    rate_hz: float
    noise: Noise
    amplitude_nm: float
    cause: str = "healthy"
    conceal: str = ""
    behind_kgm2: float = 0.0  # of a mass behind the load: part of what the motor has to move
    believed: Mapping[str, float] = field(default_factory=dict)  # factors on the machine file's numbers

    def truth(self, angle_rad: Array) -> Array:
        """The load's inertia (kg·m²), (n,), as the motor has to move it."""
        return self.inertia.at(angle_rad) + self.behind_kgm2

    @property
    def motion_torque_nm(self) -> float:
        """About what the motion takes at its peak, without injection."""
        total = self.mean_kgm2 + self.machine.rotor_inertia_kgm2
        return total * 4.5 * abs(self.motion.distance_rad) / self.motion.duration_s**2


def draw(seed: int) -> Drawn:
    """Draw a machine that a servo engineer would recognise: sizes over two decades, gains tuned to it."""
    chance = np.random.default_rng([seed, 99])
    mean = 10 ** chance.uniform(-2.5, 0.3)
    ratio = chance.uniform(3.0, 15.0)  # load over rotor inertia
    rotor = mean / ratio
    anti_resonance = chance.uniform(55.0, 120.0)
    stiffness = mean * (2 * np.pi * anti_resonance) ** 2
    damping = 2 * chance.uniform(0.01, 0.06) * np.sqrt(stiffness * mean)
    stroke = chance.uniform(1.0, np.pi)
    orders, swing = np.arange(1, 4), chance.uniform(0.0, 0.5)
    shares, phases = chance.dirichlet(np.ones(3)), chance.uniform(0, 2 * np.pi, 3)

    def curve(angle: Array) -> Array:
        waves = sum(a * np.cos(n * angle + p) for a, n, p in zip(shares, orders, phases, strict=True))
        return np.asarray(mean * (1 + swing * waves))

    machine = TwoMassMachine(
        rotor_inertia_kgm2=rotor, rotor_viscous_nms=0.05 * rotor * 2 * np.pi, stiffness_nm_rad=stiffness,
        damping_nms=damping, load_viscous_nms=0.02 * mean * 2 * np.pi,
    )  # fmt: skip
    duration = chance.uniform(0.1, 0.5)
    total = mean + rotor
    peak = 3.0 * total * 4.5 * stroke / duration**2 + total * 300
    settings = _drive(seed, total, peak)
    rate = float(chance.choice([1000.0, 2000.0, 4000.0, 8000.0]))
    frequency = rate / round(rate / (0.6 * anti_resonance))
    amplitude = 0.2 * peak
    ripple = amplitude / (total * 2 * np.pi * frequency)
    return Drawn(
        machine, Profile.of_turn(curve), mean, peak, settings,
        Motion(distance_rad=stroke, duration_s=duration, start_time_s=0.2, dwell_s=0.15),
        frequency, rate, Noise(10 ** chance.uniform(-3, -1.5) * ripple, 10 ** chance.uniform(-3.5, -2) * amplitude),
        amplitude,
    )  # fmt: skip


def _drive(seed: int, total_kgm2: float, peak_nm: float) -> AxisSettings:
    """A drive as somebody tuned it: slack or tight, an encoder of 18 to 24 bit, a speed filter of any length or none.

    The filter is on reported speed and torque alike and lags in the loop; the estimator learns nothing of it.
    """
    chance = np.random.default_rng([seed, 97])
    filtered = chance.uniform() > 1 / 3
    return AxisSettings(
        position_gain_1_s=chance.uniform(20.0, 40.0),
        speed_gain_nms_rad=chance.uniform(40.0, 80.0) * total_kgm2,
        speed_integral_time_s=chance.uniform(0.03, 0.06),
        torque_limit_nm=peak_nm,
        speed_filter_s=_log(chance, 50e-6, 400e-6) if filtered else 0.0,
        encoder_counts=2 ** int(chance.integers(18, 25)),
    )


def draw_hard(seed: int) -> Drawn:
    """A machine of `draw` with one cause of trouble, each in turn; every fifth stays healthy. 8 kHz become 4 kHz."""
    drawn, chance = draw(seed), np.random.default_rng([seed, 98])
    if drawn.rate_hz > 4000.0:
        drawn = replace(drawn, rate_hz=4000.0, frequency_hz=4000.0 / round(4000.0 / drawn.frequency_hz))
    if seed % 5 == 0:
        return drawn
    cause = tuple(CAUSES)[(seed - seed // 5 - 1) % len(CAUSES)]
    return replace(CAUSES[cause](drawn, chance), cause=cause)


def _log(chance: np.random.Generator, low: float, high: float) -> float:
    return float(np.exp(chance.uniform(np.log(low), np.log(high))))


def _sign(chance: np.random.Generator) -> float:
    return float(chance.choice([-1.0, 1.0]))


def _concealed(name: str, shares: Mapping[str, tuple[float, float]], **fixed: float) -> Cause:
    """An effect of the bench whose torques are drawn as shares of the injection."""

    def made(drawn: Drawn, chance: np.random.Generator) -> Drawn:
        keys = {key: _log(chance, *share) * drawn.amplitude_nm for key, share in shares.items()} | fixed
        return replace(drawn, conceal=_effect(name, keys))

    return made


def _effect(name: str, keys: Mapping[str, float]) -> str:
    return ":".join([name, *(f"{key}={value:.9g}" for key, value in keys.items())])


def _stribeck(drawn: Drawn, chance: np.random.Generator) -> Drawn:
    dry = _log(chance, 0.02, 0.2) * drawn.amplitude_nm
    keys = {"coulomb_torque_nm": dry, "breakaway_torque_nm": dry * chance.uniform(1.2, 1.8),
            "stribeck_speed_rad_s": _log(chance, 0.3, 3.0)}  # fmt: skip
    return replace(drawn, conceal=_effect("stribeck_friction", keys))


def _gravity(drawn: Drawn, chance: np.random.Generator) -> Drawn:
    keys = {"amplitude_nm": _log(chance, 0.05, 0.5) * drawn.amplitude_nm, "phase_rad": chance.uniform(-3, 3)}
    return replace(drawn, conceal=_effect("load_torque", keys))


def _backlash(drawn: Drawn, chance: np.random.Generator) -> Drawn:
    wind_up = drawn.amplitude_nm / drawn.machine.stiffness_nm_rad
    return replace(drawn, conceal=_effect("backlash", {"gap_rad": _log(chance, 0.1, 2.0) * wind_up}))


def _cogging(drawn: Drawn, chance: np.random.Generator) -> Drawn:
    keys = {"order": float(chance.integers(6, 60)), "amplitude_nm": _log(chance, 0.01, 0.1) * drawn.amplitude_nm,
            "phase_rad": chance.uniform(-3, 3)}  # fmt: skip
    return replace(drawn, conceal=_effect("cogging", keys))


def _load_event(drawn: Drawn, chance: np.random.Generator) -> Drawn:
    time = chance.uniform(0.1, 0.9) * drawn.motion.duration_s
    keys = {"time_s": time, "duration_s": _log(chance, 0.01, 0.06),
            "peak_nm": _sign(chance) * _log(chance, 0.1, 1.0) * drawn.amplitude_nm}  # fmt: skip
    return replace(drawn, conceal=_effect("load_event", keys))


def _compliance(drawn: Drawn, chance: np.random.Generator) -> Drawn:
    behind = _log(chance, 0.03, 0.3) * drawn.mean_kgm2
    own = 2 * np.pi * drawn.frequency_hz * chance.uniform(1.4, 4.0)  # its resonance on a resting load, rad/s
    keys = {"inertia_kgm2": behind, "stiffness_nm_rad": behind * own**2, "damping_nms": 0.04 * behind * own}
    return replace(drawn, conceal=_effect("extra_compliance", keys), behind_kgm2=behind)


def _lateness(name: str, key: str, low: float, high: float) -> Cause:
    def made(drawn: Drawn, chance: np.random.Generator) -> Drawn:
        return replace(drawn, conceal=_effect(name, {key: chance.uniform(low, high)}))

    return made


def _torque_constant(drawn: Drawn, chance: np.random.Generator) -> Drawn:
    return replace(
        drawn, conceal=_effect("torque_constant", {"gain": 1 + _sign(chance) * chance.uniform(0.02, 0.1)})
    )


def _wrong(key: str, largest: float) -> Cause:
    def made(drawn: Drawn, chance: np.random.Generator) -> Drawn:
        factor = np.exp(_sign(chance) * chance.uniform(0.2, 1.0) * np.log(largest))
        return replace(drawn, believed={key: float(factor)})

    return made


def _clipped(drawn: Drawn, chance: np.random.Generator) -> Drawn:
    limit = (drawn.motion_torque_nm + drawn.amplitude_nm) * chance.uniform(0.6, 0.95)
    return replace(drawn, peak_nm=limit, settings=replace(drawn.settings, torque_limit_nm=limit))


def _short(drawn: Drawn, chance: np.random.Generator) -> Drawn:
    duration = chance.uniform(0.04, 0.09)
    total = drawn.mean_kgm2 + drawn.machine.rotor_inertia_kgm2
    peak = 3.0 * total * 4.5 * drawn.motion.distance_rad / duration**2 + total * 300
    settings = replace(drawn.settings, torque_limit_nm=peak)
    motion = drawn.motion.model_copy(update={"duration_s": duration})
    return replace(drawn, motion=motion, peak_nm=peak, settings=settings)


def _small_injection(drawn: Drawn, chance: np.random.Generator) -> Drawn:
    return replace(drawn, amplitude_nm=_log(chance, 0.01, 0.2) * drawn.amplitude_nm)


def _noisy(drawn: Drawn, chance: np.random.Generator) -> Drawn:
    total = drawn.mean_kgm2 + drawn.machine.rotor_inertia_kgm2
    ripple = drawn.amplitude_nm / (total * 2 * np.pi * drawn.frequency_hz)
    return replace(
        drawn, noise=Noise(_log(chance, 0.05, 1.0) * ripple, _log(chance, 0.02, 0.5) * drawn.amplitude_nm)
    )


def _coarse_speed(drawn: Drawn, _chance: np.random.Generator) -> Drawn:
    top = 1.5 * drawn.motion.distance_rad / drawn.motion.duration_s
    return replace(drawn, noise=replace(drawn.noise, speed_count_rad_s=2 * 2.5 * top / 4096))


def _payload_step(drawn: Drawn, chance: np.random.Generator) -> Drawn:
    low, high = sorted(chance.uniform(0.6, 1.6, 2) * drawn.mean_kgm2)
    at, width = chance.uniform(0.3, 0.7) * drawn.motion.distance_rad, _log(chance, 0.03, 0.3)
    angle = np.linspace(-1.0, drawn.motion.distance_rad + 1.0, 800)
    curve = (low + high) / 2 + (high - low) / 2 * _sign(chance) * np.tanh((angle - at) / width)
    return replace(drawn, inertia=Profile.of_pairs(angle, curve))


Cause = Callable[[Drawn, np.random.Generator], Drawn]
CAUSES: Mapping[str, Cause] = {
    "backlash": _backlash,
    "Coulomb friction": _concealed("coulomb_friction", {"torque_nm": (0.02, 0.2)}),
    "Stribeck friction": _stribeck,
    "gravity": _gravity,
    "cogging": _cogging,
    "load event": _load_event,
    "extra compliance": _compliance,
    "torque constant": _torque_constant,
    "torque lag": _lateness("torque_lag", "time_constant_s", 0.1e-3, 1e-3),
    "measurement delay": _lateness("measurement_delay", "delay_s", 0.5e-3, 2e-3),
    "wrong stiffness": _wrong("stiffness", 1.6),
    "wrong damping": _wrong("damping", 2.0),
    "wrong rotor inertia": _wrong("rotor", 1.5),
    "clipping": _clipped,
    "very short motion": _short,
    "small injection": _small_injection,
    "heavy noise": _noisy,
    "12-bit speed": _coarse_speed,
    "payload step": _payload_step,
}


def make_session(drawn: Drawn, seed: int) -> Session:
    """A reference and four phases."""
    instants = drawn.motion.time(1 / TICK_S)
    demand = drawn.motion.demand(instants).position_rad
    every = round(1 / (drawn.rate_hz * TICK_S))
    runs = []
    for number, phase in enumerate((None, *PHASES)):
        concealed = parse_conceal(drawn.conceal)
        plant = TwoMassPlant(machine=drawn.machine, inertia=drawn.inertia, concealed=concealed, seed=seed)
        axis = ServoAxis(plant, drawn.settings, seed=seed)
        excitation = None
        if phase is not None:
            excitation = Excitation(
                frequency_hz=drawn.frequency_hz, amplitude_nm=drawn.amplitude_nm, phase_rad=phase,
                ramp_s=2 / drawn.frequency_hz, end_s=drawn.motion.total_s,
            )  # fmt: skip
        added = excitation.torque(instants) if excitation else np.zeros_like(instants)
        made = play(axis, demand, added, every, drawn.noise, 10 * seed + number)
        runs.append(
            Run(
                role="excited" if excitation else "reference",
                repeat=0,
                sample_rate_hz=drawn.rate_hz,
                time_s=made.time_s,
                position_rad=made.position_rad,
                speed_rad_s=made.speed_rad_s,
                torque_nm=made.torque_nm,
                torque_added_nm=made.torque_added_nm,
                motion=drawn.motion,
                excitation=excitation,
                name=f"machine {seed}, run {number}",
            )
        )
    return Session(tuple(runs), created="2026-01-01T00:00:00", source="calibration")


def believed(drawn: Drawn) -> Machine:
    """Data sheets, a guess of the load that is off by a third, and whatever is wrong with the file."""
    m, s, wrong = drawn.machine, drawn.settings, drawn.believed
    return Machine(
        name="drawn",
        motor=Motor(
            inertia_kgm2=m.rotor_inertia_kgm2 * wrong.get("rotor", 1.0), viscous_friction_nms=m.rotor_viscous_nms,
            peak_torque_nm=drawn.peak_nm,
        ),
        coupling=Coupling(
            stiffness_nm_rad=m.stiffness_nm_rad * wrong.get("stiffness", 1.0),
            damping_nms=m.damping_nms * wrong.get("damping", 1.0),
        ),
        load=Load(viscous_friction_nms=m.load_viscous_nms, inertia_kgm2=1.33 * drawn.mean_kgm2),
        control=Control(
            position_gain_per_s=s.position_gain_1_s, speed_gain_nms=s.speed_gain_nms_rad,
            speed_integral_time_s=s.speed_integral_time_s, sample_rate_hz=1 / TICK_S,
        ),
    )  # fmt: skip
