"""Are the bands honest, and does the verdict predict the error? Random machines, profiles, rates and noise.

    python benchmarks/calibration.py --machines 500

Every machine has its own rotor, coupling, gains, curve of inertia, motion time, rate and noise, drawn by seed. Printed
per method: error relative to the mean inertia, share of cells whose 95 % band holds the truth, and how the verdict
sorts good estimates (relative RMSE up to 2 %) from others: hits (bad ones not called good) and false alarms (good
ones not called good).
"""

from __future__ import annotations

import argparse
import itertools
from concurrent.futures import ProcessPoolExecutor
from dataclasses import dataclass

import numpy as np
from estimators import PHASES, _for_method

from schwung.drivetrain import Control, Coupling, Load, Machine, Motor
from schwung.errors import SchwungError
from schwung.estimation import estimate
from schwung.motion import Excitation, Motion
from schwung.session import Run, Session
from schwung_sim.drives.axis import AxisSettings, ServoAxis
from schwung_sim.plants import TICK_S, Profile, TwoMassMachine, TwoMassPlant
from schwung_sim.recording import Noise, play

GOOD_RELATIVE_RMSE = 0.02


@dataclass(frozen=True)
class Drawn:
    """A machine by chance, and how it is recorded."""

    machine: TwoMassMachine
    inertia: Profile
    mean_kgm2: float
    peak_nm: float
    settings: AxisSettings
    motion: Motion
    frequency_hz: float
    rate_hz: float
    noise: Noise


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

    def curve(angle: np.ndarray) -> np.ndarray:
        waves = sum(a * np.cos(n * angle + p) for a, n, p in zip(shares, orders, phases, strict=True))
        return np.asarray(mean * (1 + swing * waves))

    machine = TwoMassMachine(
        rotor_inertia_kgm2=rotor, rotor_viscous_nms=0.05 * rotor * 2 * np.pi, stiffness_nm_rad=stiffness,
        damping_nms=damping, load_viscous_nms=0.02 * mean * 2 * np.pi,
    )  # fmt: skip
    duration = chance.uniform(0.1, 0.5)
    total = mean + rotor
    peak = 3.0 * total * 4.5 * stroke / duration**2 + total * 300
    settings = AxisSettings(
        position_gain_1_s=30.0,
        speed_gain_nms_rad=60.0 * total,
        speed_integral_time_s=0.03,
        torque_limit_nm=peak,
    )
    rate = float(chance.choice([1000.0, 2000.0, 4000.0, 8000.0]))
    frequency = rate / round(rate / (0.6 * anti_resonance))
    amplitude = 0.2 * peak
    ripple = amplitude / (total * 2 * np.pi * frequency)
    return Drawn(
        machine, Profile.of_turn(curve), mean, peak, settings,
        Motion(distance_rad=stroke, duration_s=duration, start_time_s=0.2, dwell_s=0.15),
        frequency, rate, Noise(10 ** chance.uniform(-3, -1.5) * ripple, 10 ** chance.uniform(-3.5, -2) * amplitude),
    )  # fmt: skip


def make_session(drawn: Drawn, seed: int) -> Session:
    """A reference and four phases."""
    instants = drawn.motion.time(1 / TICK_S)
    demand = drawn.motion.demand(instants).position_rad
    every = round(1 / (drawn.rate_hz * TICK_S))
    runs = []
    for number, phase in enumerate((None, *PHASES)):
        plant = TwoMassPlant(machine=drawn.machine, inertia=drawn.inertia, seed=seed)
        axis = ServoAxis(plant, drawn.settings, seed=seed)
        excitation = None
        if phase is not None:
            excitation = Excitation(
                frequency_hz=drawn.frequency_hz, amplitude_nm=0.2 * drawn.peak_nm, phase_rad=phase,
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
    """Data sheets, and a guess of the load that is off by a third."""
    m, s = drawn.machine, drawn.settings
    return Machine(
        name="drawn",
        motor=Motor(
            inertia_kgm2=m.rotor_inertia_kgm2, viscous_friction_nms=m.rotor_viscous_nms, peak_torque_nm=drawn.peak_nm
        ),
        coupling=Coupling(stiffness_nm_rad=m.stiffness_nm_rad, damping_nms=m.damping_nms),
        load=Load(viscous_friction_nms=m.load_viscous_nms, inertia_kgm2=1.33 * drawn.mean_kgm2),
        control=Control(
            position_gain_per_s=s.position_gain_1_s, speed_gain_nms=s.speed_gain_nms_rad,
            speed_integral_time_s=s.speed_integral_time_s, sample_rate_hz=1 / TICK_S,
        ),
    )  # fmt: skip


@dataclass(frozen=True)
class Outcome:
    """What one method made of one machine."""

    method: str
    relative_rmse: float
    inside: int
    cells: int
    verdict: str


def judge(seed: int, methods: tuple[str, ...]) -> list[Outcome]:
    """All methods on one machine; a refusal counts as the verdict "refused"."""
    drawn = draw(seed)
    session, machine = make_session(drawn, seed), believed(drawn)
    outcomes = []
    for method in methods:
        try:
            made = estimate(_for_method(session, method), machine, method=method)
        except SchwungError:
            outcomes.append(Outcome(method, np.nan, 0, 0, "refused"))
            continue
        table = made.table
        error = table.inertia_kgm2 - drawn.inertia.at(table.position_rad)
        std = table.std_kgm2 if table.std_kgm2 is not None else np.zeros_like(error)
        outcomes.append(
            Outcome(
                method,
                float(np.sqrt(np.mean(error**2))) / drawn.mean_kgm2,
                int(np.sum(np.abs(error) <= 1.96 * std)),
                error.size,
                made.trust.verdict,
            )
        )
    return outcomes


def main() -> None:
    """Draw, estimate, count, print."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--machines", type=int, default=100)
    parser.add_argument("--first", type=int, default=0, help="first seed")
    parser.add_argument("--methods", nargs="*", default=["denoised", "multiphase", "trajectory", "auto"])
    given = parser.parse_args()
    methods = tuple(given.methods)
    outcomes: list[Outcome] = []
    with ProcessPoolExecutor(2) as pool:
        seeds = range(given.first, given.first + given.machines)
        for number, part in enumerate(pool.map(judge, seeds, itertools.repeat(methods)), start=1):
            outcomes += part
            print(f"\r{number} of {given.machines} machines", end="", flush=True)
    print(
        "\n\n| method | relative RMSE, median | 95th percentile | in the 95 % band | refused | hits | false alarms |"
    )
    print("|---|---|---|---|---|---|---|")
    for method in methods:
        of = [o for o in outcomes if o.method == method and o.verdict != "refused"]
        refused = sum(o.method == method and o.verdict == "refused" for o in outcomes)
        rmse = np.array([o.relative_rmse for o in of])
        bad = [o for o in of if o.relative_rmse > GOOD_RELATIVE_RMSE]
        fine = [o for o in of if o.relative_rmse <= GOOD_RELATIVE_RMSE]
        inside = sum(o.inside for o in of) / max(sum(o.cells for o in of), 1)
        hits = sum(o.verdict != "good" for o in bad)
        alarms = sum(o.verdict != "good" for o in fine)
        print(
            f"| {method} | {100 * np.median(rmse):.3f} % | {100 * np.percentile(rmse, 95):.2f} % "
            f"| {100 * inside:.1f} % | {refused} | {hits} of {len(bad)} | {alarms} of {len(fine)} |"
        )


if __name__ == "__main__":
    main()
