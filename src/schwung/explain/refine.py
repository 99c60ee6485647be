"""Finer shapes of a named term: what a drive engineer would call the same physics, with one more coefficient.

They take no part in the search, where they would stand in for other physics, and are fitted once the terms are chosen.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from schwung.explain.fit import PERIODIC, Fitted, Model, combined
from schwung.explain.ripple import ripple
from schwung.explain.search import Found
from schwung.explain.terms import LIBRARY

#: A ripple is worth as many parameters' price at the least.
RIPPLED = 10.0


def refined(found: Found, best: Fitted) -> Fitted:
    """The chosen terms with those of their refinements that lower the misfit by enough to be named."""
    for term in best.model.terms:
        for name in () if term == PERIODIC else LIBRARY[term].refinements:
            finer = found.problem.fit(_begun(found, best.model, name))
            if found.worthwhile(best, finer) and (best.chi2 - finer.chi2) / found.level > np.log(
                finer.samples
            ):
                best = finer
                found.by_terms[frozenset(best.model.terms)] = best
    return _rippled(found, best) if best.model.terms else best


def _rippled(found: Found, best: Fitted) -> Fitted:
    """With a ripple over position, where one stands out of all that the chosen terms leave."""
    line = ripple(found.problem, best) if "cogging" not in best.model.terms else None
    if line is None:
        return best
    fields = {
        "cogging_order": line.order,
        "cogging_amplitude_nm": line.amplitude_nm,
        "cogging_phase_rad": line.phase_rad,
    }
    finer = found.fit(combined(best.model, "cogging", fields))
    return finer if (best.chi2 - finer.chi2) / found.level > RIPPLED * np.log(finer.samples) else best


def _begun(found: Found, model: Model, name: str) -> Model:
    """The model with one more coefficient at a tenth of what the whole misfit would take: not at 0, with no slope."""
    residuals = found.problem.residuals
    floor, speed = found.problem.whitener.torque_nm, residuals.prepared.peak_speed_rad_s
    begun = replace(model, refined=(*model.refined, name))
    return begun.with_values({name: 0.1 * floor * float(np.sqrt(found.bare.misfit)) / max(speed, 1e-12)})
