"""Once the physics is named: the noise judged with it, the bias by noise in the measured motion, honest deviations.

Noise of the angle passes through the load's resonance into what a belief needs, so that its colour depends on what is
named: the whitening filter and the load's ringing at first are worked out anew. The motion is measured and prescribed,
so that its noise is in the regressors, too: as much noise again, drawn, shows what that does to a fit (antithetic
pairs: only what is of second order is left), and it is taken off. Deviations come of the scores of stretches of the
motion, over all repeats, where these scatter more than white noise does: what is shaped is not noise.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
from scipy.stats import chi2

from schwung.drivetrain.machine import Machine
from schwung.explain.fit import Fitted, Problem
from schwung.explain.noise import usable, whitener
from schwung.explain.search import Found
from schwung.explain.signals import drawn_noise
from schwung.explain.terms import LOAD_TABLE
from schwung.motion import Array

#: Pairs of draws, and times that the bias is worked out anew where it has brought the fit.
_PAIRS, _ROUNDS = 4, 3
#: A round that moves no parameter by more than so many deviations is the last.
ENOUGH = 0.2
#: Where as much noise again makes the session tell so much more of a parameter, it tells of noise.
MOSTLY_NOISE = 1.5
#: A correction that is less likely than this is none.
WITHIN = 0.999
#: Stretches of a motion that are one score (s).
STRETCH_S = 0.1


def sharpened(found: Found, best: Fitted, believed: Machine, seen: Sequence[int]) -> tuple[Found, Fitted]:
    """The problem with its noise as the best model has it, and that model's fit to it, with its bias.

    `seen`: the runs that may be looked at.
    """
    if not best.model.terms:
        return found, best
    residuals = found.problem.residuals
    residuals.settle(best.model.effects)
    prepared = residuals.prepared
    needed = residuals.all(range(len(prepared.runs)), best.model.unknowns)
    problem = replace(found.problem, whitener=whitener(prepared, believed, needed, seen))
    bare, refitted = problem.fit(found.bare.model), problem.fit(best.model)
    bias, shaken = _shaken(problem, refitted)
    ratios = np.maximum(np.maximum(_scattered(problem, refitted), shaken), 1.0)
    spread = dict(zip(refitted.model.names, map(float, ratios), strict=True))
    finer = replace(refitted, bias=bias, spread=spread)
    if not _harmless(problem, finer):
        finer = replace(finer, bias={})
    key = frozenset(finer.model.terms)
    return Found(problem, found.atoms, {frozenset(): bare, key: finer}), finer


def _harmless(problem: Problem, fitted: Fitted) -> bool:
    """Whether the bias leaves the parameters where chance could have put them: what is published has to fit, too.

    A move by the likelihood's own deviations raises Σ whitened² as often by less than `WITHIN` of χ².
    """
    told = problem.white(fitted.told)
    rise = (float(told @ told) - fitted.chi2) / max(fitted.misfit, 1.0)
    return bool(rise < chi2.ppf(WITHIN, len(fitted.model.names)))


def _shaken(problem: Problem, fitted: Fitted) -> tuple[dict[str, float], Array]:
    """By how much noise in the measured motion puts each parameter off (empty where it tells of little but noise).

    Also by how much the parameters scatter for it, (parameters,), over the deviations that white noise would give.
    """
    chance = np.random.default_rng(1)
    residuals, model, names = problem.residuals, fitted.model, fitted.model.names
    draws = [
        [drawn_noise(residuals.prepared, of.spectrum, chance) for of in residuals.runs] for _ in range(_PAIRS)
    ]
    free = np.array(
        [not model.is_bounded(name) for name in names]
    )  # the others would not stay where they may be
    columns, white = fitted.jacobian * free, fitted.white
    scatter, furthest = np.ones(len(names)), np.inf
    if LOAD_TABLE in model.terms:  # many points, of which no interval is told
        return {}, scatter
    for turn in range(_ROUNDS):
        scale = np.sqrt(np.maximum(np.sum(columns**2, axis=0), 1e-300))
        inverse = np.linalg.pinv((columns / scale).T @ (columns / scale), rcond=1e-10)
        gradients, energy = [], np.zeros(scale.size)
        for draw in draws:
            for sign in (1.0, -1.0):
                shaken = replace(problem, residuals=residuals.shaken([sign * one for one in draw]))
                white_then = shaken.white(model)
                columns_then = shaken.jacobian(model, white_then) * free / scale
                gradients.append(columns_then.T @ white_then)
                energy += np.sum(columns_then**2, axis=0) / (2 * _PAIRS)
        gradient = (columns / scale).T @ white
        if turn == 0:
            steps = (np.stack(gradients) - np.mean(gradients, axis=0)) @ inverse
            scatter = np.sqrt(np.mean(steps**2, axis=0) / np.maximum(np.diag(inverse), 1e-300))
        if np.any(energy > MOSTLY_NOISE * np.sum((columns / scale) ** 2, axis=0)):
            return {}, scatter
        # what the noise that is there has added to the gradient, as much again has added once more
        steps = -inverse @ (2 * gradient - np.mean(gradients, axis=0)) / scale
        gone = np.max(np.abs(steps * scale) / np.sqrt(np.maximum(np.diag(inverse), 1e-300)))
        if gone > furthest:  # it runs away: edges have no slope that this could go by
            return {}, scatter
        furthest = gone
        model = model.with_values({n: model.value(n) + float(d) for n, d in zip(names, steps, strict=True)})
        if gone < ENOUGH:
            break
        white = problem.white(model)
        columns = problem.jacobian(model, white) * free
    return {name: fitted.model.value(name) - model.value(name) for name in names}, scatter


def _scattered(problem: Problem, fitted: Fitted) -> Array:
    """Deviations of the parameters, (parameters,), over those that white noise of the floor's size would give."""
    columns, white = fitted.jacobian, fitted.white
    prepared = problem.residuals.prepared
    length = max(round(STRETCH_S * prepared.rate_hz / prepared.every), 1)
    scores: dict[tuple[int, int], Array] = {}
    first = 0
    for run in problem.runs:
        at = np.flatnonzero(usable(problem.residuals.valid(run)))
        here = slice(first, first + at.size)
        first += at.size
        score = columns[here] * white[here, None]
        for stretch in np.unique(at // length):
            key = prepared.runs[run].group, int(stretch)
            scores[key] = scores.get(key, 0.0) + score[at // length == stretch].sum(axis=0)
    table = np.stack([*scores.values(), columns[-1] * white[-1]])
    scale = np.sqrt(np.maximum(np.sum(columns**2, axis=0), 1e-300))
    inverse = np.linalg.pinv((columns / scale).T @ (columns / scale), rcond=1e-10)
    meat = inverse @ (table / scale).T @ (table / scale) @ inverse
    return np.asarray(np.sqrt(np.diag(meat) / np.maximum(np.diag(inverse), 1e-300)))
