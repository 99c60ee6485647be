"""Which terms: every start of every term is a whitened atom; the best few are fitted in full, one more term at a time.

Linear looks rank, full fits decide. A beam of models is kept, so that a compromise that happens to fit best alone (one
term standing in for two) does not block the pair. The score is Σ whitened² plus ln(n) for each parameter.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass, replace

import numpy as np
from scipy.signal import czt

from schwung.explain.fit import (
    PERIODIC,
    TIMING,
    Fitted,
    Model,
    Problem,
    combined,
    parameter_count,
    without,
)
from schwung.explain.noise import usable
from schwung.explain.residual import TABLE_POINTS
from schwung.explain.terms import LIBRARY, LOAD_TABLE, Start, View
from schwung.motion import Array

#: Models kept at each size, and candidates of each that are fitted in full.
BEAM, FITTED = 3, 5
#: Most terms of one explanation.
MOST_TERMS = 4
#: Terms of one field family exclude each other.
_EXCLUSIVE = (
    ("coulomb_friction", "asymmetric_friction", "stribeck_friction"),
    ("load_torque", LOAD_TABLE),
    ("torque_offset", LOAD_TABLE),
)
#: What a scanned start costs beyond its parameters: it was picked among many.
_SCANNED = 6.0
_STARTS_PER_TERM = 2
#: Share of the mismatch's amplitude by which a term's shape may be off, and scores that are equal.
SHAPE_ERROR, ALIKE = 0.015, 6.0
#: A named term lowers the mean square by at least this share of the noise, one beside others by so much.
LEAST_GAIN, BESIDE = 0.12, 0.5
#: So many times that where the term was picked among many places or frequencies.
PICKED = 2.5
#: And it carries at least this part of all that the belief misses, or that share of what is left without it.
LEAST_PART, MOST_LEFT = 0.006, 0.5
#: A belief that misses no more than this (mean square over the noise's) is consistent.
CONSISTENT = 1.6
#: So near to an injected frequency, in lines of the shortest run, no disturbance can be told from the injection.
INJECTED = 2.5
#: The search goes on after a term that takes such a share of what was missed.
GROWTH = 0.15
#: A full fit is tried where the linear look promises this share of what is wanted of it.
HOPE = 0.3

Progress = Callable[[str, float], None]


@dataclass(frozen=True, eq=False)
class Atom:
    """A start of a term and what its directions do to the whitened residual, (samples, directions)."""

    term: str
    start: Start
    columns: Array


@dataclass(eq=False)
class Found:
    """Every model that was fitted, the best of each set of terms."""

    problem: Problem
    atoms: tuple[Atom, ...]
    by_terms: dict[frozenset[str], Fitted]

    @property
    def bare(self) -> Fitted:
        """The belief itself."""
        return self.by_terms[frozenset()]

    @property
    def level(self) -> float:
        """Variance of a whitened sample that no model need explain: noise, and a little of what was explained.

        A term's textbook shape is never quite the machine's; by so much of the mismatch it may be off.
        """
        best = min(fitted.misfit for fitted in self.by_terms.values())
        return max(best, 1.0) + SHAPE_ERROR**2 * self.bare.misfit

    def score(self, fitted: Fitted) -> float:
        """Σ whitened² over that level, plus the price of the parameters."""
        model = fitted.model
        extra = len(model.refined) + max(len(model.unknowns.load_table_nm) - TABLE_POINTS, 0)
        return (
            fitted.chi2 / self.level
            + price(self.problem, model.terms, fitted.samples)
            + extra * float(np.log(fitted.samples))
        )

    def worthwhile(self, before: Fitted, after: Fitted) -> bool:
        """Whether a term lowers the misfit by enough to be named: a share of the noise floor's own energy.

        Beside other terms it is not where these alone leave a consistent belief.
        """
        if before.model.terms and before.misfit < CONSISTENT:
            return False
        more = set(after.model.terms) - set(before.model.terms)
        picked = all(term == PERIODIC or LIBRARY[term].scanned for term in more)
        gain = before.misfit - after.misfit
        least = BESIDE if before.model.terms else LEAST_GAIN
        if gain < (PICKED if picked else 1.0) * least * self.level:
            return False
        return gain > LEAST_PART * self.bare.misfit or gain > MOST_LEFT * (before.misfit - 1)

    def grows(self, before: Fitted, after: Fitted) -> bool:
        """Whether to look further: while much is missed, each of several effects takes but a part of it."""
        return self.worthwhile(before, after) or (
            before.misfit > CONSISTENT and before.misfit - after.misfit > GROWTH * before.misfit
        )

    def fit(self, model: Model, *starts: Model) -> Fitted:
        """The best fit of a set of terms from several starts, remembered."""
        key = frozenset(model.terms)
        fits = [self.problem.fit(start, 8) for start in (model, *starts)]
        known = self.by_terms.get(key)
        best = min((*fits, *([known] if known else [])), key=lambda fitted: fitted.chi2)
        best = self.problem.refine(best)
        self.by_terms[key] = best
        return best


def price(problem: Problem, terms: Iterable[str], samples: int) -> float:
    """ln(n) per parameter, and more where the start was picked among many."""
    terms = tuple(terms)
    scanned = sum(_SCANNED for t in terms if t == PERIODIC or LIBRARY[t].scanned)
    return parameter_count(terms, len(problem.runs)) * float(np.log(samples)) + scanned


def allowed(terms: Iterable[str], more: str) -> bool:
    """Whether a term may join others."""
    terms = set(terms)
    if more in terms:
        return False
    return not any(more in group and terms & set(group) for group in _EXCLUSIVE)


def atoms_at(problem: Problem, model: Model) -> tuple[Atom, ...]:
    """All starts of all terms about one model."""
    view = View(problem.residuals, problem.runs)
    base = problem.white(model)
    result = []
    for term in LIBRARY.values():
        starts = term.starts(view)
        quick = [start for start in starts if start.torques is not None]
        result += [
            Atom(term.name, start, columns)
            for start, columns in zip(quick, _quick_columns(problem, quick), strict=True)
        ]
        for begin in (start for start in starts if start.torques is None):
            columns = np.empty((base.size, len(begin.directions)))
            for number in range(len(begin.directions)):
                effects = begin.moved(model.effects, number)
                timing = model.unknowns.timing_s + begin.earlier_s
                unknowns = replace(model.unknowns, effects=effects, timing_s=timing)
                columns[:, number] = problem.white(replace(model, unknowns=unknowns)) - base
            if np.all(np.isfinite(columns)):
                result.append(Atom(term.name, begin, columns))
    return tuple(result)


def _quick_columns(problem: Problem, starts: Sequence[Start]) -> list[Array]:
    """Whitened columns of starts that know their torque on the motor: it lowers the torque that is reported."""
    if not starts:
        return []
    parts = []
    for run in problem.runs:
        moving = problem.residuals.moving(run)
        torques = [start.torques(moving) for start in starts if start.torques is not None]
        white = problem.whitener.white(np.concatenate(torques), problem.residuals.valid(run))
        parts.append(white.T)
    columns = np.concatenate([*parts, np.zeros((1, parts[0].shape[1]))])  # none moves the drive's filter
    ends = np.cumsum([len(start.directions) for start in starts])
    return np.split(columns, ends[:-1], axis=1)


def search(problem: Problem, first: Fitted, progress: Progress | None = None) -> Found:
    """Grow models from the belief. Gives the best fit for every set of terms that was tried."""
    found = Found(problem, atoms_at(problem, first.model), {frozenset(): first})
    beam = [first]
    for size in range(1, MOST_TERMS + 1):
        grown: dict[frozenset[str], Fitted] = {}
        for number, fitted in enumerate(beam):
            if progress:
                done = (size - 1 + number / len(beam)) / MOST_TERMS
                progress(f"Trying {size} term{'s' if size > 1 else ''}", done)
            for gain, term, starts in ranked(problem, found.atoms, fitted)[:FITTED]:
                if gain < HOPE * LEAST_GAIN * found.level * fitted.samples:
                    break
                key = frozenset((*fitted.model.terms, term))
                if key not in grown:
                    known = found.by_terms.get(key)
                    grown[key] = known or found.fit(
                        *(combined_start(fitted.model, term, s, c) for s, c in starts)
                    )
        smaller = min((f for k, f in found.by_terms.items() if len(k) < size), key=found.score)
        beam = sorted(grown.values(), key=found.score)[:BEAM]
        if not beam or not found.grows(smaller, min(beam, key=lambda f: f.chi2)):
            break
        if min(fitted.misfit for fitted in beam) < CONSISTENT:  # nothing is worthwhile beside these
            break
    return found


def chosen(found: Found) -> Fitted:
    """The set of terms with the lowest score of which none can be spared; of equals fewer causes, then the simpler."""
    best = min(found.by_terms.values(), key=found.score)
    alike = [
        fitted
        for fitted in found.by_terms.values()
        if len(fitted.model.terms) <= len(best.model.terms)
        and found.score(fitted) < found.score(best) + ALIKE
    ]
    return _plain(found, pruned(found, min(alike, key=lambda fitted: _plainness(found, fitted))))


def _plain(found: Found, best: Fitted) -> Fitted:
    """With a constant or a sine in the place of a load torque of any shape, where that will do."""
    if LOAD_TABLE not in best.model.terms:
        return best
    spared = without(best.model, LOAD_TABLE)
    for term in ("torque_offset", "load_torque"):
        key = frozenset((*spared.terms, term))
        plain = found.by_terms.get(key)
        if plain is None and term == "torque_offset" and allowed(spared.terms, term):
            plain = found.fit(combined(spared, term, {}))
        if plain is not None and not found.worthwhile(plain, best):
            return plain
    return best


def pruned(found: Found, best: Fitted) -> Fitted:
    """Without the terms that can be spared, the least needed one first."""
    while best.model.terms:
        superfluous = [fitted for fitted in reduced(found, best) if not found.worthwhile(fitted, best)]
        if not superfluous:
            break
        best = min(superfluous, key=lambda fitted: fitted.chi2)
    return best


def _plainness(found: Found, fitted: Fitted) -> tuple[int, int, float]:
    """Lower is preferred of equals."""
    terms = fitted.model.terms
    return len(terms), simplicity(terms), found.score(fitted)


def simplicity(terms: Iterable[str]) -> int:
    """Sum over terms; lower is simpler."""
    return sum(3 if term == PERIODIC else LIBRARY[term].simplicity for term in terms)


def reduced(found: Found, fitted: Fitted) -> list[Fitted]:
    """The model with each of its terms left out, refitted, in the order of its terms."""
    result = []
    for term in fitted.model.terms:
        key = frozenset(t for t in fitted.model.terms if t != term)
        result.append(found.by_terms.get(key) or found.fit(without(fitted.model, term)))
    return result


def combined_start(model: Model, term: str, begin: Start | float, coefficients: Array) -> Model:
    """The model with one more term where a linear look puts it."""
    if term == PERIODIC:
        assert isinstance(begin, float)
        return replace(combined(model, term, {}), frequency_hz=begin)
    assert isinstance(begin, Start)
    timing = model.unknowns.timing_s + float(np.clip(coefficients[0], 0.0, 1.5)) * begin.earlier_s
    started = combined(model, term, begin.fields([float(c) for c in coefficients]))
    return started.with_values({TIMING: timing})


def ranked(
    problem: Problem, atoms: tuple[Atom, ...], fitted: Fitted
) -> list[tuple[float, str, list[tuple[Start | float, Array]]]]:
    """Terms that may join, best first by what a linear look promises, with the best starts and their coefficients."""
    basis, _ = np.linalg.qr(fitted.jacobian / np.maximum(np.linalg.norm(fitted.jacobian, axis=0), 1e-300))
    left = fitted.white - basis @ (basis.T @ fitted.white)
    looks: dict[str, list[tuple[float, Start | float, Array]]] = {}
    for atom in atoms:
        if not allowed(fitted.model.terms, atom.term):
            continue
        columns = atom.columns - basis @ (basis.T @ atom.columns)
        normal = columns.T @ columns
        towards = -columns.T @ left
        ridge = 1e-9 * np.trace(normal) * np.eye(normal.shape[0])
        coefficients = np.linalg.solve(normal + ridge + 1e-300 * np.eye(normal.shape[0]), towards)
        if atom.start.absolute:  # finite values: the start itself, gone for about once
            coefficients = np.clip(coefficients, 0.0, 1.5)
        gain = float(2 * towards @ coefficients - coefficients @ normal @ coefficients)
        gain -= len(LIBRARY[atom.term].parameters) * np.log(fitted.samples)
        looks.setdefault(atom.term, []).append((gain, atom.start, coefficients))
    if PERIODIC not in fitted.model.terms:
        looks[PERIODIC] = _lines(problem, fitted)
    result = []
    for term, of_term in looks.items():
        best = sorted(of_term, key=lambda look: -look[0])[:_STARTS_PER_TERM]
        if best and best[0][0] > 0:
            result.append((best[0][0], term, [(start, coefficients) for _, start, coefficients in best]))
    return sorted(result, key=lambda look: -look[0])


def _lines(problem: Problem, fitted: Fitted) -> list[tuple[float, Start | float, Array]]:
    """Frequencies at which the runs, each with a phase of its own, hold the most.

    Whitening turns sine and cosine of a frequency into each other, and so leaves alone what the two hold together.
    """
    shortest = min(float(np.ptp(problem.residuals.runs[run].signals.time_s)) for run in problem.runs)
    highest = 0.9 * problem.residuals.prepared.band_hz
    lowest, step = max(2.0 / shortest, 3.0), 0.4 / shortest
    frequencies = np.arange(lowest, highest, step)
    if frequencies.size == 0:
        return []
    gains, first = np.zeros(frequencies.size), 0
    for run in problem.runs:
        kept = usable(problem.residuals.valid(run))
        white, first = np.zeros(kept.size), first + int(kept.sum())
        white[kept] = fitted.white[first - int(kept.sum()) : first]
        turn = 2j * np.pi * problem.residuals.runs[run].signals.step_s * problem.residuals.prepared.every
        once = czt(white, frequencies.size, np.exp(-turn * step), np.exp(turn * lowest))
        twice = czt(kept, frequencies.size, np.exp(-2 * turn * step), np.exp(2 * turn * lowest))
        s, c = -once.imag, once.real
        ss, cc, sc = (kept.sum() - twice.real) / 2, (kept.sum() + twice.real) / 2, -twice.imag / 2
        gains += (s**2 * cc - 2 * s * c * sc + c**2 * ss) / np.maximum(
            ss * cc - sc**2, 1e-12 * ss * cc + 1e-300
        )
    gains -= len(problem.runs) * np.log(fitted.samples)
    for (
        injected
    ) in problem.residuals.prepared.injected_hz:  # what is missed there is the injection's own answer
        gains[np.abs(frequencies - injected) < INJECTED / shortest] = -np.inf
    best = np.argsort(-gains)[:_STARTS_PER_TERM]
    return [(float(gains[i]), float(frequencies[i]), np.zeros(0)) for i in best]
