"""What acts on the load or disturbs the motor, and the load's inertia."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from scipy.interpolate import CubicSpline

from schwung.explain.residual import FINEST, TABLE_POINTS, Moving
from schwung.explain.terms.term import SHARPNESS, Start, Term, View, polar
from schwung.motion import Array

#: The load torque that no sine describes, by its points; published as "load_torque".
LOAD_TABLE = "load_torque_table"
TABLE_FIELDS = tuple(f"load_table_{point}" for point in range(FINEST))
_COARSE = TABLE_FIELDS[:TABLE_POINTS]
#: Orders of cogging that are looked for, per turn of the motor.
_HIGHEST_ORDER = 120.0


def _gravity(_view: View) -> list[Start]:
    sine = {"load_amplitude_nm": 1.0}
    cosine = {"load_amplitude_nm": 1.0, "load_phase_rad": np.pi / 2}
    return [Start({}, (sine, cosine), polar("load_amplitude_nm", "load_phase_rad"))]


def _table(view: View) -> list[Start]:
    """A load torque of any shape: cubic cardinal splines through points over the visited angles."""
    points = view.residuals.table_rad(TABLE_POINTS)
    splines = CubicSpline(points, np.eye(points.size))

    def torques(run: Moving) -> Array:
        return np.asarray(splines(np.clip(run.position_rad, points[0], points[-1])).T)

    def decode(coefficients: Sequence[float]) -> dict[str, float]:
        return dict(zip(_COARSE, coefficients, strict=True))

    return [Start({}, tuple({field: 1.0} for field in _COARSE), decode, torques=torques)]


def _offset(_view: View) -> list[Start]:
    return [Start({}, ({"offset_nm": 1.0},))]


def _event(view: View) -> list[Start]:
    time = view.gathered("motion_time_s")
    low, high = float(time.min()), float(time.max())
    return [
        _pulse(float(begin), float(duration))
        for duration in np.array([0.03, 0.06, 0.12, 0.25]) * (high - low)
        for begin in np.arange(low - duration / 2, high, duration / 4)
    ]


def _pulse(begin: float, duration: float) -> Start:
    def torques(run: Moving) -> Array:
        share = np.clip((run.motion_time_s - begin) / duration, 0.0, 1.0)
        return np.asarray(0.5 - 0.5 * np.cos(2 * np.pi * share))[None]

    shape = {"event_time_s": begin, "event_duration_s": duration}
    return Start(shape, ({"event_peak_nm": 1.0},), torques=torques)


def _cogging(view: View) -> list[Start]:
    span = float(np.ptp(view.gathered("position_rad")))
    passing = 2 * np.pi * view.residuals.prepared.band_hz / max(0.5 * view.peak_speed_rad_s, 1e-9)
    highest = min(_HIGHEST_ORDER, passing)
    orders = np.arange(max(2.0, 2.5 * np.pi / max(span, 1e-9)), max(highest, 3.0), max(1.2 / span, 0.02))
    return [_ripple(float(order)) for order in orders]


def _ripple(order: float) -> Start:
    def torques(run: Moving) -> Array:
        gain = 1 / (1 + (order * np.abs(run.speed_rad_s) / (2 * np.pi * run.band_hz)) ** 8)
        return np.asarray(
            gain * np.stack([np.sin(order * run.position_rad), np.cos(order * run.position_rad)])
        )

    sine = {"cogging_amplitude_nm": 1.0}
    cosine = {"cogging_amplitude_nm": 1.0, "cogging_phase_rad": np.pi / 2}
    decode = polar("cogging_amplitude_nm", "cogging_phase_rad")
    return Start({"cogging_order": order}, (sine, cosine), decode, torques=torques)


def _inertia(view: View) -> list[Start]:
    unit = 0.01 * view.mean_inertia_kgm2
    more, scale = {"inertia_delta_kgm2": unit}, {"inertia_scale": 0.01}
    starts = [Start({}, (more,))]
    table = view.machine.load.inertia_table
    if table is not None and np.ptp(table.inertia_kgm2) > 0.02 * view.mean_inertia_kgm2:
        starts += [Start({}, (scale,)), Start({}, (more, scale))]
    return starts


def _shift(view: View) -> list[Start]:
    table = view.machine.load.inertia_table
    if table is None or np.ptp(table.inertia_kgm2) < 0.02 * view.mean_inertia_kgm2:
        return []
    return [Start({}, ({"inertia_shift_rad": shift},)) for shift in (0.02, 0.1, -0.1, 0.3, -0.3)]


LOAD = (
    Term(LOAD_TABLE, "position", _table, _COARSE, {}, 4),
    Term("torque_offset", "direction", _offset, ("offset_nm",), {}, 0),
    Term(
        "load_inertia",
        "acceleration",
        _inertia,
        ("inertia_delta_kgm2", "inertia_scale"),
        {"inertia_scale": (0.02, 50.0)},
        1,
    ),
    Term("inertia_profile_shift", "position", _shift, ("inertia_shift_rad",), {}, 1),
    Term("load_torque", "position", _gravity, ("load_amplitude_nm", "load_phase_rad"), {}, 2),
    Term(
        "cogging",
        "position",
        _cogging,
        ("cogging_order", "cogging_amplitude_nm", "cogging_phase_rad"),
        {"cogging_order": (0.5, 1e4)},
        3,
        scanned=True,
    ),
    Term(
        "load_event",
        "time_in_motion",
        _event,
        ("event_time_s", "event_duration_s", "event_peak_nm"),
        {"event_duration_s": (1e-3, np.inf), "event_sharpness": SHARPNESS},
        3,
        refinements={"event_sharpness": (0.3, 2.0)},
        scanned=True,
    ),
)
