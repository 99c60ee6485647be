"""Whether a cause is one law, the same in all motions, or what single motions have of their own.

Evidence counts whatever a name's columns take. A law takes it with the same coefficients in every motion; an error
that is only like it (a motion that the model's steps are too coarse for) takes it where it happens, and elsewhere
another amount, or none. So one set of coefficients for all motions is weighed against some of its own for each, of
unknown size, or none: to be told once is likelier only where it is needed in more than one. Where but one motion tells
anything, the two are as likely.
"""

from __future__ import annotations

import numpy as np
from scipy.linalg import solve_triangular

from schwung.explain.weighing.candidate import LADDER
from schwung.explain.weighing.elsewhere import motions_of
from schwung.explain.weighing.search import Pick, Scored, Search
from schwung.innovations.evidence import block_gains, weigh
from schwung.motion import Array


def one_law(search: Search, scored: Scored, pick: Pick) -> float:
    """Log odds that a cause of a set is one law, all else of the set beside it; of one motion alone ∞."""
    data, candidate, where = search.data, search.candidate(pick), search.data.atoms[pick.atom].where
    motions = motions_of(data)
    if len(motions) < 2:
        return np.inf
    beside = (scored.which < where.start) | (scored.which >= where.stop)
    which, deviations = scored.which[beside], scored.deviations[beside]
    known, natural = weigh(data.at(which), deviations), np.array(candidate.deviations)

    def averaged(of: tuple[Array, Array, Array], scales: tuple[float, ...]) -> float:
        """Log evidence that columns add to the rest of the set, of any of these sizes."""
        cross, gram, slope = of
        across = solve_triangular(known.factor, deviations[:, None] * cross, lower=True, check_finite=False)
        left = slope - known.coefficients @ cross
        gains = block_gains((gram - across.T @ across)[None], left[None], natural, scales)
        return float(np.logaddexp.reduce(gains[0]) - np.log(len(scales)))

    each = [data.within(which, where, places) for places in motions]
    sizes = candidate.scales if len(candidate.scales) > 1 else LADDER
    own = sum(float(np.logaddexp(averaged(one, sizes), 0.0) - np.log(2)) for one in each)
    cross, gram, slope = (np.sum(parts, axis=0) for parts in zip(*each, strict=True))
    return averaged((cross, gram, slope), candidate.scales) - own
