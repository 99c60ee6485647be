"""What a further motion would tell: the rivals of the posterior, each with its own prediction of it.

A motion is simulated as believed; along it each rival set says what its columns do (innovation = X·β + white noise),
with the coefficients that it has and their covariance. Under each rival in turn recordings are drawn, weighed by all:

    log p(new | set) = mᵀb − ½ mᵀGm + ½ rᵀS(1 + GS)⁻¹r − ½ log det(1 + SG)        b = Xᵀy, G = XᵀX, r = b − Gm

m, S: mean and covariance of the set's coefficients so far. The gain is the mutual information of rival and recording
(Lindley 1956; Box and Hill 1967 choose by a bound of it); `expected` is the probability that the set which is then the
likeliest is right.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field, replace

import numpy as np

from schwung.explain.causes.along import Along, leaves_rest_s
from schwung.explain.causes.candidate import Candidate, Shape
from schwung.explain.causes.equations import equations_of
from schwung.explain.causes.present import with_members
from schwung.explain.causes.true_torque import TrueTorque
from schwung.explain.weighing.data import Atom
from schwung.explain.weighing.round import Cause, Linearised, View, acting, resmoothed
from schwung.explain.weighing.search import Scored, slices
from schwung.explain.weighing.sharpness import covariance_of
from schwung.explain.weighing.standing import finding
from schwung.explain.weighing.values import NAMED
from schwung.explain.weighing.weigh import Posterior
from schwung.explain.weighing.work import Work
from schwung.innovations.effect import Effect, Passed
from schwung.innovations.evidence import weigh
from schwung.innovations.signals import picked_signals_of
from schwung.innovations.statistics import Numbers, Statistics
from schwung.motion import Array
from schwung.session.model import Run

#: Sets of less probability, and more sets than this, are no rivals.
LEAST, MOST = 0.003, 8
#: What a rival's curve begins with in words.
UNNAMED = "unnamed over "
#: Recordings drawn under each rival.
_DRAWS = 48


@dataclass(frozen=True)
class Gain:
    """What a motion is expected to tell."""

    information: float  # nats, of the rivals' entropy
    expected: float  # probability that the likeliest set is right, after the motion


@dataclass(frozen=True)
class Rival:
    """An answer that is still likely: its names, without what is no more than usual, and "… unnamed" for its curves."""

    names: tuple[str, ...]
    probability: float


@dataclass(frozen=True, eq=False)
class _Set:
    """A rival's columns among those of all, its coefficients and a root of their covariance, (p,) and (p, q)."""

    which: Numbers
    mean: Array
    root: Array


@dataclass(frozen=True, eq=False)
class Rivals:
    """The answers that are still likely, and how each set of causes that gives one predicts a motion."""

    posterior: Posterior
    rivals: tuple[Rival, ...]
    _shares: Array  # of each set, in the row of the rival that it is, (rivals, sets)
    _sets: tuple[_Set, ...]
    _causes: tuple[Cause, ...] = field(repr=False)

    @classmethod
    def of(cls, posterior: Posterior) -> Rivals:
        """Of a session that was weighed."""
        search = posterior.sure
        shares = [(p, s) for p, s in search.shares()[:MOST] if p >= LEAST]
        total = sum(p for p, _ in shares)
        causes: list[Cause] = []
        places: dict[int, Numbers] = {}  # first column of a cause so far -> its columns here
        starts = {where.start: cause for where, cause in search.data.causes}
        width, sets = 0, []
        for _, scored in shares:
            mine = []
            for column in scored.which.tolist():
                if column not in starts:
                    continue
                if column not in places:
                    causes.append(starts[column])
                    size = starts[column][0].size
                    places[column] = np.arange(width, width + size)
                    width += size
                mine.append(places[column])
            # weighed alone: what was kept of a set is only its best, and not always by the same tempering
            found = weigh(search.data.at(scored.which), scored.deviations)
            root = np.linalg.cholesky(found.covariance + 1e-14 * np.diag(np.diag(found.covariance)))
            bends = list(_bends(posterior, scored))
            causes += [(bend, ()) for bend in bends]
            mine.append(np.arange(width, width + len(bends)))
            width += len(bends)
            whole = np.zeros((root.shape[0] + len(bends),) * 2)
            whole[: root.shape[0], : root.shape[0]] = root
            whole[root.shape[0] :, root.shape[0] :] = np.eye(len(bends))
            mean = np.concatenate([found.coefficients, np.zeros(len(bends))])
            sets.append(_Set(np.concatenate(mine), mean, whole))
        answers: dict[tuple[str, ...], Array] = {}
        for number, (p, scored) in enumerate(shares):
            row = answers.setdefault(_names(posterior, scored), np.zeros(len(shares)))
            row[number] = p / total
        order = sorted(answers.items(), key=lambda one: -float(one[1].sum()))
        rivals = tuple(Rival(names, float(row.sum())) for names, row in order)
        return cls(posterior, rivals, np.stack([row for _, row in order]), tuple(sets), tuple(causes))

    @property
    def best(self) -> float:
        """Probability of the likeliest set, now."""
        return self.rivals[0].probability

    @property
    def settled(self) -> bool:
        """Whether there is nothing to tell apart."""
        return len(self.rivals) == 1

    def gain(self, runs: Sequence[Run]) -> Gain:
        """Of recording these motions, given as the believed machine would make them."""
        if self.settled:
            return Gain(0.0, self.best)
        seen = self._seen(runs)
        prior, before = self._shares.sum(axis=0), self._shares.sum(axis=1)
        answer = self._shares > 0
        chance = np.random.default_rng(1)  # the same draws for every motion: they are compared
        shaking = np.linalg.cholesky(seen + 1e-12 * np.diag(np.maximum(np.diag(seen), 1e-12)))
        weighers = [_Weigher.of(one, seen) for one in self._sets]
        information = expected = 0.0
        for share, one in zip(prior, self._sets, strict=True):
            coefficients = one.mean[:, None] + one.root @ chance.standard_normal((one.root.shape[1], _DRAWS))
            noise = chance.standard_normal((seen.shape[0], _DRAWS))
            slopes = seen[:, one.which] @ coefficients + shaking @ noise
            logs = np.stack([weigher.log(slopes) for weigher in weighers]) + np.log(prior)[:, None]
            after = np.exp(logs - np.max(logs, axis=0))
            after = answer @ (after / after.sum(axis=0))
            entropy = -np.sum(after * np.log(np.maximum(after, 1e-300)), axis=0)
            information -= share * float(np.mean(entropy))
            expected += share * float(np.mean(np.max(after, axis=0)))
        information -= float(np.sum(before * np.log(before)))
        return Gain(max(information, 0.0), max(expected, self.best))

    def _seen(self, runs: Sequence[Run]) -> Array:
        """XᵀX of all rivals' columns along the motions, tempered as the sets were."""
        about, data = self._along(runs), self.posterior.sure.data
        rows = about.whitened(self._causes, range(len(runs)))
        return Statistics.of(rows.T, np.zeros(rows.shape[1])).tempered(data.excess).gram

    def _along(self, runs: Sequence[Run]) -> Linearised:
        data = self.posterior.sure.data
        about, members = data.about, data.members
        known, ranges = about.view.known, about.view.ranges
        as_now = about.view.runs[0].speed_measured
        signals = tuple(
            replace(picked_signals_of(run, known.machine, ranges.band_hz), speed_measured=as_now)
            for run in runs
        )
        torques = tuple(TrueTorque(run, run.drive.whole_nm) for run in signals)
        view: View = replace(
            about.view,
            recorded=runs,
            runs=signals,
            torques=torques,
            slowest=(),
            repeats=(),
            loud=(),
            work=Work(),
        )
        view = resmoothed(view, (), about.noise)
        present = with_members(known.machine, members, ranges)
        beyond = known.beyond(members)
        alongs, passed = [], []
        for number, (signal, recorded, torque) in enumerate(zip(view.runs, runs, torques, strict=True)):
            place = ranges.runs + number  # what drifts goes on drifting
            begins = leaves_rest_s(recorded)
            where = Along(signal, known.machine, present, ranges, place, begins, torque, beyond=beyond)
            true = TrueTorque(signal, torque.nm - _beyond_belief(where, self.posterior))
            where = replace(where, true_torque=true)
            alongs.append(where)
            equations, steps = equations_of(where, acting(view, where, members), about.noise)
            passed.append(Passed.of(equations, steps, about.noise, signal))
        return Linearised(view, alongs, dict(enumerate(passed)), about.noise)


@dataclass(frozen=True, eq=False)
class _Weigher:
    """One set's log predictive likelihood of new motions, from Xᵀy of all columns."""

    which: Numbers
    mean: Array
    pull: Array  # G m
    constant: float
    turned: Array  # (q, p): ½ |turned r|² is what the coefficients give way

    @classmethod
    def of(cls, one: _Set, seen: Array) -> _Weigher:
        gram = seen[np.ix_(one.which, one.which)]
        inner = np.eye(one.root.shape[1]) + one.root.T @ gram @ one.root
        factor = np.linalg.cholesky(inner)
        pull = gram @ one.mean
        constant = -0.5 * float(one.mean @ pull) - float(np.sum(np.log(np.diag(factor))))
        return cls(
            one.which, one.mean, pull, constant, np.asarray(np.linalg.solve(factor, one.root.T), dtype=float)
        )

    def log(self, slopes: Array) -> Array:
        """Of recordings, Xᵀy of each a column, (P, m) -> (m,)."""
        mine = slopes[self.which]
        gives = self.turned @ (mine - self.pull[:, None])
        return np.asarray(self.constant + self.mean @ mine + 0.5 * np.sum(gives**2, axis=0))


def _names(posterior: Posterior, scored: Scored) -> tuple[str, ...]:
    search = posterior.sure
    candidates = [search.candidate(pick) for pick in scored.picks if finding(search, scored, pick) > NAMED]
    return tuple(sorted(c.name if c.named else UNNAMED + c.coordinate for c in candidates))


def _beyond_belief(where: Along, posterior: Posterior) -> Array:
    """Torque (N·m) that what was found adds to the machine along a run; the drive has to make up for it."""
    total = np.zeros_like(where.speed)
    for member in posterior.sure.data.members:
        parts = member.candidate.done(where, member.shape, member.coefficients).parts[:2]
        for part in parts:
            if part is not None:
                total = total + part[:, 0]
    return total


def _bends(posterior: Posterior, scored: Scored) -> list[Candidate]:
    """What shapes that are known with a deviation may do besides, one column each, for a coefficient of deviation 1."""
    search, found = posterior.sure, []
    for pick, where in zip(scored.picks, slices(search, scored), strict=True):
        atom, candidate = search.data.atoms[pick.atom], search.candidate(pick)
        coefficients = scored.found.coefficients[where]
        known_to = np.sqrt(np.diag(covariance_of(search, scored, pick)))[coefficients.size :]
        for axis, spread in enumerate(known_to.tolist()):
            ends = tuple(_moved(candidate, atom, axis, way * spread) for way in (-1.0, 1.0))
            if ends[0] != ends[1]:
                found.append(_difference(candidate, ends, coefficients))
    return found


def _moved(candidate: Candidate, atom: Atom, axis: int, by: float) -> Shape:
    low, high = candidate.bounds[axis] if candidate.bounds else (-np.inf, np.inf)
    values = list(atom.shape)
    values[axis] = float(np.clip(values[axis] + by, low, high))
    return tuple(values)


def _difference(candidate: Candidate, ends: tuple[Shape, ...], coefficients: Array) -> Candidate:
    def effect(where: Along, _shape: Shape) -> Effect:
        low, high = (candidate.effect(where, shape).parts for shape in ends)
        return Effect(
            *(
                None if a is None or b is None else (b - a) @ coefficients[:, None] / 2
                for a, b in zip(low, high, strict=True)
            )
        )

    return Candidate(f"{candidate.name}, bent", effect, (1.0,), named=False)
