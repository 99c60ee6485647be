"""What is looked for once terms are chosen: ripples over position that stand out, and numbers that are not needed."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from scipy.interpolate import CubicSpline

from schwung.drivetrain.effects import Effects
from schwung.explain.fit import Fitted, combined, without
from schwung.explain.residual import FINEST
from schwung.explain.ripple import ripple
from schwung.explain.search import ALIKE, CONSISTENT, Found, chosen, pruned
from schwung.explain.terms import LOAD_TABLE

#: A ripple is worth as many parameters' price at the least.
RIPPLED = 10.0
#: Highest order per turn of what may be a load's own (a second crank, an unbalanced lever), not a motor's teeth.
HARMONICS = 3.5
#: A refinement is worth as many.
REFINED = 4.0


def refined(found: Found, best: Fitted, *, proven: bool) -> Fitted:
    """The chosen terms without refinements that do not pay, and with a ripple over position where one stands out.

    `proven`: runs are kept aside; without them a load torque keeps the few points that it was found with.
    """
    for name in best.model.refined:
        kept = tuple(other for other in best.model.refined if other != name)
        neutral = best.model.with_values({name: getattr(Effects(), name)})
        plain = found.problem.fit(replace(neutral, refined=kept))
        if (plain.chi2 - best.chi2) / found.level < REFINED * np.log(best.samples):
            found.by_terms[frozenset(best.model.terms)] = plain
            best = chosen(found)
            break
    if proven:
        best = _with_finer_table(found, best)
    if "cogging" in best.model.terms:
        return _without_harmonic(found, best)
    if not best.model.terms:
        return best
    line = ripple(found.problem, best)
    if line is None:
        return best
    fields = {
        "cogging_order": line.order,
        "cogging_amplitude_nm": line.amplitude_nm,
        "cogging_phase_rad": line.phase_rad,
    }
    finer = found.fit(combined(best.model, "cogging", fields))
    return finer if (best.chi2 - finer.chi2) / found.level > RIPPLED * np.log(finer.samples) else best


def _without_harmonic(found: Found, best: Fitted) -> Fitted:
    """One load torque of any shape in place of a sine and a "cogging" of an order as low as a load's."""
    terms = best.model.terms
    if "load_torque" not in terms or best.model.effects.cogging_order > HARMONICS:
        return best
    spared = without(without(best.model, "cogging"), "load_torque")
    table = _with_finer_table(found, found.fit(combined(spared, LOAD_TABLE, {})))
    return table if LOAD_TABLE in table.model.terms and table.misfit < CONSISTENT * best.misfit else best


def _with_finer_table(found: Found, best: Fitted) -> Fitted:
    """A load torque with twice the points as long as that pays; terms that stood in for these fall away."""
    while LOAD_TABLE in best.model.terms and len(best.model.unknowns.load_table_nm) < FINEST:
        coarse = np.array(best.model.unknowns.load_table_nm)
        table = CubicSpline(np.arange(coarse.size), coarse)(np.arange(0, coarse.size - 0.9, 0.5))
        unknowns = replace(best.model.unknowns, load_table_nm=tuple(map(float, table)))
        finer = found.problem.fit(replace(best.model, unknowns=unknowns))
        if found.score(finer) > found.score(best) - ALIKE:
            break
        found.by_terms[frozenset(finer.model.terms)] = finer
        for term in finer.model.terms:
            spared = found.problem.fit(without(finer.model, term))
            known = found.by_terms.get(frozenset(spared.model.terms))
            if known is None or spared.chi2 < known.chi2:
                found.by_terms[frozenset(spared.model.terms)] = spared
        best = pruned(found, finer)
    return best


def slimmed(found: Found, best: Fitted) -> Fitted:
    """With one number for the load's inertia where one will do: more mass, or another scale, but not a bit of both."""
    if "load_inertia" not in best.model.terms:
        return best
    single = []
    for name, neutral in (("inertia_scale", 1.0), ("inertia_delta_kgm2", 0.0)):
        model = replace(best.model.with_values({name: neutral}), fixed=(*best.model.fixed, name))
        single.append(found.problem.fit(model))
    slim = min(single, key=lambda fitted: fitted.chi2)
    if (slim.chi2 - best.chi2) / found.level > np.log(best.samples):
        return best
    found.by_terms[frozenset(best.model.terms)] = slim
    return slim
