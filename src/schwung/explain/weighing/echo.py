"""What noise alone makes of a cause that is part of the machine.

Columns are about the smoothed motion, which holds noise that the innovations hold as well: what damps it or winds it up
goes with them even where there is nothing. How much is the mean over noise such as is drawn here, once on either side,
so that what the motion itself does cancels.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from schwung.explain.weighing.along import Along
from schwung.explain.weighing.candidate import Candidate, Shape
from schwung.innovations.effect import Passed
from schwung.innovations.likelihood import Noise
from schwung.innovations.low_pass import heard
from schwung.motion import Array

#: From the start of a run the smoothed state at first is taken as known for so long (s): no innovations there.
_KNOWN_S = 0.02


@dataclass(frozen=True, eq=False)
class Echo:
    """One run with drawn noise more, and less."""

    passed: Passed
    more: Along
    less: Along
    white: Array  # (2n,) the innovations that were drawn

    @classmethod
    def of(cls, passed: Passed, where: Along, noise: Noise) -> Echo:
        """The same for the same run, on any computer."""
        run = where.run
        white = np.random.default_rng(where.number).standard_normal((run.time_s.size, 2))
        white[run.time_s - run.time_s[0] < _KNOWN_S] = 0.0
        moved = passed.shaken(white)
        torque = heard(-moved[:, -1], noise.torque_of(run.load_nm))

        def beside(sign: float) -> Along:
            states = run.states + sign * moved[:, :-1]
            return replace(
                where,
                run=replace(run, states=states),
                true_torque=where.true_torque + sign * torque,
            )

        return cls(passed, beside(1.0), beside(-1.0), white.reshape(-1))

    def of_cause(self, candidate: Candidate, shape: Shape) -> Array:
        """Mean product (p,) of a cause's columns with white innovations."""
        rows = self.passed.whitened([candidate.effect(self.more, shape), candidate.effect(self.less, shape)])
        return np.asarray((rows[: candidate.size] - rows[candidate.size :]) @ self.white / 2)
