"""The shaft between motor and load, and what hangs behind the load."""

from __future__ import annotations

import numpy as np

from schwung.explain.terms.term import Start, Term, View, at


def _stiffness(view: View) -> list[Start]:
    k = view.stiffness_nm_rad
    return [at(k, stiffness_nm_rad=k * f) for f in (0.4, 0.6, 0.8, 0.95, 1.05, 1.25, 1.6, 2.5)] if k else []


def _damping(view: View) -> list[Start]:
    b = view.damping_nms
    return [at(b, damping_nms=b * f) for f in (0.1, 0.5, 0.8, 1.25, 2.0, 4.0)] if b else []


def _cubic(view: View) -> list[Start]:
    k, wound = view.stiffness_nm_rad, view.wind_up_rad
    return [at(cubic_nm_rad3=share * k / wound**2) for share in (0.03, 0.2, 1.0, 4.0, -0.03)] if k else []


def _backlash(view: View) -> list[Start]:
    return (
        [at(gap_rad=view.wind_up_rad * f) for f in (0.005, 0.03, 0.1, 0.3, 1.0, 3.0)]
        if view.stiffness_nm_rad
        else []
    )


def _compliance(view: View) -> list[Start]:
    starts = []
    for share in (0.05, 0.2):
        for frequency in (12.0, 20.0, 30.0, 45.0, 65.0, 95.0, 140.0, 200.0):
            for ratio in (0.03, 0.15):
                inertia = share * view.mean_inertia_kgm2
                omega = 2 * np.pi * frequency
                starts.append(
                    at(
                        third_inertia_kgm2=inertia,
                        third_stiffness_nm_rad=inertia * omega**2,
                        third_damping_nms=2 * ratio * inertia * omega,
                    )
                )
    return starts


COUPLING = (
    Term(
        "coupling_stiffness",
        "torque",
        _stiffness,
        ("stiffness_nm_rad",),
        {"stiffness_nm_rad": (1e-3, np.inf)},
        1,
    ),
    Term("coupling_damping", "frequency", _damping, ("damping_nms",), {"damping_nms": (0.0, np.inf)}, 1),
    Term("nonlinear_stiffness", "torque", _cubic, ("cubic_nm_rad3",), {}, 2),
    Term("backlash", "torque", _backlash, ("gap_rad",), {"gap_rad": (0.0, 1.0)}, 2),
    Term(
        "extra_compliance",
        "frequency",
        _compliance,
        ("third_inertia_kgm2", "third_stiffness_nm_rad", "third_damping_nms"),
        {
            "third_inertia_kgm2": (1e-12, np.inf),
            "third_stiffness_nm_rad": (1e-6, np.inf),
            "third_damping_nms": (0.0, np.inf),
        },
        4,
    ),
)
