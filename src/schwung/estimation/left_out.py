"""Physics that the trajectory fit leaves out until the record shows it: what each takes from the motor's torque.

The inertia is free over the angle, and takes what has the same form along the motion: a curve fitted without them is
narrow and wrong. Fitted with all of them it would be wide on every machine, most of which have none. So each is asked
for by its score, as Lagrange multipliers are (C. R. Rao, 1948), and fitted where that is clear.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from scipy.linalg import cho_factor, cho_solve

from schwung.motion import Array


@dataclass(frozen=True)
class LeftOut:
    """One of them: what its number is called, what it is a case of, and what it naturally is, a share of the peak
    torque or none. Where one is shown all of its `kind` are fitted: which law a machine has is told less surely."""

    words: str
    kind: str
    natural: float
    of_peak: bool


_DROP, _ALONG = "a torque constant that drops", "friction that changes along the way"
#: In the order in which `taken` has them.
LEFT_OUT = (
    LeftOut("drop of the torque constant with current", _DROP, 0.1, False),
    LeftOut("drop with its square", _DROP, 0.1, False),
    LeftOut("friction over the torque carried", "friction of the torque that is carried", 0.1, False),
    LeftOut("friction that falls with speed", "friction that falls with speed", 0.1, True),
    LeftOut("friction over the way (−1…1)", _ALONG, 0.1, True),
    LeftOut("over its square", _ALONG, 0.1, True),
    LeftOut("over its cube", _ALONG, 0.1, True),
    LeftOut("over its fourth power", _ALONG, 0.1, True),
)
#: Which of them are of the same kind as each.
ALIKE = tuple(frozenset(i for i, other in enumerate(LEFT_OUT) if other.kind == one.kind) for one in LEFT_OUT)
#: Who writes a law otherwise means another tenth of what it does to the inertia.
ROUGH = 0.1
#: Friction falls within this share of the top speed.
FALLS = 0.1
#: Standard deviations from which one is shown, as of any number that is found beside the inertia.
CLEAR = 4.0


def taken(
    torque_nm: Array,
    carried_nm: Array,
    speed_rad_s: Array,
    direction: Array,
    along: Array,
    peak_nm: float,
    top_rad_s: float,
) -> Array:
    """What a unit of each takes from the motor's torque (N·m, or of those that are a torque 1), (n, 8).

    `carried_nm`: by the coupling, or all that the motor gives; `direction`, and place `along` the way: −1…1; all (n,).
    """
    falling = np.exp(-np.abs(speed_rad_s) / (FALLS * top_rad_s))
    each = [
        torque_nm * np.abs(torque_nm) / peak_nm,
        torque_nm**3 / peak_nm**2,
        np.abs(carried_nm) * direction,
        falling * direction,
        *(along**power * direction for power in range(1, 5)),
    ]
    return np.stack(each, axis=1)


def along_way(angle_rad: Array, low_rad: float, high_rad: float) -> Array:
    """−1…1 from one end of the load's angles to the other, (n,)."""
    return np.asarray((2 * angle_rad - low_rad - high_rad) / max(high_rad - low_rad, 1e-300))


def shown(
    information: Array, slope: Array, scores: Array, precision: Array, fitted: Array, asked: Sequence[int]
) -> int | None:
    """Which of the `asked` parameters (places in the vector of all) the record shows most clearly; None: none of them.

    `information` (P, P), `slope` (P,) and `scores` (blocks, P) of the data where the `fitted` ones (places) are most
    likely, `precision` (P, P) of the prior. A score is as sure as its information says, or as its sums over stretches
    of time do, where innovations are not white.
    """
    inner = np.ix_(fitted, fitted)
    factor = cho_factor(information[inner] + precision[inner])
    best, top = None, CLEAR
    for one in asked:
        follows = cho_solve(factor, information[fitted, one])
        own = scores[:, one] - scores[:, fitted] @ follows
        variance = max(information[one, one] - information[one, fitted] @ follows, float(own @ own))
        clear = abs(slope[one] - slope[fitted] @ follows) / np.sqrt(max(variance, 1e-300))
        if clear > top:
            best, top = one, float(clear)
    return best
