"""The best motion to take away: JSON, setpoints, and cams for the usual controllers.

- motion.json: for Schwung, and whoever reads JSON (docs/files.md)
- setpoints.csv: cyclic position with torque beside it (CiA 402: 607A and 60B2)
- pvt.csv: position, velocity, time; cubics between points that have a speed (CiA 402, interpolated position mode)
- twincat_cam.st: ARRAY OF MC_MotionFunctionPoint with POLYNOM5_MM between them, for MC_WriteMotionFunction
  (Beckhoff, TF5050 NC Camming: MC_MotionFunctionPoint, MC_MotionFunctionType)
- codesys_cam.st: ARRAY OF SMC_CAMXYVA and its MC_CAM_REF with byType 3, for PLCopen's MC_CamTableSelect
  (CODESYS, SM3_Basic: MC_CAM_REF; Lenze, PLC Designer SoftMotion, 5.7.2: SMC_CAMXYVA)
- cam.csv: master and slave position, for editors that import points (Rockwell: CAM structure, segment type 1, cubic)

The master of a cam is the time in ms from the start of the stroke; a cam is the way there.
"""

from __future__ import annotations

import csv
import io
import json
from pathlib import Path
from typing import Any

import numpy as np

from schwung.files import replace_file
from schwung.motion import Array, Motion
from schwung.optimise.rivals.chebyshev import fitted
from schwung.optimise.values import Stroke

#: Degree of the Chebyshev series in motion.json.
CHEBYSHEV_DEGREE = 24
_MS = 1e3


def mean_torque(stroke: Stroke, edges_s: Array) -> Array:
    """The torque that a stroke takes (N·m), as its mean between instants of it (s), (n,) edges, (n−1,) means.

    Before and after the stroke it is what holds the axis there.
    """
    fine = np.linspace(edges_s[:-1], edges_s[1:], 10)
    fine = (fine[1:] + fine[:-1]) / 2
    moving = np.interp(fine, stroke.time_s, stroke.torque_nm)
    resting = np.where(fine < 0, stroke.hold_start_nm, stroke.hold_end_nm)
    inside = (fine >= 0) & (fine <= stroke.duration_s)
    return np.asarray(np.mean(np.where(inside, moving, resting), axis=0))


def cycle_torque(stroke: Stroke, back: Stroke | None, motion: Motion, time_s: Array) -> Array:
    """The torque beside each setpoint of a motion there and back (N·m), (n,): the mean over the cycle that leads to it.

    A drive that takes a setpoint at SYNC reaches it one cycle later, and holds the torque meanwhile.
    """
    edges = np.concatenate([[2 * time_s[0] - time_s[1]], time_s])
    starts = motion.stroke_starts_s
    torque = mean_torque(stroke, edges - starts[0])
    if back is None or len(starts) < 2:
        return torque
    return torque + mean_torque(back, edges - starts[1]) - back.hold_start_nm


def write_all(
    folder: Path, name: str, stroke: Stroke, back: Stroke, rate_hz: float, extra: dict[str, Any]
) -> list[Path]:
    """Write every format into a folder that is there; returns the paths. Raises InputError where it cannot."""
    documents = {
        "motion.json": motion_json(name, stroke, back, extra),
        "setpoints.csv": setpoints_csv(stroke, back, rate_hz),
        "pvt.csv": _csv(
            ("time_s", "position_rad", "speed_rad_s"),
            [(s.time_s, s.start_rad + s.distance_rad * s.share, _speed(s)) for s in (stroke,)],
        ),
        "cam.csv": _csv(
            ("master_ms", "slave_rad"), [(stroke.time_s * _MS, stroke.distance_rad * stroke.share)]
        ),
        "twincat_cam.st": twincat_cam(stroke),
        "codesys_cam.st": codesys_cam(stroke),
    }
    for file, text in documents.items():
        replace_file(folder / file, text)
    return [folder / file for file in documents]


def motion_json(name: str, stroke: Stroke, back: Stroke, extra: dict[str, Any]) -> str:
    """The motion with its torque: `schwung-motion`, version 1."""
    document = {
        "format": "schwung-motion",
        "version": 1,
        "machine": name,
        "start_rad": stroke.start_rad,
        "motion": stroke.motion(back).model_dump(),
        "torque_nm": [float(x) for x in stroke.torque_nm],
        "torque_back_nm": [float(x) for x in back.torque_nm],
        "chebyshev": [float(x) for x in fitted(stroke.share, CHEBYSHEV_DEGREE)],
        **extra,
    }
    return json.dumps(document, indent=1, allow_nan=False) + "\n"


def setpoints_csv(stroke: Stroke, back: Stroke, rate_hz: float) -> str:
    """One row per setpoint of a bus at so many per second, there and back: the torque is the mean of its cycle."""
    motion = stroke.motion(back, start_time_s=0.0, dwell_s=0.0)
    time = motion.time(rate_hz)
    demand = motion.demand(time)
    torque = cycle_torque(stroke, back, motion, time)
    header = ("time_s", "position_rad", "speed_rad_s", "acceleration_rad_s2", "torque_nm")
    position = stroke.start_rad + demand.position_rad
    return _csv(header, [(time, position, demand.speed_rad_s, demand.acceleration_rad_s2, torque)])


def twincat_cam(stroke: Stroke) -> str:
    """A motion function of TwinCAT: polynomials of fifth order between the nodes, which our cubics are."""
    rows = [
        f"    (PointIndex := {i}, FunctionType := MOTIONFUNCTYPE_POLYNOM5_MM, PointType := MOTIONPOINTTYPE_MOTION, "
        f"RelIndexNextPoint := 1, MasterPos := {x:.9g}, SlavePos := {y:.12g}, "
        f"SlaveVelo := {v:.12g}, SlaveAcc := {a:.12g})"
        for i, (x, y, v, a) in enumerate(_cam_rows(stroke), start=1)
    ]
    head = "(* master: ms from the start of the stroke; slave: rad from where the axis stands *)"
    body = ",\n".join(rows)
    return f"{head}\nVAR\n  aPoints : ARRAY[1..{len(rows)}] OF MC_MotionFunctionPoint := [\n{body}\n  ];\nEND_VAR\n"


def codesys_cam(stroke: Stroke) -> str:
    """A cam of CODESYS SoftMotion: points with slave position and its first two derivatives by the master."""
    rows = [
        f"    (dX := {x:.9g}, dY := {y:.12g}, dV := {v:.12g}, dA := {a:.12g})"
        for x, y, v, a in _cam_rows(stroke)
    ]
    end = stroke.duration_s * _MS
    body = ",\n".join(rows)
    return (
        "(* master: ms from the start of the stroke; slave: rad from where the axis stands;\n"
        "   Cam.pce := ADR(aPoints) before MC_CamTableSelect *)\n"
        f"VAR\n  aPoints : ARRAY[0..{len(rows) - 1}] OF SMC_CAMXYVA := [\n{body}\n  ];\n"
        f"  Cam : MC_CAM_REF := (byType := 3, xStart := 0, xEnd := {end:.9g}, nElements := {len(rows)});\nEND_VAR\n"
    )


def _cam_rows(stroke: Stroke) -> list[tuple[float, float, float, float]]:
    """Master (ms), slave (rad), and its derivatives by the master."""
    by_ms = stroke.duration_s * _MS
    columns = (
        stroke.time_s * _MS,
        stroke.distance_rad * stroke.share,
        stroke.distance_rad * stroke.speed_share / by_ms,
        stroke.distance_rad * stroke.acceleration_share / by_ms**2,
    )
    return [tuple(float(x) for x in row) for row in zip(*columns, strict=True)]  # type: ignore[misc]


def _speed(stroke: Stroke) -> Array:
    return stroke.distance_rad * stroke.speed_share / stroke.duration_s


def _csv(header: tuple[str, ...], parts: list[tuple[Array, ...]]) -> str:
    text = io.StringIO()
    writer = csv.writer(text, lineterminator="\n")
    writer.writerow(header)
    for columns in parts:
        writer.writerows([f"{float(x):.12g}" for x in row] for row in zip(*columns, strict=True))
    return text.getvalue()


def read_motion(document: dict[str, Any]) -> Motion:
    """The motion of a motion.json. Raises pydantic's ValidationError for what is none."""
    return Motion.model_validate(document["motion"])
