"""May the estimate be believed? One verdict, from the relative error that the session itself lets expect.

`evidence.py` derives that error from three scale-free balances and the noise, and it is the table's own band; it is
below GOOD where the estimate is good and above UNUSABLE where it is not to be used. They take the place of the paper's
MIV and position deviation (equations 15, 16), which go on being reported, and still judge where a recording allows no
such balance (a method without reference runs): the paper's bounds on MIV, 0.05 and 0.08 kg·m², divided by its
machine's mean load inertia of about 0.11; bounds on position deviation are ours (on the paper's machine the ratio stays
below 0.16 down to 200 ms, is 0.35 at 150 ms and 4 at 100 ms, where the estimate fails). DPR (7) judges methods that
want slow motion.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from schwung.drivetrain.inertia import InertiaTable
from schwung.drivetrain.response import disturbance_to_position_ratio
from schwung.estimation.choice import CLIPPED
from schwung.estimation.evidence import Evidence
from schwung.estimation.methods import Outcome, Task
from schwung.estimation.sdft import sliding_dft
from schwung.estimation.values import Trace, Trust, Verdict, finite

PAPER_MIV_KGM2 = (0.05, 0.08)  # good below, unreliable above (4.2)
PAPER_MEAN_INERTIA_KGM2 = 0.11
RELATIVE_MIV = (PAPER_MIV_KGM2[0] / PAPER_MEAN_INERTIA_KGM2, PAPER_MIV_KGM2[1] / PAPER_MEAN_INERTIA_KGM2)
MIN_DPR = 0.05  # for the former method
POSITION_DC_RATIO = (0.25, 1.0)
IMAGINARY_RATIO = (0.1, 0.3)
#: Relative error to be expected: good below the first, unusable from the second.
PREDICTED = (0.035, 0.1)
MAX_CLIPPED_SHARE = 0.01  # of a run
STIFFNESS_OFF = 0.05  # worth a word

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


def judge(
    outcome: Outcome, task: Task, table: InertiaTable, evidence: Evidence, *, needs_slow_motion: bool
) -> Trust:
    """All checks together. `needs_slow_motion`: the method does not denoise, so that DPR counts (former)."""
    mean = float(np.mean(table.inertia_kgm2))
    variation = np.abs(finite(outcome.traces, "inertia_variation_kgm2"))
    miv = float(np.max(variation, initial=0.0))
    dpr = _dpr(task, mean)
    deviation = _position_deviation(outcome, task.frequency_hz)
    found = _expected(evidence, outcome, task)
    if outcome.windowed:
        if evidence.difference is None:
            found += [_variation(miv, mean, task), *_path_shift(deviation), *_clipping(outcome, task)]
        elif evidence.predicted >= PREDICTED[0]:
            found += _clipping(outcome, task)
        found += _imaginary(outcome.traces, mean)
    if needs_slow_motion and dpr is not None:
        found += _ripple(dpr)
    return Trust(
        dpr=dpr,
        miv_kgm2=miv,
        relative_miv=miv / mean,
        position_amplitude_rad=deviation.amplitude_rad,
        position_dc_rad=deviation.dc_rad,
        verdict=max((finding.verdict for finding in found), key=_ORDER.index),
        reasons=tuple(f.text for f in sorted(found, key=lambda f: -_ORDER.index(f.verdict))),
        predicted_error=evidence.predicted,
        left_out=evidence.left_out,
    )


def _expected(evidence: Evidence, outcome: Outcome, task: Task) -> list[_Finding]:
    """The error to be expected, and where it is not small, what makes it and what would mend it."""
    low, high = PREDICTED
    predicted = evidence.predicted
    verdict = _ORDER[int(predicted >= low) + int(predicted >= high)]
    bounds = f"good below {100 * low:g} %" + (f", unusable from {100 * high:g} %" if predicted >= low else "")
    found = [_Finding(verdict, f"expected error about {100 * predicted:.2g} % of the inertia ({bounds})")]
    if predicted >= low:
        largest = max(evidence.parts.values())
        parts = sorted(evidence.parts.items(), key=lambda part: -part[1])
        texts = _texts(evidence, outcome)
        found += [_Finding(verdict, texts[name]) for name, part in parts if part >= largest / 2]
    for name, doubt in evidence.doubts.items():
        if doubt >= low:
            found.append(_Finding(_ORDER[1 + int(doubt >= high)], _texts(evidence, outcome)[name]))
    if abs(evidence.stiffer.value) > STIFFNESS_OFF:
        found.append(_Finding("good", _texts(evidence, outcome)["stiffness"]))
    return found


def _texts(evidence: Evidence, outcome: Outcome) -> dict[str, str]:
    """What each part of the evidence means, and the remedy."""

    def percent(value: float | None) -> str:
        return f"{100 * abs(value or 0.0):.2g} %"

    scale = evidence.scale.value - 1 if evidence.scale is not None else 0.0
    stiffer = evidence.stiffer.value
    smear = (
        f"windows of one period put the curve off by {percent(evidence.difference)}; inject four phases, move more "
        "slowly, or inject a higher frequency"
        if outcome.windowed
        else f"the ripple by itself gives a curve that is {percent(evidence.difference)} away; look for play in the "
        "coupling and for disturbances, and record again"
    )
    noise = (
        f"noise and what is not known of the drive leave {percent(evidence.band)} of the inertia open; inject more, "
        "repeat more often, or move more slowly"
    )
    return {
        "motion": f"the motion takes {percent(scale)} {'more' if scale > 0 else 'less'} torque than this inertia "
        "needs; check stiffness (`schwung bode`), rotor inertia and torque constant in the machine file, and look for "
        "play",
        "difference": smear,
        "unexplained": f"{percent(evidence.unexplained)} of the ripple's torque follows from no inertia, friction or "
        "delay; look for play or noise, and inject more",
        "missed": f"{percent(evidence.missed)} of the torque follows from no inertia, friction or load; look for play "
        "and disturbances",
        "band": smear if outcome.windowed and evidence.difference is not None else noise,
        "stiffness": f"the stiffness comes out {percent(stiffer)} {'above' if stiffer > 0 else 'below'} the machine "
        "file's; should the file be right, torque constant or rotor inertia are not, nor is this inertia",
    }  # fmt: skip


def _variation(miv: float, mean: float, task: Task) -> _Finding:
    fact = (
        f"the inertia changes by up to {miv:.3g} {'kg' if task.session.axis == 'linear' else 'kg·m²'} within one "
        f"period of the injected sine, {100 * miv / mean:.0f} % of its mean"
    )
    return _graded(miv / mean, RELATIVE_MIV, fact, "move more slowly, or inject a higher frequency")


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


def _clipping(outcome: Outcome, task: Task) -> list[_Finding]:
    """Clipped torque breaks the superposition that denoising rests on."""
    peak, unit = task.machine.motor.peak_torque_nm, "N" if task.session.axis == "linear" else "N·m"
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
