"""One round: the runs with everything present that may be there, the noise found so, and all columns whitened."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property
from typing import TypeVar

import numpy as np
from scipy.optimize import nnls

from schwung.explain.causes.along import Along, Ranges, leaves_rest_s
from schwung.explain.causes.candidate import Candidate, Missed, Shape
from schwung.explain.causes.equations import Acting, equations_of, load_taken, together
from schwung.explain.causes.joined import Joined
from schwung.explain.causes.known import Known
from schwung.explain.causes.present import Member, with_members
from schwung.explain.causes.true_torque import TrueTorque, torque_noise
from schwung.explain.weighing.work import LINEARISED, NOISE, Work
from schwung.innovations.effect import Effect, Passed, whiten
from schwung.innovations.likelihood import Noise, likely_noise, unshared_deviance_of
from schwung.innovations.low_pass import heard, loudness
from schwung.innovations.signals import Signals
from schwung.innovations.statistics import Columns
from schwung.motion import Array
from schwung.session.model import Run

#: Runs, or pairs of runs of one motion, that the sizes of noise are found from, and gaps looked for in first, at most.
FEW = 3
#: Steps to rest at most, of states and of coefficients.
STEPS = 12
#: Costs (−2 log) that differ by less are the same: the filter's equations change a little with the states.
ALIKE = 0.5
#: What misses so many times the noise is far from the truth.
FAR = 2.0
#: By how much less is known of what was measured, before states that do not settle are as sure as they are.
_LESS_SURE = (30.0, 10.0, 3.0)

#: Shares of a step by which what is held is taken otherwise, for the slope.
_APART = 1e-3
#: Of the way to the states that a further mass makes likely, so much at once.
_OF_THE_WAY = 0.5

#: Samples of angle and speed whose columns are worked out at once: more are further away than the nearest memory.
TOGETHER = 16_384

T = TypeVar("T")
#: A candidate in one of its shapes.
Cause = tuple[Candidate, Shape]


@dataclass(frozen=True, eq=False)
class View:
    """The session as a round sees it: recorded and prepared runs, the belief."""

    recorded: Sequence[Run]
    runs: tuple[Signals, ...]
    known: Known
    ranges: Ranges
    torques: tuple[TrueTorque, ...]  # of each run, as far as it is known
    dry_nm: float | None = None  # friction that leaves open where the shaft sticks; None: of what is present
    slowest: tuple[
        Array, ...
    ] = ()  # `Along.slowest` of each run for all sets alike; empty: as the states say
    repeats: Sequence[Sequence[int]] = ()  # runs of each motion and injection
    loud: tuple[
        Sequence[Array], ...
    ] = ()  # `loudness` of noise in each run's wind-up, its rate and the load's acceleration; empty: not known
    work: Work = field(default_factory=Work)  # that was done since the session was first looked at

    @property
    def noise_found(self) -> bool:
        """Whether what all sets have alike is known."""
        return self.dry_nm is not None

    @cached_property
    def _kept(self) -> list[dict[str, Array]]:
        """Coordinates of each run, as they were asked for."""
        return [{"slowest": one} for one in self.slowest] or [{} for _ in self.runs]

    def alongs(self, members: Sequence[Member]) -> list[Along]:
        """Every run's coordinates, with these members present."""
        present = with_members(self.known.machine, members, self.ranges)
        beyond = self.known.beyond(members)
        return [
            Along(
                run,
                self.known.machine,
                present,
                self.ranges,
                number,
                leaves_rest_s(recorded),
                self.torques[number],
                self._kept[number],
                self.loud[number] if self.loud else None,
                beyond,
            )
            for number, (run, recorded) in enumerate(zip(self.runs, self.recorded, strict=True))
        ]


def acting(view: View, along: Along, members: Sequence[Member]) -> Acting:
    """What the belief and the members do along a run."""
    (found,) = acting_on_each(view, Joined.of([along]), members)[1]
    return found


def acting_on_each(view: View, along: Joined, members: Sequence[Member]) -> tuple[Acting, list[Acting]]:
    """The same of several runs: together, where dry friction is not told, and of each."""
    known, carried = view.known, view.known.carried(members)
    what = known.effect(along)
    total, opposed = Acting(*what.alone), known.dry(along)
    if known.bends:
        total += _eased(along, known.tangent(along))
    for member in members:
        needless = member is carried or (member.candidate.of_machine and view.dry_nm is not None)
        if needless or not np.any(member.coefficients):
            continue
        done = Acting(*member.candidate.done(along, member.shape, member.coefficients).alone)
        if not member.candidate.swings:
            opposed = opposed - together(done.on_motor, done.on_load)
        if not member.candidate.of_machine:
            total += _further(along, member, done)
    each = zip(along.parts, along.wheres, strict=True)
    known_nm = view.dry_nm
    return total, [
        total.within(where, _dry(part, opposed[where]) if known_nm is None else known_nm)
        for part, where in each
    ]


def _further(along: Along, member: Member, done: Acting) -> Acting:
    """What it does, and what the filter has to know beside it.

    Of what bends the coupling: how much more that winds up for more torque. Of what follows the acceleration: how much
    less the load accelerates for more torque. Given as a torque alone, along an acceleration that is told by the
    samples that it shall foresee, it would foresee anything.
    """
    tangent, heavier = member.candidate.tangent, member.candidate.heavier
    if tangent is not None:
        done += _eased(along, tangent(along, member.shape, member.coefficients))
    if heavier is not None:
        done += Acting(inertia=heavier(along, member.shape, member.coefficients))
    return done


def _eased(along: Along, stiffer: Array) -> Acting:
    """A coupling that is so much stiffer, and damps so much more, (n, 2), in place of the torque of that."""
    turned = np.sum(stiffer * along.turned, axis=1)
    return Acting(on_motor=turned, on_load=-turned, coupling=stiffer)


def _dry(along: Along, opposed: Array) -> float:
    """Size of dry friction (N·m): what `opposed` (n,) takes from the motion where the shaft slides, however slowly.

    `opposed` is the believed dry friction and all that acts beyond the belief, for where everything smooth is present,
    any curve may carry friction, and others may cancel it. What grows with the speed holds nothing at rest; of two that
    friction is, neither drives. What swings is no part of it: in a stroke as short as its period that is all on one
    side, and is as well known as the motion.
    """
    fastest = max(float(np.max(np.abs(along.speed))), 1e-300)
    dry_and_viscous = np.stack([along.direction, along.speed / fastest], 1)[along.moves]
    return float(nnls(dry_and_viscous, opposed[along.moves])[0][0]) if np.any(along.moves) else 0.0


@dataclass(frozen=True, eq=False)
class Linearised:
    """The session about what is present: every run filtered."""

    view: View
    alongs: list[Along]
    passed: Mapping[int, Passed]  # of the runs that were asked for
    noise: Noise
    members: Sequence[Member] = ()  # that are present
    unlikely: float = 0.0  # what repeats do not share, where noise was found by it (−2 log likelihood)

    @property
    def swings(self) -> bool:
        """Whether a further mass, driven by the load, is present or known that is no state of the filter's: what it
        does follows from what it does."""
        return self.view.known.swings(self.members)

    def beside(self, runs: Sequence[int]) -> Linearised:
        """Other runs about the same, with the states that it makes likely."""
        return at_rest(self.view, self.members, self.noise, runs)

    def missed(self, run: int) -> Missed:
        """What is missed in one of the runs."""
        excitation = self.view.recorded[run].excitation
        injected = () if excitation is None else tuple(excitation.lines_hz.tolist())
        missed, along = -self.passed[run].torque_error_nm, self.alongs[run]
        return Missed(missed, along.angle, self.view.runs[run].step_s, injected, along)

    def samples(self, runs: Sequence[int]) -> int:
        """Σ2n of some runs."""
        return sum(self.passed[run].samples for run in runs)

    def measured(self, runs: Sequence[int]) -> int:
        """How many of them tell anything."""
        return sum(self.passed[run].measured for run in runs)

    def stretches(self, runs: Sequence[int]) -> list[slice]:
        """Where each of some runs is, one behind another."""
        ends = np.cumsum([self.passed[run].samples for run in runs]).tolist()
        return [slice(start, end) for start, end in zip([0, *ends[:-1]], ends, strict=True)]

    def whiten(self, causes: Iterable[Cause], runs: Sequence[int], rows: Columns | Array) -> None:
        """Write causes as the innovations of some runs show them, one run behind another, to `rows` (Σp, Σ2n)."""
        causes, across = list(causes), 0
        for some in self._few_samples(runs):
            joined = Joined.of([self.alongs[run] for run in some])
            effects = (candidate.effect(joined, shape) for candidate, shape in causes)
            whiten([self.passed[run] for run in some], effects, rows, across)
            self._whiten_hold(causes, some, joined, rows, across)
            across += self.samples(some)
        self.view.work.add(self.samples(runs) * sum(candidate.size for candidate, _ in causes))

    def _whiten_hold(
        self, causes: Sequence[Cause], runs: Sequence[int], joined: Joined, rows: Columns | Array, across: int
    ) -> None:
        """The same of what is held and taken later: where in a step it is taken, no torque at samples says."""
        downs = np.cumsum([0, *(candidate.size for candidate, _ in causes)]).tolist()
        holds = [down for (one, _), down in zip(causes, downs, strict=False) if one.holds]
        held = [self.view.runs[run].drive.held.is_any for run in runs]
        if not holds or not any(held):
            return
        beside = self._beside(joined).parts
        for run, where, is_held in zip(runs, joined.wheres, held, strict=True):
            passed, signals = self.passed[run], self.view.runs[run]
            if is_held:
                later = signals.drive.held.slope(self.alongs[run].beyond.held_late * signals.step_s)
                own = Effect(*(None if part is None else part[where] for part in beside))
                found = passed.driven(later).innovations + passed.whitened([own])[0]
                rows[holds, across : across + passed.samples] = found
            across += passed.samples

    def _beside(self, joined: Joined) -> Effect:
        """What all that is present does otherwise along some runs where what is held is taken later, by a step: of a
        late speed, the corners are elsewhere."""

        def later(way: int) -> Acting:
            parts = [
                replace(one, beyond=replace(one.beyond, held_late=one.beyond.held_late + way * _APART))
                for one in joined.parts
            ]
            return acting_on_each(self.view, Joined.of(parts), self.members)[0]

        after, before = later(1), later(-1)
        slopes = (
            (getattr(after, way) - getattr(before, way)) / (2 * _APART) + np.zeros_like(joined.speed)
            for way in ("on_motor", "on_load", "position", "speed")
        )
        return Effect(*(slope[:, None] for slope in slopes))

    def _few_samples(self, runs: Sequence[int]) -> list[list[int]]:
        """These runs, as many at once as there is room for their columns in the nearest memory."""
        found: list[list[int]] = []
        for run in runs:
            if not found or self.samples([*found[-1], run]) > TOGETHER:
                found.append([])
            found[-1].append(run)
        return found

    def whitened(self, causes: Iterable[Cause], runs: Sequence[int]) -> Array:
        """The same in an array that holds until columns are whitened next."""
        causes = list(causes)
        rows = self.view.work.rows(sum(candidate.size for candidate, _ in causes), self.samples(runs))
        self.whiten(causes, runs, rows)
        return rows

    def square(self, runs: Sequence[int]) -> float:
        """Sum of squares of some runs' innovations; ∞ where they ran away."""
        with np.errstate(over="ignore"):
            return float(np.sum(self.innovations(runs) ** 2))

    def unsure(self, runs: Sequence[int]) -> float:
        """What some runs' innovations are less sure of for a coupling's gap (−2 log likelihood)."""
        return sum(self.passed[run].unsure for run in runs)

    def innovations(self, runs: Sequence[int]) -> Array:
        """Of some runs, one behind another, (Σ2n,)."""
        return np.concatenate([self.passed[run].innovations for run in runs])


def linearised(
    view: View,
    members: Sequence[Member],
    noise: Noise,
    reach: float | None,
    runs: Sequence[int] | None = None,
    telling: Sequence[int] | None = None,
) -> Linearised:
    """Filter some runs (None: all) with these members present; `reach`: how far off the noise may be (log), None: keep
    it. It is found from some of those that are `telling` it (None: any): others may be about states of former members.
    """
    alongs = view.alongs(members)
    runs = range(len(alongs)) if runs is None else runs
    pairs = few_of(repeated_among(view, telling or runs))
    few = [] if reach is None else [i for pair in pairs for i in pair[:2]] or few_of(list(telling or runs))
    asked = sorted({*runs, *few})
    joined = Joined.of([alongs[i] for i in asked])
    act, each = acting_on_each(view, joined, members)
    load = load_taken(joined, act)
    made = {
        i: equations_of(alongs[i], acts, noise, load.within(where))
        for i, acts, where in zip(asked, each, joined.wheres, strict=True)
    }
    unlikely = 0.0
    if reach is not None:
        equations = [made[i][0] for i in few]
        these, span = [view.runs[i] for i in few], view.ranges.span_rad
        places = [(2 * i, 2 * i + 1) for i in range(len(pairs))]
        noise = likely_noise(equations, these, noise, reach, span, whole=True, repeats=places)
        unlikely = unshared_deviance_of(equations, these, noise, places)
        view.work.add(NOISE * sum(2 * run.time_s.size for run in these))
    passed = {i: Passed.of(*made[i], noise, view.runs[i]) for i in runs}
    for i in runs:
        play = made[i][0].play
        alongs[i] = alongs[i] if play is None else replace(alongs[i], met=play.contact)
    view.work.add(LINEARISED * sum(one.samples for one in passed.values()))
    return Linearised(view, alongs, passed, noise, members, unlikely)


def repeated_among(view: View, runs: Sequence[int]) -> list[list[int]]:
    """Those of some runs that repeat one another, by motion and injection."""
    return [some for group in view.repeats if len(some := [i for i in group if i in runs]) > 1]


def few_of(every: Sequence[T]) -> list[T]:
    """A few of these, evenly spread: all of them, where they are no more."""
    places = np.unique(np.round(np.linspace(0, len(every) - 1, FEW))) if every else ()
    return [every[int(place)] for place in places]


def resmoothed(
    view: View, members: Sequence[Member], noise: Noise, runs: Sequence[int] | None = None
) -> View:
    """Some runs (None: all) with the states that these members make likely, given the noise."""
    return resmoothed_about(linearised(view, members, noise, None, runs))


def resmoothed_about(about: Linearised) -> View:
    """With the states that what is present makes likely, and the torque that drives the machine then.

    How the true torque changes stays what it is taken to be for all sets: the second derivative of what a set cannot do
    would look like that. Of what a further mass does that is no state of the filter's, half of the way is taken: near
    the load's own resonance the whole leads past it, further each time.
    """
    view = about.view
    runs, torques = list(view.runs), list(view.torques)
    for i, passed in about.passed.items():
        states = passed.shaft_states
        if about.swings:
            states = runs[i].states + _OF_THE_WAY * (states - runs[i].states)
        runs[i] = runs[i].about(states)
        if view.noise_found:
            torques[i] = torques[i].with_driving(_without_noise(about, i))
    return replace(view, runs=tuple(runs), torques=tuple(torques))


def torques_about(about: Linearised) -> tuple[TrueTorque, ...]:
    """The torque of each run without what is noise of it."""
    torques = list(about.view.torques)
    for i in about.passed:
        as_sampled = about.view.torques[i].as_sampled
        torques[i] = TrueTorque(about.view.runs[i], _without_noise(about, i), as_sampled=as_sampled)
    return tuple(torques)


def _without_noise(about: Linearised, number: int) -> Array:
    """The torque of a run (N·m), (n,), as far as it moves the machine and can be heard."""
    drive = about.view.runs[number].drive
    reported = drive.smooth_nm - about.passed[number].torque_error_nm
    return np.asarray(heard(reported, torque_noise(about.view.runs[number], about.noise)) + drive.injected_nm)


def loud_about(about: Linearised) -> tuple[Sequence[Array], ...]:
    """How loud noise alone is in each run's wind-up, in its rate, and in the load's acceleration: of what is smoothed,
    that is noise."""
    every = []
    for i, passed in sorted(about.passed.items()):
        run = about.view.runs[i]
        states = passed.of_noise(about.noise, run, np.random.default_rng(i)).shaft_states
        about.view.work.add(LINEARISED * passed.samples)
        loads = run.about(states).load_acceleration
        still = np.zeros_like(loads)
        wound = (still, still) if run.rigid else (states[:, 2], states[:, 1] - states[:, 3])
        every.append([*(loudness(run.quiet(one)) for one in wound), loudness(loads)])
    return tuple(every)


def finite(view: View) -> bool:
    """Whether the machine still moved as machines do: coefficients far off make its numbers run away."""
    return all(bool(np.all(np.isfinite(run.states))) for run in view.runs)


def at_rest(
    view: View, members: Sequence[Member], noise: Noise, runs: Sequence[int] | None = None
) -> Linearised:
    """Some runs (None: all) about the states that these members make likely, smoothed until those stay as they are.

    As recorded, a shaft is not wound up: about such states, and about those smoothed once from there, a machine that is
    as believed misses several times its noise. Where what is present makes the numbers run away, they stay where the
    runs were likeliest.

    With a coupling that bends they may settle where no machine is: then what was measured counts little at first.
    """
    about = _at_rest(view, members, noise, runs)
    bends = view.known.bends or any(m.candidate.tangent is not None for m in members)
    every = tuple(about.passed)
    if not bends or about.square(every) <= FAR**2 * about.samples(every):
        return about
    for times in _LESS_SURE:
        vague = replace(noise, position_rad=times * noise.position_rad, speed_rad_s=times * noise.speed_rad_s)
        for _ in range(2):
            view = resmoothed(view, members, vague, runs)
            if not finite(view):
                return about
    other = _at_rest(view, members, noise, runs)
    return other if other.square(every) < about.square(every) else about


def _at_rest(view: View, members: Sequence[Member], noise: Noise, runs: Sequence[int] | None) -> Linearised:
    about = best = linearised(view, members, noise, None, runs)
    every = tuple(about.passed)
    first, square = about.square(every), np.inf
    least = first
    for _ in range(1 + STEPS):
        further = resmoothed_about(about)
        if not finite(further):
            return best
        about = linearised(further, members, noise, None, runs)
        before, square = square, about.square(every)
        if square < least:
            best, least = about, square
        if abs(square - before) < ALIKE * max(1.0, before / about.samples(every)):
            break
    return about if square <= first else best


def target_of(about: Linearised, members: Sequence[Member], runs: Sequence[int]) -> Array:
    """The innovations of some runs as if the members were not there, (Σ2n,)."""
    rows = about.whitened([(m.candidate.about(m.coefficients), m.shape) for m in members], runs)
    return np.asarray(about.innovations(runs) + np.concatenate([m.coefficients for m in members]) @ rows)
