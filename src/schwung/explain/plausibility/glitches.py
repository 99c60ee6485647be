"""Single samples that are unlike their neighbours: one that a bus lost and the log repeated, a bit that fell over.

No motion makes one: what is off by e in one sample alone makes fourth differences of e, −4e, 6e, −4e, e, where a jump
of the speed makes three and one of the acceleration two of them. In the likelihood of the motion a single one of a few
thousand samples is as much as the noise of all.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from schwung.motion import Array
from schwung.session.model import Run, Session

_ALONE = np.array([1.0, -4.0, 6.0, -4.0, 1.0])
#: By the neighbours' cubic.
_GUESS = np.array([-1.0, 4.0, 4.0, -1.0]) / 6
#: Off by so many times what nine of ten samples are, and so much of its fourth differences those of one sample alone; a
#: jump of the speed has 0.95.
_UNLIKE, _ONE = 30.0, 0.99
#: More than this share of the samples is no accident, but how the drive reports.
_MOST = 0.005


def without_glitches(session: Session) -> tuple[Session, tuple[str, ...]]:
    """The session with what neighbours say in place of single samples that are unlike them, and a note for each run."""
    runs, notes = [], []
    for number, run in enumerate(session.runs):
        mended, places = _mended(run)
        runs.append(mended)
        if places:
            at = ", ".join(f"{run.time_s[place]:.4g} s" for place in places[:3]) + (
                " …" if len(places) > 3 else ""
            )
            what = (
                "sample is unlike its neighbours"
                if len(places) == 1
                else "samples are unlike their neighbours"
            )
            notes.append(f"run {number}: {len(places)} {what}, which say what was taken instead: at {at}")
    return (replace(session, runs=tuple(runs)) if notes else session), tuple(notes)


def _mended(run: Run) -> tuple[Run, list[int]]:
    position, speed, torque = run.position_rad.copy(), run.speed_rad_s.copy(), run.torque_nm.copy()
    found: set[int] = set()
    for signal in (position, speed):
        alone = _alone(signal)
        if alone.size > _MOST * len(run):
            continue
        for place in alone.tolist():
            repeated = all(values[place] == values[place - 1] for values in (run.torque_nm, run.speed_rad_s))
            for each in (position, speed, torque) if repeated else (signal,):
                each[place] = _GUESS @ each[[place - 2, place - 1, place + 1, place + 2]]
            found.add(place)
    if not found:
        return run, []
    return replace(run, position_rad=position, speed_rad_s=speed, torque_nm=torque), sorted(found)


def _alone(values: Array) -> NDArray[np.intp]:
    """Places of samples that are unlike their neighbours, none within five of another."""
    nowhere = np.zeros(0, dtype=np.intp)
    if values.size < 4 * _ALONE.size:
        return nowhere
    fourth = np.convolve(values, _ALONE, "valid")  # about the samples from the third on
    off = np.convolve(fourth, _ALONE, "valid") / float(_ALONE @ _ALONE)  # from the fifth on
    all_of_it = np.convolve(fourth**2, np.ones(_ALONE.size), "valid")
    usual = float(np.quantile(np.abs(off), 0.9))
    if usual == 0:
        return nowhere
    surely = (np.abs(off) > _UNLIKE * usual) & (off**2 * float(_ALONE @ _ALONE) > _ONE * all_of_it)
    places = np.flatnonzero(surely)
    near = np.flatnonzero(np.diff(places) < _ALONE.size)
    return np.delete(places, np.union1d(near, near + 1)) + _ALONE.size - 1
