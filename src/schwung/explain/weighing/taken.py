"""Which injection a drive has when it takes what a bus holds: the last one that was sent, or one before.

Drives answer a PDO some periods later. Where within a period it is taken, the filter's equations say
(`innovations.held`); how many whole ones later decides what of the reported torque is the injection's, and how torque
goes on between samples. No line leads from one sample's to the next one's: a set that is near to the truth is asked,
and then all is looked for again.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from schwung.explain.weighing.round import ALIKE, View, few_of
from schwung.explain.weighing.search import HOPELESS
from schwung.explain.weighing.settling import Settled, Weighing, settled
from schwung.session.model import Run, Session

#: Shares of a step that a set is begun at: in all, and before it is left for another one.
_MIDDLE, _ENDS = 0.5, (0.1, 0.9)


class TakenLater(Exception):
    """What a bus holds is taken a sample later than the session was looked at."""


def taken_later(session: Session, samples: int) -> Session:
    """A session with its held injections so many samples later than they were sent."""
    return replace(session, runs=tuple(_later(run, samples) for run in session.runs))


def _later(run: Run, samples: int) -> Run:
    if samples == 0 or not run.is_held or run.torque_added_nm is None:
        return run
    return replace(run, torque_added_nm=np.concatenate([np.zeros(samples), run.torque_added_nm[:-samples]]))


@dataclass(frozen=True, eq=False)
class Held:
    """A session as it was looked at before anything was found, and as it is where what is held is taken later."""

    now: View
    seen_later: Callable[[], View]

    @cached_property
    def later(self) -> View:
        """The same with what is held a sample later."""
        return self.seen_later()

    def nearest(self, at: Settled, weighing: Weighing) -> Settled:
        """A set at rest, or the same begun in the middle of the step, where a few runs are likelier so; raises
        TakenLater where begun in the next one they are so much likelier that nothing else found makes up for it.

        About a set that is far off, neither says anything: that there are few maxima of the likelihood.
        """
        held = [run for run in weighing.train if self.now.runs[run].drive.held.is_any]
        if not held:
            return at
        few = replace(weighing, train=few_of(held))

        def begun(share: float, view: View = self.now) -> Settled:
            taken = (np.array([share]) if m.candidate.holds else m.coefficients for m in at.members)
            members = [replace(m, coefficients=c) for m, c in zip(at.members, taken, strict=True)]
            return settled(view, members, few)

        here, within, later = settled(self.now, at.members, few), begun(_MIDDLE), begun(_MIDDLE, self.later)
        if later.log > max(here.log, within.log) + HOPELESS:
            within = max(within, *map(begun, _ENDS), key=lambda one: one.log)
            if later.log > max(here.log, within.log) + HOPELESS:
                raise TakenLater
        if within.log <= here.log + ALIKE:
            return at
        found = settled(at.about.view, within.members, weighing)
        return found if found.log > at.log else at
