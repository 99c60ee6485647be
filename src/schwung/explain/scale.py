"""Whether torque and inertia go together, asked of the slow part of a motion.

Noise of the acceleration makes a fit see less inertia than there is, the more the wider the band. In a fraction of the
band hardly any of it is left: there the believed torque and each named one are scaled so that they sum to the reported
one. A scale of the believed part that is not 1 is a torque constant or an inertia that is off; nothing within a session
tells which, since every other torque is found in reported units anyway.
"""

from __future__ import annotations

import numpy as np

from schwung.explain.fit import Fitted
from schwung.explain.naming import contribution
from schwung.explain.search import Found
from schwung.explain.spectrum import Spectrum
from schwung.explain.terms import View

#: Share of the band, and what is left out at each end of a run, in periods of it.
SLOW, EDGE = 0.2, 1.0
#: A scale is told where it is off by so much, by one deviation at the least, and known to so much.
OFF, KNOWN = 0.05, 0.15
#: By fewer deviations than these it may be chance.
SURE = 2.0
#: Acceleration takes this share of the reported torque at the least, or nothing can be said of the inertia.
INERT = 0.2
#: Terms that say it themselves, or bend the torque where it is greatest.
_SCALES = ("torque_constant", "load_inertia", "torque_saturation")


def scale_note(found: Found, best: Fitted) -> str | None:
    """A sentence where torque and believed inertia disagree in the slow part of the motion; None else."""
    residuals, terms = found.problem.residuals, best.model.terms
    if set(terms) & set(_SCALES):
        return None
    prepared = residuals.prepared
    rate, slow_hz = prepared.rate_hz / prepared.every, SLOW * prepared.band_hz
    view = View(residuals, found.problem.runs)
    inertia = residuals.machine.motor.inertia_kgm2 + view.mean_inertia_kgm2
    columns, reported, inert = [], [], []
    for run in found.problem.runs:
        of = residuals.runs[run]
        whole = of.torque_nm[:: prepared.every]
        edge = int(EDGE * rate / slow_hz)
        if whole.size <= 4 * edge:
            continue
        believed = whole - residuals.residual(run, found.bare.model.unknowns)
        parts = [-contribution(residuals, run, best.model, term) for term in terms]
        spectrum = Spectrum(whole.size, rate, 2 / slow_hz)
        change = inertia * of.signals.acceleration_rad_s2[:: prepared.every]
        slow = spectrum.apply(np.stack([whole, believed, *parts, change]), spectrum.low_pass(slow_hz))
        inert.append(slow[-1, edge:-edge])
        reported.append(slow[0, edge:-edge])
        columns.append(slow[1:-1, edge:-edge].T)
    if not columns:
        return None
    matrix, wanted = np.concatenate(columns), np.concatenate(reported)
    if np.mean(np.concatenate(inert) ** 2) < INERT**2 * np.mean(wanted**2):
        return None
    scales, *_ = np.linalg.lstsq(matrix, wanted, rcond=None)
    left = float(np.mean((wanted - matrix @ scales) ** 2))
    covariance = np.linalg.pinv(matrix.T @ matrix) * left * max(rate / (2 * slow_hz), 1.0)
    scale, deviation = float(scales[0]), float(np.sqrt(covariance[0, 0]))
    if deviation > KNOWN or scale < OFF or abs(scale - 1) < max(deviation, OFF):
        return None
    is_off = "is" if abs(scale - 1) >= SURE * deviation else "may be"
    return (
        f"below {slow_hz:.2g} Hz, where noise of the acceleration matters least, the reported torque is {scale:.2f} "
        f"times (± {1.96 * deviation:.2f}) what the believed inertia takes: the torque constant {is_off} off "
        f"(true over reported {1 / scale:.2f}), or the inertia is. This session cannot tell torque_constant from "
        "load_inertia; if it is the torque constant, every torque named here has to be multiplied by it"
    )
