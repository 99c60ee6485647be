"""Four runs or more with equally spaced phases of the injection: J_l without window and lag, all at once.

Beats the sliding DFT by what it does not average: see `ripple.py` for the phases and `balance.py` for the
balance that the ripple obeys. The rules, none of which belongs to one machine: the equations' band is 0.25 to
2.5 times the injected frequency; the curve's roughness is what the record's own likelihood asks for; weights of
speed against differentiated angle, and of one group against another, follow from the noise found in them.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import numpy as np

from schwung.drivetrain.inertia import InertiaTable
from schwung.drivetrain.machine import Machine
from schwung.errors import InputError
from schwung.estimation.fit import CurveFit, fit_curve
from schwung.estimation.methods import Outcome, Suitability, Task, register, strokes_of
from schwung.estimation.ripple import Ripple, phase_groups, require_groups, ripple_of_phases
from schwung.estimation.sdft import ComplexArray, samples_per_window
from schwung.estimation.table import DEFAULT_POINTS
from schwung.estimation.values import Trace
from schwung.motion import Array

#: Cells whose standard deviation exceeds this share of their value hold no information worth a number.
MAX_RELATIVE_STD = 0.25


class MultiphaseMethod:
    """Ours: injection phases that cancel the motion, and a fit of the whole curve to what is left."""

    name = "multiphase"
    needs_reference = False
    joint = True  # one curve for all frequencies

    def suits(self, task: Task) -> Suitability | None:
        """Wherever the phases are complete."""
        groups = phase_groups(task.excited)
        if not groups:
            return None
        return Suitability(
            3.0, f"{len(groups[0])} equally spaced phases cancel motion and even non-linearities"
        )

    def traces(self, task: Task) -> Outcome:
        """Combine the phases of each repeat, fit one curve to all."""
        groups = require_groups(task.excited)
        samples_per_window(groups[0][0].sample_rate_hz, task.frequency_hz)  # too few are named there
        fit = fit_curve([ripple_of_phases(group) for group in groups], task.machine)
        _check_physical(fit, task.machine)
        table, notes = table_of(fit, task.points or DEFAULT_POINTS)
        left_out = len(task.excited) - sum(len(group) for group in groups)
        if left_out:
            notes.append(f"{left_out} excited runs belong to no complete set of phases and were left out.")
        traces = tuple(_trace(fit, number) for number in range(len(groups)))
        return Outcome(traces, notes=tuple(notes + friction_notes(fit)), table=table, windowed=False, fit=fit)


register(MultiphaseMethod())


def table_of(fit: CurveFit, points: int) -> tuple[InertiaTable, list[str]]:
    """The curve at so many angles, cells without information left out; and what has to be said about it.

    Raises InputError where the ripple is lost in noise or fewer than two cells are left.
    """
    angle = np.linspace(fit.basis.low_rad, fit.basis.high_rad, points)
    inertia, std = fit.inertia_at(angle), fit.std_at(angle)
    known = (inertia > 0) & (std < MAX_RELATIVE_STD * inertia) & fit.passed(angle)
    if known.sum() < 2:
        raise InputError(
            fit.ripples[0].name,
            "torque and speed of the ripple give no positive inertia that stands clear of the noise",
            "See whether the drive applies the injection and reports the total torque with its sign; inject more.",
        )
    notes = []
    if not known.all():
        notes.append(f"{int(np.sum(~known))} of {points} angles hold no information and were left out.")
    return InertiaTable(angle[known], inertia[known], std[known]), notes


def _check_physical(fit: CurveFit, machine: Machine) -> None:
    """Raises InputError where torque and speed do not belong together, and says what would mend it."""
    if fit.physical:
        return

    def would(change: Callable[[Ripple], ComplexArray]) -> bool:
        return fit_curve([replace(r, ripple_torque_nm=change(r)) for r in fit.ripples], machine).physical

    if would(lambda ripple: -ripple.ripple_torque_nm):
        why = "with the torque's sign reversed they do"
        remedy = "Correct the sign of torque (or of speed and position) in the recording or the profile."
    elif would(lambda ripple: ripple.ripple_torque_nm + _injected(ripple)):
        why = "the reported torque seems to leave the injected part out"
        remedy = "Record the total motor torque, or add torque_added to torque."
    else:
        why = f"{100 * fit.unexplained_share:.0f} % of the torque's power stays unexplained"
        remedy = (
            "See whether the drive applies the injection; check rotor inertia, stiffness, units and delay."
        )
    raise InputError(fit.ripples[0].name, f"torque and speed do not fit this machine; {why}", remedy)


def _injected(ripple: Ripple) -> ComplexArray:
    """The injected part as commanded."""
    runs = ripple.runs
    each = [run.excitation.torque(ripple.time_s) for run in runs if run.excitation]
    return np.asarray(np.exp(-1j * np.array(ripple.phases_rad)) @ np.vstack(each) * 2 / len(runs))


def friction_notes(fit: CurveFit) -> list[str]:
    """What the fit found beside the inertia, where it is clear."""
    notes = []
    for found, what, unit in (
        (fit.viscous_nms, "viscous friction", "N·m·s/rad"),
        (fit.dry_nm, "dry friction", "N·m"),
    ):
        if found.clear:
            notes.append(f"{what} of {found.value:+.2g} ± {2 * found.std:.1g} {unit} beyond the machine file "
                         "was found and allowed for.")  # fmt: skip
    return notes


def _trace(fit: CurveFit, number: int) -> Trace:
    """The curve along one group's motion, plus what each instant would have it differ by, over one period."""
    load, ripple = fit.loads[number], fit.ripples[number]
    window = samples_per_window(ripple.sample_rate_hz, ripple.frequency_hz)
    rate = 2j * np.pi * ripple.frequency_hz * load.ripple_speed_rad_s
    span = np.hanning(window + 2)[1:-1]
    power = _around(rate * np.conj(rate), span).real
    usable = (load.fade >= 1) & (power > 0.05 * np.median(power[load.fade >= 1]))
    with np.errstate(divide="ignore", invalid="ignore"):
        off = _around(fit.unexplained(number) * np.conj(rate), span) / power
    off = np.where(usable, off, np.nan)
    inertia = fit.inertia_at(load.angle_rad) + off.real
    variation = np.full_like(inertia, np.nan)
    variation[window:] = inertia[window:] - inertia[:-window]
    torque = np.abs(load.driving_torque_nm)
    return Trace(
        time_s=ripple.time_s,
        position_rad=load.angle_rad,
        inertia_kgm2=inertia,
        imaginary_kgm2=off.imag,
        inertia_variation_kgm2=variation,
        speed_amplitude_rad_s=np.where(usable, np.abs(load.motor_speed_rad_s), np.nan),
        torque_amplitude_nm=np.where(usable, torque, np.nan),
        stroke=strokes_of(ripple.runs[0], ripple.time_s, ripple.position_rad, ripple.time_s),
        name=ripple.name,
    )


def _around(values: ComplexArray, span: Array) -> ComplexArray:
    return np.asarray(np.convolve(values, span, "same"))
