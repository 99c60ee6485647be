"""Actuator and sensor: what is wrong with the torque or the angle that is reported."""

from __future__ import annotations

import numpy as np

from schwung.explain.terms.term import Start, Term, View, at, polar


def _gain(_view: View) -> list[Start]:
    return [Start({}, ({"torque_gain": 0.02},))]


def _lag(_view: View) -> list[Start]:
    """Finite, and with the shift in time taken back: a small lag is nothing but that, and it is fitted along."""
    return [at(earlier_s=-lag, torque_lag_s=lag) for lag in (1.5e-4, 4e-4, 1.2e-3, 4e-3)]


def _saturation(view: View) -> list[Start]:
    peak = view.peak_torque_nm
    return [
        at(peak * share, torque_limit_nm=peak * share)
        for share in (0.4, 0.5, 0.6, 0.7, 0.8, 0.87, 0.93, 0.97)
    ]


def _eccentricity(view: View) -> list[Start]:
    unit = 1e-4
    sine = {"eccentricity_rad": unit}
    cosine = {"eccentricity_rad": unit, "eccentricity_phase_rad": np.pi / 2}
    return [Start({}, (sine, cosine), polar("eccentricity_rad", "eccentricity_phase_rad", unit))]


ACTUATOR = (
    Term("torque_constant", "torque", _gain, ("torque_gain",), {"torque_gain": (0.1, 10.0)}, 1),
    Term("torque_lag", "frequency", _lag, ("torque_lag_s",), {"torque_lag_s": (0.0, 0.1)}, 1),
    Term(
        "torque_saturation",
        "torque",
        _saturation,
        ("torque_limit_nm",),
        {"torque_limit_nm": (1e-9, np.inf)},
        2,
    ),
    Term(
        "encoder_eccentricity",
        "position",
        _eccentricity,
        ("eccentricity_rad", "eccentricity_phase_rad"),
        {},
        2,
    ),
)
