"""Hysteresis of the coupling: −Z·z on the motor and Z·z on the load, z of how far the coupling is wound up, and was."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from schwung.drivetrain.hysteresis import left_of, yielded
from schwung.drivetrain.machine import Coupling
from schwung.explain.causes.along import Along, Ranges
from schwung.explain.causes.candidate import RIGHT_TO, Candidate, Shape, grid
from schwung.explain.causes.curves import column
from schwung.explain.causes.joined import run_by_run
from schwung.explain.causes.known import Known
from schwung.explain.causes.vocabulary.slipping import SPRINGS, springs
from schwung.innovations.effect import Effect
from schwung.motion import Array

#: Over which it yields, over the largest wind-up: what yields sooner is friction, what never does a stiffness.
_SHORTEST, _LONGEST = 0.01, 2.0
_EXPONENTS = (1.0, 4.0)


@run_by_run
def _held(along: Along, shape: Shape) -> Array:
    """What it holds over what it yields at."""
    return np.asarray(yielded(along.wound, *shape))


@run_by_run
def _slips(along: Along, shape: Shape) -> Effect:
    held = along.contact[:, :1] * springs(along.wound, shape[0])
    return Effect(-held, held)


_OTHERS = Candidate("coupling_hysteresis, inexact", _slips, (1.0,) * SPRINGS, named=False)


def hysteresis(of: Ranges, coupling: Coupling, torque_nm: float, known: Known) -> Candidate:
    """The family's only one; `torque_nm`: a natural torque; `known`: whose hysteresis no change makes negative."""
    wound = of.peak_torque_nm / coupling.stiffness_nm_rad

    def hardly_yields(_torque: Array, shape: Shape) -> bool:
        """Whether that is less than a law is right to: then it is a stiffness. z = x − x^(n+1)/(n + 1) of x yields."""
        over, exponent = shape
        return bool((wound / over) ** exponent < RIGHT_TO * (exponent + 1))

    return Candidate(
        "coupling_hysteresis", _effect, (torque_nm,), _keys,
        shapes=grid(wound * np.geomspace(_SHORTEST, _LONGEST, 7), _EXPONENTS), spacing=(0.3, 0.5),
        logarithmic=(True, True), bounds=((0.5 * _SHORTEST * wound, 2 * _LONGEST * wound), (0.5, 20.0)),
        endless=(1,), positive=(0,), least=(-known.effects.hysteresis_nm,), coordinate="torque", own=(_held,),
        tangent=_tangent, others=_OTHERS, none_of=hardly_yields,
        limit="coupling_stiffness", causes=2,
    )  # fmt: skip


def _effect(along: Along, shape: Shape) -> Effect:
    held = column(along.contact[:, 0] * _held(along, shape))
    return Effect(-held, held)


def _tangent(along: Along, shape: Shape, torque: Array) -> Array:
    left = along.contact[:, 0] * left_of(_held(along, shape), along.winding, shape[1])
    stiffer = torque[0] / shape[0] * left
    return np.stack([stiffer, 0 * stiffer], 1)


def _keys(torque: Array, shape: Shape) -> Mapping[str, float]:
    return {"torque_nm": torque[0], "stiffness_nm_rad": torque[0] / shape[0], "exponent": shape[1]}
