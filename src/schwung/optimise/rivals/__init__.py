"""What our motion is held against: standard profiles, polynomials by a genetic algorithm, TOPP-RA, shapers."""

from schwung.optimise.rivals.chebyshev import chebyshev_stroke
from schwung.optimise.rivals.fastest import toppra_stroke
from schwung.optimise.rivals.shaping import shaped_demand

__all__ = ["chebyshev_stroke", "shaped_demand", "toppra_stroke"]
