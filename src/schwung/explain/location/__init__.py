"""Where a mismatch is: by which coordinates, how surely, on which interval."""

from schwung.explain.location.columns import Residual
from schwung.explain.location.interval import interval_of
from schwung.explain.location.mismatch import Share, locate, shares
from schwung.explain.location.words import unit_of

__all__ = ["Residual", "Share", "interval_of", "locate", "shares", "unit_of"]
