"""A member of a set taken further by a step: within bounds, up to corners of the likelihood and ends of its shapes."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from schwung.explain.causes.present import Member
from schwung.motion import Array

#: What is held and taken within so much of a step of a sample is taken at it.
AT_SAMPLE = 1e-6


def taken_further(member: Member, step: Array, shift: Array) -> Member:
    """A member so much further, its shape by so many spacings of the grid.

    A line says how the product of a late cause's time and bend changes.
    """
    coefficients = within(member, member.coefficients + step)
    if member.candidate.bends is not None and coefficients[0] > 0:
        shift = shift * [
            min(max(member.coefficients[0] / coefficients[0], 0.0), 2.0),
            *np.ones(shift.size - 1),
        ]
    return replace(member, coefficients=coefficients, shape=member.candidate.moved(member.shape, shift))


def leads_across(member: Member, step: Array) -> NDArray[np.bool_]:
    """Which of its coefficients are at a corner of the likelihood, and are led across it, (p,): what is held and taken
    just before a sample moves what is measured there, and just behind it does not."""
    at_corner = member.candidate.holds & (np.abs(member.coefficients) <= AT_SAMPLE)
    return np.asarray(at_corner & (np.where(member.coefficients < 0, -1, 1) * step < 0))


def leads_beyond(member: Member, shift: Array) -> NDArray[np.bool_]:
    """Which numbers of its shape are at an end, and are led beyond, (d,)."""
    shape = member.candidate.moved(member.shape, shift)
    each = zip(shift, member.shape, shape, strict=False)
    return np.array([by != 0 and ahead == now for by, now, ahead in each], dtype=bool)


def within(member: Member, coefficients: Array) -> Array:
    """Coefficients that leave a total above what no machine goes below; no step takes more than most of it. What is
    held is taken within its step, or a little before what is sampled with it; no step leads past the sample."""
    if member.candidate.holds:
        now, asked = member.coefficients, np.clip(coefficients, -0.5, 1.0)
        at_sample = np.sign(asked if abs(now[0]) <= AT_SAMPLE else now) * AT_SAMPLE
        return np.where(now * asked < 0, at_sample, asked)
    held = coefficients.copy()
    for which, least in member.candidate.bounds_below:
        total = member.coefficients[which] - least
        if total > 0 and member.candidate.of_machine:
            held[which] = max(held[which], least + total / 4)
    return held
