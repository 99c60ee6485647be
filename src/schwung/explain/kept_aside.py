"""Which runs are kept aside to prove what was found in the others."""

from __future__ import annotations

from collections.abc import Hashable

from schwung.session.imports import motion_identity
from schwung.session.model import Session


def kept_aside(session: Session) -> tuple[int, ...]:
    """Half of a motion time where there are several, else of the last repeats, else the last run; none of one or two.

    The last, the third last and so on: so both roles are among those that are fitted.
    """
    times = {n: run.motion.duration_s for n, run in enumerate(session.runs) if run.motion is not None}
    different = sorted(set(times.values()))
    if len(times) == len(session.runs) and len(different) > 1:
        left_out = different[len(different) // 2]
        aside = [n for n, duration_s in times.items() if duration_s == left_out]
    else:
        first: dict[Hashable, int] = {}
        last: dict[Hashable, int] = {}
        for number, run in enumerate(session.runs):
            first.setdefault(motion_identity(run), number)
            last[motion_identity(run)] = number
        aside = sorted(number for motion, number in last.items() if number != first[motion])
        if not aside and len(session.runs) > 2:
            aside = [len(session.runs) - 1]
    return tuple(sorted(aside[::-2]))
