"""Dry friction of all kinds, viscous friction and drag, all on the motor."""

from __future__ import annotations

import numpy as np

from schwung.explain.residual import Moving
from schwung.explain.terms.term import SHARPNESS, Start, Term, View
from schwung.motion import Array

BOTH = ("coulomb_positive_nm", "coulomb_negative_nm")


def _dry(_view: View) -> list[Start]:
    return [Start({}, (dict.fromkeys(BOTH, 1.0),))]


def _stribeck(view: View) -> list[Start]:
    speeds = view.peak_speed_rad_s * np.geomspace(0.01, 0.5, 8)
    return [
        Start({"stribeck_speed_rad_s": float(speed)}, (dict.fromkeys(BOTH, 1.0), {"stribeck_rise_nm": 1.0}))
        for speed in speeds
    ]


def _asymmetric(_view: View) -> list[Start]:
    return [Start({}, tuple({field: 1.0} for field in BOTH))]


def _viscous(_view: View) -> list[Start]:
    return [Start({}, ({"viscous_nms": 1.0},))]


def _drag(_view: View) -> list[Start]:
    return [Start({}, ({"drag_nms2": 1.0},))]


def _drift(view: View) -> list[Start]:
    return [Start({}, ({"drift_nm": 1.0},))] if len(view.runs) > 2 else []


def _local(view: View) -> list[Start]:
    angle = view.gathered("position_rad")
    low, high = float(angle.min()), float(min(angle.max(), angle.min() + 2 * np.pi))
    return [
        _tight_spot(float(centre), float(width))
        for width in np.array([0.04, 0.08, 0.16, 0.32]) * (high - low)
        for centre in np.arange(low, high + width / 4, width / 4)
    ]


def _tight_spot(centre: float, width: float) -> Start:
    def torques(run: Moving) -> Array:
        away = run.position_rad - centre
        away = away - 2 * np.pi * np.round(away / (2 * np.pi))
        level = np.where(np.abs(away) < width / 2, 0.5 + 0.5 * np.cos(2 * np.pi * away / width), 0.0)
        return np.asarray(-level * run.direction)[None]

    shape = {"local_centre_rad": centre, "local_width_rad": width}
    return Start(shape, ({"local_friction_nm": 1.0},), torques=torques)


FRICTION = (
    Term("coulomb_friction", "direction", _dry, ("coulomb_positive_nm",), {}, 0, tied=BOTH),
    Term("viscous_friction", "speed", _viscous, ("viscous_nms",), {}, 0),
    Term(
        "asymmetric_friction",
        "direction",
        _asymmetric,
        BOTH,
        {},
        1,
        refinements={"viscous_difference_nms": ()},
    ),
    Term(
        "stribeck_friction",
        "speed",
        _stribeck,
        ("coulomb_positive_nm", "stribeck_rise_nm", "stribeck_speed_rad_s"),
        {
            "stribeck_speed_rad_s": (1e-6, np.inf),
            "stribeck_rise_nm": (0.0, np.inf),
            "stribeck_exponent": (0.3, 6.0),
        },
        3,
        tied=BOTH,
        refinements={"stribeck_exponent": (1.0, 3.0)},
    ),
    Term("quadratic_drag", "speed", _drag, ("drag_nms2",), {}, 1),
    Term(
        "friction_drift",
        "run",
        _drift,
        ("drift_nm",),
        {"drift_settling": (-12.0, 25.0)},
        1,
        refinements={"drift_settling": (3.0, -3.0)},
    ),
    Term(
        "local_friction",
        "position",
        _local,
        ("local_friction_nm", "local_centre_rad", "local_width_rad"),
        {
            "local_width_rad": (1e-3, 2 * np.pi),
            "local_friction_nm": (0.0, np.inf),
            "local_sharpness": SHARPNESS,
        },
        3,
        refinements={"local_sharpness": (0.3, 2.0)},
        scanned=True,
    ),
)
