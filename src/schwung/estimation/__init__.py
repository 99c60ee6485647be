"""From a session to the load inertia over angle: sliding DFT, denoising, inversion, trust."""

from schwung.estimation.estimate import estimate
from schwung.estimation.multiphase import MultiphaseMethod
from schwung.estimation.ripple import MIN_PHASES
from schwung.estimation.rivals import RIVALS
from schwung.estimation.trajectory import TrajectoryMethod
from schwung.estimation.values import Denoised, Estimate, Inversion, Trace, Trust, Verdict

__all__ = [
    "MIN_PHASES",
    "RIVALS",
    "Denoised",
    "Estimate",
    "Inversion",
    "MultiphaseMethod",
    "Trace",
    "TrajectoryMethod",
    "Trust",
    "Verdict",
    "estimate",
]
