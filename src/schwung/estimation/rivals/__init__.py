"""The methods that Schwung is measured against, one file each, registered here.

All follow the one tuning rule of `common` and are found by name, as `estimate(..., method="rls")`.
"""

from schwung.estimation.methods import Method, register
from schwung.estimation.rivals.acceleration_median import AccelerationMedian
from schwung.estimation.rivals.bspline import BSplineExpansion
from schwung.estimation.rivals.ekf import ExtendedKalman
from schwung.estimation.rivals.gdft import GeneralisedDft
from schwung.estimation.rivals.kalman_fourier import KalmanFourier
from schwung.estimation.rivals.rls import RecursiveLeastSquares
from schwung.estimation.rivals.sigma_point import SigmaPoint
from schwung.estimation.rivals.windowed_ls import WindowedLeastSquares

RIVALS: tuple[Method, ...] = (
    GeneralisedDft(),
    KalmanFourier(),
    RecursiveLeastSquares(),
    WindowedLeastSquares(),
    ExtendedKalman(),
    SigmaPoint(),
    BSplineExpansion(),
    AccelerationMedian(),
)
for _rival in RIVALS:
    register(_rival)

__all__ = ["RIVALS"]
