"""How the report looks and speaks, for who draws the same elsewhere: colours, thinned curves, names of physics."""

from __future__ import annotations

from schwung.explain.words import words_of
from schwung.report.figures_explanation import probability
from schwung.report.style import PALETTE, thin
from schwung.report.wording import label_of

__all__ = ["PALETTE", "label_of", "probability", "thin", "words_of"]
