"""How much work a session may cost: counted in numbers worked out, so that an answer does not depend on the computer.

On one core of 2023 a number takes 10 to 25 ns, and all of them less than 90 s.
"""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np

from schwung.motion import Array

#: Whitened numbers (one column at one sample of angle or speed) after which nothing more is tried.
MOST = 3e9
#: What else takes time, in whitened numbers: to linearise about a sample; to score a set.
LINEARISED, SCORED = 200.0, 1e5


@dataclass(eq=False)
class Work:
    """Counts."""

    most: float = MOST
    done: float = 0.0
    scratch: Array = field(default_factory=lambda: np.empty(0))

    def add(self, numbers: float) -> None:
        """Count."""
        self.done += numbers

    @property
    def spent(self) -> bool:
        """Whether there was enough of it."""
        return self.done > self.most

    def rows(self, count: int, samples: int) -> Array:
        """Room (count, samples), in C's order, for numbers that are used up before it is asked for again.

        Whitened columns are hundreds of megabytes; to touch fresh memory takes longer than to work them out.
        """
        if self.scratch.size < count * samples:
            self.scratch = np.empty(0)
            self.scratch = np.empty(count * samples)
        return self.scratch[: count * samples].reshape(count, samples)
