"""What the injection adds to a motion: the mean motion, and the ripple around it, free of the motion itself.

Runs of one motion with the injected phases φ_m: at every instant x_m = x_0 + Re(z e^{jφ_m}) + even terms. With
four equally spaced phases or more (an even number) the sum 2/M Σ x_m e^{−jφ_m} is z: the opposite pairs cancel
the motion and every even non-linearity, the quadrature pairs make z complex, the machine's answer to e^{jωt},
at every instant, without a window. A reference and one excited run leave Re(z e^{jφ}) only, even terms included.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from schwung.errors import InputError
from schwung.estimation.denoise import check_aligned, same_motion
from schwung.estimation.sampling import fundamental
from schwung.estimation.sdft import ComplexArray
from schwung.estimation.values import Denoised
from schwung.innovations.signals import LOSS_STD
from schwung.motion import Array
from schwung.session.model import Run

#: Fewer phases than this do not cancel the even non-linearities.
MIN_PHASES = 4
#: Phases may be off the equal spacing by so much (rad).
PHASE_TOLERANCE = 1e-3
#: Injections count as one when amplitude and ramp agree to this share.
SAME_INJECTION = 1e-6
#: Attribute of a run with a held injection: how sure it is when its controller's torque acted, s.
CONTROLLER_STD = "controller_lag_std_s"


@dataclass(frozen=True, eq=False)
class Ripple:
    """Motor signals, (n,): of the mean motion, and of the ripple (complex: the answer to e^{jωt}; or real)."""

    name: str
    runs: tuple[Run, ...]
    frequency_hz: float
    sample_rate_hz: float
    time_s: Array
    position_rad: Array
    speed_rad_s: Array
    torque_nm: Array
    ripple_position_rad: ComplexArray
    ripple_speed_rad_s: ComplexArray
    ripple_torque_nm: ComplexArray
    phases_rad: tuple[float, ...]
    real: bool  # one phase only: the ripple is its real part
    loss_std_s2: float = 0.0  # of the torque, see LOSS_STD
    held_torque_nm: ComplexArray | None = (
        None  # the injection's share of the ripple's torque, where it was held
    )
    controller_std_s: float = 0.0  # see CONTROLLER_STD


def phase_groups(excited: Sequence[Run]) -> tuple[tuple[Run, ...], ...]:
    """The runs in groups of equally spaced phases, four or more and an even number; the others left out.

    Of each repeat by itself where it has all phases; where none has, of all repeats together.
    """
    alike: list[list[Run]] = []
    for run in excited:
        for group in alike:
            if _same_injection(group[0], run):
                group.append(run)
                break
        else:
            alike.append([run])
    groups: list[tuple[Run, ...]] = []
    for candidates in alike:
        repeats = sorted({run.repeat for run in candidates})
        each = [_complete([run for run in candidates if run.repeat == repeat]) for repeat in repeats]
        found = [group for group in each if group]
        together = _complete(candidates)
        groups += found or ([together] if together else [])
    return tuple(groups)


def _same_injection(first: Run, second: Run) -> bool:
    one, other = first.excitation, second.excitation
    assert one is not None  # guaranteed by Run
    assert other is not None
    numbers = [
        (one.frequency_hz, other.frequency_hz),
        (one.amplitude_nm, other.amplitude_nm),
        (one.ramp_s or 0.0, other.ramp_s or 0.0),
    ]
    return same_motion(first, second) and all(abs(a - b) <= SAME_INJECTION * max(a, b) for a, b in numbers)


def _complete(runs: Sequence[Run]) -> tuple[Run, ...]:
    """The runs, one at least per phase and equally many of each; empty where the phases are not equally spaced."""
    by_phase: dict[int, list[Run]] = {}
    for run in runs:
        assert run.excitation is not None  # guaranteed by Run
        phase = run.excitation.phase_rad % (2 * np.pi)
        by_phase.setdefault(round(phase / PHASE_TOLERANCE) % round(2 * np.pi / PHASE_TOLERANCE), []).append(
            run
        )
    count = len(by_phase)
    if count < MIN_PHASES or count % 2:
        return ()
    angles = np.sort(
        [run[0].excitation.phase_rad % (2 * np.pi) for run in by_phase.values() if run[0].excitation]
    )
    spacing = np.diff(np.append(angles, angles[0] + 2 * np.pi))
    if np.any(np.abs(spacing - 2 * np.pi / count) > 2 * PHASE_TOLERANCE):
        return ()
    fewest = min(len(found) for found in by_phase.values())
    return tuple(run for found in by_phase.values() for run in found[:fewest])


def ripple_of_phases(runs: Sequence[Run]) -> Ripple:
    """Mean motion and complex ripple of a group of phases. Raises InputError where the runs do not align."""
    first = runs[0]
    assert first.excitation is not None  # guaranteed by Run
    for run in runs[1:]:
        check_aligned(first, run)
    n = min(len(run) for run in runs)
    phases = np.array([run.excitation.phase_rad for run in runs if run.excitation])
    taken = np.exp(-1j * phases) * 2 / len(runs)

    def both(name: str) -> tuple[Array, ComplexArray]:
        values = np.vstack([getattr(run, name)[:n] for run in runs])
        return values.mean(axis=0), np.asarray(taken @ values)

    held = np.vstack([injection_of(run)[:n] for run in runs]) if first.is_held else None
    position, speed, torque = both("position_rad"), both("speed_rad_s"), both("torque_nm")
    return Ripple(
        name=f"{first.name or 'excited run'} and {len(runs) - 1} of other phases",
        runs=tuple(runs),
        frequency_hz=first.excitation.frequency_hz,
        sample_rate_hz=first.sample_rate_hz,
        time_s=first.time_s[:n],
        position_rad=position[0],
        speed_rad_s=speed[0],
        torque_nm=torque[0],
        ripple_position_rad=position[1],
        ripple_speed_rad_s=speed[1],
        ripple_torque_nm=torque[1],
        phases_rad=tuple(phases.tolist()),
        real=False,
        loss_std_s2=float(first.extra.get(LOSS_STD, 0.0)),
        held_torque_nm=None if held is None else np.asarray(taken @ held),
        controller_std_s=float(first.extra.get(CONTROLLER_STD, 0.0)),
    )


def injection_of(run: Run) -> Array:
    """What a run made ready (`sampling.prepared`) holds of a held injection (N·m), (n,); zeros where it has none."""
    return np.zeros(len(run)) if run.torque_added_nm is None else fundamental(run.torque_added_nm)


def ripple_of_pair(pair: Denoised) -> Ripple:
    """Motion and real ripple of a reference and an excited run."""
    n = pair.time_s.size
    assert pair.excited.excitation is not None  # guaranteed by Run
    return Ripple(
        name=pair.excited.name or "excited run",
        runs=(pair.excited,),
        frequency_hz=pair.excited.excitation.frequency_hz,
        sample_rate_hz=pair.excited.sample_rate_hz,
        time_s=pair.time_s,
        position_rad=pair.position_rad,
        speed_rad_s=pair.reference.speed_rad_s[:n],
        torque_nm=pair.reference.torque_nm[:n],
        ripple_position_rad=pair.position_deviation_rad.astype(np.complex128),
        ripple_speed_rad_s=pair.speed_rad_s.astype(np.complex128),
        ripple_torque_nm=pair.torque_nm.astype(np.complex128),
        phases_rad=(0.0,),
        real=True,
        loss_std_s2=float(pair.excited.extra.get(LOSS_STD, 0.0)),
        held_torque_nm=injection_of(pair.excited)[:n].astype(np.complex128) if pair.excited.is_held else None,
        controller_std_s=float(pair.excited.extra.get(CONTROLLER_STD, 0.0)),
    )


def require_groups(excited: Sequence[Run]) -> tuple[tuple[Run, ...], ...]:
    """`phase_groups`; raises InputError where there is none."""
    groups = phase_groups(excited)
    if not groups:
        phases = sorted({round(run.excitation.phase_rad, 3) for run in excited if run.excitation})
        raise InputError(
            "session",
            f"has no four equally spaced phases of the injection (phases: {', '.join(f'{p:g}' for p in phases)} rad)",
            'Record with --phases 4, or estimate with method "denoised".',
        )
    return groups
