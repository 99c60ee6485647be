"""Which runs are kept aside: those that prove what was found, and those that check it."""

from __future__ import annotations

from collections.abc import Hashable
from dataclasses import dataclass

from schwung.session.imports import motion_identity
from schwung.session.model import Session


@dataclass(frozen=True)
class Split:
    """Runs to fit on, runs that only veto what was chosen there, and runs that nothing is asked of but the proof."""

    train: tuple[int, ...]
    check: tuple[int, ...]
    heldout: tuple[int, ...]
    how: str

    @property
    def seen(self) -> tuple[int, ...]:
        """All that took part in choosing or fitting."""
        return tuple(sorted((*self.train, *self.check)))


def split(session: Session) -> Split:
    """Keep a motion time aside where there are several, else the last repeats, else the last runs.

    Of the runs aside the last, the third last and so on are for the proof; those between check what was chosen.
    """
    numbers = range(len(session.runs))
    times = {n: run.motion.duration_s for n, run in enumerate(session.runs) if run.motion is not None}
    different = sorted(set(times.values()))
    if len(times) == len(session.runs) and len(different) > 1:
        left_out = different[len(different) // 2]
        aside = [n for n in numbers if times[n] == left_out]
        which = f"the motions of {1000 * left_out:g} ms"
    else:
        first: dict[Hashable, int] = {}
        last: dict[Hashable, int] = {}
        for number, run in enumerate(session.runs):
            first.setdefault(motion_identity(run), number)
            last[motion_identity(run)] = number
        aside = sorted(number for motion, number in last.items() if number != first[motion])
        which = "the last repeats of each motion"
        if not aside and len(session.runs) > 2:
            aside, which = [len(session.runs) - 1], "the last run"
    train = [n for n in numbers if n not in aside]
    heldout = tuple(sorted(aside[::-2]))
    check = tuple(n for n in aside if n not in heldout)
    how = f"half of {which}; the other half checked what was chosen" if check else which
    repeated = [n for n in train if sum(_same(session, n, other) for other in train) > 1]
    if not check and repeated:
        train.remove(repeated[-1])
        check, how = (repeated[-1],), f"{which}; one more repeat checked what was chosen"
    return Split(tuple(train), check, heldout, how)


def _same(session: Session, one: int, other: int) -> bool:
    """Whether two runs repeat the same motion."""
    return motion_identity(session.runs[one]) == motion_identity(session.runs[other])
