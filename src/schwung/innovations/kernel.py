"""The compiled inside of the trajectory fit: what follows Kalman's filter."""

from __future__ import annotations

import numpy as np

from schwung.compiled import compiled, compiled_fastmath, compiled_or
from schwung.innovations import plain
from schwung.innovations.statistics import Columns
from schwung.innovations.values import Added, Filtered
from schwung.motion import Array

#: Samples whose rows are turned at once, from one after another to one column after another.
TILE = 32


@compiled_or(plain.smoothed)
def smoothed(transition: Array, result: Filtered) -> Array:
    """States given all samples, (n, s): Bryson and Frazier's form, which inverts no covariance."""
    count, size = result.state.shape
    states = np.empty((count, size))
    adjoint, before = np.zeros(size), np.empty(size)
    for k in range(count - 1, -1, -1):
        for i in range(size):
            states[k, i] = result.state[k, i]
            for j in range(size):
                states[k, i] -= result.covariance[k, i, j] * adjoint[j]
        for m in range(1, -1, -1):
            onto = 0.0
            for i in range(size):
                onto += result.gain[k, m, i] * adjoint[i]
            adjoint[m] -= onto + result.error[k, m] / result.variance[k, m]
        if k > 0:
            before[:] = 0.0
            for j in range(size):
                for i in range(size):
                    before[i] += transition[k - 1, j, i] * adjoint[j]
            adjoint, before = before, adjoint
    return states


@compiled_or(plain.adjoints)
def adjoints(transition: Array, result: Filtered) -> Array:
    """What all samples from each on say of the state that is foreseen there, (n, s): what adds v to a step is
    −variance·v·adjoint of the sample after it."""
    count, size = result.state.shape
    found = np.zeros((count, size))
    for k in range(count - 1, -1, -1):
        if k < count - 1:
            for j in range(size):
                for i in range(size):
                    found[k, i] += transition[k, j, i] * found[k + 1, j]
        for m in range(1, -1, -1):
            onto = 0.0
            for i in range(size):
                onto += result.gain[k, m, i] * found[k, i]
            found[k, m] -= onto + result.error[k, m] / result.variance[k, m]
    return found


@compiled_fastmath
def _one_step_on(x: Array, ahead: Array, phi: Array, added: Added, k: int) -> None:
    """`ahead` becomes Φ x and what the parameters add to step k, (s, c + p)."""
    steps, curves = (
        added.start.shape[1],
        added.torque.shape[1],
    )  # the torque's error, a state too, is none of theirs
    for i in range(x.shape[0]):
        ahead[i, :] = 0.0
        for j in range(x.shape[0]):
            factor = phi[i, j]
            for c in range(x.shape[1]):
                ahead[i, c] += factor * x[j, c]
    for c in range(curves):
        here, there = added.torque[k, c], added.torque[k + 1, c]
        if here != 0.0 or there != 0.0:
            for i in range(steps):
                ahead[i, c] += added.start[k, i] * here + added.end[k, i] * there
    for c in range(added.share.shape[1]):
        factor = added.share[k, c]
        if factor != 0.0:
            for i in range(steps):
                ahead[i, c] += added.inertia[k, i] * factor
    for i in range(steps):
        for c in range(added.others.shape[2]):
            ahead[i, curves + c] += added.others[k, i, c]


@compiled_or(plain.whitened, fastmath=True)
def whitened(transition: Array, result: Filtered, added: Added) -> Array:
    """∂(predicted samples)/∂parameters as the filter sees them, over the innovations' deviation; (2n, c + p)."""
    count, size = result.state.shape
    curves = added.torque.shape[1]
    number = curves + added.others.shape[2]
    rows = np.empty((2 * count, number))
    x, ahead, seen = np.zeros((size, number)), np.zeros((size, number)), np.empty(number)
    for k in range(count):
        if k > 0:
            _one_step_on(x, ahead, transition[k - 1], added, k - 1)
            x, ahead = ahead, x
        for m in range(2):
            weight = 1.0 / np.sqrt(result.variance[k, m])
            for c in range(number):
                seen[c] = x[m, c]
            for c in range(number - curves):
                seen[curves + c] += added.reported[k, m, c]
            for c in range(number):
                rows[2 * k + m, c] = weight * seen[c]
            for i in range(size):
                factor = result.gain[k, m, i]
                for c in range(number):
                    x[i, c] -= factor * seen[c]
    return rows


@compiled
def closed_loop(transition: Array, result: Filtered, inputs: Array) -> Array:
    """What `responses` needs of each sample, side by side, (n, 44); fewer than four states are filled up with zeros.

    Of the step after the sample: Φ (16), Φ·gain of angle and of speed (8), what torques at its two ends do on motor and
    load (16); and what the angle's update does to the speed, and the weights of both innovations. The last state is the
    torque's white error: it is forgotten from step to step and acts through the gains alone. `inputs`: see `Steps`.
    """
    count, size = result.state.shape
    packed = np.zeros((count, 44))
    for k in range(count):
        packed[k, 40] = result.gain[k, 0, 1]
        packed[k, 41], packed[k, 42] = (
            1.0 / np.sqrt(result.variance[k, 0]),
            1.0 / np.sqrt(result.variance[k, 1]),
        )
        if k == count - 1:
            break
        for i in range(size - 1):
            for j in range(size):
                if j < size - 1:
                    packed[k, 4 * i + j] = transition[k, i, j]
                packed[k, 16 + i] += transition[k, i, j] * result.gain[k, 0, j]
                packed[k, 20 + i] += transition[k, i, j] * result.gain[k, 1, j]
            for j in range(4):  # motor at start, load at start, motor at end, load at end
                packed[k, 24 + 4 * j + i] = inputs[k, i, j]
    return packed


@compiled_fastmath
def _push(
    a: Array, b: Array, c: Array, d: Array, starts: Array, ends: Array, here: Array, ahead: Array
) -> None:
    """Add what torques here and a sample ahead (p,) do to the four states (p,) each."""
    s0, s1, s2, s3 = starts[0], starts[1], starts[2], starts[3]
    e0, e1, e2, e3 = ends[0], ends[1], ends[2], ends[3]
    for i in range(a.size):
        start, end = here[i], ahead[i]
        a[i] += s0 * start + e0 * end
        b[i] += s1 * start + e1 * end
        c[i] += s2 * start + e2 * end
        d[i] += s3 * start + e3 * end


@compiled_fastmath
def _turn(tile: Array, rows: Columns | Array, down: int, across: int) -> None:
    """Write the transpose of `tile` to `rows` from [down, across] on."""
    for i in range(tile.shape[1]):
        for j in range(tile.shape[0]):
            rows[down + i, across + j] = tile[j, i]


@compiled_fastmath
def responses_to_torque(
    packed: Array, torque: Array, side: int, rows: Columns | Array, down: int, across: int
) -> None:
    """`responses` of columns that are torques (n, p) on motor (`side` 0) or load (1) alone, as most are.

    What the filter takes off is part of the transition then, and what is carried is gone through once a sample.
    """
    count, number = torque.shape
    a, b, c, d = np.zeros(number), np.zeros(number), np.zeros(number), np.zeros(number)
    tile = np.empty((2 * TILE, number))
    for k in range(count):
        f = packed[k]
        onto, heavy, weighty = f[40], f[41], f[42]
        f0, f1, f2, f3 = f[0] - f[16] + f[20] * onto, f[1] - f[20], f[2], f[3]
        f4, f5, f6, f7 = f[4] - f[17] + f[21] * onto, f[5] - f[21], f[6], f[7]
        f8, f9, f10, f11 = f[8] - f[18] + f[22] * onto, f[9] - f[22], f[10], f[11]
        f12, f13, f14, f15 = f[12] - f[19] + f[23] * onto, f[13] - f[23], f[14], f[15]
        s0, s1, s2, s3 = f[24 + 4 * side], f[25 + 4 * side], f[26 + 4 * side], f[27 + 4 * side]
        e0, e1, e2, e3 = f[32 + 4 * side], f[33 + 4 * side], f[34 + 4 * side], f[35 + 4 * side]
        at, down_weighed = 2 * (k % TILE), weighty * onto
        here, ahead = torque[k], torque[min(k + 1, count - 1)]
        first, second = tile[at], tile[at + 1]
        for i in range(number):
            a0, b0, c0, d0, start, end = a[i], b[i], c[i], d[i], here[i], ahead[i]
            first[i], second[i] = heavy * a0, weighty * b0 - down_weighed * a0
            a[i] = f0 * a0 + f1 * b0 + f2 * c0 + f3 * d0 + s0 * start + e0 * end
            b[i] = f4 * a0 + f5 * b0 + f6 * c0 + f7 * d0 + s1 * start + e1 * end
            c[i] = f8 * a0 + f9 * b0 + f10 * c0 + f11 * d0 + s2 * start + e2 * end
            d[i] = f12 * a0 + f13 * b0 + f14 * c0 + f15 * d0 + s3 * start + e3 * end
        if k % TILE == TILE - 1 or k == count - 1:
            _turn(tile[: at + 2], rows, down, across + 2 * (k - k % TILE))


@compiled_fastmath
def responses(
    packed: Array, parts: tuple[Array, Array, Array, Array], rows: Columns | Array, down: int, across: int
) -> None:
    """Write to `rows`, from [down, across] on, what p columns do to the innovations over their deviation, (p, 2n).

    `parts` (n, p) each, or (n, 0) for nothing: torque on motor and load, error of the reported angle and speed.
    What is carried of a few columns from step to step stays in registers and in the nearest memory.
    """
    motor, load, angle, speed = parts
    count = packed.shape[0]
    number = max(motor.shape[1], load.shape[1], angle.shape[1], speed.shape[1])
    driven, pulled, turned, hurried = (
        motor.shape[1] > 0,
        load.shape[1] > 0,
        angle.shape[1] > 0,
        speed.shape[1] > 0,
    )
    a, b, c, d = np.zeros(number), np.zeros(number), np.zeros(number), np.zeros(number)
    first, second = np.empty(number), np.empty(number)
    tile = np.empty((2 * TILE, number))
    for k in range(count):
        f = packed[k]
        f0, f1, f2, f3, f4, f5, f6, f7 = f[0], f[1], f[2], f[3], f[4], f[5], f[6], f[7]
        f8, f9, f10, f11, f12, f13, f14, f15 = f[8], f[9], f[10], f[11], f[12], f[13], f[14], f[15]
        h0, h1, h2, h3, g0, g1, g2, g3 = f[16], f[17], f[18], f[19], f[20], f[21], f[22], f[23]
        onto, heavy, weighty = f[40], f[41], f[42]
        for i in range(number):
            first[i], second[i] = a[i], b[i]
        if turned:
            for i in range(number):
                first[i] += angle[k, i]
        if hurried:
            for i in range(number):
                second[i] += speed[k, i]
        at = 2 * (k % TILE)
        for i in range(number):
            seen = first[i]
            later = second[i] - onto * seen
            tile[at, i], tile[at + 1, i] = heavy * seen, weighty * later
            a0, b0, c0, d0 = a[i], b[i], c[i], d[i]
            a[i] = f0 * a0 + f1 * b0 + f2 * c0 + f3 * d0 - h0 * seen - g0 * later
            b[i] = f4 * a0 + f5 * b0 + f6 * c0 + f7 * d0 - h1 * seen - g1 * later
            c[i] = f8 * a0 + f9 * b0 + f10 * c0 + f11 * d0 - h2 * seen - g2 * later
            d[i] = f12 * a0 + f13 * b0 + f14 * c0 + f15 * d0 - h3 * seen - g3 * later
        if k < count - 1:
            if driven:
                _push(a, b, c, d, f[24:28], f[32:36], motor[k], motor[k + 1])
            if pulled:
                _push(a, b, c, d, f[28:32], f[36:40], load[k], load[k + 1])
        if k % TILE == TILE - 1 or k == count - 1:
            _turn(tile[: at + 2], rows, down, across + 2 * (k - k % TILE))


@compiled_fastmath
def _pushed(ahead: Array, torque: Array, inputs: Array, side: int, k: int) -> None:
    """Add what torques (n, p) on motor (`side` 0) or load (1) do in step k to the states ahead; (n, 0): none."""
    for i in range(inputs.shape[1]):
        first, last = inputs[k, i, side], inputs[k, i, 2 + side]
        for c in range(torque.shape[1]):
            ahead[i, c] += first * torque[k, c] + last * torque[k + 1, c]


@compiled_fastmath
def _seen(x: Array, onto: float, angle: Array, speed: Array, k: int, seen: Array) -> None:
    """What a sample's angle, and the speed beyond it, show of states (s, p), (2, p): as they are reported, with errors
    (n, p), or (n, 0) for none. `onto`: what the angle's update does to the speed."""
    for c in range(x.shape[1]):
        seen[0, c] = x[0, c]
    for c in range(angle.shape[1]):
        seen[0, c] += angle[k, c]
    for c in range(x.shape[1]):
        seen[1, c] = x[1, c] - onto * seen[0, c]
    for c in range(speed.shape[1]):
        seen[1, c] += speed[k, c]


@compiled_fastmath
def responses_of_six(
    transition: Array,
    result: Filtered,
    inputs: Array,
    parts: tuple[Array, Array, Array, Array],
    rows: Columns | Array,
    down: int,
    across: int,
) -> None:
    """`responses` of six states and the torque's error. There is no place for so many in registers: one state after
    another is worked out for all columns, with what the filter takes off as a part of the transition."""
    motor, load, angle, speed = parts
    count = result.state.shape[0]
    number = max(motor.shape[1], load.shape[1], angle.shape[1], speed.shape[1])
    x, ahead, seen = np.zeros((6, number)), np.zeros((6, number)), np.empty((2, number))
    tile = np.empty((2 * TILE, number))
    for k in range(count):
        gain, at = result.gain[k], 2 * (k % TILE)
        heavy, weighty = 1.0 / np.sqrt(result.variance[k, 0]), 1.0 / np.sqrt(result.variance[k, 1])
        _seen(x, gain[0, 1], angle, speed, k, seen)
        for c in range(number):
            tile[at, c] = heavy * seen[0, c]
        for c in range(number):
            tile[at + 1, c] = weighty * seen[1, c]
        if k % TILE == TILE - 1 or k == count - 1:
            _turn(tile[: at + 2], rows, down, across + 2 * (k - k % TILE))
        if k == count - 1:
            break
        for i in range(6):
            f = transition[k, i]
            f0, f1, f2, f3, f4, f5 = f[0], f[1], f[2], f[3], f[4], f[5]
            h, g = 0.0, 0.0
            for j in range(7):
                h -= f[j] * gain[0, j]
                g -= f[j] * gain[1, j]
            for c in range(number):
                half = f0 * x[0, c] + f1 * x[1, c] + f2 * x[2, c]
                rest = f3 * x[3, c] + f4 * x[4, c] + f5 * x[5, c]
                ahead[i, c] = half + rest + h * seen[0, c] + g * seen[1, c]
        _pushed(ahead, motor, inputs, 0, k)
        _pushed(ahead, load, inputs, 1, k)
        x, ahead = ahead, x


@compiled_or(plain.cholesky, fastmath=True)
def cholesky(matrix: Array) -> Array:
    """Lower factor of a positive definite matrix (P, P); NaN where it is none. One thread, no wait for others."""
    factor = matrix.copy()
    for i in range(factor.shape[0]):
        for j in range(i + 1):
            rest = factor[i, j]
            for c in range(j):
                rest -= factor[i, c] * factor[j, c]
            factor[i, j] = np.sqrt(rest) if i == j else rest / factor[j, j]
        factor[i, i + 1 :] = 0.0
    return factor


@compiled
def driven(transition: Array, forcing: Array, values: Array) -> Array:
    """States (n, s) of x⁺ = transition·x + forcing·value from rest, one per value (n,)."""
    states = np.zeros((values.size, transition.shape[0]))
    for k in range(1, values.size):
        for i in range(states.shape[1]):
            states[k, i] = forcing[i] * values[k - 1]
            for j in range(states.shape[1]):
                states[k, i] += transition[i, j] * states[k - 1, j]
    return states


@compiled
def moved(transition: Array, forcing: Array, first: Array) -> Array:
    """States (n, s) of x⁺ = transition·x + forcing in each of n − 1 steps, from the first on."""
    states = np.empty((forcing.shape[0] + 1, first.size))
    states[0] = first
    for k in range(forcing.shape[0]):
        for i in range(first.size):
            states[k + 1, i] = forcing[k, i]
            for j in range(first.size):
                states[k + 1, i] += transition[k, i, j] * states[k, j]
    return states
