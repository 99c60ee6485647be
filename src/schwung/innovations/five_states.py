"""Kalman's filter of the machine that most are, motor, coupling and load: five states, number by number.

What an array holds goes to memory and back at every sum. Numbers by themselves stay in the processor's registers: the
filter is three times as fast. A state is (angle, speed, wind-up, the load's speed, the torque's error), its covariance
the lower half of the matrix, row by row.
"""

from __future__ import annotations

from schwung.compiled import inlined
from schwung.innovations.values import System
from schwung.motion import Array

Five = tuple[float, float, float, float, float]
Fifteen = tuple[
    float, float, float, float, float, float, float, float, float, float, float, float, float, float, float
]


@inlined
def begun(system: System) -> tuple[Five, Fifteen]:
    """The first state and its covariance."""
    first, spread = system.first, system.spread
    a, b, c, d, e = spread[0] ** 2, spread[1] ** 2, spread[2] ** 2, spread[3] ** 2, spread[4] ** 2
    return (first[0], first[1], first[2], first[3], first[4]), (
        a,
        0.0, b,
        0.0, 0.0, c,
        0.0, 0.0, 0.0, d,
        0.0, 0.0, 0.0, 0.0, e,
    )  # fmt: skip


@inlined
def _onto(phi: Array, k: int, i: int, x: Five) -> float:
    """Row i of Φ in step k times five numbers."""
    a, b, c, d, e = x
    return float(phi[k, i, 0] * a + phi[k, i, 1] * b + phi[k, i, 2] * c + phi[k, i, 3] * d + phi[k, i, 4] * e)


@inlined
def _row(phi: Array, k: int, i: int, p: Fifteen) -> Five:
    """Row i of Φ·p."""
    p00, p10, p11, p20, p21, p22, p30, p31, p32, p33, p40, p41, p42, p43, p44 = p
    return (
        _onto(phi, k, i, (p00, p10, p20, p30, p40)),
        _onto(phi, k, i, (p10, p11, p21, p31, p41)),
        _onto(phi, k, i, (p20, p21, p22, p32, p42)),
        _onto(phi, k, i, (p30, p31, p32, p33, p43)),
        _onto(phi, k, i, (p40, p41, p42, p43, p44)),
    )


@inlined
def _with(p: Fifteen, power: float, a: float, b: float, c: float, d: float) -> Fifteen:
    """p and what a torque of this power does that moves the first four states so."""
    p00, p10, p11, p20, p21, p22, p30, p31, p32, p33, p40, p41, p42, p43, p44 = p
    wa, wb, wc, wd = power * a, power * b, power * c, power * d
    return (
        p00 + wa * a,
        p10 + wb * a, p11 + wb * b,
        p20 + wc * a, p21 + wc * b, p22 + wc * c,
        p30 + wd * a, p31 + wd * b, p32 + wd * c, p33 + wd * d,
        p40, p41, p42, p43, p44,
    )  # fmt: skip


@inlined
def _besides(system: System, k: int, p: Fifteen) -> Fifteen:
    """p and what torques do that act within step k alone, and what an open contact does.

    Most of them are zero. To ask for that would take longer than to add them: where it branches, numba counts who holds
    an array.
    """
    phi, noise, on, contact = system.transition, system.noise, system.on_load, system.open_contact
    motor, load, along = system.apart[k, 0], system.apart[k, 1], system.apart[k, 2]
    a, b, c, d = phi[k, 0, 4], phi[k, 1, 4], phi[k, 2, 4], phi[k, 3, 4]
    e, f, g, h = noise[k, 0], noise[k, 1], noise[k, 2], noise[k, 3]
    p = _with(_with(p, motor, a, b, c, d), motor, e, f, g, h)
    p = _with(p, load, on[k, 0, 0], on[k, 0, 1], on[k, 0, 2], on[k, 0, 3])
    p = _with(p, load, on[k, 1, 0], on[k, 1, 1], on[k, 1, 2], on[k, 1, 3])
    p = _with(p, along, a + e, b + f, c + g, d + h)
    return _with(p, 1.0, contact[k, 0], contact[k, 1], contact[k, 2], contact[k, 3])


@inlined
def carried(system: System, k: int, x: Five, p: Fifteen) -> tuple[Five, Fifteen]:
    """x and p over step k: as `kalman.carried`. The torque's error is forgotten: the last row of Φ is zero."""
    phi, forcing, noise, power = system.transition, system.forcing, system.noise, system.power[k]
    ahead = (
        forcing[k, 0] + _onto(phi, k, 0, x),
        forcing[k, 1] + _onto(phi, k, 1, x),
        forcing[k, 2] + _onto(phi, k, 2, x),
        forcing[k, 3] + _onto(phi, k, 3, x),
        forcing[k, 4],
    )
    a, b, c, d = _row(phi, k, 0, p), _row(phi, k, 1, p), _row(phi, k, 2, p), _row(phi, k, 3, p)
    n0, n1, n2, n3, n4 = noise[k, 0], noise[k, 1], noise[k, 2], noise[k, 3], noise[k, 4]
    own = power * n4
    over = (
        _onto(phi, k, 0, a),
        _onto(phi, k, 0, b), _onto(phi, k, 1, b),
        _onto(phi, k, 0, c), _onto(phi, k, 1, c), _onto(phi, k, 2, c),
        _onto(phi, k, 0, d), _onto(phi, k, 1, d), _onto(phi, k, 2, d), _onto(phi, k, 3, d),
        own * n0, own * n1, own * n2, own * n3, own * n4,
    )  # fmt: skip
    return ahead, _besides(system, k, _with(over, power, n0, n1, n2, n3))


@inlined
def angle_updated(
    x: Five, p: Fifteen, measured: float, variance: float
) -> tuple[Five, Fifteen, float, float, Five]:
    """x and p after a sample of the angle; its innovation, the variance of that, and the gain."""
    x0, x1, x2, x3, x4 = x
    p00, p10, p11, p20, p21, p22, p30, p31, p32, p33, p40, p41, p42, p43, p44 = p
    # below zero by rounding, where nearly nothing is noise
    spread, error = max(p00, 0.0) + variance, measured - x0
    a, b, c, d, e = p00 / spread, p10 / spread, p20 / spread, p30 / spread, p40 / spread
    after = (
        max(a * variance, 1e-300),  # Joseph's form, cheaply: with its smallest entry exact
        p10 - b * p00, p11 - b * p10,
        p20 - c * p00, p21 - c * p10, p22 - c * p20,
        p30 - d * p00, p31 - d * p10, p32 - d * p20, p33 - d * p30,
        p40 - e * p00, p41 - e * p10, p42 - e * p20, p43 - e * p30, p44 - e * p40,
    )  # fmt: skip
    return (
        (x0 + a * error, x1 + b * error, x2 + c * error, x3 + d * error, x4 + e * error),
        after,
        error,
        spread,
        (a, b, c, d, e),
    )


@inlined
def speed_updated(
    x: Five, p: Fifteen, measured: float, variance: float
) -> tuple[Five, Fifteen, float, float, Five]:
    """The same of the speed."""
    x0, x1, x2, x3, x4 = x
    p00, p10, p11, p20, p21, p22, p30, p31, p32, p33, p40, p41, p42, p43, p44 = p
    spread, error = max(p11, 0.0) + variance, measured - x1
    a, b, c, d, e = p10 / spread, p11 / spread, p21 / spread, p31 / spread, p41 / spread
    after = (
        p00 - a * p10,
        p10 - b * p10, max(b * variance, 1e-300),
        p20 - c * p10, p21 - c * p11, p22 - c * p21,
        p30 - d * p10, p31 - d * p11, p32 - d * p21, p33 - d * p31,
        p40 - e * p10, p41 - e * p11, p42 - e * p21, p43 - e * p31, p44 - e * p41,
    )  # fmt: skip
    return (
        (x0 + a * error, x1 + b * error, x2 + c * error, x3 + d * error, x4 + e * error),
        after,
        error,
        spread,
        (a, b, c, d, e),
    )


@inlined
def kept(x: Five, at: Array) -> None:
    """Write five numbers to an array (5,)."""
    at[0], at[1], at[2], at[3], at[4] = x


@inlined
def kept_whole(p: Fifteen, at: Array) -> None:
    """Write a covariance to an array (5, 5)."""
    p00, p10, p11, p20, p21, p22, p30, p31, p32, p33, p40, p41, p42, p43, p44 = p
    kept((p00, p10, p20, p30, p40), at[0])
    kept((p10, p11, p21, p31, p41), at[1])
    kept((p20, p21, p22, p32, p42), at[2])
    kept((p30, p31, p32, p33, p43), at[3])
    kept((p40, p41, p42, p43, p44), at[4])
