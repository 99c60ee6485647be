"""Everything that is smooth, fitted at once, from which noise and effective samples are found."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass, replace

import numpy as np

from schwung.explain.causes.along import SLIDES
from schwung.explain.causes.present import Member
from schwung.explain.causes.true_torque import TrueTorque
from schwung.explain.weighing.further import within
from schwung.explain.weighing.round import (
    Linearised,
    View,
    acting,
    at_rest,
    few_of,
    finite,
    linearised,
    loud_about,
    repeated_among,
    resmoothed,
    resmoothed_about,
    torques_about,
)
from schwung.explain.weighing.search import HOPELESS
from schwung.explain.weighing.settling import HALVINGS
from schwung.explain.weighing.work import PRODUCT
from schwung.innovations.evidence import Weighed, weigh
from schwung.innovations.likelihood import Noise
from schwung.innovations.statistics import Statistics, colour
from schwung.motion import Array

#: Innovations further apart than this are taken as independent (s).
STRETCH_S = 0.02


@dataclass(frozen=True, eq=False)
class Wide:
    """Everything that is smooth, fitted at once: what noise and effective samples are found from."""

    noise: Noise
    excess: float  # variance of scores over that of white noise
    torques: tuple[TrueTorque, ...]  # of each run, as far as it is known
    dry_nm: float  # friction that leaves open where the shaft sticks or turns
    slowest: tuple[Array, ...]  # where it does, `Along.slowest` of each run
    loud: tuple[Sequence[Array], ...]  # `loudness` of noise in each run's states

    def seen(self, view: View) -> View:
        """The session with what is known of all sets alike: they differ in what they predict, not in how surely."""
        return replace(view, torques=self.torques, dry_nm=self.dry_nm, slowest=self.slowest, loud=self.loud)


#: Passes of noise, coefficients and states at most; settled, where no size of noise moves by more than this (log).
_PASSES, _SETTLED = 6, 0.05
#: Of repeats the noise does not depend on what else is known.
_PASSES_OF_REPEATS = 2
#: No pass begins after this share of the processor's time: the search needs the rest.
_TIME = 0.3
#: How far off the sizes of noise may be in the next pass (log).
_REACHES = (0.1, 1.0)
#: Sizes of all curves are found by so many steps of their fixed point (MacKay), within these.
_SIZING, _SMALLEST, _LARGEST = 12, 1e-4, 10.0


def wide_fit(
    view: View, candidates: Sequence[Member], noise: Noise, train: Sequence[int], reach: float = 1.0
) -> Wide:
    """Fit the belief with all of these present. `candidates` begin with the coefficients they have; `reach`: how far
    off the noise may be (log).

    Where repeats are likelier about the former states, what was found about those holds: curves that cancel one another
    may make them differ by more than their noise. What each run has of its own is known of those alone that are fitted:
    of the others it would be noise.
    """
    members, least = list(candidates), np.inf
    telling = train if any(m.candidate.each_run for m in members) else range(len(view.runs))
    view = _begun(replace(view, dry_nm=None, slowest=()), members, noise, train)
    view = at_rest(view, members, noise).view
    passes = _PASSES_OF_REPEATS if repeated_among(view, telling) else _PASSES
    for number in range(passes):
        latest = linearised(view, members, noise, reach, telling=telling)
        if latest.unlikely > least:
            break
        about, least = latest, latest.unlikely
        moved, noise = about.noise.moved_from(noise), about.noise
        reach = float(np.clip(moved, *_REACHES))
        rows = about.whitened([(m.candidate.about(m.coefficients), m.shape) for m in members], train)
        present = np.concatenate([m.coefficients for m in members])
        target = about.innovations(train) + present @ rows
        view.work.add(PRODUCT * rows.size * rows.shape[0])
        data = Statistics.of(rows.T, target)
        found = _sized(data, members)
        members, view, torques = _nearer(about, members, found.coefficients - present, train)
        if moved < _SETTLED or number == passes - 1 or view.work.spent or view.work.overdue(_TIME):
            break
        view = _bending(replace(view, torques=torques), members, noise, few_of(train))
    rest = target - found.coefficients @ rows
    beyond = max(1.0, unshared_by_neighbours(rest, about.stretches(train)))
    noise, excess = noise.times(float(np.sqrt(beyond))), excess_of(rows, rest, about, train) / beyond
    alongs = view.alongs(members)
    dry = max(acting(view, where, members).dry_nm for where in alongs)
    loud = loud_about(replace(about, noise=noise))
    wide = Wide(noise, max(1.0, excess), torques, dry, tuple(where.slowest for where in alongs), loud)
    return replace(wide, slowest=_sticking(wide, view, members, train))


def _begun(view: View, members: Sequence[Member], noise: Noise, train: Sequence[int]) -> View:
    """With states of the runs that are not fitted as smooth as the others': they may still be as recorded, which
    nothing is likelier than, and by their noise late speeds are corrected."""
    aside = [run for run in range(len(view.runs)) if run not in train]
    begun = resmoothed(view, members, noise, aside) if aside else view
    return begun if finite(begun) else view


def _bending(view: View, members: Sequence[Member], noise: Noise, few: Sequence[int]) -> View:
    """With torques that bend between samples as what is reported does, or as they do themselves: as a few runs are
    likelier."""
    found = []
    for as_sampled in (True, False):
        torques = tuple(replace(torque, as_sampled=as_sampled) for torque in view.torques)
        seen = replace(view, torques=torques)
        about = linearised(seen, members, noise, None, few)
        found.append((sum(float(np.sum(about.passed[run].deviances)) for run in few), seen))
    return min(found, key=lambda each: each[0])[1]


def _sticking(wide: Wide, view: View, members: Sequence[Member], train: Sequence[int]) -> tuple[Array, ...]:
    """`Along.slowest` of each run; ∞ for the load, unless motion is surely likelier where what holds the load is open,
    too: a load that is held winds up the shaft, and swings when it is let go.
    """
    if wide.dry_nm == 0 or view.runs[0].rigid:
        return wide.slowest
    few, sure = few_of(train), SLIDES * view.ranges.sticking_rad_s
    slides = {run: np.all(wide.slowest[run] > sure, axis=1) for run in few}

    def unlikely(slowest: tuple[Array, ...]) -> float:
        """The motion of motor and load while both slide (−2 log likelihood)."""
        seen = replace(wide, slowest=slowest).seen(view)
        about = linearised(resmoothed(seen, members, wide.noise, few), members, wide.noise, None, few)
        return sum(float(np.sum(about.passed[run].deviances[1:][slides[run]])) for run in few)

    motor = tuple(np.maximum(one, [0.0, np.inf]) for one in wide.slowest)
    return wide.slowest if unlikely(wide.slowest) + 2 * HOPELESS < unlikely(motor) else motor


def _nearer(
    about: Linearised, members: Sequence[Member], step: Array, train: Sequence[int]
) -> tuple[list[Member], View, tuple[TrueTorque, ...]]:
    """Members a step (P,) on, or so much of it as makes the runs likelier, and the runs about them."""
    before, at = about.square(train), np.cumsum([m.candidate.size for m in members])[:-1]
    share = 1.0
    for _ in range(HALVINGS):
        tried = [
            replace(m, coefficients=within(m, m.coefficients + share * part))
            for m, part in zip(members, np.split(step, at), strict=True)
        ]
        beyond = linearised(about.view, tried, about.noise, None)
        view = resmoothed_about(beyond)
        if finite(view) and linearised(view, tried, about.noise, None, train).square(train) < before:
            return tried, view, torques_about(beyond)
        share /= 2
    whole = linearised(about.view, members, about.noise, None)
    return list(members), resmoothed_about(whole), torques_about(whole)


def excess_of(rows: Array, rest: Array, about: Linearised, train: Sequence[int]) -> float:
    """How much more than white noise's the scores of these columns (P, Σ2n) vary: the median column's.

    Of what repeats do not share, where there are repeats: what they share is no noise.
    """
    wheres, every = dict(zip(train, about.stretches(train), strict=True)), []
    groups = [[i for i in group if i in wheres] for group in about.view.repeats]
    groups = [group for group in groups if len(group) > 1]
    for group in groups or [[i] for i in train]:
        length = min(about.passed[i].samples for i in group)
        heads = [slice(wheres[i].start, wheres[i].start + length) for i in group]
        rests = np.stack([rest[head] for head in heads])
        if groups:
            rests = (rests - np.mean(rests, axis=0)) * np.sqrt(len(group) / (len(group) - 1))
        for i, head, own in zip(group, heads, rests, strict=True):
            stretch = 2 * max(round(STRETCH_S / about.view.runs[i].step_s), 1)
            every.append(colour(rows[:, head].T, own, stretch))
    return float(np.median(np.mean(every, axis=0)))


def unshared_by_neighbours(rest: Array, wheres: Iterable[slice]) -> float:
    """Variance of what angle and speed (in turn, (Σ2n,)) have in one sample and not in the next, of some runs.

    That is noise even where repeats share it, as they do an encoder's errors, or the rounding where there is little
    else: no cause explains it.
    """
    apart = [np.diff(rest[where].reshape(-1, 2), axis=0) for where in wheres]
    return 0.5 * float(np.mean(np.concatenate(apart) ** 2))


def _sized(data: Statistics, members: Sequence[Member]) -> Weighed:
    """All columns, the size of each curve as the evidence wants it."""
    natural = np.concatenate([np.array(m.candidate.deviations) for m in members])
    blocks, at = [], 0
    for member in members:
        blocks.append(slice(at, at + member.candidate.size))
        at += member.candidate.size
    scale = np.ones(len(members))
    for _ in range(_SIZING):
        deviations = natural * np.repeat(scale, [m.candidate.size for m in members])
        found = weigh(data, deviations)
        sure = 1 - (found.spread / deviations) ** 2
        for j, (member, where) in enumerate(zip(members, blocks, strict=True)):
            if len(member.candidate.scales) > 1:
                power = float(np.sum((found.coefficients[where] / natural[where]) ** 2))
                scale[j] = np.clip(
                    np.sqrt(power / max(float(np.sum(sure[where])), 1e-3)), _SMALLEST, _LARGEST
                )
    return found
