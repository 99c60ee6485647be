"""Exact steps of the two-mass model, compiled.

State of the flexible machine: motor angle, motor speed, wind-up θ_r − θ_l, load speed; of the rigid one: angle and
speed; and of a further mass how far and how fast the load is turned ahead of it. Over one sampling interval the load
inertia stands still and the torques are parabolas; the step is then made of matrix exponentials, exact for any
stiffness. With the number of states known when it is compiled, as in `kalman`, a step costs a tenth.
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from schwung.compiled import compiled_or, inlined
from schwung.innovations import plain
from schwung.innovations.values import REACH, TERMS, Shaft
from schwung.motion import Array


def steps(shaft: Shaft, inertia: Array, duration: float) -> Array:
    """For every interval, side by side (m, s, s + 6): the transition, and what torques add, on motor and load each.

    Torques run straight from start to end, with a parabola on top: start, end, height of the parabola.
    """
    return steps_of_each(shaft, np.array([[shaft.stiffness, shaft.damping]]), inertia, duration)


def steps_of_each(shaft: Shaft, coupling: Array, inertia: Array, duration: float) -> Array:
    """`steps` where the shaft's stiffness and damping, `coupling` (m, 2), differ from interval to interval; (1, 2): in
    none.
    """
    return _STEPS[shaft.states](shaft, coupling, inertia, duration)


@inlined
def _product(left: Array, right: Array, result: Array, size: int, width: int) -> None:
    """`result` becomes left (s, s) · right (s, w)."""
    for i in range(size):
        for c in range(width):
            entry = 0.0
            for j in range(size):
                entry += left[i, j] * right[j, c]
            result[i, c] = entry


@inlined
def _written(
    shaft: Shaft, k: float, b: float, inertia: float, rates: Array, inputs: Array, size: int
) -> float:
    """Write A (s, s) and B (s, 2) of dx/dt = Ax + B·(torque on motor, on load), zero before; the highest |eigenvalue|,
    or more.
    """
    fastest = _shaft_written(shaft, k, b, inertia, rates, inputs)
    mass = shaft.further
    if mass.rate <= 0.0:
        return float(fastest)
    load, ahead = size - 3, size - 2
    moved = inertia + shaft.rotor_inertia if shaft.rigid else inertia
    spring, damper = mass.rate**2, 2.0 * mass.ratio * mass.rate
    rates[ahead, ahead + 1] = 1.0
    rates[load, ahead], rates[load, ahead + 1] = (
        -mass.inertia * spring / moved,
        -mass.inertia * damper / moved,
    )
    for j in range(size):
        rates[ahead + 1, j] = rates[load, j]
    rates[ahead + 1, ahead] -= spring
    rates[ahead + 1, ahead + 1] -= damper
    inputs[ahead + 1, 0], inputs[ahead + 1, 1] = inputs[load, 0], inputs[load, 1]
    against = 1.0 + max(mass.inertia, 0.0) / moved
    return float(fastest + mass.rate * np.sqrt(against) + damper * against)


@inlined
def _shaft_written(shaft: Shaft, k: float, b: float, inertia: float, rates: Array, inputs: Array) -> float:
    """The same of motor, coupling and load."""
    rates[0, 1] = 1.0
    if shaft.rigid:
        total = shaft.rotor_inertia + inertia
        inputs[1, 0] = inputs[1, 1] = 1.0 / total
        rates[1, 1] = -(shaft.motor_friction + shaft.load_friction) / total
        return float(-rates[1, 1])
    rotor = shaft.rotor_inertia
    rates[1, 1], rates[1, 2], rates[1, 3] = -(b + shaft.motor_friction) / rotor, -k / rotor, b / rotor
    rates[2, 1], rates[2, 3] = 1.0, -1.0
    rates[3, 1], rates[3, 2], rates[3, 3] = b / inertia, k / inertia, -(b + shaft.load_friction) / inertia
    inputs[1, 0], inputs[3, 1] = 1.0 / rotor, 1.0 / inertia
    mobility = 1.0 / rotor + 1.0 / inertia
    fastest = max(np.sqrt(k * mobility), b * mobility)
    return float(fastest + shaft.motor_friction / rotor + shaft.load_friction / inertia)


@inlined
def _series(
    rates: Array, inputs: Array, h: float, whole: Array, term: Array, following: Array, size: int
) -> None:
    """Write e^{Ah} and ∫e^{A(h−t)}B tⁱ dt, i = 0, 1, 2, over so short a time, side by side to `whole` (s, s + 6)."""
    for i in range(size):
        for j in range(size):
            term[i, j] = whole[i, j] = 1.0 if i == j else 0.0
        for c in range(2):
            added = inputs[i, c] * h
            term[i, size + c] = whole[i, size + c] = added
            whole[i, size + 2 + c], whole[i, size + 4 + c] = added * h / 2.0, added * h * h / 3.0
    for n in range(1, TERMS + 1):  # (Ah)ⁿ / n!, and (Ah)ⁿ Bh / (n + 1)!
        _product(rates, term, following, size, size + 2)
        for i in range(size):
            for j in range(size):
                term[i, j] = following[i, j] * (h / n)
                whole[i, j] += term[i, j]
            for c in range(size, size + 2):
                term[i, c] = following[i, c] * (h / (n + 1))
                whole[i, c] += term[i, c]
                whole[i, c + 2] += term[i, c] * (h / (n + 2))
                whole[i, c + 4] += term[i, c] * (2.0 * h * h / ((n + 2) * (n + 3)))


@inlined
def _doubled(whole: Array, twice: Array, h: float, size: int) -> None:
    """`whole` over twice the time h."""
    _product(whole, whole, twice, size, size + 6)
    for i in range(size):
        for c in range(size, size + 2):
            first, second = whole[i, c], whole[i, c + 2]
            twice[i, c] += first
            twice[i, c + 2] += second + h * first
            twice[i, c + 4] += whole[i, c + 4] + 2.0 * h * second + h * h * first
    for i in range(size):
        for c in range(size + 6):
            whole[i, c] = twice[i, c]


def _steps_of(size: int) -> Callable[[Shaft, Array, Array, float], Array]:
    @compiled_or(plain.steps_of_each)
    def exact_steps(shaft: Shaft, coupling: Array, inertia: Array, duration: float) -> Array:
        result = np.empty((inertia.size, size, size + 6))
        rates, inputs = np.zeros((size, size)), np.zeros((size, 2))
        whole, twice = np.empty((size, size + 6)), np.empty((size, size + 6))
        term, following = np.empty((size, size + 2)), np.empty((size, size + 2))
        for m in range(inertia.size):
            k, b = coupling[min(m, coupling.shape[0] - 1)]
            fastest = _written(shaft, k, b, inertia[m], rates, inputs, size)
            doublings = max(0, int(np.ceil(np.log2(max(fastest * duration / REACH, 1e-9)))))
            h = duration / 2**doublings
            _series(rates, inputs, h, whole, term, following, size)
            for _ in range(doublings):
                _doubled(whole, twice, h, size)
                h *= 2.0
            for i in range(size):
                for j in range(size):
                    result[m, i, j] = whole[i, j]
                for c in range(size, size + 2):
                    second, third = whole[i, c + 2] / duration, whole[i, c + 4] / duration
                    result[m, i, c], result[m, i, c + 2] = whole[i, c] - second, second
                    result[m, i, c + 4] = 4.0 * (second - third / duration)
        return result

    return exact_steps


#: Of the rigid machine and of the flexible one, and of that with a further mass.
_STEPS = {size: _steps_of(size) for size in (2, 4, 6)}
