"""An FMU as the belief of an explanation: played along the recorded runs, in a process of its own, never looked into.

A forward FMU (torque in, motion out) is kept near the recorded motion by position and speed while it gets the recorded
torque: what it took is the torque that it needs for its motion. An inverse one says that at once. Both give a *twin* of
each recorded run. What the stand-in (`standin.py`) misses of a twin it misses of the recording, too; the explanation
takes it off (`explain(…, twin=…)`). So the residual is that against the FMU itself, errors of the stand-in cancel to
first order, and the stand-in only says how named physics would show.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
from scipy.interpolate import CubicHermiteSpline, CubicSpline

from schwung.drivetrain.machine import Machine
from schwung.errors import InputError
from schwung.motion import Array
from schwung.session.imports import motion_identity
from schwung.session.model import Run, Session
from schwung.simulators.described import Described, describe
from schwung.simulators.followed import Followed, Recording, along, recording_of
from schwung.simulators.mapping import Ports, ports, read_map
from schwung.simulators.needed import MotorMotion, needed, two_masses
from schwung.simulators.playing import Job, Played, play
from schwung.simulators.spectrum import Spectrum
from schwung.simulators.standin import StandIn, stand_in

Progress = Callable[[str, float], None]

#: Steps of an FMU per second that are asked for: of co-simulation, and of a variable-step solver (model exchange).
CO_SIMULATION_HZ, MODEL_EXCHANGE_HZ = 16000.0, 4000.0
#: Crossover of the speed that brings a forward FMU back to the motion, and of the position, times 2π (Hz); and the
#: largest share of a step's change of speed that may be fed back at once.
SPEED_HZ, POSITION_HZ, LARGEST_SHARE = 40.0, 8.0, 0.3
#: How long a first push is (s).
PUSH_S = 4e-3
#: Motions that are repeated with a multisine, its lines (Hz), and its share of the session's highest torque.
PROBED, LINES_HZ, PROBE_SHARE = 3, (11.0, 300.0), 0.15
#: How slowly the multisine comes and goes (s): a period of its lowest line.
FADE_S = 1 / LINES_HZ[0]
#: So much of the FMU's torque that the stand-in misses is worth a word.
WORTH_A_WORD = 0.05


@dataclass(frozen=True, eq=False)
class FmuBelief:
    """What an explanation takes: a machine that stands in for the FMU, and the twin of the session that it made."""

    machine: Machine
    twin: Session
    stand_in: StandIn
    notes: tuple[str, ...]


def fmu_belief(
    session: Session, fmu: str | Path, mapped: str | Path, *, progress: Progress | None = None
) -> FmuBelief:
    """Measure an FMU along a recorded session.

    Args:
        session: as recorded; its motions are what the FMU is played along.
        fmu: FMI 2.0 or 3.0, co-simulation or model exchange; torque in and motion out, or the inverse.
        mapped: map.toml, which variable is which.
        progress: told what is done, and the share of it, 0…1.

    Raises InputError where FMU or map are not what they should be, or the FMU fails while it is played.
    """
    tell = progress or (lambda _text, _share: None)
    tell("Reading the FMU", 0.0)
    if session.effort != "torque":
        raise InputError(
            "session",
            "holds currents in A, and an FMU speaks of torques",
            "Import it with its torque constant.",
        )
    described = describe(fmu)
    of = ports(read_map(mapped), described, str(mapped))
    prepared = recording_of(session, _crude_kgm2(session))
    step = _step_s(of, session)
    gains = (1.0, 1.0) if of.inverse else _gains(described, of, prepared, step)
    jobs = [_job(run, step, gains) for run in prepared.runs]
    probes = _probes(session, prepared, jobs, of)
    tell("Playing the FMU", 0.02)
    played = play(
        described.path, of, [*jobs, *probes], lambda share: tell("Playing the FMU", 0.02 + 0.6 * share)
    )
    twins, probed = played[: len(jobs)], played[len(jobs) :]
    _require_near(described, twins, prepared)
    tell("Measuring the FMU", 0.65)
    few = [twins[number] for number in _distinct(session)[:PROBED]]
    found = stand_in(few, probed, f"Stand-in for {described.name}", held=not of.inverse)
    twin = _session(session, described, of, twins)
    if not of.inverse:
        nearer = _nearer(jobs, twins, prepared, along(twin, prepared), found.machine)
        again = play(
            described.path, of, nearer, lambda share: tell("Playing it once more", 0.7 + 0.3 * share)
        )
        twin = _session(session, described, of, again)
    tell("Measuring the FMU", 1.0)
    return FmuBelief(
        machine=found.machine,
        twin=twin,
        stand_in=found,
        notes=_notes(described, of, found),
    )


def _crude_kgm2(session: Session) -> float:
    """One mass, by torque over acceleration: enough to know which band the recording holds."""
    inertias = []
    for run in session.runs:
        spectrum = Spectrum(len(run), run.sample_rate_hz, 0.1)
        low = spectrum.low_pass(min(25.0, 0.1 * run.sample_rate_hz))
        alpha = spectrum.apply(run.position_rad, low * spectrum.omega**2, "drop")
        torque = spectrum.apply(run.torque_nm, low)
        inertias.append(abs(float(alpha @ torque)) / max(float(alpha @ alpha), 1e-300))
    peak = max(float(np.max(np.abs(run.torque_nm))) for run in session.runs)
    return max(float(np.median(inertias)), peak / 1e8, 1e-12)


def _step_s(of: Ports, session: Session) -> float:
    """How long the FMU's steps are: the map's, whole ones of its own, or ours."""
    wanted = 1 / (MODEL_EXCHANGE_HZ if of.interface == "model-exchange" else CO_SIMULATION_HZ)
    fastest = max(run.sample_rate_hz for run in session.runs)
    wanted = min(wanted, 0.5 / fastest)
    if of.step_s is None:
        return wanted
    return of.step_s * max(1, round(wanted / of.step_s)) if of.own_step else of.step_s


def _job(run: Followed, step: float, gains: tuple[float, float]) -> Job:
    """A recorded run on the FMU's grid."""
    begin, end = float(run.time_s[0]), float(run.time_s[-1])
    n = max(2, int((end - begin) / step))
    time = begin + step * np.arange(n + 1)
    angle = CubicHermiteSpline(run.time_s, run.position_rad, run.speed_rad_s)
    speed = CubicHermiteSpline(run.time_s, run.speed_rad_s, run.acceleration_rad_s2)
    torque = CubicSpline(run.time_s, run.torque_nm)
    return Job(
        begin, step, angle(time), speed(time), speed.derivative()(time), torque(time[:-1] + step / 2), gains
    )


def _gains(described: Described, of: Ports, prepared: Recording, step: float) -> tuple[float, float]:
    """What brings the FMU back to the motion, by what a push does to it. Raises InputError for a wrong sign."""
    first = prepared.runs[0]
    push = max(float(np.max(np.abs(run.torque_nm))) for run in prepared.runs)
    n = max(4, round(PUSH_S / step))
    rest = np.full(n + 1, first.position_rad[0])
    jobs = [
        Job(float(first.time_s[0]), step, rest, 0 * rest, 0 * rest, np.full(n, side * push), (0.0, 0.0))
        for side in (1.0, -1.0)
    ]
    forth, back = play(described.path, of, jobs)
    gained = 0.5 * (forth.speed_rad_s - back.speed_rad_s)[1:]
    path = 0.5 * (forth.angle_rad - back.angle_rad)
    moved = float(np.mean(path))  # not where it is at the end: a coupling may have thrown it back by then
    if not abs(moved) > 0:
        raise InputError(
            str(described.path),
            f'"{of.position.name}" does not move when "{of.torque.name}" pushes',
            "Check the variables of the map.",
        )
    if moved < 0:
        raise InputError(
            str(described.path),
            f'a positive "{of.torque.name}" moves "{of.position.name}" back',
            "One of them counts the other way round than the recording: give it sign = -1 in the map.",
        )
    if of.speed is not None and float(gained @ np.diff(path)) < 0:
        raise InputError(
            str(described.path),
            f'"{of.speed.name}" falls while "{of.position.name}" rises',
            "Give one of them sign = -1 in the map.",
        )
    elapsed = step * np.arange(1, n + 1)
    inertia = float(np.min(push * elapsed / np.maximum(gained, 1e-300)))
    speed = min(2 * np.pi * SPEED_HZ, LARGEST_SHARE / step) * inertia
    return float(2 * np.pi * POSITION_HZ * speed), float(speed)


def _distinct(session: Session) -> list[int]:
    """The first run of each motion."""
    known: dict[object, int] = {}
    for number, run in enumerate(session.runs):
        known.setdefault(motion_identity(run), number)
    return list(known.values())


def _probes(session: Session, prepared: Recording, jobs: Sequence[Job], of: Ports) -> list[Job]:
    """The first motions again with a multisine in the torque, or of an inverse FMU in the motion."""
    push = PROBE_SHARE * max(float(np.max(np.abs(run.torque_nm))) for run in prepared.runs)
    result = []
    for number in _distinct(session)[:PROBED]:
        job = jobs[number]
        highest = min(LINES_HZ[1], 0.08 / job.step_s)
        lines = 2 * np.pi * np.geomspace(LINES_HZ[0], highest, 24)
        phases = np.pi * np.arange(lines.size) ** 2 / lines.size  # Schroeder: no peaks
        each = push * np.sqrt(2 / lines.size)
        time = job.step_s * np.arange(job.angle_rad.size)
        fade = _faded(np.asarray(time, dtype=float))
        if not of.inverse:
            sine = np.sin(np.outer(time[:-1] + job.step_s / 2, lines) + phases)
            result.append(replace(job, torque_nm=job.torque_nm + each * fade[:-1] * sine.sum(axis=1)))
            continue
        inertia = _crude_kgm2(session)
        turned = np.outer(time, lines) + phases
        angle = fade * (-each / inertia * np.sin(turned) / lines**2).sum(axis=1)
        shaken = CubicSpline(time, angle)
        result.append(
            replace(
                job,
                angle_rad=job.angle_rad + angle,
                speed_rad_s=job.speed_rad_s + shaken(time, 1),
                acceleration_rad_s2=job.acceleration_rad_s2 + shaken(time, 2),
            )
        )
    return result


def _faded(time_s: Array) -> Array:
    """1, but rising from 0 and falling to it at the ends of a run, (n,): what is cut off rings long after in filters
    and on springs, and would be measured."""
    whole = float(time_s[-1])
    fade = min(FADE_S, whole / 4)
    return np.asarray(np.sin(np.pi / 2 * np.clip(np.minimum(time_s, whole - time_s) / fade, 0, 1)) ** 2)


def _session(session: Session, described: Described, of: Ports, twins: Sequence[Played]) -> Session:
    """The twins as runs of a session."""
    runs = [_twin(run, twin, held=not of.inverse) for run, twin in zip(session.runs, twins, strict=True)]
    return replace(session, runs=tuple(runs), source=str(described.path))


def _nearer(
    jobs: Sequence[Job], twins: Sequence[Played], recorded: Recording, prepared: Recording, machine: Machine
) -> list[Job]:
    """The jobs with the torque that the FMU took, and what the stand-in asks for the way back to the recorded motion.

    What the FMU lacks, the recorded torque held: it strayed by that, as far as what brings it back is soft.
    """
    masses = two_masses(machine)

    def asked(run: Followed) -> Array:
        motion = MotorMotion(run.position_rad, run.speed_rad_s, run.acceleration_rad_s2, 1 / recorded.rate_hz)
        return needed(masses, motion)

    result = []
    for job, played, here, there in zip(jobs, twins, recorded.runs, prepared.runs, strict=True):
        spectrum = Spectrum(here.time_s.size, recorded.rate_hz, 3 / recorded.band_hz)
        back = spectrum.apply(asked(here) - asked(there), spectrum.low_pass(recorded.band_hz))
        middle = job.begin_s + job.step_s * (np.arange(job.torque_nm.size) + 0.5)
        taken = played.torque_nm + CubicSpline(here.time_s, back)(np.minimum(middle, here.time_s[-1]))
        result.append(replace(job, torque_nm=taken))
    return result


def _twin(run: Run, played: Played, *, held: bool) -> Run:
    """What the FMU did, at the recording's instants."""
    n, step = played.torque_nm.size, played.job.step_s
    spectrum = Spectrum(n, 1 / step, 20 * step)
    gain = np.exp(-0.5 * spectrum.omega * step)
    if held:
        gain = gain * np.sinc(spectrum.frequency_hz * step)
    torque = spectrum.apply(played.torque_nm, gain * spectrum.low_pass(0.45 * run.sample_rate_hz))
    time = played.time_s
    inside = np.clip(run.time_s, time[0], time[-1])

    def at(values: Array) -> Array:
        return np.asarray(CubicSpline(time[: values.size], values)(np.minimum(inside, time[values.size - 1])))

    extra = dict(run.extra)
    return replace(
        run,
        position_rad=at(played.angle_rad),
        speed_rad_s=at(played.speed_rad_s),
        torque_nm=at(torque),
        torque_added_nm=None,
        extra=extra,
    )


def _require_near(described: Described, twins: Sequence[Played], prepared: Recording) -> None:
    """Raise InputError where the FMU did not go where the recording did: another machine, or another unit."""
    for twin, run in zip(twins, prepared.runs, strict=True):
        stroke = max(float(np.ptp(run.position_rad)), 1e-12)
        off = float(np.max(np.abs(twin.angle_rad - twin.job.angle_rad)))
        if off > 0.25 * stroke:
            raise InputError(
                str(described.path),
                f"strays from the recorded motion by {off / stroke:.0%} of the stroke even when it is held to it",
                "Check units and signs of the map, and whether it is a model of this machine.",
            )


def _notes(described: Described, of: Ports, found: StandIn) -> tuple[str, ...]:
    notes = [
        f'the belief is the FMU "{described.name}" as it was played; the machine file is a stand-in, measured of it: '
        "inertia, coupling and load torque, with the named physics"
    ]
    mapped = {port.name for port in (of.torque, of.position, of.speed, of.acceleration) if port is not None}
    left = [name for name in described.of("input") if name not in mapped and name not in of.parameters]
    if left:
        notes.append(
            f"nobody says what the FMU's input{'s' * (len(left) > 1)} {', '.join(left)} should be: at the start value "
            "all along, unless [parameters] of the map give another"
        )
    if found.left_out_nm > WORTH_A_WORD * found.torque_nm:
        share = found.left_out_nm / found.torque_nm
        notes.append(
            f"the FMU asks {found.left_out_nm:.3g} N·m RMS ({share:.0%} of its torque) for more than the stand-in has: "
            "it is taken off the recording, but is not in the machine file"
        )
    return tuple(notes)
