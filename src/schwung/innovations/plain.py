"""The innermost of the trajectory fit without numba: what the kernels do entry by entry, in whole matrices."""

from __future__ import annotations

import numpy as np

from schwung.innovations.contact import PARTS, SUREST, touching
from schwung.innovations.values import REACH, TERMS, Added, Filtered, Shaft, System
from schwung.motion import Array


def steps_of_each(shaft: Shaft, coupling: Array, inertia: Array, duration: float) -> Array:
    """As `step_kernel.steps_of_each`: all that need as many doublings side by side."""
    rates, inputs, fastest = _rates(shaft, coupling[:, 0], coupling[:, 1], inertia)
    doublings = np.maximum(0, np.ceil(np.log2(np.maximum(fastest * duration / REACH, 1e-9)))).astype(int)
    size = rates.shape[1]
    result = np.empty((inertia.size, size, size + 6))
    for count in np.unique(doublings):
        these = doublings == count
        moved, first, second, third = _exponentials(rates[these], duration, int(count))
        first, second, third = first @ inputs[these], second @ inputs[these], third @ inputs[these]
        start, end = first - second / duration, second / duration
        height = 4.0 * (second - third / duration) / duration
        result[these] = np.concatenate([moved, start, end, height], axis=2)
    return result


def _rates(shaft: Shaft, k: Array, b: Array, inertia: Array) -> tuple[Array, Array, Array]:
    """A (m, s, s) and B (m, s, 2) of dx/dt = Ax + B·torques, and the highest |eigenvalue| or more (m,)."""
    rates, inputs, fastest = _shaft_rates(shaft, k, b, inertia)
    mass, size = shaft.further, rates.shape[1]
    if mass.rate <= 0:
        return rates, inputs, fastest
    moved = inertia + shaft.rotor_inertia if shaft.rigid else inertia
    load, ahead, back = (
        size - 3,
        slice(size - 2, size),
        np.array([mass.rate**2, 2 * mass.ratio * mass.rate]),
    )
    rates[:, size - 2, size - 1] = 1.0
    rates[:, load, ahead] = -mass.inertia * back / moved[:, None]
    rates[:, size - 1] = rates[:, load]
    rates[:, size - 1, ahead] -= back
    inputs[:, size - 1] = inputs[:, load]
    against = 1 + max(mass.inertia, 0.0) / moved
    return rates, inputs, fastest + mass.rate * np.sqrt(against) + back[1] * against


def _shaft_rates(shaft: Shaft, k: Array, b: Array, inertia: Array) -> tuple[Array, Array, Array]:
    """The same of motor, coupling and load; of what is behind that, zeros."""
    size, rotor = shaft.states, shaft.rotor_inertia
    rates, inputs = np.zeros((inertia.size, size, size)), np.zeros((inertia.size, size, 2))
    rates[:, 0, 1] = 1.0
    if shaft.rigid:
        total = rotor + inertia
        fastest = (shaft.motor_friction + shaft.load_friction) / total
        rates[:, 1, 1] = -fastest
        inputs[:, 1, :] = (1.0 / total)[:, None]
        return rates, inputs, fastest
    rates[:, 1, 1], rates[:, 1, 2], rates[:, 1, 3] = (
        -(b + shaft.motor_friction) / rotor,
        -k / rotor,
        b / rotor,
    )
    rates[:, 2, 1], rates[:, 2, 3] = 1.0, -1.0
    rates[:, 3, 1], rates[:, 3, 2] = b / inertia, k / inertia
    rates[:, 3, 3] = -(b + shaft.load_friction) / inertia
    inputs[:, 1, 0], inputs[:, 3, 1] = 1.0 / rotor, 1.0 / inertia
    mobility = 1.0 / rotor + 1.0 / inertia
    fastest = np.maximum(np.sqrt(k * mobility), b * mobility)
    return rates, inputs, fastest + shaft.motor_friction / rotor + shaft.load_friction / inertia


def _exponentials(rates: Array, duration: float, doublings: int) -> tuple[Array, Array, Array, Array]:
    """e^{Ah} and ∫e^{A(h−t)} tⁱ dt, i = 0, 1, 2, (m, s, s) each, over h = `duration`."""
    h = duration / 2**doublings
    moved = np.broadcast_to(np.eye(rates.shape[1]), rates.shape).copy()
    term = moved.copy()
    first, second, third = np.zeros_like(rates), np.zeros_like(rates), np.zeros_like(rates)
    for i in range(TERMS):  # term = (Ah)^i / i!
        first += term * (h / (i + 1))
        second += term * (h * h / ((i + 1) * (i + 2)))
        third += term * (2.0 * h * h * h / ((i + 1) * (i + 2) * (i + 3)))
        term = term @ rates * (h / (i + 1))
        moved += term
    for _ in range(doublings):
        third = moved @ third + third + 2.0 * h * second + h * h * first
        second = moved @ second + second + h * first
        first = moved @ first + first
        moved = moved @ moved
        h *= 2.0
    return moved, first, second, third


def filtered(system: System) -> Filtered:
    """As `kalman.filtered`. The state stands beside its covariance, as one more column: both move and learn alike."""
    count, size = system.measured.shape[0], system.first.size
    errors, spreads, gains = np.empty((count, 2)), np.empty((count, 2)), np.empty((count, 2, size))
    both = np.empty((count, size, size + 1))
    across = np.zeros((count - 1, size + 1, size + 1))
    across[:, :size, :size] = np.swapaxes(system.transition, 1, 2)
    across[:, size, size] = 1.0
    added = np.empty((count - 1, size, size + 1))
    added[:, :, :size] = system.noise[:, :, None] * (system.noise * system.power[:, None])[:, None, :]
    on_motor = [system.transition[:, :-1, size - 1], system.noise[:, :-1]]
    on_load = [system.on_load[:, end, :-1] for end in range(2)]
    along = [on_motor[0] + on_motor[1]]
    for apart, each in zip(system.apart.T, (on_motor, on_load, along), strict=True):
        for ends in each:
            added[:, :-1, : size - 1] += ends[:, :, None] * (ends * apart[:, None])[:, None, :]
    added[:, :, :size] += system.open_contact[:, :, None] * system.open_contact[:, None, :]
    added[:, :, size] = system.forcing
    measured, variances = system.measured.tolist(), system.variances.tolist()
    here = np.column_stack([np.diag(system.spread**2), system.first])
    covariance = here[:, :size]
    for k in range(count):
        if k > 0:
            here = system.transition[k - 1] @ here @ across[k - 1] + added[k - 1]
            covariance = here[:, :size]
            covariance[:] = (covariance + covariance.T) / 2
        for m in range(2):
            row = here[m].copy()
            row[size] -= measured[k][m]
            spread = max(row[m], 0.0) + variances[k][m]
            gain = gains[k, m] = row[:size] / spread
            here -= gain[:, None] * row
            here[m, m] = max(gain[m] * variances[k][m], 1e-300)  # Joseph's form, cheaply, as there
            errors[k, m], spreads[k, m] = -row[size], spread
        both[k] = here
    return Filtered(errors, spreads, gains, both[:, :, size].copy(), both[:, :, :size].copy())


def deviance(system: System) -> tuple[float, float]:
    """As `kalman.deviance`."""
    result = filtered(system)
    return float(np.sum(np.log(result.variance))), float(np.sum(result.error**2 / result.variance))


def through(
    system: System,
    pressed: Array,
    free: Array,
    torques: Array,
    coupling: Array,
    driven: Array,
    gap: float,
    middle: float,
    inputs: Array,
    contact: Array,
) -> None:
    """As `play._through`."""
    x, p = system.first.copy(), np.diag(system.spread**2)
    _updated(system, 0, x, p)
    share = np.arange(PARTS + 1)[:, None] / PARTS
    parabola = 4 * share * (1 - share)
    for k in range(system.measured.shape[0] - 1):
        drifting, turned = p[2, 1] - p[2, 3], p[1, 1] + p[3, 3] - 2 * p[1, 3]
        acting = torques[k, :2] * (1 - share) + torques[k, 2:4] * share + torques[k, 4:] * parabola
        phi, onto, push, opened = np.eye(4), np.zeros((4, 4)), np.zeros(4), np.zeros(4)
        ratio = coupling[k, 1] / coupling[k, 0]
        beside = driven[k] * (1 - share[:-1] - 0.5 / PARTS) + driven[k + 1] * (share[:-1] + 0.5 / PARTS)
        for part in range(PARTS):
            here = phi @ x[:4] + push - onto[:, 0] * x[4]
            further, faster = beside[part]
            turning = here[1] - here[3] + faster
            since, moves, lifts = (2 * part + 1) * middle, 2 * turning * middle, ratio * turning
            begins = here[2] + further - faster * middle
            up, down = begins + min(lifts, 0.0), begins + max(lifts, 0.0)
            variance = max(p[2, 2] + 2 * since * drifting + since * since * turned, 0.0)
            spread = max(float(np.sqrt(variance)), SUREST * gap)
            one, missing, open_one = touching(up, up + moves, gap / 2, spread)
            other, misses, open_other = touching(-down, -down - moves, gap / 2, spread)
            contact[k] += np.array([one + other, one - other, missing - misses]) / PARTS
            step = free[k] + (one + other) * (pressed[k] - free[k])
            pushed = (one + other) * (coupling[k, 0] * further + coupling[k, 1] * faster)
            lacks = (coupling[k, 0] * (missing - misses) - pushed) * np.array([1.0, -1.0])
            early, late = share[part, 0], share[part + 1, 0]
            push = step[:, :4] @ push + step[:, 4:6] @ (acting[part] + lacks)
            push += step[:, 6:8] @ (acting[part + 1] + lacks) + step[:, 8:] @ torques[k, 4:] / PARTS**2
            unknown = coupling[k, 0] * np.sqrt(open_one**2 + open_other**2)
            opened = step[:, :4] @ opened + unknown * (step[:, 4:8] @ [-1.0, 1.0, -1.0, 1.0])
            within = [
                step[:, 4:6] * (1 - early) + step[:, 6:8] * (1 - late),
                step[:, 4:6] * early + step[:, 6:8] * late,
            ]
            onto, phi = step[:, :4] @ onto + np.hstack(within), step[:, :4] @ phi
        system.forcing[k, :4], system.transition[k, :4, :4], inputs[k, :, :4] = push, phi, onto
        system.transition[k, :4, 4], system.noise[k, :4] = -onto[:, 0], -onto[:, 2]
        system.open_contact[k, :4] = opened
        system.on_load[k, :, :4] = onto[:, 1::2].T
        x, p = _carried(system, k, x, p)
        _updated(system, k + 1, x, p)


def _carried(system: System, k: int, x: Array, p: Array) -> tuple[Array, Array]:
    """As `kalman.carried`."""
    phi, noise = system.transition[k], system.noise[k]
    last = np.append(phi[:-1, -1], 0.0)
    torque = np.append(noise[:-1], 0.0)
    added = system.power[k] * np.outer(noise, noise)
    added += system.apart[k, 0] * (np.outer(last, last) + np.outer(torque, torque))
    added += system.apart[k, 1] * (system.on_load[k].T @ system.on_load[k])
    added += system.apart[k, 2] * np.outer(last + torque, last + torque)
    added += np.outer(system.open_contact[k], system.open_contact[k])
    return phi @ x + system.forcing[k], phi @ p @ phi.T + added


def _updated(system: System, k: int, x: Array, p: Array) -> None:
    """As `kalman.updated`, in place."""
    for m in range(2):
        gain = p[:, m] / (max(p[m, m], 0.0) + system.variances[k, m])
        x += gain * (system.measured[k, m] - x[m])
        p -= np.outer(gain, p[m])
        p[:] = (p + p.T) / 2
        p[m, m] = max(gain[m] * system.variances[k, m], 1e-300)


def smoothed(transition: Array, result: Filtered) -> Array:
    """As `kernel.smoothed`."""
    count, size = result.state.shape
    states, adjoint = np.empty((count, size)), np.zeros(size)
    for k in range(count - 1, -1, -1):
        states[k] = result.state[k] - result.covariance[k] @ adjoint
        for m in range(1, -1, -1):
            adjoint[m] -= float(result.gain[k, m] @ adjoint) + result.error[k, m] / result.variance[k, m]
        if k > 0:
            adjoint = transition[k - 1].T @ adjoint
    return states


def adjoints(transition: Array, result: Filtered) -> Array:
    """As `kernel.adjoints`."""
    count, size = result.state.shape
    found = np.zeros((count, size))
    for k in range(count - 1, -1, -1):
        if k < count - 1:
            found[k] = transition[k].T @ found[k + 1]
        for m in range(1, -1, -1):
            found[k, m] -= float(result.gain[k, m] @ found[k]) + result.error[k, m] / result.variance[k, m]
    return found


def whitened(transition: Array, result: Filtered, added: Added) -> Array:
    """As `kernel.whitened`."""
    count, size = result.state.shape
    steps, curves = added.start.shape[1], added.torque.shape[1]
    number = curves + added.others.shape[2]
    rows, columns = np.zeros((count, 2, number)), np.zeros((count - 1, size, number))
    columns[:, :steps, :curves] = added.start[:, :, None] * added.torque[:-1, None, :]
    columns[:, :steps, :curves] += added.end[:, :, None] * added.torque[1:, None, :]
    columns[:, :steps, : added.share.shape[1]] += added.inertia[:, :, None] * added.share[:, None, :]
    columns[:, :steps, curves:] = added.others
    rows[:, :, curves:] = added.reported
    x = np.zeros((size, number))
    for k in range(count):
        if k > 0:
            x = transition[k - 1] @ x + columns[k - 1]
        for m in range(2):
            rows[k, m] += x[m]
            x -= result.gain[k, m][:, None] * rows[k, m]
    rows /= np.sqrt(result.variance)[:, :, None]
    return rows.reshape(2 * count, -1)


def cholesky(matrix: Array) -> Array:
    """As `kernel.cholesky`."""
    try:
        return np.asarray(np.linalg.cholesky(matrix))
    except np.linalg.LinAlgError:
        return np.full_like(matrix, np.nan)


def spline_rows(low: float, step: float, pieces: int, places: Array) -> tuple[Array, Array]:
    """As `spline_kernel.spline_rows`."""
    whole = (places - low) / step
    at = np.clip(whole, 0.0, pieces)
    piece = np.minimum(at.astype(int), pieces - 1)
    u = at - piece
    v = 1 - u
    values = (v**3 / 6, 2 / 3 - u**2 + u**3 / 2, 2 / 3 - v**2 + v**3 / 2, u**3 / 6)
    slopes = (-(v**2) / 2, -2 * u + 1.5 * u**2, 2 * v - 1.5 * v**2, u**2 / 2)
    value, slope = np.zeros((places.size, pieces + 3)), np.zeros((places.size, pieces + 3))
    line = np.arange(places.size)
    for i in range(4):
        value[line, piece + i] = values[i]
        slope[line, piece + i] = slopes[i] / step
    outside = np.flatnonzero(whole != at)
    value[outside] += ((whole - at) * step)[outside, None] * slope[outside]
    return value, slope
