"""A session as long as they come, with long rests, from `schwung_sim`'s two-mass machine: for who measures time.

Eight motions (three motion times, as references and with 50 Hz injected at two phases) are recorded three times each.
"""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from schwung.drivetrain.inertia import InertiaTable
from schwung.drivetrain.machine import Coupling, Load, Machine, Motor
from schwung.motion import Excitation, Motion
from schwung.session.model import Run, Session
from schwung_sim.drives.axis import AxisSettings, ServoAxis
from schwung_sim.plants import TICK_S, TwoMassPlant
from schwung_sim.plants.concealed import parse_conceal
from schwung_sim.recording import Noise, play

RATE_HZ, SAMPLES, REPEATS = 4000.0, 4000, 3
MOTION_TIMES_S = (0.25, 0.4, 0.6)
#: Injected phases of each motion time; None: a reference.
PHASES: dict[float, tuple[float | None, ...]] = {
    0.25: (None, 0.0, np.pi),
    0.4: (None, 0.0, np.pi),
    0.6: (None, 0.0),
}


def session(
    concealed: str,
    seed: int = 0,
    *,
    samples: int = SAMPLES,
    rate_hz: float = RATE_HZ,
    foreign: Mapping[str, Mapping[str, float]] | None = None,
) -> tuple[Session, Machine]:
    """The recorded session, and the machine without what it conceals; `foreign`: effects that have no name."""
    plant = TwoMassPlant(concealed=parse_conceal(concealed), seed=seed, foreign=foreign)
    axis = ServoAxis(plant, AxisSettings(), seed=seed)
    every = round(1 / (rate_hz * TICK_S))
    runs: list[Run] = []
    for repeat in range(REPEATS):
        for duration in MOTION_TIMES_S:
            dwell = samples / rate_hz - 0.1 - duration
            motion = Motion(
                kind="poly5", distance_rad=np.pi, duration_s=duration, start_time_s=0.1, dwell_s=dwell
            )
            time = motion.time(1 / TICK_S)
            demand = motion.demand(time).position_rad
            for phase in PHASES[duration]:
                excitation = None
                if phase is not None:
                    excitation = Excitation(
                        frequency_hz=50.0,
                        amplitude_nm=40.0,
                        phase_rad=phase,
                        ramp_s=0.04,
                        end_s=motion.total_s,
                    )
                added = excitation.torque(time) if excitation else np.zeros_like(time)
                plant.begin_motion()
                noise = Noise(0.02, 0.1)
                r = play(axis, demand, added, every, noise, 1000 * seed + len(runs))
                runs.append(
                    Run(
                        role="excited" if excitation else "reference",
                        repeat=repeat,
                        sample_rate_hz=rate_hz,
                        time_s=r.time_s[:samples],
                        position_rad=r.position_rad[:samples],
                        speed_rad_s=r.speed_rad_s[:samples],
                        torque_nm=r.torque_nm[:samples],
                        position_demand_rad=r.position_demand_rad[:samples],
                        torque_added_nm=r.torque_added_nm[:samples],
                        motion=motion,
                        excitation=excitation,
                        name=f"run {len(runs)}",
                    )
                )
    return Session(tuple(runs), created="2026-01-01T00:00:00", source="benchmark"), _belief(seed)


def _belief(seed: int) -> Machine:
    truth = TwoMassPlant(seed=seed)
    angles = np.linspace(-0.3, np.pi + 0.3, 200)
    machine = truth.machine
    return Machine(
        name="belief",
        motor=Motor(
            inertia_kgm2=machine.rotor_inertia_kgm2,
            viscous_friction_nms=machine.rotor_viscous_nms,
            peak_torque_nm=233.0,
        ),
        coupling=Coupling(stiffness_nm_rad=machine.stiffness_nm_rad, damping_nms=machine.damping_nms),
        load=Load(
            viscous_friction_nms=machine.load_viscous_nms,
            inertia_table=InertiaTable(angles, truth.true_inertia(angles)),
        ),
    )
