"""Which f_est and |T_add| to take on a machine whose response is known, and why.

For every frequency with a whole number of samples a period, the expected error of J_l at the worst measured angle:

    noise    the spread of a speed phasor over one period, as measured, over |∂G/∂J_l|·|T|
    model    what the intervals of J_r, k, b and the delay do to it, each by itself: Re(∂G/∂p · σ_p / (∂G/∂J_l))
    blur     what a window of one period makes of a J_l that swings once over the stroke: ΔJ_l π²/12 · (travel/stroke)²

Simulated sessions of the paper's machine had 0.9 to 1.4 times the blur as RMSE from 25 to 60 Hz, and 0.001 kg·m² above.
The amplitude is the usual share of the torque limit, or what linearity, room and the motion's own torque leave of it.
"""

from __future__ import annotations

import math
from collections.abc import Iterable
from dataclasses import dataclass
from typing import Any

import numpy as np

from schwung.drivetrain import Machine, anti_resonance_hz, disturbance_to_position_ratio
from schwung.drivetrain.response import injection_to_speed, injection_to_torque, torque_to_speed
from schwung.errors import InputError
from schwung.estimation.bode_values import BodeFit

#: Samples a period below which the sliding DFT has no room; the most that are worth trying.
_FEWEST_SAMPLES, _MOST_SAMPLES = 10, 200
#: And below which four phases are not better than one: they have no window, but derivatives to take between samples.
#: At 1 kHz on the bench, with 10 samples a period four phases erred ten times as much as with 14 to 30.
_FEWEST_IN_PHASES = 16
#: Share of the torque limit that is injected, as in the paper, and that motion and injection may take together.
AMPLITUDE_SHARE, TOTAL_SHARE = 0.2, 0.9
#: The injection may move the axis by so much (rad), and by this share of the stroke: J_l is constant within it.
MAX_DEVIATION_RAD, MAX_DEVIATION_SHARE = 0.02, 0.01
#: The former method wants this much injected speed over the motion's (method.md, 7).
WANTED_DPR = 0.05
#: Peak speed and acceleration of the 1/3 profile over distance/duration and distance/duration².
_PEAK_SPEED, _PEAK_ACCELERATION = 1.5, 4.5
#: Step of numerical derivatives, relative.
_STEP = 1e-4


@dataclass(frozen=True)
class Stroke:
    """The motion during which J_l shall be estimated; `room_rad` is left beyond it on either side, None: enough."""

    distance_rad: float
    duration_s: float
    room_rad: float | None = None


@dataclass(frozen=True)
class Candidate:
    """One frequency: amplitude and what is to be expected at the worst angle, where J_l is `inertia_kgm2`."""

    frequency_hz: float
    samples: int
    amplitude_nm: float
    inertia_kgm2: float
    noise_kgm2: float
    model_kgm2: float
    blur_kgm2: float
    deviation_rad: float
    dpr: float | None

    @property
    def error_kgm2(self) -> float:
        """Expected error of J_l."""
        return math.hypot(self.noise_kgm2, self.model_kgm2, self.blur_kgm2)

    @property
    def sharp_kgm2(self) -> float:
        """Expected error of J_l without blur."""
        return math.hypot(self.noise_kgm2, self.model_kgm2)

    @property
    def relative(self) -> float:
        """Expected error over J_l."""
        return self.error_kgm2 / self.inertia_kgm2


@dataclass(frozen=True)
class Proposal:
    """What to inject, why, and what else was looked at."""

    best: Candidate
    reasons: tuple[str, ...]
    candidates: tuple[Candidate, ...]

    @property
    def in_phases(self) -> Candidate:
        """For four phases of injection, which have no window to blur J_l; `best` where none has the samples for it."""
        enough = [c for c in self.candidates if c.samples >= _FEWEST_IN_PHASES]
        return min(enough, key=lambda c: c.sharp_kgm2 / c.inertia_kgm2, default=self.best)

    def to_json(self) -> dict[str, Any]:
        """For machines."""
        return {
            "frequency_hz": self.best.frequency_hz,
            "amplitude_nm": self.best.amplitude_nm,
            "expected_error_kgm2": self.best.error_kgm2,
            "reasons": list(self.reasons),
            "in_phases": {
                "frequency_hz": self.in_phases.frequency_hz,
                "amplitude_nm": self.in_phases.amplitude_nm,
                "expected_error_kgm2": self.in_phases.sharp_kgm2,
            },
            "candidates": [vars(c) | {"error_kgm2": c.error_kgm2} for c in self.candidates],
        }


def propose(
    fit: BodeFit,
    machine: Machine,
    sample_rate_hz: float,
    torque_max_nm: float | None = None,
    stroke: Stroke | None = None,
) -> Proposal:
    """Frequency and amplitude for a machine as fitted (`fit.machine`).

    `torque_max_nm`: the limit; None: the motor's peak. `stroke`: None leaves blur, DPR and room out.
    Raises InputError where the machine has no [control], or no frequency of the measured band has ten samples.
    """
    machine.required_control()
    lowest = min(float(r.frequency_hz[r.used].min()) for r in fit.responses)
    highest = max(float(r.frequency_hz[r.used].max()) for r in fit.responses)
    limit = min(torque_max_nm or math.inf, machine.motor.peak_torque_nm)
    candidates = [
        _candidate(n, sample_rate_hz / n, fit, machine, limit, stroke)
        for n in range(_FEWEST_SAMPLES, _MOST_SAMPLES + 1)
        if lowest <= sample_rate_hz / n <= highest
    ]
    if not candidates:
        raise InputError(
            "proposal",
            f"no frequency within {lowest:.3g} … {highest:.3g} Hz has {_FEWEST_SAMPLES} samples a period",
            "Sample faster, or measure the response at lower frequencies.",
        )
    best = min(candidates, key=lambda candidate: candidate.relative)
    return Proposal(best, tuple(_reasons(best, candidates, fit, machine, limit, stroke)), tuple(candidates))


def _candidate(
    samples: int, frequency: float, fit: BodeFit, machine: Machine, limit: float, stroke: Stroke | None
) -> Candidate:
    amplitude = _amplitude(frequency, fit, machine, limit, stroke)
    found = []
    for angle, response in zip(fit.angles, fit.responses, strict=True):
        inertia = angle.inertia.value
        torque = amplitude * float(np.abs(injection_to_torque(machine, inertia, frequency)))
        slope = _slope(machine, inertia, frequency)
        spread = float(np.interp(frequency, response.frequency_hz, response.speed_noise))
        # two runs are subtracted (variance × 2), the real part is taken (÷ 2)
        noise = spread * math.sqrt(frequency) / (abs(slope) * torque)
        model = _model_error(fit, machine, inertia, frequency, slope)
        found.append((inertia, noise, model))
    blur = _blur(fit, frequency, stroke)
    inertia, noise, model = max(found, key=lambda row: math.hypot(row[1], row[2], blur) / row[0])
    range_kgm2 = np.array(fit.inertia_range_kgm2)
    deviation = (
        amplitude * np.abs(injection_to_speed(machine, range_kgm2, frequency)) / (2 * np.pi * frequency)
    )
    dpr = None
    if stroke is not None:
        ratios = disturbance_to_position_ratio(
            machine, range_kgm2, distance_rad=stroke.distance_rad, duration_s=stroke.duration_s,
            frequency_hz=frequency, amplitude_nm=amplitude,
        )  # fmt: skip
        dpr = float(ratios.min())
    return Candidate(
        frequency_hz=frequency,
        samples=samples,
        amplitude_nm=amplitude,
        inertia_kgm2=inertia,
        noise_kgm2=noise,
        model_kgm2=model,
        blur_kgm2=blur,
        deviation_rad=float(deviation.max()),
        dpr=dpr,
    )


def _amplitude(
    frequency: float, fit: BodeFit, machine: Machine, limit: float, stroke: Stroke | None
) -> float:
    """The usual share of the limit, or less where deviation, room or the motion's torque want it."""
    inertia = np.array(fit.inertia_range_kgm2)
    travel = float(np.abs(injection_to_speed(machine, inertia, frequency)).max()) / (2 * np.pi * frequency)
    allowed, room = MAX_DEVIATION_RAD, limit
    if stroke is not None:
        allowed = min(allowed, MAX_DEVIATION_SHARE * abs(stroke.distance_rad), stroke.room_rad or math.inf)
        room = max(TOTAL_SHARE * limit - motion_torque_nm(fit, machine, stroke), 0.05 * limit)
    total = float(np.abs(injection_to_torque(machine, inertia, frequency)).max())
    return min(AMPLITUDE_SHARE * limit, allowed / travel, room / total)


def motion_torque_nm(fit: BodeFit, machine: Machine, stroke: Stroke) -> float:
    """Peak torque that a 1/3 profile takes with the largest inertia; without load torque and what J_l' does."""
    inertia = machine.motor.inertia_kgm2 + fit.inertia_range_kgm2[1]
    return inertia * _PEAK_ACCELERATION * abs(stroke.distance_rad) / stroke.duration_s**2


def _slope(machine: Machine, inertia: float, frequency: float) -> complex:
    """∂G/∂J_l."""
    step = _STEP * inertia
    up, down = (torque_to_speed(machine, inertia + h, frequency) for h in (step, -step))
    return complex(up - down) / (2 * step)


def _model_error(fit: BodeFit, machine: Machine, inertia: float, frequency: float, slope: complex) -> float:
    """What the intervals of J_r, k, b and the delay make of J_l, as if they were independent (kg·m²)."""
    coupling, motor = machine.coupling, machine.motor
    here = complex(torque_to_speed(machine, inertia, frequency))
    late = math.hypot(fit.delay.value, fit.delay.std)  # the estimator knows of no delay
    square = (2j * math.pi * frequency * here * late / slope).real ** 2
    if coupling is None or fit.rotor is None or fit.stiffness is None or fit.damping is None:
        return math.sqrt(square)
    changed = (
        (machine.model_copy(update={"coupling": coupling.model_copy(update={
            "stiffness_nm_rad": coupling.stiffness_nm_rad * (1 + _STEP)})}),
         coupling.stiffness_nm_rad, fit.stiffness.std),
        (machine.model_copy(update={"coupling": coupling.model_copy(update={
            "damping_nms": coupling.damping_nms * (1 + _STEP)})}),
         coupling.damping_nms, fit.damping.std),
        (machine.model_copy(update={"motor": motor.model_copy(update={
            "inertia_kgm2": motor.inertia_kgm2 * (1 + _STEP)})}),
         motor.inertia_kgm2, fit.rotor.std),
    )  # fmt: skip
    for other, value, std in changed:
        if value > 0:
            change = (complex(torque_to_speed(other, inertia, frequency)) - here) / (_STEP * value)
            square += (change / slope).real ** 2 * std**2
    return math.sqrt(square)


def _blur(fit: BodeFit, frequency: float, stroke: Stroke | None) -> float:
    """A window of one period at the stroke's highest speed, on J_0 + ΔJ sin²(πθ/stroke) (kg·m²)."""
    if stroke is None:
        return 0.0
    low, high = fit.inertia_range_kgm2
    return (high - low) * math.pi**2 / 12 * (_PEAK_SPEED / (frequency * stroke.duration_s)) ** 2


def _reasons(
    best: Candidate,
    candidates: Iterable[Candidate],
    fit: BodeFit,
    machine: Machine,
    limit: float,
    stroke: Stroke | None,
) -> Iterable[str]:
    yield f"{best.frequency_hz:.4g} Hz: {best.samples} samples a period, so that the window holds whole periods"
    parts = f"noise {best.noise_kgm2:.2g}, model {best.model_kgm2:.2g}, blur {best.blur_kgm2:.2g}"
    yield f"expected error {best.error_kgm2:.2g} kg·m² at the worst angle ({parts}), the least of all frequencies tried"
    others = list(candidates)
    for name, near in (
        ("lower", [c for c in others if c.frequency_hz < best.frequency_hz / 1.3]),
        ("higher", [c for c in others if c.frequency_hz > best.frequency_hz * 1.3]),
    ):
        if near:
            other = near[0] if name == "lower" else near[-1]
            causes = {"noise": other.noise_kgm2, "model": other.model_kgm2, "blur": other.blur_kgm2}
            worst = max(causes, key=lambda cause: causes[cause])
            yield f"{name}, at {other.frequency_hz:.4g} Hz, {other.error_kgm2:.2g} kg·m², mostly {worst}"
    if fit.coupled:
        low = float(anti_resonance_hz(machine, fit.inertia_range_kgm2[1]))
        side = "below" if best.frequency_hz < low else "above"
        yield f"{side} the lowest anti-resonance, {low:.0f} Hz"
    yield _amplitude_reason(best, limit, stroke)
    if stroke is not None and best.dpr is not None:
        enough = "enough" if best.dpr > WANTED_DPR else "too little"
        yield f"DPR {best.dpr:.3f}: {enough} for the former method, which wants {WANTED_DPR:g}; denoising needs less"
        needed = motion_torque_nm(fit, machine, stroke)
        if needed > TOTAL_SHARE * limit:
            yield (
                f"the motion alone takes about {needed:.3g} of {limit:.3g} N·m: it will be clipped, take longer or use "
                "a method that does not mind"
            )
    else:
        yield "blur, DPR and room were left out: they need the motion (--distance and --duration)"


def _amplitude_reason(best: Candidate, limit: float, stroke: Stroke | None) -> str:
    moved = f"the axis deviates by {best.deviation_rad:.2g} rad"
    if best.amplitude_nm >= AMPLITUDE_SHARE * limit * (1 - 1e-9):
        return f"{best.amplitude_nm:.3g} N·m: {AMPLITUDE_SHARE:.0%} of the torque limit, as in the paper; {moved}"
    bound = MAX_DEVIATION_RAD
    if stroke is not None:
        bound = min(bound, MAX_DEVIATION_SHARE * abs(stroke.distance_rad), stroke.room_rad or math.inf)
    why = "that much keeps J_l constant" if best.deviation_rad > 0.99 * bound else "the motion needs the rest"
    return f"{best.amplitude_nm:.3g} N·m: {moved}, {why}"
