"""The peer: PySINDy on the same residual, in a process of its own: `python benchmarks/explain_peer.py SESSION MACHINE`.

Sparse regression (STLSQ) of the torque residual on the functions that an engineer would write down. It names nothing
below the noise floor of the session's repeats; of what it keeps, the largest contribution comes first. Prints JSON:
names and seconds. Needs the extra `peers`; nothing in src imports PySINDy.
"""

from __future__ import annotations

import json
import sys
import time
import warnings
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from schwung.drivetrain.machine import Machine, load_machine
from schwung.explain.residual import Residuals, Unknowns
from schwung.explain.signals import prepare
from schwung.session import read_session

Array = NDArray[np.float64]

#: In units of the noise floor: contributions below are pruned. This and the ridge named most singles right of
#: thresholds 0.5 to 4 and ridges 1e-6 to 0.1 per sample.
_THRESHOLD, _RIDGE = 2.0, 0.1
_STRIBECK_SHARES = (0.06, 0.12, 0.2)
_COGGING_ORDERS = range(6, 49)


def library(machine: Machine, of: dict[str, Array], peak_speed: float) -> dict[str, list[Array]]:
    """Name and functions: each a column over the samples, (n,)."""
    angle, speed, acceleration = of["position"], of["speed"], of["acceleration"]
    jerk, torque = of["jerk"], of["torque"]
    sign = np.sign(speed)
    shift = 0.02
    inertia = machine.load_inertia_at
    functions: dict[str, list[Array]] = {
        "torque_offset": [np.ones_like(angle)],
        "coulomb_friction": [sign],
        "viscous_friction": [speed],
        "quadratic_drag": [speed * np.abs(speed)],
        "stribeck_friction": [
            sign * np.exp(-((speed / (share * peak_speed)) ** 2)) for share in _STRIBECK_SHARES
        ],
        "friction_drift": [sign * of["share"]],
        "load_torque": [np.sin(angle), np.cos(angle)],
        "load_inertia": [acceleration, inertia(angle) * acceleration],
        "torque_constant": [torque],
        "torque_lag": [of["torque_rate"]],
        "measurement_delay": [jerk],
        "encoder_eccentricity": [
            np.cos(angle) * acceleration - np.sin(angle) * speed**2,
            np.sin(angle) * acceleration + np.cos(angle) * speed**2,
        ],
        "coupling_stiffness": [of["snap"]],
        "nonlinear_stiffness": [torque**3],
    }
    change = inertia(angle + shift) - inertia(angle - shift)
    if np.any(change != 0):
        bend = inertia(angle + shift) - 2 * inertia(angle) + inertia(angle - shift)
        functions["inertia_profile_shift"] = [
            change / (2 * shift) * acceleration + 0.5 * bend / shift**2 * speed**2
        ]
    turns = float(np.ptp(angle)) / (2 * np.pi)
    orders = [order for order in _COGGING_ORDERS if order * turns > 2]  # slower ones are load torques
    functions["cogging"] = [f(order * angle) for order in orders for f in (np.sin, np.cos)]
    return functions


def names(session_file: Path, machine_file: Path) -> list[str]:
    """What sparse regression would call the mismatch, the largest contribution first."""
    import pysindy

    machine = load_machine(machine_file)
    prepared = prepare(read_session(session_file), machine)
    residuals = Residuals(prepared, machine)
    aligned = Unknowns(timing_s=-prepared.speed_delay_s)  # drives report torque and speed of one instant
    rows: list[dict[str, Array]] = []
    targets: list[Array] = []
    groups: dict[int, list[Array]] = {}
    for index, run in enumerate(prepared.runs):
        valid, residual = residuals.valid(index), residuals.residual(index, aligned)
        jerk = np.gradient(run.acceleration_rad_s2, run.step_s)
        torque = residuals.runs[index].torque_nm  # reported, within the band
        columns = {
            "position": run.position_rad, "speed": run.speed_rad_s, "acceleration": run.acceleration_rad_s2,
            "jerk": jerk, "snap": np.gradient(jerk, run.step_s), "torque": torque,
            "torque_rate": np.gradient(torque, run.step_s),
            "share": np.full(run.position_rad.size, run.share),
        }  # fmt: skip
        rows.append({key: values[:: prepared.every][valid] for key, values in columns.items()})
        targets.append(residual[valid])
        groups.setdefault(run.group, []).append(np.where(valid, residual, np.nan))
    repeats = [np.nanstd(np.array(same), axis=0, ddof=1) for same in groups.values() if len(same) > 1]
    floor = float(np.sqrt(np.nanmean(np.concatenate(repeats) ** 2))) if repeats else 0.0
    of = {key: np.concatenate([row[key] for row in rows]) for key in rows[0]}
    target = np.concatenate(targets)
    functions = library(machine, of, prepared.peak_speed_rad_s)
    owners = [name for name, columns in functions.items() for _ in columns]
    matrix = np.column_stack([column for columns in functions.values() for column in columns])
    scale = np.sqrt(np.mean(matrix**2, axis=0))
    model = pysindy.SINDy(
        optimizer=pysindy.STLSQ(threshold=_THRESHOLD * floor, alpha=_RIDGE * target.size),
        feature_library=pysindy.IdentityLibrary(),
    )
    model.fit(matrix / scale, t=1.0, x_dot=target[:, np.newaxis])
    weights = np.abs(model.coefficients()[0])
    sizes: dict[str, float] = {}
    for owner, weight in zip(owners, weights, strict=True):
        sizes[owner] = float(np.hypot(sizes.get(owner, 0.0), weight))
    found = sorted((name for name, size in sizes.items() if size > 0), key=lambda name: -sizes[name])
    if found[:2] in (["coulomb_friction", "torque_offset"], ["torque_offset", "coulomb_friction"]):
        found = ["asymmetric_friction", *found[2:]]  # that is what the two together are
    return found


def main() -> None:
    """Command line."""
    warnings.simplefilter("ignore")
    began = time.perf_counter()
    found = names(Path(sys.argv[1]), Path(sys.argv[2]))
    print(json.dumps({"names": found, "seconds": time.perf_counter() - began}))


if __name__ == "__main__":
    main()
