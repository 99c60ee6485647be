"""Whether a session is fit to be explained: units, signs, wraps, rests, repeats, clipping."""

from schwung.explain.plausibility.examination import examine
from schwung.explain.plausibility.glitches import without_glitches
from schwung.explain.plausibility.values import Correction, Doubt, Plausibility, corrected

__all__ = ["Correction", "Doubt", "Plausibility", "corrected", "examine", "without_glitches"]
