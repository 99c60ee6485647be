"""Session and belief -> names with their probabilities, by one likelihood."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property, partial
from itertools import count

import numpy as np

from schwung.drivetrain.machine import Machine
from schwung.explain.causes.along import ranges_of
from schwung.explain.causes.candidate import NATURAL, RIGHT_TO
from schwung.explain.causes.known import known
from schwung.explain.causes.true_torque import TrueTorque
from schwung.explain.causes.vocabulary import vocabulary
from schwung.explain.kept_aside import kept_aside
from schwung.explain.plausibility import without_glitches
from schwung.explain.weighing.contact import Damped, damped, damping_name, opening_of, with_damping
from schwung.explain.weighing.elsewhere import holding
from schwung.explain.weighing.grown import Grown, grown
from schwung.explain.weighing.growth import NOISE_SHARE, Growth, Progress
from schwung.explain.weighing.one_law import one_law
from schwung.explain.weighing.parameters import over_sets, parameters_of, tells
from schwung.explain.weighing.phases import phased
from schwung.explain.weighing.repeated import motions_of, repeated, telling_noise
from schwung.explain.weighing.resting import Rests
from schwung.explain.weighing.round import View
from schwung.explain.weighing.search import TOLD, Pick, Scored, Search, slices
from schwung.explain.weighing.sets import everything
from schwung.explain.weighing.sharpness import covariance_of
from schwung.explain.weighing.standing import Standing, is_plain, standing
from schwung.explain.weighing.taken import Held, TakenLater, taken_later
from schwung.explain.weighing.told import as_told, timing
from schwung.explain.weighing.values import NAMED, Named, Parameter, Unnamed, Weighed
from schwung.explain.weighing.wide import wide_fit
from schwung.explain.weighing.work import Work, on_one_thread
from schwung.innovations.likelihood import first_noise
from schwung.innovations.signals import Signals, picked_signals_of
from schwung.session.derived import speed_is_derived
from schwung.session.model import Session

#: What causes show within (Hz); injections above widen it.
BAND_HZ, BEYOND_INJECTION = 160.0, 1.8
#: Within this share of the peak speed the sign of a motion is smoothed; up to a few times that it is open.
STICKING = 0.002
_UNFINISHED = (
    "the search ended before all was tried: "
    "what only promises more has as much of the probability as what was tried"
)
_HURRIED = (
    "the search was ended when its processor time was spent, before all was tried: what only promises more has as much "
    "of the probability as what was, and a faster computer may find more"
)
_REFUTED = (
    "{} takes something of the motions at hand, and makes others worse that it is not fitted to: left out"
)
_DISPROVED = "{} makes the runs kept aside less likely than they are without it: left out"


@dataclass(frozen=True, eq=False)
class Posterior:
    """A session weighed: what is told of it, and what the next motion is chosen by."""

    grown: Grown
    stands: Standing
    sure: Search  # the sets, weighed by what stands out
    heldout: tuple[int, ...]
    view: View
    growth: Growth
    disproved: frozenset[str] = frozenset()  # by runs kept aside
    unlawful: frozenset[str] = frozenset()  # laws that do not hold elsewhere
    notes: tuple[str, ...] = ()  # of samples that were not taken as recorded

    @cached_property
    def told(self) -> Weighed:
        """In names, probabilities and parameters."""
        return _told(self)

    @cached_property
    def names(self) -> dict[str, float]:
        """Every cause that is worth telling, with its probability; of a name, that it is right."""
        named = {c.name for c in self.grown.data.candidates if c.named}
        likely = {name: p for name, p in _probabilities(self.sure).items() if p >= TOLD}
        search = self.grown.search
        likely = {name: p for name, p in likely.items() if name not in self.disproved | self.unlawful}
        right = {name: self.stands.of(search, name) * self._possible(name) for name in likely.keys() & named}
        names = {name: p * right.get(name, 1.0) for name, p in likely.items()}
        damping, both = damping_name(search), self.damped
        if both.named >= TOLD and damping not in self.disproved:
            sure = self.stands.sure(search, both.worth) * both.named
            names[damping] = max(names.get(damping, 0.0), self.gap * sure)
        return names

    @property
    def gap(self) -> float:
        """How probable play is."""
        return sum(p for p, one in self.sure.shares() if opening_of(self.sure, one.picks) is not None)

    @cached_property
    def damped(self) -> Damped:
        """What contacts of the best set damp."""
        return damped(self.grown.search, self.grown.best)

    @cached_property
    def holding(self) -> Scored:
        """The best set without what has no name and does not hold where it was not fitted."""
        search, best = self.grown.search, self.grown.best
        named = {name for name in map(search.name, best.picks) if self.names.get(name, 0.0) > NAMED}
        unnamed = {c.name for c in search.data.candidates if not c.named}
        return holding(search, best, named - unnamed)

    def parameters(self, name: str) -> dict[str, Parameter]:
        """Of a name in the most probable set that holds it; intervals over all sets that do, from the coefficients'
        deviations beside what has no name."""
        best = _holding(self.sure, name)
        if best is None:
            return {}
        holding = [(p, one) for p, one in self.sure.shares() if name in map(self.sure.name, one.picks)]
        whole = sum(p for p, _ in holding)
        sets = [(p, one) for p, one in holding if one is best or tells(p, whole)]
        if not holding or best is not holding[0][1]:  # what contacts damp, which no set holds
            sets = [(1.0, best)]
        return over_sets([(p, parameters_of(*self._held(name, one))) for p, one in sets])

    def _held(self, name: str, best: Scored) -> tuple[Search, Scored, Pick, slice]:
        """A set that holds a name, as it is told, and where in it the name is."""
        of = self.grown.search
        search = Search(of.data.tempered(self.stands.blurring), of.always)
        scored = search.score(best.picks)
        places = zip(scored.picks, slices(search, scored), strict=True)
        pick, where = next((pick, where) for pick, where in places if search.name(pick) == name)
        return search, as_told(search, scored), pick, where

    def _possible(self, name: str) -> float:
        """Chance of what a name was found with, where it is what it says."""
        best = _holding(self.sure, name)
        if best is None:
            return 1.0
        search, scored, pick, where = self._held(name, best)
        candidate = search.candidate(pick)
        if candidate.frictions is None:
            return 1.0
        covariance = covariance_of(search, scored, pick)[: candidate.size, : candidate.size]
        return candidate.takes(scored.exact[where], covariance)

    @cached_property
    def negligible(self) -> frozenset[str]:
        """Causes of the best set without a sure name, whose torque is less than what is believed is right to, and that
        are not plain: of no use to anybody. What only errs in what is reported makes no torque."""
        search, best = self.grown.search, self.grown.best
        torque = np.concatenate([run.drive.whole_nm for run in self.view.runs])
        least = RIGHT_TO * float(np.sqrt(np.mean(torque**2)))
        return frozenset(
            search.name(pick)
            for pick in best.picks
            if self.names.get(search.name(pick), 0.0) <= NAMED or not search.candidate(pick).named
            if 0 < _rms(search, search.name(pick)) < least and not is_plain(search, best, pick)
        )

    @cached_property
    def refuted(self) -> frozenset[str]:
        """Causes of the best set that do not."""
        search = self.grown.search
        kept = set(map(search.name, self.holding.picks))
        return frozenset(set(map(search.name, self.grown.best.picks)) - kept)

    @property
    def left_out(self) -> frozenset[str]:
        """Causes of the best set of which nothing is told: refuted by other motions or runs, or negligible."""
        return self.refuted | self.negligible | self.disproved


def weigh(session: Session, machine: Machine) -> Weighed:
    """Say what the belief leaves out, with probabilities; raises InputError where the inertia is unknown."""
    return posterior_of(session, machine).told


@on_one_thread
def posterior_of(
    session: Session,
    machine: Machine,
    heldout: Sequence[int] | None = None,
    tell: Progress = lambda _text, _share: None,
    work: Work | None = None,
    *,
    steady: bool = False,
) -> Posterior:
    """The same with all that was weighed.

    `heldout`: runs for the proof; None: those that are `kept_aside`. `tell`: what is being done, and its share, 0…1.
    `work`: that may be done; None: the usual, from now on. `steady`: whether hardly anything accelerates, so that
    nothing can be told of what only accelerating shows.

    Raises InputError where the inertia is unknown.
    """
    work = work or Work()
    session, mended = without_glitches(session)
    heldout = kept_aside(session) if heldout is None else tuple(heldout)
    train = tuple(run for run in range(len(session.runs)) if run not in heldout)
    groups = telling_noise(session)
    unrepeated = not any(len(group) > 1 for group in groups)
    view = _view(session, machine, groups, work)
    candidates = [c for c in vocabulary(view.ranges, view.known) if not (steady and c.shown_by_accelerating)]
    tell("Finding the noise", NOISE_SHARE / 2)
    always = tuple(i for i, c in enumerate(candidates) if c.name.startswith("usual"))
    beside = repeated(session.runs, NATURAL * view.ranges.peak_torque_nm)
    for samples in count(1):
        wide = wide_fit(view, everything(candidates, ()), first_noise(view.runs), train)
        held = Held(view, partial(_view, taken_later(session, samples), machine, groups, work))
        rests = Rests(candidates, train, wide)
        growth = Growth(rests, always, held, tell=tell, unrepeated=unrepeated)
        try:
            found = grown(growth, view)
            break
        except TakenLater:
            view, work.done = held.later, 0.0

    def about(best: Scored, unlawful: frozenset[str] = frozenset()) -> Posterior:
        lost = max(found.best.log - best.log, 0.0)  # with laws that do not hold elsewhere
        stands = standing(found.search, best, beside, one_law, besides=lost)
        sure = found.tempered(stands.tempering)
        held_out = tuple(heldout)
        return Posterior(found, stands, sure, held_out, view, found.growth, unlawful=unlawful, notes=mended)

    outcome = about(found.best)
    laws = frozenset(c.name for c in candidates if c.named) & outcome.refuted
    if not laws:
        return outcome
    # beside a law that does not hold elsewhere, none stands out whose place it can take
    kept = tuple(pick for pick in found.best.picks if found.search.name(pick) not in laws)
    return about(found.search.score(kept), laws)


def _view(session: Session, machine: Machine, groups: Sequence[Sequence[int]], work: Work) -> View:
    """A session as it is before anything is known of it; `groups`: of runs whose noise shows."""
    runs = signals_as_measured(session, machine)
    of = replace(
        ranges_of(runs, STICKING, band_of(session)),
        one_motion=len(motions_of(session.runs)) == 1,
        unrepeated=not any(len(group) > 1 for group in groups),
    )
    torques = tuple(TrueTorque(run, run.drive.whole_nm) for run in runs)
    belief = known(machine, of.low_rad, of.high_rad)
    seen = View(session.runs, tuple(runs), belief, of, torques, repeats=groups, work=work)
    return phased(seen, first_noise(runs))


def band_of(session: Session) -> float:
    """Up to which frequency (Hz) causes are looked for."""
    exciting = [run.excitation.frequency_hz for run in session.runs if run.excitation]
    return max([BAND_HZ, *(BEYOND_INJECTION * f for f in exciting)])


def signals_as_measured(session: Session, machine: Machine) -> list[Signals]:
    """Every run with all its samples; of a speed that was made of the angle, errors are not its own."""
    band, derived = band_of(session), speed_is_derived(session.runs)
    return [
        replace(
            picked_signals_of(run, machine, band),
            speed_measured=not derived and bool(np.ptp(run.speed_rad_s)),
        )
        for run in session.runs
    ]


def _told(posterior: Posterior) -> Weighed:
    outcome, sure, likely = posterior.grown, posterior.sure, posterior.names
    search, data = outcome.search, outcome.data
    shares = _probabilities(search)
    damping = damping_name(search)
    if posterior.damped.off >= TOLD:
        shares[damping] = max(shares.get(damping, 0.0), posterior.gap * posterior.damped.off)
    refuted = posterior.refuted
    named = (c.name for c in data.candidates if c.named and c.name not in refuted)
    names = {name: likely[name] for name in named if likely.get(name, 0.0) >= TOLD}
    told = [
        Named(name, p, posterior.parameters(name)) for name, p in names.items() if not _at_bound(sure, name)
    ]
    ends = [name for name in names if _at_bound(sure, name)]
    told.sort(key=lambda one: (-round(one.probability, 2), -_worth(search, outcome.best, one.name)))
    return Weighed(
        names=tuple(told),
        unnamed=_unnamed(search, shares, likely, posterior.left_out, posterior.stands.usual),
        noise=data.about.noise,
        excess=data.excess * posterior.stands.tempering,
        timing=timing(sure, sure.score(outcome.best.picks)),
        notes=(
            *posterior.notes,
            *(
                _REFUTED.format(name.replace("_", " "))
                for name in sorted(posterior.refuted - posterior.disproved)
            ),
            *(_DISPROVED.format(name.replace("_", " ")) for name in sorted(posterior.disproved)),
            *(f"{name} only fits at the end of its range, and is not named" for name in sorted(ends)),
            *_ended(data.work),
        ),
    )


def _ended(work: Work) -> tuple[str, ...]:
    """A note, where not all was tried."""
    spent = work.spent
    if work.hurried:
        return (_HURRIED,)
    return (_UNFINISHED,) if spent else ()


def _probabilities(search: Search) -> dict[str, float]:
    """Of every cause, over all sets."""
    found: dict[str, float] = {}
    for share, scored in search.shares():
        for name in {search.candidate(pick).name for pick in scored.picks}:
            found[name] = found.get(name, 0.0) + share
    return found


def _unnamed(
    search: Search,
    shares: Mapping[str, float],
    names: Mapping[str, float],
    left_out: frozenset[str],
    usual: Mapping[str, float],
) -> tuple[Unnamed, ...]:
    """What describes the motion without being a name, the most probable first: curves, and names that are only like it.

    `shares`: how probable causes are; `names`: that a name is right; what is more probable by the description alone is
    not named. `usual`: that it is as much as is usual, which is no finding. What the recording has made no more
    probable than it was before is none, either: of a drift over the runs one run says nothing.
    """
    found, before = [], 1 / (1 + np.exp(-search.odds))
    for name, p in shares.items():
        if name in left_out:
            continue
        candidate = next(c for c in search.data.candidates if c.name == name)
        if names.get(candidate.part_of, 0.0) > NAMED:
            continue
        more = p * (1 - usual.get(name, 0.0)) - names.get(name, 0.0) if candidate.named else p
        if more >= max(TOLD, before):
            like = name if candidate.named else ""
            found.append(Unnamed(candidate.coordinate, more, _rms(search, name), like))
    return tuple(sorted(found, key=lambda one: (-round(one.probability, 2), -one.torque_nm)))


def _worth(search: Search, best: Scored, name: str) -> float:
    """How much evidence goes with a name from the best set."""
    others = tuple(pick for pick in best.picks if search.candidate(pick).name != name)
    return best.log - search.score(others).log if len(others) < len(best.picks) else 0.0


def _holding(search: Search, name: str) -> Scored | None:
    """The most probable set that holds a name."""
    sets = [scored for _, scored in search.shares()]
    if sets and name == damping_name(search) and opening_of(search, sets[0].picks) is not None:
        return with_damping(search, sets[0])
    return next((scored for scored in sets if name in map(search.name, scored.picks)), None)


def _at_bound(search: Search, name: str) -> bool:
    """Whether the most probable set that holds a name has it at its bound."""
    scored = _holding(search, name)
    return scored is not None and any(
        at_bound(search, scored, pick) for pick in scored.picks if search.name(pick) == name
    )


def at_bound(search: Search, scored: Scored, pick: Pick) -> bool:
    """Whether a cause of a set is at the end of what is tried, or nothing that there can be."""
    candidate, shape = search.candidate(pick), search.data.atoms[pick.atom].shape
    coefficients = scored.exact[slices(search, scored)[scored.picks.index(pick)]]
    return not candidate.possible(coefficients) or candidate.at_end(shape, coefficients)


def _rms(search: Search, name: str) -> float:
    """Torque of a curve along all runs (N·m), in the most probable set that holds it."""
    found = _holding(search, name)
    if found is None:
        return 0.0
    scored = as_told(search, found)
    places = zip(scored.picks, slices(search, scored), strict=True)
    pick, where = next((pick, where) for pick, where in places if search.name(pick) == name)
    candidate, shape, total = search.candidate(pick), search.data.atoms[pick.atom].shape, []
    for along in search.data.about.alongs:
        done = candidate.done(along, shape, scored.exact[where])
        motor, load, _, _ = done.alone
        # what acts between the shafts is the same on both, and takes nothing of the whole
        each = (np.mean((side + 0.0 * along.speed) ** 2) for side in (motor, load, motor + load))
        total.append(max(each))
    return float(np.sqrt(np.mean(total)))
