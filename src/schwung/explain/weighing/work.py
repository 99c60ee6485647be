"""How much work a session may cost: counted in numbers worked out, so that an answer does not depend on the computer.

On one core of 2023 a number takes 7 to 15 ns. The search ends at `MOST`, what is told of it at half as much more. Where
the processor has taken `SECONDS` before that, the search ends as well, and says so.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass, field
from functools import wraps
from typing import ParamSpec, TypeVar

import numpy as np
from threadpoolctl import threadpool_limits

from schwung.compiled import computing_s
from schwung.innovations.statistics import Columns
from schwung.motion import Array

P = ParamSpec("P")
R = TypeVar("R")

#: Whitened numbers (one column at one sample of angle or speed) after which nothing more is tried.
MOST = 3e9
#: Time of the processor (s) after which nothing more is tried either.
SECONDS = 45.0
#: All that is looked for apart may take so much more of both, and what stands in the place of what was found where the
#: search ended so much more again: 81 s, and what was begun and is told.
APART, ENDING = 0.7, 0.1
#: Beyond so much more, sets are taken as far as they have come to rest, and no further formula is tried.
_LATE, _LATE_S = 0.5, 0.1
#: What else takes time, in whitened numbers: to linearise about a sample of angle or speed; to find the sizes of noise
#: from one; to score a set, for the set and for each of its columns cubed; and a product in a sum of products.
LINEARISED, NOISE, SCORED, CUBED, PRODUCT = 100.0, 1000.0, 1e5, 0.01, 0.01


def on_one_thread(function: Callable[P, R]) -> Callable[P, R]:
    """A function during which linear algebra has one thread: its matrices are small, and more of them would take the
    time that it may take from as many processors at once."""

    @wraps(function)
    def alone(*arguments: P.args, **options: P.kwargs) -> R:
        with threadpool_limits(1, user_api="blas"):
            return function(*arguments, **options)

    return alone


@dataclass(eq=False)
class Work:
    """Counts; and the time since it was made, by the clock that it is given (s)."""

    most: float = MOST
    seconds: float = SECONDS
    now: Callable[[], float] = computing_s
    done: float = 0.0
    scratch: Array = field(default_factory=lambda: np.empty(0))
    hurried: bool = False  # whether it was the time that ended the search

    def __post_init__(self) -> None:
        self.began = self.now()
        self._usual, self._apart, self._ending = (self.most, self.seconds), APART, ENDING
        self._whole = self._usual  # of which a share may be asked for

    def add(self, numbers: float) -> None:
        """Count."""
        self.done += numbers

    @contextmanager
    def apart(self, share: float) -> Iterator[None]:
        """Within, so much more may be done, while all that is done so is not too much; it counts to nothing else."""
        with self._beyond(min(share, self._apart)) as used:
            yield
        self._apart = max(self._apart - used(), 0.0)

    @contextmanager
    def ending(self) -> Iterator[None]:
        """Within, as much more may be done as is kept for where the search has ended."""
        with self._beyond(self._ending) as used:
            yield
        self._ending = max(self._ending - used(), 0.0)

    @contextmanager
    def _beyond(self, share: float) -> Iterator[Callable[[], float]]:
        """Within, so much more may be done, which counts to nothing else; gives what share of the usual was used."""
        most, seconds, hurried, done, began = self.most, self.seconds, self.hurried, self.done, self.now()
        numbers, time_s = self._usual
        self.most = done + share * numbers
        self.seconds = began - self.began + (share * time_s if share else 0.0)
        whole, self._whole = self._whole, (self.most, self.seconds)
        try:
            yield lambda: max((self.done - done) / numbers, (self.now() - began) / time_s)
        finally:
            self._whole = whole
            self.most, self.seconds = most + self.done - done, seconds + self.now() - began
            self.hurried = hurried

    @contextmanager
    def besides(self) -> Iterator[None]:
        """Within, what is done is not of the share that is asked for, but of all of which it is one."""
        done, began = self.done, self.now()
        yield
        most, seconds = self._whole
        self.most = max(self.most, min(self.most + self.done - done, most))
        self.seconds = max(self.seconds, min(self.seconds + self.now() - began, seconds))

    @contextmanager
    def within(self, share: float) -> Iterator[None]:
        """Within, no more than so much more may be done; what was left of it may be done after it."""
        most, seconds, hurried = self.most, self.seconds, self.hurried
        whole, self._whole = self._whole, (most, seconds)
        self.most = min(most, self.done + share * most)
        self.seconds = min(seconds, self.now() - self.began + share * seconds)
        try:
            yield
        finally:
            self._whole = whole
            self.most, self.seconds, self.hurried = most, seconds, hurried

    @property
    def share(self) -> float:
        """How much of it was done, 0…"""
        return self.done / self.most

    @property
    def spent(self) -> bool:
        """Whether there was enough of it."""
        return self.done > self.most or self.overdue(1.0)

    @property
    def late(self) -> bool:
        """Whether not even what was begun should be finished."""
        numbers, time_s = self._usual
        overdue = self.now() - self.began > self.seconds + _LATE_S * time_s
        return self.done > self.most + _LATE * numbers or overdue

    def overdue(self, share: float) -> bool:
        """Whether this share of the time is over. Where all of it is, what asks ends the search."""
        overdue = self.now() - self.began > share * self.seconds
        self.hurried = self.hurried or (overdue and share >= 1)
        return overdue

    def rows(self, count: int, samples: int) -> Array:
        """Room (count, samples), in C's order, for numbers that are used up before it is asked for again.

        Whitened columns are hundreds of megabytes; to touch fresh memory takes longer than to work them out.
        """
        if self.scratch.size < count * samples:
            self.scratch = np.empty(0)
            self.scratch = np.empty(count * samples)
        return self.scratch[: count * samples].reshape(count, samples)

    def columns(self, count: int, samples: int) -> Columns:
        """Room (count, samples) for columns that are kept; in place of the other, where that is smaller: what was
        touched already is soon touched again."""
        if self.scratch.nbytes < count * samples * np.dtype(np.float32).itemsize:
            self.scratch = np.empty(0)
        return np.empty((count, samples), dtype=np.float32)
