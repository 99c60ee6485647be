"""How far a law itself is off: a textbook's law is right to a per cent or so.

The error is a smooth curve over the law's coordinate times what the law does, one for each of its coefficients, with a
prior size of a share of all that the law does: a wave is right to a per cent or so in its phase as well, where that has
no coefficient of its own. Of what there are several textbooks' laws of, it is what the others do. It is there whenever
the law is and has no name.
"""

from __future__ import annotations

import numpy as np

from schwung.explain.causes.along import Along
from schwung.explain.causes.candidate import Candidate, Shape
from schwung.explain.causes.curves import Curve, curve_modes
from schwung.innovations.effect import Effect
from schwung.motion import Array

#: Sizes of the error that are tried, as shares of the law.
SHARES = (0.001, 0.003, 0.01, 0.03)
#: Within so much of its whole range (2) an error is alike; shapes of less weight than this do not matter.
_REACH, _LEAST = 1.0, 0.01
#: Speeds are told apart the finer the slower they are, down to this share of the peak.
_SLOW = 0.1
_POINTS = np.linspace(-1.0, 1.0, 33)
_CURVE = Curve(_POINTS, curve_modes(_POINTS, _REACH, least=_LEAST))


def error_of(law: Candidate) -> Candidate | None:
    """The columns of a law's error, for coefficients of 1; None: the law is a curve already, or each run has one, or no
    sample is anywhere along its coordinate."""
    if not law.named or len(law.scales) > 1 or law.each_run:
        return None
    if law.others is not None:
        return law.others
    if law.coordinate == "frequency":
        return None

    def effect(along: Along, shape: Shape) -> Effect:
        places = [own(along, shape) for own in law.own] or [_coordinate(law.coordinate, along)]
        modes = np.hstack([_CURVE.at(place) for place in places])
        return Effect(
            *(None if part is None else _times(part, modes) for part in law.effect(along, shape).parts)
        )

    columns = law.size * max(len(law.own), 1) * _CURVE.size
    return Candidate(f"{law.name}, inexact", effect, (1.0,) * columns, named=False)


def alike(coefficients: Array, gram: Array) -> Array:
    """Of each coefficient of a law (p,) what does as much as any other, and all together what the law does; of one
    that does nothing, nothing. `gram`: products of their columns (p, p)."""
    power = max(float(coefficients @ gram @ coefficients), 0.0) / coefficients.size
    each = np.diag(gram)
    return np.sqrt(np.divide(power, each, out=np.zeros(each.size), where=each > 0))


def deviations_of(coefficients: Array, gram: Array, columns: int) -> Array:
    """Of a law's error as large as the law, in the order of its columns; see `alike`."""
    return np.repeat(alike(coefficients, gram), columns // coefficients.size)


def _times(part: Array, modes: Array) -> Array:
    return np.asarray((part[:, :, None] * modes[:, None, :]).reshape(part.shape[0], -1))


def _coordinate(name: str, along: Along) -> Array:
    """From −1 to 1 over the session."""
    of = along.ranges
    if name == "position":
        return np.asarray(2 * (along.angle - of.low_rad) / max(of.span_rad, 1e-9) - 1)
    if name in ("direction", "speed"):
        return np.asarray(np.arcsinh(along.speed / (_SLOW * of.peak_speed_rad_s)) / np.arcsinh(1 / _SLOW))
    if name == "acceleration":
        return along.load_acceleration / of.peak_acceleration_rad_s2
    if name == "run":
        return np.full_like(along.speed, 2 * along.share - 1)
    if name == "time_in_motion":
        return 2 * along.motion_time_s / of.longest_s - 1
    return along.torque / of.peak_torque_nm
