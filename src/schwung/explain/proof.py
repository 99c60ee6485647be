"""The proof: which runs are kept aside, and what the model misses on them."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from schwung.explain.fit import PERIODIC, Model
from schwung.explain.residual import Residuals
from schwung.explain.signals import Prepared
from schwung.explain.spectrum import Spectrum
from schwung.explain.values import Misfit
from schwung.motion import Array
from schwung.session.model import Session


@dataclass(frozen=True)
class Split:
    """Runs to choose and fit on, and runs kept aside."""

    train: tuple[int, ...]
    heldout: tuple[int, ...]
    how: str


def split(session: Session, prepared: Prepared) -> Split:
    """Keep a motion time aside where there are several, else the last repeats, else the last runs."""
    numbers = range(len(session.runs))
    times = {n: run.motion.duration_s for n, run in enumerate(session.runs) if run.motion is not None}
    different = sorted(set(times.values()))
    if len(times) == len(session.runs) and len(different) > 1:
        aside = different[len(different) // 2]
        heldout = tuple(n for n in numbers if times[n] == aside)
        how = f"all motions of {1000 * aside:g} ms"
    else:
        last = {run.group: run.run for run in prepared.runs}
        several = {run.group for run in prepared.runs if last[run.group] != run.run}
        heldout = tuple(sorted(last[group] for group in several))
        how = "the last repeat of each motion"
        if not heldout and len(session.runs) > 2:
            heldout, how = (len(session.runs) - 1,), "the last run"
    train = tuple(n for n in numbers if n not in heldout)
    if not any(prepared.runs[n].considered.any() for n in heldout):
        return Split(tuple(numbers), (), "none: there is no run that could be spared")
    return Split(train, heldout, how)


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
    torque = [remainder(residuals, run, model)[residuals.valid(run)] for run in runs]
    speed = [_speed_error(session, residuals.prepared, run, speed_delay_s) for run in runs]
    return Misfit(_rms(torque), _rms(speed))


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
