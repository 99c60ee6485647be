"""The parameters of a name with their intervals: in one set, and over all sets that hold it.

Where two sets are about as likely, a number that both have lies where either of them says: of a coupling beside a motor
inertia or a load inertia that is off, the stiffness is one or the other.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np
from scipy.optimize import brentq
from scipy.special import ndtr

from schwung.explain.causes.candidate import Candidate, Shape
from schwung.explain.weighing.search import Pick, Scored, Search
from schwung.explain.weighing.sharpness import covariance_of
from schwung.explain.weighing.values import Parameter
from schwung.motion import Array

#: Deviations to either end of an interval, and the share that lies beyond one of them.
_ENDS, _BEYOND = 1.96, 0.025


def parameters_of(search: Search, scored: Scored, pick: Pick, where: slice) -> dict[str, Parameter]:
    """Of one cause of a set, whose coefficients are at these places."""
    candidate, atom = search.candidate(pick), search.data.atoms[pick.atom]
    centre = scored.exact[where]
    moved = _spread(candidate, centre, covariance_of(search, scored, pick), atom.shape)
    return {
        key: Parameter(float(v), float(v - _ENDS * moved[key]), float(v + _ENDS * moved[key]))
        for key, v in candidate.keys(centre, atom.shape).items()
    }


def tells(share: float, of: float) -> bool:
    """Whether a set that is so probable, of such as are so together, can move an end of an interval."""
    return share > _BEYOND * of


def over_sets(each: Sequence[tuple[float, Mapping[str, Parameter]]]) -> dict[str, Parameter]:
    """Of several sets with their shares, the likeliest first, which says the value: intervals that hold 95 % of all.

    A set that says the name by other numbers says nothing of these.
    """
    first = each[0][1]
    alike = [(share, found) for share, found in each if found.keys() == first.keys()]
    return {key: _over([(share, found[key]) for share, found in alike], key) for key in first}


def _over(each: Sequence[tuple[float, Parameter]], key: str) -> Parameter:
    value = each[0][1].value
    shares = np.array([share for share, _ in each])
    centres, low, high = np.array([(one.value, one.low, one.high) for _, one in each]).T
    if key.startswith("phase"):  # a turn further is the same
        turns = 2 * np.pi * np.round((centres - value) / (2 * np.pi))
        centres, low, high = centres - turns, low - turns, high - turns
    spreads = (high - low) / (2 * _ENDS)
    if len(each) == 1 or not np.all(np.isfinite(spreads) & (spreads > 0)):
        return Parameter(value, float(np.min(low)), float(np.max(high)))

    def beyond(at: float, share: float) -> float:
        return float(shares @ ndtr((at - centres) / spreads)) / float(shares.sum()) - share

    reach = float(np.min(low) - np.max(spreads)), float(np.max(high) + np.max(spreads))
    ends = [brentq(beyond, *reach, args=(share,)) for share in (_BEYOND, 1 - _BEYOND)]
    return Parameter(value, min(float(ends[0]), value), max(float(ends[1]), value))


def _spread(candidate: Candidate, centre: Array, covariance: Array, shape: Shape) -> dict[str, float]:
    """Deviations of the published numbers, by differences over coefficients and shape."""
    at = np.concatenate([centre, np.array(shape[: covariance.shape[0] - centre.size])])
    keys = list(candidate.keys(centre, shape))
    slopes = np.zeros((len(keys), at.size))
    for i in range(at.size):
        step = np.eye(at.size)[i] * max(1e-3 * float(np.sqrt(covariance[i, i])), 1e-9 * abs(at[i]), 1e-300)
        ahead, behind = (
            candidate.keys(v[: centre.size], (*v[centre.size :].tolist(), *shape[at.size - centre.size :]))
            for v in (at + step, at - step)
        )
        slopes[:, i] = [(ahead[key] - behind[key]) / (2 * step[i]) for key in keys]
    deviations = np.sqrt(np.maximum(np.einsum("ki,ij,kj->k", slopes, covariance, slopes), 0.0))
    return dict(zip(keys, deviations.tolist(), strict=True))
