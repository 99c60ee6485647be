"""May the estimate be believed? DPR, MIV and position deviation (paper, equations 7, 15, 16), in words.

The paper's bounds on MIV, 0.05 and 0.08 kg·m², belong to its machine, whose mean load inertia is about
0.11. The scale-free bounds used here are those two divided by 0.11: they say the same of that machine, and
for others they are derived, not measured. The bounds on position deviation are ours: on the paper's machine
(inertia inferred) the ratio stays below 0.16 down to 200 ms, is 0.35 at 150 ms and 4 at 100 ms, where the
estimate fails.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from schwung.drivetrain.inertia import InertiaTable
from schwung.drivetrain.response import disturbance_to_position_ratio
from schwung.estimation.choice import CLIPPED
from schwung.estimation.methods import Outcome, Task
from schwung.estimation.sdft import sliding_dft
from schwung.estimation.values import Trace, Trust, Verdict, finite

PAPER_MIV_KGM2 = (0.05, 0.08)  # good below, unreliable above (4.2)
PAPER_MEAN_INERTIA_KGM2 = 0.11
RELATIVE_MIV = (PAPER_MIV_KGM2[0] / PAPER_MEAN_INERTIA_KGM2, PAPER_MIV_KGM2[1] / PAPER_MEAN_INERTIA_KGM2)
MIN_DPR = 0.05  # for the former method
POSITION_DC_RATIO = (0.25, 1.0)
IMAGINARY_RATIO = (0.1, 0.3)
RELATIVE_STD = (0.03, 0.1)  # of a whole-record method
MAX_CLIPPED_SHARE = 0.01  # of a run

_ORDER: tuple[Verdict, ...] = ("good", "doubtful", "unusable")


@dataclass(frozen=True)
class _Deviation:
    amplitude_rad: float
    dc_rad: float
    ratio: float  # largest local DC over local amplitude


@dataclass(frozen=True)
class _Finding:
    verdict: Verdict
    text: str


def judge(outcome: Outcome, task: Task, table: InertiaTable, *, needs_slow_motion: bool) -> Trust:
    """All checks together. `needs_slow_motion`: the method does not denoise, so that DPR counts (former)."""
    linear = task.session.axis == "linear"
    mean = float(np.mean(table.inertia_kgm2))
    variation = np.abs(finite(outcome.traces, "inertia_variation_kgm2"))
    miv = float(np.max(variation, initial=0.0))
    dpr = _dpr(task, mean)
    deviation = _position_deviation(outcome, task.frequency_hz)
    change = _graded(
        miv / mean,
        RELATIVE_MIV,
        f"the inertia changes by up to {miv:.3g} {'kg' if linear else 'kg·m²'} within one period of the "
        f"injected sine, {100 * miv / mean:.0f} % of its mean",
        "move more slowly, or inject a higher frequency",
    )
    found = [
        *([change] if outcome.windowed else _precision(table)),
        *_path_shift(deviation),
        *(_ripple(dpr) if needs_slow_motion and dpr is not None else ()),
        *_imaginary(outcome.traces, mean),
        *(_clipping(outcome, task, "N" if linear else "N·m") if outcome.windowed else ()),
    ]
    return Trust(
        dpr=dpr,
        miv_kgm2=miv,
        relative_miv=miv / mean,
        position_amplitude_rad=deviation.amplitude_rad,
        position_dc_rad=deviation.dc_rad,
        verdict=max((finding.verdict for finding in found), key=_ORDER.index),
        reasons=tuple(f.text for f in sorted(found, key=lambda f: -_ORDER.index(f.verdict))),
    )


def _graded(value: float, bounds: tuple[float, float], fact: str, remedy: str) -> _Finding:
    """Verdict and sentence for a number with two bounds."""
    low, high = (100 * bound for bound in bounds)
    if 100 * value < low:
        return _Finding("good", f"{fact} (good below {low:.0f} %)")
    if 100 * value < high:
        return _Finding(
            "doubtful", f"{fact} (good below {low:.0f} %, unreliable from {high:.0f} %); {remedy}"
        )
    return _Finding("unusable", f"{fact} (unreliable from {high:.0f} %); {remedy}")


def _precision(table: InertiaTable) -> list[_Finding]:
    """The band of a method that knows its own: the 90th percentile, so that one edge cell does not condemn it."""
    if table.std_kgm2 is None:
        return []
    relative = float(np.quantile(table.std_kgm2 / table.inertia_kgm2, 0.9))
    fact = f"the standard deviation is up to {100 * relative:.2g} % of the inertia"
    return [_graded(relative, RELATIVE_STD, fact, "inject more, repeat more often, or move more slowly")]


def _path_shift(deviation: _Deviation) -> list[_Finding]:
    if not np.isfinite(deviation.ratio):
        return []
    fact = (
        f"the injection shifts the path itself by up to {100 * deviation.ratio:.0f} % of the ripple it makes"
    )
    remedy = "the machine is not linear over that ripple: inject less, or a higher frequency"
    return [_graded(deviation.ratio, POSITION_DC_RATIO, fact, remedy)]


def _ripple(dpr: float) -> list[_Finding]:
    fact = f"the injected ripple is {100 * dpr:.1f} % of the motion's speed (DPR)"
    if dpr >= MIN_DPR:
        return [_Finding("good", f"{fact} (good above {100 * MIN_DPR:.0f} %)")]
    remedy = "move more slowly, inject more, or use the denoised method"
    verdict: Verdict = "doubtful" if dpr > MIN_DPR / 2 else "unusable"
    return [_Finding(verdict, f"{fact}, below the {100 * MIN_DPR:.0f} % that this method needs; {remedy}")]


def _dpr(task: Task, estimated_kgm2: float) -> float | None:
    """The smallest DPR of the runs; None where controller or motion is not known.

    The inertia is the believed one where there is one: an estimate that failed would make a wrong DPR, too.
    """
    machine, believed = task.machine, task.machine.load_inertia
    if machine.control is None:
        return None
    if isinstance(believed, InertiaTable):
        believed = float(np.mean(believed.inertia_kgm2))
    values = [
        float(
            disturbance_to_position_ratio(
                machine,
                believed or estimated_kgm2,
                distance_rad=run.motion.distance_rad,
                duration_s=run.motion.duration_s,
                frequency_hz=task.frequency_hz,
                amplitude_nm=run.excitation.amplitude_nm,
            )
        )
        for run in task.excited
        if run.motion is not None and run.excitation is not None and run.motion.distance_rad != 0
    ]
    return min(values, default=None)


def _position_deviation(outcome: Outcome, frequency_hz: float) -> _Deviation:
    """Sine and local mean of θ_est − θ_RtR (16) in the windows that the estimate used."""
    amplitudes, means = [], []
    for pair, trace in zip(outcome.denoised, outcome.traces, strict=False):
        rate = pair.excited.sample_rate_hz
        spectrum = sliding_dft(pair.position_deviation_rad, pair.time_s, rate, frequency_hz)
        used = np.isfinite(trace.speed_amplitude_rad_s)
        amplitudes.append(np.abs(spectrum.phasor[used]))
        means.append(np.abs(spectrum.mean[used]))
    if not amplitudes:
        return _Deviation(np.nan, np.nan, np.nan)
    amplitude, mean = np.concatenate(amplitudes), np.concatenate(means)
    # an encoder count or two of ripple would make any ratio: never divide by less than a tenth of the median
    floor = max(0.1 * float(np.median(amplitude)), 1e-12)
    ratio = float(np.max(mean / np.maximum(amplitude, floor)))
    return _Deviation(float(np.median(amplitude)), float(np.max(mean)), ratio)


def _imaginary(traces: Sequence[Trace], mean_inertia: float) -> list[_Finding]:
    part = finite(traces, "imaginary_kgm2")
    ratio = float(np.median(np.abs(part))) / mean_inertia if part.size else 0.0
    if ratio < IMAGINARY_RATIO[0]:
        return []
    fact = f"torque and speed are out of phase: {100 * ratio:.0f} % of the inertia comes out imaginary"
    remedy = (
        "check friction, stiffness and damping in the machine file, and whether the drive delays its speed"
    )
    return [_graded(ratio, IMAGINARY_RATIO, fact, remedy)]


def _clipping(outcome: Outcome, task: Task, unit: str) -> list[_Finding]:
    """Clipped torque breaks the superposition that denoising rests on."""
    peak = task.machine.motor.peak_torque_nm
    runs = [*task.excited, *(pair.reference for pair in outcome.denoised)]
    share = max(float(np.mean(np.abs(run.torque_nm) >= CLIPPED * peak)) for run in runs)
    if share == 0:
        return []
    return [
        _Finding(
            "unusable" if share > MAX_CLIPPED_SHARE else "doubtful",
            f"the motor's peak torque of {peak:g} {unit} is reached in {100 * share:.1f} % of a run; where "
            "the drive clips, motion and injection no longer add up; move more slowly or inject less",
        )
    ]
