"""Take the motion out of an excited run: subtract the run without injection (paper, 3.2, equation 11)."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from schwung.errors import InputError
from schwung.estimation.sdft import samples_per_window
from schwung.estimation.values import Denoised
from schwung.motion import Array, Motion
from schwung.session.model import Run, Session

#: Runs whose paths differ by more than this share of the stroke (rms, sine averaged out) are not one motion.
MAX_PATH_DIFFERENCE = 0.02
#: Where a shift in time explains this share of the difference (injection alone: below 0.01), it is a shift.
SHIFT_EXPLAINS = 0.8
MAX_SHIFT_SAMPLES = 0.5
#: Recordings of one motion may differ in length by so many periods; the longer one is cut.
MAX_LENGTH_DIFFERENCE_PERIODS = 1.0


def denoise(session: Session, excited: Sequence[Run]) -> tuple[Denoised, ...]:
    """Pair each excited run with its reference and subtract.

    The reference is the run without injection of the same motion and the same repeat; where that repeat has
    none, the mean of all references of the motion. Pairing repeat by repeat costs no noise in the end, as the
    pairs are averaged later, follows a machine that warms up, and leaves the scatter between pairs honest.

    Raises InputError when a reference is missing or does not align: other rate, length, start or path.
    """
    return tuple(_subtract(_reference_for(session, run), run) for run in excited)


def _reference_for(session: Session, excited: Run) -> Run:
    if not session.references:
        raise InputError(
            excited.name or "session",
            "has no reference run, a motion without injection",
            'Record one, or estimate with method "former", which needs none but wants slow motions.',
        )
    same = [run for run in session.references if same_motion(run, excited)]
    if not same:
        motions = "; ".join(sorted({_motion_text(run) for run in session.references}))
        raise InputError(
            excited.name or "excited run",
            f"no reference run has its motion ({_motion_text(excited)}; references: {motions})",
            "Record a reference of the very same motion.",
        )
    repeated = [run for run in same if run.repeat == excited.repeat]
    chosen = repeated or same
    for run in chosen:
        check_aligned(run, excited)
    return chosen[0] if len(chosen) == 1 else _mean(chosen, excited)


def same_motion(first: Run, second: Run) -> bool:
    """Whether the same was commanded; keys of later versions do not count. Without `motion` paths decide."""
    if first.motion is None or second.motion is None:
        return first.motion is second.motion
    return all(getattr(first.motion, key) == getattr(second.motion, key) for key in Motion.model_fields)


def _motion_text(run: Run) -> str:
    motion = run.motion
    if motion is None:
        return "motion not given"
    return f"{motion.kind}, {motion.distance_rad:g} in {motion.duration_s:g} s from {motion.start_time_s:g} s"


def check_aligned(reference: Run, excited: Run) -> None:
    """Rate, start, length and path must agree. Raises InputError that names both runs and what is off."""
    place = f"{excited.name or 'excited run'} and {reference.name or 'its reference'}"
    rate = excited.sample_rate_hz
    if abs(reference.sample_rate_hz - rate) > 1e-6 * rate:
        raise InputError(place, f"are sampled at {rate:g} and {reference.sample_rate_hz:g} Hz",
                         "Record both at one rate, or resample one.")  # fmt: skip
    shift = (excited.time_s[0] - reference.time_s[0]) * rate
    if abs(shift) > 0.5:
        raise InputError(
            place,
            f"start {abs(shift):.1f} samples apart on their own clocks",
            "Cut both so that time is 0 at the start trigger and the first samples coincide.",
        )
    assert excited.excitation is not None  # a Run with this role has one
    period = samples_per_window(rate, excited.excitation.frequency_hz)
    if abs(len(reference) - len(excited)) > MAX_LENGTH_DIFFERENCE_PERIODS * period:
        raise InputError(place, f"have {len(excited)} and {len(reference)} samples",
                         "Record both over the whole motion.")  # fmt: skip
    _check_path(reference, excited, period, place)


def _check_path(reference: Run, excited: Run, period: int, place: str) -> None:
    """Both must run along one path, the sine averaged out: else the start trigger or the motion differs."""
    length = min(len(reference), len(excited))
    window = np.ones(period) / period
    path = reference.position_rad[:length]
    difference = np.convolve(excited.position_rad[:length] - path, window, "valid")
    stroke = float(np.ptp(path))
    rms = float(np.sqrt(np.mean(difference**2)))
    speed = np.convolve(reference.speed_rad_s[:length], window, "valid")
    late = -float(np.dot(speed, difference)) / max(float(np.dot(speed, speed)), 1e-300)
    explained = 1 - float(np.mean((difference + late * speed) ** 2)) / max(rms**2, 1e-300)
    if explained > SHIFT_EXPLAINS and abs(late) * excited.sample_rate_hz >= MAX_SHIFT_SAMPLES:
        order = "later" if late > 0 else "earlier"
        raise InputError(
            place,
            f"follow one path, but the excited one {abs(late) * 1e3:.1f} ms {order}",
            "Align both on the drive's start trigger.",
        )
    if rms > MAX_PATH_DIFFERENCE * stroke:
        raise InputError(
            place,
            f"do not follow one path: {rms:.3g} apart (rms) in a stroke of {stroke:.3g}",
            "Record both with the same motion, from the same rest position, below the torque limit.",
        )


def _mean(runs: Sequence[Run], excited: Run) -> Run:
    """The mean of several references, as one run."""
    length = min(*(len(run) for run in runs), len(excited))

    def mean(name: str) -> Array:
        return np.asarray(np.mean([getattr(run, name)[:length] for run in runs], axis=0))

    return replace(
        runs[0],
        time_s=runs[0].time_s[:length],
        position_rad=mean("position_rad"),
        speed_rad_s=mean("speed_rad_s"),
        torque_nm=mean("torque_nm"),
        position_demand_rad=None,
        torque_added_nm=None,
        name=f"mean of {len(runs)} references",
        extra={},
    )


def _subtract(reference: Run, excited: Run) -> Denoised:
    n = min(len(reference), len(excited))
    return Denoised(
        time_s=excited.time_s[:n],
        position_rad=reference.position_rad[:n],
        speed_rad_s=excited.speed_rad_s[:n] - reference.speed_rad_s[:n],
        torque_nm=excited.torque_nm[:n] - reference.torque_nm[:n],
        position_deviation_rad=excited.position_rad[:n] - reference.position_rad[:n],
        reference=reference,
        excited=excited,
    )
