"""The noise, looked for again about what was found."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

from schwung.explain.causes.candidate import RIGHT_TO
from schwung.explain.causes.present import Member
from schwung.explain.weighing.resting import Rests
from schwung.explain.weighing.sets import everything
from schwung.explain.weighing.settling import Settled, own_noise, settled, smoothed
from schwung.explain.weighing.wide import wide_fit

#: How far off the noise may be, once it was found (log).
KNOWN = 0.3


def about_its_noise(
    rests: Rests, at: Settled, every: Sequence[int], believed: Sequence[Member], unrepeated: bool
) -> tuple[Rests, Settled]:
    """Where sets come to rest about the noise of a set at rest, and that at rest about the former noise, in all runs.

    Far from the truth, noise had to be taken for what a linear model could not do. Sets are compared about one and the
    same, so that none has been at rest about the new one. `every`: of a few runs all, by which noise is told; empty:
    these are all. `believed`: what is there where nothing else is; `unrepeated`: whether no run repeats another.
    """
    if every:
        at = settled(at.about.view, at.members, replace(rests.weighing, train=every))
    if unrepeated:  # of everything that may be there, something fits any noise
        noise = own_noise(at, rests.weighing)
        wide = replace(rests.wide, noise=replace(noise, torque_share=max(noise.torque_share, RIGHT_TO)))
    else:
        members = everything(rests.candidates, at.members)
        wide = wide_fit(at.about.view, members, rests.wide.noise, every or rests.train, KNOWN)
    rests = rests.about(wide)
    return rests.beside(smoothed(at.about.view, believed, rests.weighing)), at
