"""Formulas for a curve as it is drawn: forward and backward together where one formula says both, else each its own."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from schwung.drivetrain.residual import UNDIRECTED
from schwung.explain.publishing.drawn import Drawn
from schwung.explain.publishing.formula import Formula, formulas
from schwung.motion import Array

_LETTERS = {"position": "θ", "load_position": "θ", "speed": "|ω|", "torque": "|T|", "acceleration": "α",
            "time_in_motion": "t", "run": "r", "wind_up": "φ"}  # fmt: skip
#: Formulas that are held against the runs kept aside, at most.
_TRIED = 6


def formulas_of(curve: Drawn) -> list[tuple[Formula, Drawn]]:
    """Formulas for a curve, the shortest first: for both directions at once where they go together."""
    letter = _LETTERS[curve.over]
    x, f, b, df, db = (
        curve.x,
        curve.forward_nm,
        curve.backward_nm,
        curve.forward_std_nm,
        curve.backward_std_nm,
    )
    if curve.over in UNDIRECTED:
        return [(one, _as(curve, one.at(x), one.at(x))) for one in formulas(x, f, df, letter)]
    result = []
    for sign, words in ((-1.0, "({})·sign ω"), (1.0, "{}")):
        together, y, deviation = (
            np.concatenate([x, x]),
            np.concatenate([f, sign * b]),
            np.concatenate([df, db]),
        )
        for one in formulas(together, y, deviation, letter):
            result.append(
                (replace(one, text=words.format(one.text)), _as(curve, one.at(x), sign * one.at(x)))
            )
    for ahead, back in zip(formulas(x, f, df, letter), formulas(x, b, db, letter), strict=True):
        text = f"forward {ahead.text}; backward {back.text}"
        both = Formula(text, ahead.terms + back.terms, ahead.at, ahead.misfit + back.misfit)
        result.append((both, _as(curve, ahead.at(x), back.at(x))))
    return sorted(result, key=lambda pair: (pair[0].terms, pair[0].misfit))[:_TRIED]


def _as(curve: Drawn, forward: Array, backward: Array) -> Drawn:
    return replace(curve, forward_nm=forward, backward_nm=backward)
