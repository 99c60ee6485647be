"""How much work a session may cost: counted in numbers worked out, so that an answer does not depend on the computer.

On one core of 2023 a number takes 10 to 25 ns, and all of them less than 90 s.
"""

from __future__ import annotations

from dataclasses import dataclass

#: Whitened numbers (one column at one sample of angle or speed) after which nothing more is tried.
MOST = 3e9
#: What else takes time, in whitened numbers: to linearise about a sample; to score a set.
LINEARISED, SCORED = 200.0, 1e5


@dataclass(eq=False)
class Work:
    """Counts."""

    most: float = MOST
    done: float = 0.0

    def add(self, numbers: float) -> None:
        """Count."""
        self.done += numbers

    @property
    def spent(self) -> bool:
        """Whether there was enough of it."""
        return self.done > self.most
