"""The proof: what the model misses on the runs that are kept aside."""

from __future__ import annotations

from collections.abc import Iterable

import numpy as np
from numpy.typing import NDArray

from schwung.explain.fit import PERIODIC, Model
from schwung.explain.kept_aside import Split
from schwung.explain.residual import Residuals
from schwung.explain.signals import Prepared
from schwung.explain.spectrum import Spectrum
from schwung.explain.values import Misfit
from schwung.motion import Array
from schwung.session.model import Session


def usable(parts: Split, prepared: Prepared) -> Split:
    """The parts, or nothing kept aside where no sample of what was could be compared."""
    if any(prepared.runs[run].considered.any() for run in parts.heldout):
        return parts
    numbers = tuple(range(len(prepared.runs)))
    return Split(numbers, (), (), "none: there is no run that could be spared")


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
