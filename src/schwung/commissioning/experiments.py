"""The next experiment: of the motions within a machine's limits, the one that best tells apart what is still confused.

Motions are tried on the belief, planned and checked as those of a commissioning; what comes near a limit is none.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from itertools import product

import numpy as np

from schwung.commissioning.commission import Wishes, wishes_of
from schwung.commissioning.limits import Limits, LimitWishes
from schwung.commissioning.plan import Plan, make_plan
from schwung.commissioning.preflight import motion_checks, sampled_run, simulated_run
from schwung.drivetrain import FeedForward, InertiaTable, Machine
from schwung.errors import InputError
from schwung.explain.weighing.experiment import UNNAMED, Gain, Rival, Rivals
from schwung.explain.weighing.values import Weighed
from schwung.session import Run, Session

#: Times of a stroke, frequencies and amplitudes that are tried, over those of the session.
DURATIONS = (0.5, 0.7, 1.0, 1.4, 2.0, 4.0, 8.0)
FREQUENCIES, AMPLITUDES = (0.5, 1.0, 1.5), (0.3, 1.0, 2.0)
#: Strokes that are tried, over the session's; and how much of the room on either side.
STROKES, ROOM = (1.0, 0.5, 0.2), (0.5, 0.95)
#: Strokes that differ by less than this share are one.
_SAME = 0.15
#: No run lasts longer (s).
LONGEST_S = 10.0
#: The best so many strokes are tried with every injection.
_CLOSELY = 3
#: What tells less (nats) tells nothing.
WORTH = 0.01
#: A name is told apart at this probability.
SURE = 0.95


@dataclass(frozen=True)
class Setting:
    """Where a next motion is looked for: what was done last, the limits, where the axis stands, the belief."""

    done: Wishes
    limits: Limits
    start_position_rad: float
    machine: Machine  # with gains
    torque_held: bool = True
    feed_forward: FeedForward | None = None
    longest_s: float = LONGEST_S

    @property
    def window_rad(self) -> tuple[float, float]:
        """Angles within the limits at which the belief says what the load's inertia is, or the session has been.

        Beyond its table all that is unknown of the inertia would drown what is confused.
        """
        low, high = self.limits.position_min_rad, self.limits.position_max_rad
        table = self.machine.load_inertia
        if not isinstance(table, InertiaTable):
            return low, high
        here, there = self.start_position_rad, self.start_position_rad + self.done.distance_rad
        known = float(table.position_rad[0]), float(table.position_rad[-1])
        return max(low, min(known[0], here, there)), min(high, max(known[1], here, there))

    def plan(self, wishes: Wishes) -> Plan:
        """The motions of some wishes. Raises InputError where no motion can be them."""
        return make_plan(
            self.machine,
            self.limits,
            start_position_rad=self.start_position_rad,
            distance_rad=wishes.distance_rad,
            duration_s=wishes.duration_s,
            kind=wishes.kind,
            returns=wishes.returns,
            sample_rate_hz=wishes.sample_rate_hz,
            frequency_hz=wishes.frequency_hz,
            amplitude_nm=wishes.amplitude_nm,
            repeats=wishes.repeats,
            torque_held=self.torque_held,
        )

    def played(self, wishes: Wishes) -> tuple[Run, ...] | None:
        """The runs as the believed machine would make them; None where they come near a limit."""
        try:
            plan = self.plan(wishes)
        except InputError:
            return None
        if plan.motion.total_s > self.longest_s:
            return None
        planned = tuple(plan.runs())
        back = plan.way_back(planned[0])
        made = [
            simulated_run(run, plan, self.machine, self.feed_forward)
            for run in (*planned, *([back] if back else []))
        ]
        if any(check.severity != "ok" for check in motion_checks(plan, made)):
            return None
        return tuple(sampled_run(run, plan, one) for run, one in zip(planned, made, strict=False))


@dataclass(frozen=True)
class Experiment:
    """A motion, what it is expected to tell, and of what."""

    wishes: Wishes
    gain: Gain
    rivals: tuple[Rival, ...]

    @property
    def motions(self) -> int:
        """How many runs it takes: without and with the injected torque."""
        return 2 * self.wishes.repeats

    @property
    def sentence(self) -> str:
        """What it separates, and by how much."""
        return f"{told_apart(self.rivals)} → expected {self.gain.expected:.2f}"


def told_apart(rivals: Sequence[Rival]) -> str:
    """The likeliest rivals by what they differ in: "stribeck_friction 0.55 / local_friction 0.41"."""
    first = rivals[
        : next((i for i, one in enumerate(rivals) if i > 1 and one.probability < 0.05), len(rivals))
    ]
    common = set(first[0].names).intersection(*(one.names for one in first)) if len(first) > 1 else set()

    def words(rival: Rival) -> str:
        own = [name for name in rival.names if name not in common]
        return " and ".join(own) if own else "nothing more" if common else "nothing"

    said = " / ".join(f"{words(one)} {one.probability:.2f}" for one in first)
    return f"{said} (beside {' and '.join(sorted(common))})" if common else said


def faint(weighed: Weighed, rivals: Sequence[Rival]) -> str:
    """Names of the likeliest set that hardly stand out from what has no name, in words; or that it holds no name, where
    something was found that has none. Empty: neither. No motion that tells names apart helps there."""
    likeliest = rivals[0].names
    if not likeliest and weighed.unnamed and weighed.unnamed[0].probability > 1 - SURE:
        first = weighed.unnamed[0]
        return f"what follows {first.coordinate} has no name, and is there with {first.probability:.2f}"
    said = [
        f"{name} stands out from what no name describes with {weighed.probability(name):.2f} only"
        for name in likeliest
        if not name.startswith(UNNAMED) and weighed.probability(name) < SURE
    ]
    return " and ".join(said)


def setting_of(session: Session, machine: Machine) -> Setting:
    """Where a session's next motion may be: within its own limits, or, where it has none, within what it did.

    Raises InputError where it does not say which motion was made, or neither it nor the belief know the drive's gains.
    """
    machine.required_control()
    motion = next((run.motion for run in session.runs if run.motion is not None), None)
    if motion is None:
        raise InputError(
            "session", "does not say which motion was made", "Take one whose runs have their motion."
        )
    sine = next((run.excitation for run in session.runs if run.excitation is not None), None)
    try:
        done = wishes_of(session)
        limits = Limits(**vars(done.limits))
        settings = (session.drive or {})["settings"]
        start = float(settings["start_position_rad"])
    except (InputError, KeyError, TypeError, ValueError):
        limits, start = _as_done(session, machine), float(session.runs[0].position_rad[0])
        done = Wishes(
            distance_rad=motion.distance_rad,
            duration_s=motion.duration_s,
            limits=LimitWishes(**vars(limits)),
            kind="third" if motion.kind == "points" else motion.kind,
            returns=motion.returns,
            sample_rate_hz=session.runs[0].sample_rate_hz,
        )
    if sine is not None:
        done = replace(done, frequency_hz=sine.frequency_hz, amplitude_nm=sine.amplitude_nm)
    done = replace(done, repeats=1, phases=1, also_s=())
    return Setting(done, limits, start, machine, torque_held=sine is None or sine.hold_s is not None)


def _as_done(session: Session, machine: Machine) -> Limits:
    """Within what the session did, nothing new can break."""
    low = min(float(run.position_rad.min()) for run in session.runs)
    high = max(float(run.position_rad.max()) for run in session.runs)
    errors = [
        float(np.max(np.abs(run.position_demand_rad - run.position_rad)))
        for run in session.runs
        if run.position_demand_rad is not None
    ]
    torque = max(float(np.max(np.abs(run.torque_nm))) for run in session.runs)
    return Limits(
        position_min_rad=low,
        position_max_rad=high,
        speed_max_rad_s=max(float(np.max(np.abs(run.speed_rad_s))) for run in session.runs),
        torque_max_nm=min(torque, machine.motor.peak_torque_nm or torque),
        following_error_rad=max(errors, default=high - low),
    )


def strokes(setting: Setting) -> Iterator[Wishes]:
    """Every stroke and time that is tried, with the session's own injection."""
    done, here = setting.done, setting.start_position_rad
    below, above = (end - here for end in setting.window_rad)
    wanted = [share * done.distance_rad for share in STROKES]
    wanted += [share * room for share in ROOM for room in (above, below)]
    distances: list[float] = []
    for distance in wanted:
        usual = max(abs(done.distance_rad), 1e-9)
        new = all(abs(distance - other) > _SAME * usual for other in distances)
        if new and below <= distance <= above and abs(distance) > 0.05 * usual:
            distances.append(distance)
    for distance, factor in product(distances, DURATIONS):
        yield replace(done, distance_rad=distance, duration_s=factor * done.duration_s)


def injections(setting: Setting, wishes: Wishes) -> Iterator[Wishes]:
    """The same stroke with every injection that is tried."""
    excitation = setting.plan(setting.done).excitation
    for f, a in product(FREQUENCIES, AMPLITUDES):
        yield replace(
            wishes, frequency_hz=f * excitation.frequency_hz, amplitude_nm=a * excitation.amplitude_nm
        )


def next_experiments(rivals: Rivals, setting: Setting) -> list[Experiment]:
    """The motions worth making, that which tells most first; empty where none within the limits tells anything."""
    if rivals.settled:
        return []
    found = [one for wishes in strokes(setting) if (one := weighed(rivals, setting, wishes))]
    found.sort(key=lambda one: -one.gain.information)
    closely = [
        one
        for first in found[:_CLOSELY]
        for wishes in injections(setting, first.wishes)
        if (one := weighed(rivals, setting, wishes))
    ]
    worth = [one for one in (*found, *closely) if one.gain.information > WORTH]
    return sorted(worth, key=lambda one: -one.gain.information)


def weighed(rivals: Rivals, setting: Setting, wishes: Wishes) -> Experiment | None:
    """What some wishes would tell; None where they come near a limit."""
    runs = setting.played(wishes)
    if runs is None:
        return None
    gain = rivals.gain(runs)
    return Experiment(wishes, gain, rivals.rivals) if math.isfinite(gain.information) else None
