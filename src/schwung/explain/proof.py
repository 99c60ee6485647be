"""The proof: which runs are kept aside, and what the model misses on them."""

from __future__ import annotations

from collections.abc import Hashable, Iterable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from schwung.explain.fit import PERIODIC, Model
from schwung.explain.residual import Residuals
from schwung.explain.signals import Prepared
from schwung.explain.spectrum import Spectrum
from schwung.explain.values import Misfit
from schwung.motion import Array
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

    def usable(self, prepared: Prepared) -> Split:
        """This, or nothing kept aside where no sample of what was could be compared."""
        if any(prepared.runs[run].considered.any() for run in self.heldout):
            return self
        numbers = tuple(range(len(prepared.runs)))
        return Split(numbers, (), (), "none: there is no run that could be spared")


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


def remainder(residuals: Residuals, run: int, model: Model) -> Array:
    """What a model misses in one run on the compared grid (N·m), (n,); a periodic torque takes the run's own phase."""
    residual = residuals.residual(run, model.unknowns)
    if PERIODIC not in model.terms:
        return residual
    valid = residuals.valid(run)
    time = residuals.runs[run].signals.time_s[:: residuals.prepared.every]
    turn = 2 * np.pi * model.frequency_hz * time
    waves = np.stack([np.sin(turn), np.cos(turn)], axis=1)
    return np.asarray(residual - waves @ np.linalg.lstsq(waves[valid], residual[valid], rcond=None)[0])


def misfit(
    session: Session, residuals: Residuals, runs: tuple[int, ...], model: Model, speed_delay_s: float
) -> Misfit:
    """Root mean squares over the compared samples of some runs.

    Torque: reported minus needed. Speed: reported minus what the angle says, the reported one `speed_delay_s` late.
    """
    speed = [_speed_error(session, residuals.prepared, run, speed_delay_s) for run in runs]
    return Misfit(missed_nm(residuals, runs, model), _rms(speed))


def missed_nm(residuals: Residuals, runs: Iterable[int], model: Model) -> float:
    """Root mean square of reported minus needed torque over the compared samples of some runs (N·m)."""
    return _rms([remainder(residuals, run, model)[residuals.valid(run)] for run in runs])


def _rms(parts: list[Array]) -> float:
    values = np.concatenate(parts) if parts else np.zeros(0)
    return float(np.sqrt(np.mean(values**2))) if values.size else 0.0


def _speed_error(session: Session, prepared: Prepared, run: int, delay_s: float) -> Array:
    recorded = session.runs[run]
    spectrum = Spectrum(len(recorded), recorded.sample_rate_hz, 4 / prepared.band_hz)
    low = spectrum.low_pass(prepared.band_hz)
    derived = spectrum.apply(recorded.position_rad, low * spectrum.omega, "slope")
    reported = spectrum.apply(recorded.speed_rad_s, low)
    late = spectrum.apply(derived, np.exp(-spectrum.omega * delay_s))
    grid: NDArray[np.bool_] = prepared.runs[run].considered
    factor = round(prepared.source_rate_hz / prepared.rate_hz)
    return np.asarray((reported - late)[::factor][grid])
