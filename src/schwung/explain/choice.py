"""Which of the models that were tried stands: runs that nothing was fitted to check it; those for the proof do not."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from schwung.explain.fit import Fitted, Model, Problem
from schwung.explain.kept_aside import Split
from schwung.explain.proof import missed_nm
from schwung.explain.refine import refined, slimmed
from schwung.explain.search import CONSISTENT, Found, Progress, chosen, reduced, search

#: A term that makes the runs that check it so much worse is wrong.
WORSE = 1.02
#: Below a consistent misfit, terms stand where they lower the same on the runs that check them by so much; below the
#: second, a belief is at the floor, and nothing is sought that could only be fitted to the noise.
BORNE_OUT, AT_FLOOR = 0.15, 1.15
#: And where the belief misses so many times the floor on them: less is for those who look at single lines.
SEEN = 1.12
#: Without runs to check it a term carries this part of the mismatch at least: what is small stands on its shape alone.
UNPROVEN = 0.01


def searched(problem: Problem, parts: Split, progress: Progress) -> tuple[Found, Fitted]:
    """What was tried, and the best model that stands; of the runs that are for the proof nothing is asked."""
    first = problem.fit(Model())
    found = Found(problem, (), {frozenset(): first})
    if max(first.misfit, missed(problem, first.model, parts.check or parts.train)) <= AT_FLOOR:
        return found, first
    found = search(problem, first, progress)
    best = refined(found, chosen(found), proven=bool(parts.check))
    best = slimmed(found, _upheld(found, best, parts.check) if parts.check else _carrying(found, best))
    if first.misfit < CONSISTENT and not _borne_out(found, best, parts.check):
        best = first
    return found, best


def needed(found: Found, best: Fitted) -> Fitted:
    """Without the terms that do not pay for themselves once the noise is known better."""
    while len(best.model.terms) > 1:
        spared = min(reduced(found, best), key=found.score)
        if found.score(spared) > found.score(best):
            break
        best = spared
    return best


def missed(problem: Problem, model: Model, runs: tuple[int, ...]) -> float:
    """Mean square of the whitened residual on some runs."""
    white = replace(problem, runs=runs).white(model)
    return float(np.mean(white**2)) if white.size else 1.0


def _carrying(found: Found, best: Fitted) -> Fitted:
    """Where nothing checks what was chosen: the terms of several that carry a part of the mismatch that shows."""
    while len(best.model.terms) > 1:
        spared = min(reduced(found, best), key=lambda fitted: fitted.misfit)
        if spared.misfit - best.misfit >= UNPROVEN * (found.bare.misfit - 1):
            break
        best = spared
    return best


def _upheld(found: Found, best: Fitted, check: tuple[int, ...]) -> Fitted:
    """The terms of several that do not make the runs that check them worse."""
    while len(best.model.terms) > 1:
        spared = min(reduced(found, best), key=lambda fitted: missed(found.problem, fitted.model, check))
        if missed(found.problem, best.model, check) < WORSE * missed(found.problem, spared.model, check):
            break
        best = spared
    return best


def _borne_out(found: Found, best: Fitted, check: tuple[int, ...]) -> bool:
    """Whether the runs that check it miss less, too: near the floor a term may fit what is no physics."""
    if not check:
        return False
    before, after = (missed(found.problem, model, check) for model in (found.bare.model, best.model))
    if before - after < BORNE_OUT:
        return False
    return (
        missed_nm(found.problem.residuals, check, found.bare.model) > SEEN * found.problem.whitener.torque_nm
    )
