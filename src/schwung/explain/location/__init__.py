"""Where a mismatch is: by which coordinates, how surely, on which interval."""

from schwung.explain.location.columns import Residual
from schwung.explain.location.interval import interval_of
from schwung.explain.location.mismatch import locate
from schwung.explain.location.words import unit_of

__all__ = ["Residual", "interval_of", "locate", "unit_of"]
