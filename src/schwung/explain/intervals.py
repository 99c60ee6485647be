"""95 % intervals from the profile of the likelihood, and terms that this session cannot tell apart."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from schwung.explain.fit import PERIODIC, TIMING, Fitted, combined, without
from schwung.explain.search import HOPE, Found, allowed, combined_start, ranked
from schwung.explain.terms import LIBRARY, published

#: Rise of Σ whitened² over its level at the ends of a 95 % interval.
RISE = 3.84
#: Alternatives that fit as well within this rise, or that give up less than this share of the gain, are open.
OPEN_RISE, OPEN_SHARE = 9.0, 0.01
_ALTERNATIVES = 4
#: Of these the likelihood is too rough for a profile: deviations have to do.
ROUGH = ("gap_rad",)
#: Whoever has more freedom and holds the named term as a special case is no alternative to it.
_CONTAINS = {
    "stribeck_friction": {"coulomb_friction"},
    "asymmetric_friction": {"coulomb_friction", "torque_offset"},
    "extra_compliance": {"load_inertia"},
}


def interval(found: Found, fitted: Fitted, name: str, least_variance: float = 1.0) -> tuple[float, float]:
    """Ends of the 95 % interval of one parameter: where the refitted likelihood has fallen by RISE / 2."""
    names = fitted.model.names
    at, value = names.index(name), fitted.model.value(name)
    level = max(found.level, least_variance, fitted.spread.get(name, 1.0) ** 2)
    shift = fitted.bias.get(name, 0.0)
    std = float(np.sqrt(max(fitted.covariance()[at, at], 0.0)) * np.sqrt(level / max(fitted.misfit, 1.0)))
    if not np.isfinite(std) or std == 0:
        return value - shift, value - shift
    ends = []
    for side in (-1.0, 1.0):
        reach = 1.96 * std
        for _ in range(0 if name in ROUGH else 2):
            trial = fitted.model.with_values({name: value + side * reach})
            pinned = replace(trial, fixed=(*trial.fixed, name))
            chi2 = found.problem.fit(pinned, 4).chi2
            rise = (
                (chi2 - fitted.chi2) / level if np.isfinite(chi2) else 10 * RISE
            )  # no such machine: too far
            if 0.8 * RISE < rise < 1.25 * RISE:
                break
            reach *= float(np.clip(np.sqrt(RISE / max(rise, 1e-3)), 0.3, 3.0))
        ends.append(value - shift + side * reach)
    return min(ends), max(ends)


def alternatives(found: Found, fitted: Fitted, term: str) -> tuple[str, ...]:
    """Names that would do in the place of one of the model's terms."""
    others = frozenset(t for t in fitted.model.terms if t != term)
    spared = found.by_terms[others]
    gain = spared.chi2 - fitted.chi2
    result = []
    for promised, other, starts in ranked(found.problem, found.atoms, spared)[: _ALTERNATIVES + 1]:
        if promised < HOPE * gain:
            break
        if other == term or term in _CONTAINS.get(other, set()) or not allowed(others, other):
            continue
        known = found.by_terms.get(others | {other})
        tried = known or found.fit(*(combined_start(spared.model, other, s, c) for s, c in starts))
        loss = tried.chi2 - fitted.chi2
        if loss < OPEN_RISE * found.level or loss < OPEN_SHARE * gain:
            result.append(other)
    if term == "asymmetric_friction" and _offset_does(found, fitted, others, gain):
        result.append("torque_offset")
    return tuple(dict.fromkeys(published(other) for other in result if published(other) != published(term)))


def _offset_does(found: Found, fitted: Fitted, others: frozenset[str], gain: float) -> bool:
    """Whether one dry friction for both directions and an offset fit as well: while an axis moves they are the same."""
    pair = {"coulomb_friction", "torque_offset"}
    if pair & others or fitted.model.refined:
        return False
    positive, negative = fitted.model.value("coulomb_positive_nm"), fitted.model.value("coulomb_negative_nm")
    even = without(fitted.model, "asymmetric_friction")
    even = combined(even, "coulomb_friction", {"coulomb_positive_nm": (positive + negative) / 2})
    even = combined(even, "torque_offset", {"offset_nm": (negative - positive) / 2})
    loss = found.fit(even).chi2 - fitted.chi2
    return loss < OPEN_RISE * found.level or loss < OPEN_SHARE * gain


def parameters(term: str) -> tuple[str, ...]:
    """The fields that a term fits."""
    return ("periodic_frequency_hz",) if term == PERIODIC else LIBRARY[term].parameters


__all__ = ["TIMING", "alternatives", "interval", "parameters"]
