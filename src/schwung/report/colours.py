"""Colours that mean the same in every picture and on every page, and curves of few enough points; nothing that draws.

The palette follows Okabe and Ito (2008), darkened where a thin line on white needs it, so that people with any colour
vision tell the curves apart.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from schwung.motion import Array

#: Of a curve: no picture shows more.
MOST_POINTS = 4000


@dataclass(frozen=True)
class Colour:
    """A meaning, with its colour in light and in dark."""

    name: str
    light: str
    dark: str


INK = Colour("ink", "#1c2733", "#e8ecf1")  # text, demand, and whatever is taken as true
MUTED = Colour("muted", "#5a6775", "#a3afbd")
GRID = Colour("grid", "#e4e8ed", "#2e3743")
SURFACE = Colour("surface", "#fffffe", "#171c23")
ESTIMATE = Colour("estimate", "#0068b0", "#5db8f5")  # denoised signals and what is estimated from them
EXCITED = Colour("excited", "#c65200", "#ff9550")  # a run with the injected sine
PLAIN = Colour("plain", "#6b6f88", "#a9aec9")  # the same run without it
FORMER = Colour("former", "#b04a78", "#ec8fb4")
GOOD = Colour("good", "#00795a", "#35c99b")
DOUBTFUL = Colour("doubtful", "#9a6700", "#f0b93a")
UNUSABLE = Colour("unusable", "#b00040", "#ff857c")
PALETTE = (INK, MUTED, GRID, SURFACE, ESTIMATE, EXCITED, PLAIN, FORMER, GOOD, DOUBTFUL, UNUSABLE)


def thin(x: Array, y: Array, most: int = MOST_POINTS) -> tuple[Array, Array]:
    """Fewer points for the eye: smallest and largest sample of every bin are kept, so that no peak is lost.

    Arrays (n,) in, at most `most` points out; a bin with no finite sample stays a gap (NaN).
    """
    if x.size <= most:
        return x, y
    chosen: list[int] = []
    for bin_ in np.array_split(np.arange(x.size), most // 2):
        finite = bin_[np.isfinite(y[bin_])]
        ends = (
            (finite[y[finite].argmin()], finite[y[finite].argmax()]) if finite.size else (bin_[0], bin_[-1])
        )
        chosen.extend(sorted(int(end) for end in ends))
    return x[chosen], y[chosen]
