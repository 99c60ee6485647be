"""Method `trajectory`: the whole of every run explained at once, by one J_l(θ), load torque and friction.

No window, no lag and no superposition: the model is driven by the torque as measured, so that a clipped torque or a
motion of a few periods is as good as any. All runs of the session count, excited or not, whatever their phase or
frequency. The band is the posterior's: what noise and unknown friction, load torque, delays and coupling leave open,
and between samples of a held injection what the controller answers there.
"""

from __future__ import annotations

from functools import partial

import numpy as np
from pydantic import ValidationError

from schwung.drivetrain.inertia import InertiaTable
from schwung.drivetrain.machine import Coupling, Machine
from schwung.errors import InputError
from schwung.estimation.choice import clipped_share
from schwung.estimation.delay import amplitudes_restored
from schwung.estimation.evidence import ripple_fit
from schwung.estimation.fit import NOTHING, Nuisance
from schwung.estimation.left_out import LEFT_OUT
from schwung.estimation.methods import Outcome, Suitability, Task, register
from schwung.estimation.report import unknown_answer
from schwung.estimation.table import DEFAULT_POINTS
from schwung.estimation.trajectory_fit import Fit, fit
from schwung.estimation.trust import MAX_CLIPPED_SHARE

#: Where the band is wider than this share of the inertia itself, there was no information.
UNKNOWN = 0.3
#: A torque that the model misses by more than this share of its rms belongs to another machine, or has the wrong sign.
UNEXPLAINED = 0.3
#: A model that misses so many times the noise of the torque's own samples leaves physics out.
MISFIT = 4.0


class TrajectoryMethod:
    """A spline J_l(θ) with the smoothness that the data call for, fitted to the whole session."""

    name = "trajectory"
    needs_reference = False
    joint = True  # one curve for all frequencies
    robust = True  # stiffness and damping are found as well, and clipped torque does no harm

    def suits(self, task: Task) -> Suitability | None:
        """Where superposition fails, or nothing takes the motion out of the excited runs."""
        share = clipped_share(task)
        if share > MAX_CLIPPED_SHARE:
            return Suitability(
                4.0,
                f"the torque is clipped in up to {100 * share:.0f} % of a run, where motion and injection do not add",
            )
        return Suitability(0.5, "there is neither a reference run nor a full set of injection phases")

    def traces(self, task: Task) -> Outcome:
        """Fit, and tabulate with the posterior's standard deviation."""
        session = amplitudes_restored(task.recorded or task.session, task.session)
        how = partial(
            fit, session.runs, task.machine, rotary=session.axis == "rotary", start=task.start or _near(task)
        )
        found = how()
        if found.shown and _misses(found):  # what takes a part of something else says nothing
            found = how(without=True)
        _check_explained(found)
        hidden = max((unknown_answer(run, task.machine) for run in session.runs if run.is_held), default=0.0)
        table, notes = _table(found, task.points or DEFAULT_POINTS, hidden)
        return Outcome(
            table=table,
            notes=(*notes, *_notes(found)),
            windowed=False,
            machine=_as_found(found),
            missed=_missed(found),
            misses=_misses(found),
            stiffer=_stiffer(found),
            shown=found.shown,
        )


register(TrajectoryMethod())


def _near(task: Task) -> InertiaTable | None:
    """The curve that the ripple by itself tells: from a constant, a noisy fit may end at another coupling."""
    if clipped_share(task) > MAX_CLIPPED_SHARE:
        return None
    ripples = ripple_fit(task, task.machine)
    if ripples is None:
        return None
    grid = np.linspace(ripples.basis.low_rad, ripples.basis.high_rad, DEFAULT_POINTS)
    inertia = ripples.inertia_at(grid)
    return InertiaTable(grid, inertia) if np.all(inertia > 0) else None


def _table(found: Fit, points: int, hidden: float = 0.0) -> tuple[InertiaTable, tuple[str, ...]]:
    """The table over all visited angles that the data say something about.

    `hidden`: share of the torque that may hide between samples, and all inertia with it.
    """
    basis = found.model.layout.basis
    grid = np.linspace(basis.low_rad, basis.high_rad, points)
    inertia, deviation = found.inertia_at(grid)
    if hidden:
        deviation = np.hypot(deviation, hidden * (inertia + found.model.machine.motor.inertia_kgm2))
    keep = deviation < UNKNOWN * inertia
    if keep.sum() < 2:
        raise InputError(
            "session",
            "says nothing of the inertia: no angle has a band narrower than "
            f"{100 * UNKNOWN:.0f} % of its value",
            "Accelerate more, inject more, or record more runs.",
        )
    notes = (
        ()
        if keep.all()
        else (f"{int(np.sum(~keep))} of {points} angles are not determined and were left out.",)
    )
    return InertiaTable(grid[keep], inertia[keep], deviation[keep]), notes


def _as_found(found: Fit) -> Machine:
    """The machine with the stiffness and damping that were found.

    Raises InputError where those are none that a machine file may hold: samples that belong to no one motion, as of a
    bus that stalled, let a fit run away.
    """
    believed, at = found.model.machine, found.model.layout
    if believed.coupling is None:
        return believed
    with np.errstate(over="ignore"):
        stiffer, damped = np.exp(found.parameters[[at.stiffness, at.damping]])
    try:
        coupling = Coupling(
            stiffness_nm_rad=believed.coupling.stiffness_nm_rad * float(stiffer),
            damping_nms=believed.coupling.damping_nms * float(damped),
        )
    except ValidationError:
        raise InputError(
            "session",
            f"fits no coupling: it would be {stiffer:.2g} times as stiff as the machine file says and damp "
            f"{damped:.2g} times as much",
            "Record it anew, more slowly where samples came late; else check units, rotor inertia and stiffness.",
        ) from None
    return believed.model_copy(update={"coupling": coupling})


def _stiffer(found: Fit) -> Nuisance:
    """How far the stiffness is from the machine file's, relative."""
    at = found.model.layout.stiffness
    if found.model.machine.coupling is None:
        return NOTHING
    return Nuisance(float(np.expm1(found.parameters[at])), found.std_of(at))


def _missed(found: Fit) -> float:
    """The torque that the model misses beyond the noise of its samples, over all torque (both rms)."""
    torque = np.concatenate([run.drive.smooth_nm for run in found.runs])
    beyond = max(found.noise.torque_nm**2 - _sensor_noise(found) ** 2, 0.0)
    return float(np.sqrt(beyond / max(float(np.mean(torque**2)), 1e-300)))


def _check_explained(found: Fit) -> None:
    torque = np.concatenate([run.drive.smooth_nm for run in found.runs])
    missed = found.noise.torque_nm / max(float(np.sqrt(np.mean(torque**2))), 1e-300)
    if missed > UNEXPLAINED:
        raise InputError(
            "session",
            f"the torque that no inertia, friction or load explains is {100 * missed:.0f} % of all torque (rms)",
            "Check the sign of torque and speed, units, rotor inertia and stiffness.",
        )


def _notes(found: Fit) -> tuple[str, ...]:
    at, noise = found.model.layout, found.noise
    values, deviations = found.parameters, np.sqrt(np.diag(found.covariance))

    def told(name: str, index: int, unit: str, scale: float = 1.0) -> str:
        return f"{name} {scale * values[index]:.3g} ± {scale * deviations[index]:.2g} {unit}".strip()

    hidden = [
        told(LEFT_OUT[one].words, at.left_out.start + one, "N·m" if LEFT_OUT[one].of_peak else "")
        for one in found.shown
    ]
    missed, sensor = noise.torque_nm, _sensor_noise(found)
    lines = [
        f"Noise found: torque {noise.torque_nm:.2g} N·m, speed {noise.speed_rad_s:.2g} rad/s, "
        f"position {noise.position_rad:.2g} rad.",
        "Estimated beside the inertia: "
        + ", ".join(
            [
                told("dry friction", at.coulomb, "N·m"),
                told("viscous friction beyond the machine file's", at.viscous, "N·m·s/rad"),
                told("torque delay", at.torque_delay, "ms", 1e3),
                told("speed delay", at.speed_delay, "ms", 1e3),
                *hidden,
            ]
        )
        + ".",
    ]
    if _misses(found):
        lines.append(
            f"The model misses {missed:.2g} N·m (rms), {missed / sensor:.0f} times the noise of the torque itself: "
            "the machine does something that the model does not hold, and the inertia's band is wider for it."
        )
    if not found.converged:
        lines.append(f"The fit had not settled after {found.iterations} iterations.")
    return tuple(lines)


def _misses(found: Fit) -> bool:
    """Whether the model leaves physics out."""
    return found.noise.torque_nm > MISFIT * _sensor_noise(found)


def _sensor_noise(found: Fit) -> float:
    """The noise of the torque's samples (N·m), from third differences: what no machine could follow."""
    bends = np.concatenate([np.diff(run.drive.smooth_nm, 3) for run in found.runs])
    return max(float(np.sqrt(found.every * np.mean(bends**2) / 20)), 1e-300)
