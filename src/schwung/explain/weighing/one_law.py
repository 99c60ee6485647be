"""Whether a cause is one law, the same in all motions, or what single motions have of their own.

Evidence counts whatever a name's columns take. A law takes it with the same coefficients in every motion; an error
that is only like it (a motion that the model's steps are too coarse for) takes it where it happens, and elsewhere
another amount, or none. So one set of coefficients for all motions, off by a per cent or so in each, is weighed
against such in one motion alone, and against each motion's own, all of sizes of one ladder. What a motion has of its
own has a form of its own: that it is this law's, of all that there are, is a coincidence as unlikely as any cause, in
each motion anew. So what one motion alone can show (a torque that saturates where it is largest) is a law, unless
another motion denies it.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from scipy.linalg import solve_triangular

from schwung.explain.causes.candidate import LADDER
from schwung.explain.causes.inexact import SHARES, alike
from schwung.explain.weighing.elsewhere import motions_of_fitted
from schwung.explain.weighing.search import Pick, Scored, Search
from schwung.innovations.evidence import ROUNDING, weigh
from schwung.innovations.statistics import Statistics
from schwung.motion import Array

#: Of a cause's columns in one motion: their cross products with a set's columns, their own, and their slope.
_Part = tuple[Array, Array, Array]


def one_law(search: Search, scored: Scored, pick: Pick) -> float:
    """Log odds that a cause of a set is one law, all else of the set beside it.

    ∞ where there is one motion alone, and for a law whose numbers are each run's own.
    """
    return _alike(search, scored, pick, search.odds)


def law_without_name(search: Search, scored: Scored, pick: Pick) -> float:
    """Log odds that a curve of a set is a law that nobody has named: that all motions have it alike.

    A curve has any form, so that what a motion has of its own has it by no coincidence; −∞ where there is one motion.
    """
    alike = _alike(search, scored, pick, 0.0)
    return alike if np.isfinite(alike) else -np.inf


def _alike(search: Search, scored: Scored, pick: Pick, coincidence: float) -> float:
    """Log odds of one law; `coincidence`: that what a motion has of its own has this form (log odds)."""
    data, candidate, where = search.data, search.candidate(pick), search.data.atoms[pick.atom].where
    motions = motions_of_fitted(data)
    if len(motions) < 2 or candidate.each_run:
        return np.inf
    beside = (scored.which < where.start) | (scored.which >= where.stop)
    which, deviations = scored.which[beside], scored.deviations[beside]
    known, natural = data.at(which), np.array(candidate.deviations)
    sizes = candidate.scales if len(candidate.scales) > 1 else LADDER

    each = [data.within(which, where, places) for places in motions]
    cross, gram, slope = (np.sum(parts, axis=0) for parts in zip(*each, strict=True))
    beyond = [(np.vstack([across, own]), own, pulled) for across, own, pulled in each]
    joined = _joined(known, cross, gram, slope)
    found = weigh(joined, np.append(deviations, pick.scale * natural)).coefficients[which.size :]
    whole = alike(found, gram)

    def averaged(parts: Sequence[_Part]) -> float:
        """Log evidence with coefficients for each of these parts, of any size."""
        return float(np.logaddexp.reduce([_log(known, deviations, parts, size * natural) for size in sizes]))

    def nearly(share: float) -> float:
        """Log evidence of a law whose coefficients are off by such a share in each motion."""
        logs = [_log(joined, np.append(deviations, size * natural), beyond, share * whole) for size in sizes]
        return float(np.logaddexp.reduce(logs))

    own = [averaged(parts) + len(parts) * coincidence for parts in (each, *([part] for part in each))]
    law = np.logaddexp.reduce([nearly(share) for share in SHARES]) - np.log(len(SHARES))
    return float(law - np.logaddexp.reduce(own))


def _joined(known: Statistics, cross: Array, gram: Array, slope: Array) -> Statistics:
    """A set's columns, and a cause's behind them."""
    return Statistics(
        np.block([[known.gram, cross], [cross.T, gram]]),
        np.append(known.slope, slope),
        known.square,
        known.count,
    )


def _log(known: Statistics, deviations: Array, parts: Sequence[_Part], own: Array) -> float:
    """Log evidence of a set's columns (n,) and, for each part, such of a cause with deviations `own` (p,)."""
    gram, slope, log = known.gram.copy(), known.slope.copy(), 0.0
    for across, products, pulled in parts:
        inner = products * own[:, None] * own
        inner[np.diag_indices_from(inner)] += 1.0 + ROUNDING * float(np.max(np.diag(inner)))
        factor = np.linalg.cholesky(inner)
        half = solve_triangular(factor, own[:, None] * across.T, lower=True, check_finite=False)
        pull = solve_triangular(factor, own * pulled, lower=True, check_finite=False)
        gram -= half.T @ half
        slope -= pull @ half
        log += 0.5 * float(pull @ pull) - float(np.sum(np.log(np.diag(factor))))
    return log + weigh(Statistics(gram, slope, known.square, known.count), deviations).log_evidence
