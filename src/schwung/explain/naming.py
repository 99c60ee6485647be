"""From a fitted model to what people read: findings with units and intervals, the learned machine, overlays."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from scipy.interpolate import CubicSpline

from schwung.drivetrain.effects import PHYSICS
from schwung.drivetrain.machine import Machine
from schwung.drivetrain.physics_term import PhysicsTerm
from schwung.explain.fit import PERIODIC, Fitted, Model, without
from schwung.explain.intervals import alternatives, interval, parameters
from schwung.explain.kept_aside import Split
from schwung.explain.location import interval_of, unit_of
from schwung.explain.proof import remainder
from schwung.explain.residual import Residuals
from schwung.explain.search import Found
from schwung.explain.signals import Prepared
from schwung.explain.terms import LIBRARY, LOAD_TABLE, published
from schwung.explain.timing import Shift
from schwung.explain.values import Coordinate, Finding, Located, Overlay, Quantity
from schwung.explain.words import unit_on
from schwung.motion import Array
from schwung.session.model import Axis

_OVERLAYS = 4
_FINER = (
    3  # published pieces of a load torque per piece of its spline: whoever reads it may draw straight lines
)
#: Angles of these keys repeat every turn.
_PHASES = ("load_phase_rad", "cogging_phase_rad", "eccentricity_phase_rad", "local_centre_rad")


def finding(
    axis: Axis, found: Found, fitted: Fitted, term: str, share: float, p_value: float, runs: tuple[int, ...]
) -> Finding:
    """One term of the model as a finding."""
    quantities = _quantities(axis, found, fitted, term)
    others = alternatives(found, fitted, term)
    where = _where(axis, found.problem.residuals, fitted.model, term, runs, share, p_value)
    main = next(iter(quantities))
    value = quantities[main].value
    told = (
        f"{value:.4g} {quantities[main].unit}".strip() if isinstance(value, float) else "a shape of its own"
    )
    return Finding(
        physics=published(term),
        parameters=quantities,
        where=where,
        indistinguishable_from=others,
        evidence={"share_of_energy": share, "p_value": p_value},
        text=f"{published(term).replace('_', ' ')} of {told} was left out",
    )


def _quantities(axis: Axis, found: Found, fitted: Fitted, term: str) -> dict[str, Quantity]:
    """Parameters by the file contract's keys."""
    model = fitted.told
    if term == LOAD_TABLE:
        points = found.problem.residuals.table_rad(len(model.unknowns.load_table_nm))
        angles = np.linspace(points[0], points[-1], _FINER * (points.size - 1) + 1)
        torque = CubicSpline(points, model.unknowns.load_table_nm)(angles)
        pairs = zip(angles.tolist(), torque.tolist(), strict=True)
        return {"table": Quantity(tuple(pairs), unit_on("N·m", axis), None)}
    refined = () if term == PERIODIC else (f for f in LIBRARY[term].refinements if f in model.refined)
    free = (name for name in (*parameters(term), *refined) if name not in model.fixed)
    ends = {name: interval(found, fitted, name) for name in free}
    if term == PERIODIC:
        amplitude, spread = _periodic_amplitude(found, model)
        return {
            "frequency_hz": Quantity(model.frequency_hz, "Hz", ends["periodic_frequency_hz"]),
            "amplitude_nm": Quantity(
                amplitude, unit_on("N·m", axis), (amplitude - 1.96 * spread, amplitude + 1.96 * spread)
            ),
        }
    result = {}
    for name, key in PHYSICS[term].items():
        field = "coulomb_positive_nm" if key.field == "coulomb" else key.field
        if field not in ends:
            continue
        value, (low, high) = model.value(field), ends[field]
        if name == "breakaway_torque_nm":
            level = model.value("coulomb_positive_nm")
            value, low, high = value + level, low + level, high + level
        if field in _PHASES:
            value, low, high = _within_turn(value, low, high)
        unit = key.unit if name == "phase_rad" else unit_on(key.unit, axis)
        result[name] = Quantity(value, unit, (max(low, key.lowest), min(high, key.highest)))
    return result


def _within_turn(value: float, low: float, high: float) -> tuple[float, float, float]:
    turn = 2 * np.pi * np.round(value / (2 * np.pi))
    return float(value - turn), float(low - turn), float(high - turn)


def _periodic_amplitude(found: Found, model: Model) -> tuple[float, float]:
    """Mean amplitude over the runs, and its standard deviation."""
    problem = found.problem
    bare = replace(model, terms=tuple(t for t in model.terms if t != PERIODIC))
    amplitudes, variances = [], []
    for run in problem.runs:
        white = problem.whitener.white(
            problem.residuals.residual(run, bare.unknowns), problem.residuals.valid(run)
        )
        waves = problem.waves(run, np.array([model.frequency_hz]))[:, 0].T
        inverse = np.linalg.pinv(waves.T @ waves)
        amplitudes.append(float(np.hypot(*(inverse @ (waves.T @ white)))))
        variances.append(float(np.trace(inverse)) / 2 * found.level)
    weights = 1 / np.maximum(variances, 1e-300)
    return float(np.average(amplitudes, weights=weights)), float(1 / np.sqrt(np.sum(weights)))


def contribution(residuals: Residuals, run: int, model: Model, term: str) -> Array:
    """What one term takes off the residual in a run (N·m) on the compared grid, (n,)."""
    return remainder(residuals, run, without(model, term)) - remainder(residuals, run, model)


def _where(
    axis: Axis,
    residuals: Residuals,
    model: Model,
    term: str,
    runs: tuple[int, ...],
    share: float,
    p_value: float,
) -> Located:
    coordinate: Coordinate = "frequency" if term == PERIODIC else LIBRARY[term].coordinate
    effects = model.effects
    if term == PERIODIC:
        width = 0.5 / float(np.ptp(residuals.runs[runs[0]].signals.time_s))
        ends = (model.frequency_hz - width, model.frequency_hz + width)
    elif term == "local_friction":
        centre, _, _ = _within_turn(effects.local_centre_rad, 0, 0)
        ends = (centre - effects.local_width_rad / 2, centre + effects.local_width_rad / 2)
    elif term == "load_event":
        ends = (effects.event_time_s, effects.event_time_s + effects.event_duration_s)
    elif coordinate == "frequency":
        ends = (0.0, residuals.prepared.band_hz)
    elif coordinate == "run":
        ends = (0.0, float(len(residuals.runs) - 1))
    else:
        values = np.concatenate(
            [_coordinate(residuals, run, coordinate)[residuals.valid(run)] for run in runs]
        )
        ends = (float(values.min()), float(values.max()))
        if term == "torque_saturation":
            ends = _clipped(residuals, runs, effects.torque_limit_nm / effects.torque_gain)
        elif term == "backlash":
            parts = [contribution(residuals, run, model, term)[residuals.valid(run)] for run in runs]
            ends = interval_of(values, np.concatenate(parts))
    unit = unit_of(coordinate, axis)
    text = f"{100 * share:.0f} % of what the belief misses, over {coordinate.replace('_', ' ')}"
    return Located(coordinate, (float(ends[0]), float(ends[1])), unit, share, p_value, text)


def _clipped(residuals: Residuals, runs: tuple[int, ...], limit_nm: float) -> tuple[float, float]:
    """The reported torques beyond a limit, on the side that goes further."""
    highest = max(float(residuals.runs[run].torque_nm.max()) for run in runs)
    lowest = min(float(residuals.runs[run].torque_nm.min()) for run in runs)
    if highest >= -lowest:
        return limit_nm, max(highest, limit_nm)
    return min(lowest, -limit_nm), -limit_nm


def _coordinate(residuals: Residuals, run: int, coordinate: Coordinate) -> Array:
    signals, every = residuals.runs[run].signals, residuals.prepared.every
    values = {
        "position": signals.position_rad,
        "speed": signals.speed_rad_s,
        "direction": np.sign(signals.speed_rad_s),
        "acceleration": signals.acceleration_rad_s2,
        "torque": signals.torque_nm,
        "time_in_motion": signals.motion_time_s,
        "run": np.full(signals.time_s.size, float(run)),
    }[coordinate]
    return np.asarray(values[::every])


def late(
    axis: Axis, prepared: Prepared, moved: Shift, residuals: Residuals, runs: tuple[int, ...]
) -> Finding:
    """A finding that the time shifts between the channels show."""
    key = "delay_s" if moved.name == "measurement_delay" else "time_constant_s"
    band = 1.96 * moved.std_s
    assert moved.name is not None
    coordinate: Coordinate = "acceleration" if moved.name == "measurement_delay" else "frequency"
    if coordinate == "frequency":
        ends = (0.0, prepared.band_hz)
    else:
        values = np.concatenate(
            [_coordinate(residuals, run, coordinate)[residuals.valid(run)] for run in runs]
        )
        ends = (float(values.min()), float(values.max()))
    other = "torque_lag" if moved.name == "measurement_delay" else "measurement_delay"
    what = "the reported speed is late by" if key == "delay_s" else "the torque acts later than reported, by"
    text = f"{what} {1e3 * moved.seconds:.3g} ms"
    return Finding(
        physics=moved.name,
        parameters={key: Quantity(moved.seconds, "s", (moved.seconds - band, moved.seconds + band))},
        where=Located(coordinate, ends, unit_of(coordinate, axis), 1.0, 0.0, text),
        indistinguishable_from=(other,) if moved.doubtful else (),
        evidence={"deviations": moved.seconds / max(moved.std_s, 1e-12)},
        text=text,
    )


def learned(machine: Machine, findings: tuple[Finding, ...]) -> Machine:
    """The belief with what was found, ready to be simulated."""
    terms = [
        PhysicsTerm(
            name=found.physics,
            **{key: _plain(q) for key, q in found.parameters.items()},
        )
        for found in findings
    ]
    return machine.model_copy(update={"physics": (*machine.physics, *terms)})


def _plain(quantity: Quantity) -> float | list[list[float]]:
    return quantity.value if isinstance(quantity.value, float) else [list(pair) for pair in quantity.value]


def overlays(residuals: Residuals, parts: Split, bare: Model, model: Model) -> tuple[Overlay, ...]:
    """A few runs for pictures: one that was kept aside first, then those in which a named term shows the most."""
    runs = [*parts.heldout, *parts.train]
    shown = runs[:1]
    for term in model.terms:
        sizes = {run: float(np.sum(contribution(residuals, run, model, term) ** 2)) for run in runs}
        shown.append(max(sizes, key=lambda run: sizes[run]))
    chosen = list(dict.fromkeys([*shown, *parts.heldout[:2], *parts.train]))[:_OVERLAYS]
    return tuple(_overlay(residuals, run, run in parts.heldout, bare, model) for run in chosen)


def _overlay(residuals: Residuals, run: int, heldout: bool, bare: Model, model: Model) -> Overlay:
    signals, at = residuals.runs[run].signals, slice(None, None, residuals.prepared.every)
    torque = residuals.runs[run].torque_nm[at]
    return Overlay(
        run=run,
        heldout=heldout,
        time_s=signals.time_s[at],
        position_rad=signals.position_rad[at],
        speed_rad_s=signals.speed_rad_s[at],
        acceleration_rad_s2=signals.acceleration_rad_s2[at],
        torque_nm=torque,
        before_nm=torque - remainder(residuals, run, bare),
        after_nm=torque - remainder(residuals, run, model),
        terms_nm={published(term): contribution(residuals, run, model, term) for term in model.terms},
        considered=residuals.valid(run),
        motion_time_s=signals.motion_time_s[at],
    )
