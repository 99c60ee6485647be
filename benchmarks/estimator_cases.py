"""The sessions of the estimators' benchmark: machines × motion times × what real life adds, and who gets which runs.

The recordings come from the virtual machine room, which shares no code with the estimators; what real life adds
(friction, gravity, play, delay, …) is not told to them. Sessions are kept, so that only new ones are made.
"""

from __future__ import annotations

import itertools
from collections.abc import Callable, Iterator
from dataclasses import asdict, dataclass, field
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from schwung.drivetrain import Control, Coupling, InertiaTable, Load, Machine, Motor
from schwung.motion import Excitation, Motion
from schwung.session import Run, Session, read_session
from schwung.session.hdf5 import SessionWriter
from schwung_sim.drives.axis import AxisSettings, ServoAxis
from schwung_sim.plants import TICK_S, Profile, TwoMassPlant, parse_conceal
from schwung_sim.recording import Noise, play

Array = NDArray[np.float64]
FREQUENCY_HZ, AMPLITUDE_NM = 50.0, 46.6
PHASES = (0.0, np.pi / 2, np.pi, 3 * np.pi / 2)
#: The torque limit where nothing shall be clipped, over what the motion takes.
FREE = 1.25
#: Runs of a session: reference and one phase, as the paper has it; reference and four phases.
PAIR, ALL = 2, 5
SLIDER_CRANK = "slider-crank"


def _payload_step(angle: Array) -> Array:
    """A payload picked up half-way: 0.08 to 0.14 kg·m² within 0.2 rad."""
    return 0.11 + 0.03 * np.tanh((angle - 1.57) / 0.1)


MACHINES: dict[str, Callable[[], Profile]] = {
    "constant": lambda: Profile.constant(0.11),
    SLIDER_CRANK: lambda: TwoMassPlant(inertia="slider-crank").inertia,
    "four-bar": lambda: TwoMassPlant(inertia="four-bar").inertia,
    "payload step": lambda: Profile.of_pairs(
        np.linspace(-0.5, 3.7, 400), _payload_step(np.linspace(-0.5, 3.7, 400))
    ),
}


@dataclass(frozen=True)
class Condition:
    """What real life adds; `modelled`: the machine file holds all there is, so that a Cramér-Rao bound applies."""

    conceal: str = ""
    rate_hz: float = 4000.0
    noise: Noise = field(default_factory=Noise)
    clip: float | None = None  # torque limit as a share of what the motion would take
    modelled: bool = True


CLEAN = "clean"
CONDITIONS = {
    CLEAN: Condition(),
    "friction": Condition("stribeck_friction", modelled=False),
    "gravity": Condition("load_torque", modelled=False),
    "backlash": Condition("backlash", modelled=False),
    "0.5 ms delay": Condition("measurement_delay=0.0005", modelled=False),
    "12-bit speed": Condition(noise=Noise(0.02, 0.1, 2 * 60.0 / 4096)),
    "1 kHz": Condition(rate_hz=1000.0),
    "8 kHz": Condition(rate_hz=8000.0),
    "clipped": Condition(clip=0.8),
}
DURATIONS_S = (0.5, 0.3, 0.25, 0.2, 0.15, 0.1, 0.08)
USUAL_S = 0.25


@dataclass(frozen=True)
class Case:
    """One session, to be estimated by everybody."""

    machine: str
    duration_s: float
    condition: str
    seed: int = 0

    @property
    def motion(self) -> Motion:
        """Half a turn and back by the 1/3 profile."""
        return Motion(distance_rad=np.pi, duration_s=self.duration_s, start_time_s=0.12, dwell_s=0.1)

    @property
    def inertia(self) -> Profile:
        """The truth."""
        return MACHINES[self.machine]()


@dataclass(frozen=True)
class Entrant:
    """A method, and how many runs of the session it gets."""

    method: str
    runs: int

    def given(self, session: Session) -> Session:
        """Its share of the session."""
        return Session(session.runs[: self.runs], session.created, session.source)


BOUND = "bound"  # listed among the methods: the Cramér-Rao bound


def usual_runs(method: str) -> int:
    """One injected phase for all but the methods that are made for several."""
    return ALL if method in ("multiphase", "trajectory", "auto", BOUND) else PAIR


def entrants(case: Case, methods: tuple[str, ...]) -> Iterator[Entrant]:
    """Everybody with the runs that they are made for; where nothing is added, with the others' runs as well."""
    for method in methods:
        yield Entrant(method, usual_runs(method))
        if case.condition == CLEAN and method != "multiphase":
            yield Entrant(method, PAIR if usual_runs(method) == ALL else ALL)
    if CONDITIONS[case.condition].modelled:
        yield from (Entrant(BOUND, runs) for runs in ((PAIR, ALL) if case.condition == CLEAN else (ALL,)))


def cases(quick: bool, seeds: int = 1) -> Iterator[Case]:
    """Every machine, motion time and condition; `quick`: the slider-crank in the clean, and one motion time."""
    durations = (0.5, 0.25, 0.15, 0.1) if quick else DURATIONS_S
    for seed, duration, condition, machine in itertools.product(
        range(seeds), durations, CONDITIONS, MACHINES
    ):
        if not quick or (machine == SLIDER_CRANK and (condition == CLEAN or duration == USUAL_S)):
            yield Case(machine, duration, condition, seed)


def session_of(case: Case, folder: Path) -> Session:
    """The case's session from the folder, or made and kept there."""
    name = "-".join(str(value) for value in asdict(case).values()).replace(" ", "_")
    path = folder / f"{name}.h5"
    if not path.exists():
        made, draft = make_session(case), path.with_suffix(".draft")
        with SessionWriter(draft, source=made.source, created=made.created, overwrite=True) as writer:
            for run in made.runs:
                writer.append(run)
        draft.replace(path)
    return read_session(path)


def make_session(case: Case, limit_nm: float = 1e6) -> Session:
    """A reference and four excited runs (the first with phase 0), recorded on the virtual axis.

    `limit_nm`: of the torque, where the condition has none of its own.
    """
    clip = CONDITIONS[case.condition].clip
    limit = limit_nm
    if clip is not None:
        free = [_record(case, phase, 1e6) for phase in (None, PHASES[0])]
        limit = clip * max(float(np.max(np.abs(run.torque_nm))) for run in free)
    runs = tuple(_record(case, phase, limit) for phase in (None, *PHASES))
    return Session(runs, created="2026-01-01T00:00:00", source="benchmark")


def _record(case: Case, phase: float | None, limit_nm: float) -> Run:
    condition, motion = CONDITIONS[case.condition], case.motion
    plant = TwoMassPlant(inertia=case.inertia, concealed=parse_conceal(condition.conceal), seed=case.seed)
    axis = ServoAxis(plant, AxisSettings(torque_limit_nm=limit_nm), seed=case.seed)
    instants = motion.time(1 / TICK_S)
    excitation = None
    added = np.zeros_like(instants)
    if phase is not None:
        excitation = Excitation(
            frequency_hz=FREQUENCY_HZ,
            amplitude_nm=AMPLITUDE_NM,
            phase_rad=phase,
            ramp_s=0.04,
            end_s=motion.total_s,
        )
        added = excitation.torque(instants)
    every = round(1 / (condition.rate_hz * TICK_S))
    number = 0 if phase is None else 1 + PHASES.index(phase)
    made = play(
        axis, motion.demand(instants).position_rad, added, every, condition.noise, 100 * case.seed + number
    )
    return Run(
        role="reference" if excitation is None else "excited", repeat=0, sample_rate_hz=condition.rate_hz,
        time_s=made.time_s, position_rad=made.position_rad, speed_rad_s=made.speed_rad_s, torque_nm=made.torque_nm,
        position_demand_rad=made.position_demand_rad, torque_added_nm=made.torque_added_nm, motion=motion,
        excitation=excitation, name=f"{case.machine}, {case.condition}, run {number}",
    )  # fmt: skip


def believed(session: Session, clipped: bool) -> Machine:
    """Motor, coupling and gains as they are, the torque limit as the drive has it; the load a guess."""
    settings = AxisSettings()
    largest = max(float(np.max(np.abs(run.torque_nm))) for run in session.runs)
    return Machine(
        name="benchmark",
        motor=Motor(
            inertia_kgm2=0.012, viscous_friction_nms=0.2, peak_torque_nm=largest * (1 if clipped else FREE)
        ),
        coupling=Coupling(stiffness_nm_rad=24963.0, damping_nms=8.62),
        load=Load(viscous_friction_nms=0.1, inertia_kgm2=0.11),
        control=Control(
            position_gain_per_s=settings.position_gain_1_s,
            speed_gain_nms=settings.speed_gain_nms_rad,
            speed_integral_time_s=settings.speed_integral_time_s,
            sample_rate_hz=1 / TICK_S,
        ),
    )


def known(session: Session, machine: Machine, truth: Profile) -> Machine:
    """The machine with the true inertia over all visited angles."""
    low = min(float(run.position_rad.min()) for run in session.runs) - 0.2
    high = max(float(run.position_rad.max()) for run in session.runs) + 0.2
    angle = np.linspace(low, high, 800)
    load = Load(viscous_friction_nms=0.1, inertia_table=InertiaTable(angle, truth.at(angle)))
    return machine.model_copy(update={"load": load})
