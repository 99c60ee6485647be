"""Friction that is a spring before it slides: −F·z, z how far bristles are bent, bent over a distance.

z follows the angle alone and F does not bend it, so that each distance is a column. What the bristles hold at rest,
before a run moves, shows in the torque that the drive then reports, up to what else acts there: two columns more, by
which z goes from 1 to 0, one in proportion to that torque.
"""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from schwung.drivetrain.presliding import bent
from schwung.explain.causes.along import Along, Ranges
from schwung.explain.causes.candidate import Candidate, Shape, grid
from schwung.explain.causes.joined import run_by_run
from schwung.explain.causes.known import Known
from schwung.explain.causes.vocabulary.slipping import SPRINGS, springs
from schwung.innovations.effect import Effect
from schwung.motion import Array

#: What builds up sooner than within a period of the band's end, from rest, is not told from dry friction. At most this
#: share of the way is asked for.
_SHORTEST_SHARE = 0.05


def _slid(along: Along, shape: Shape) -> Array:
    """How far the bristles are bent, from rest."""
    return np.asarray(bent(along.angle, shape[0], 0.0))


@run_by_run
def _effect(along: Along, shape: Shape) -> Effect:
    sliding = _slid(along, shape)
    first = bent(along.angle, shape[0], 1.0) - sliding
    return Effect(-np.stack([sliding, first, first * along.resting_nm], 1))


@run_by_run
def _slips(along: Along, shape: Shape) -> Effect:
    """What other laws of it do, of each of its coefficients."""
    sliding = springs(along.angle, shape[0])
    first = springs(along.angle, shape[0], 1.0) - sliding
    return Effect(-np.hstack([sliding, first, first * along.resting_nm]))


_OTHERS = Candidate("presliding_friction, inexact", _slips, (1.0,) * (3 * SPRINGS), named=False)


def presliding(of: Ranges, torque_nm: float, known: Known) -> Candidate:
    """The family's only one; `torque_nm`: a natural torque; `known`: whose friction no change makes negative."""
    soonest = 0.5 * of.peak_acceleration_rad_s2 / of.band_hz**2
    shortest = min(soonest, _SHORTEST_SHARE * of.span_rad)
    return Candidate(
        "presliding_friction", _effect, (torque_nm, torque_nm, 1.0), _keys,
        shapes=grid(np.geomspace(shortest, of.span_rad, 10)), spacing=(0.3,), logarithmic=(True,),
        bounds=((0.5 * shortest, 2 * of.span_rad),), positive=(0,), least=(-known.effects.presliding_nm,),
        coordinate="travel", others=_OTHERS,
    )  # fmt: skip


def _keys(coefficients: Array, shape: Shape) -> Mapping[str, float]:
    return {"torque_nm": coefficients[0], "stiffness_nm_rad": coefficients[0] / shape[0]}
