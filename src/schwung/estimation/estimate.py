"""A session and a machine make an estimate: load inertia over angle, its band and the trust it deserves."""

from __future__ import annotations

from dataclasses import replace

from schwung.drivetrain.machine import Machine
from schwung.errors import InputError
from schwung.estimation.choice import AUTO, Choice, is_joint, is_robust, leaves_much, ranked
from schwung.estimation.delay import delay_removed
from schwung.estimation.evidence import at_least, gather, relative_band, widened
from schwung.estimation.left_out import LEFT_OUT
from schwung.estimation.methods import Method, Task, excited_at, frequencies_of, method_named
from schwung.estimation.sampling import prepared
from schwung.estimation.sdft import samples_per_window
from schwung.estimation.table import Combined, combine, combine_tables
from schwung.estimation.trust import judge
from schwung.estimation.values import Denoised, Estimate, Inversion, Trace, Trust
from schwung.session.effort import require_alike
from schwung.session.model import Session

__all__ = ["Denoised", "Estimate", "Trace", "Trust", "estimate"]


def estimate(
    session: Session,
    machine: Machine,
    method: str = AUTO,
    inversion: Inversion = "complex",
    *,
    frequency_hz: float | None = None,
    points: int | None = None,
    remove_delay: bool = True,
) -> Estimate:
    """Estimate J_l over the load angle from every excited run of a session.

    `method`: any registered name, as "multiphase" (four injection phases), "denoised" (reference runs) or "former";
    "auto" takes the best that the session allows, or where its verdict is not good, a more robust one that is expected
    to be less far off, or where much of the record would lie idle, one that uses motion and injection together; the
    notes say why. `inversion`: "complex" or "magnitude", where the method inverts. `frequency_hz`: of one excitation;
    None: all, each with the weight it deserves. `points`: of the table, at most. `remove_delay`: look for a delay of
    speed behind torque and remove it where it is significant, which the notes say. On a linear axis every quantity has
    its linear counterpart: m, m/s, N, kg; where the session's effort is a current, A and A·s²/rad.

    Raises InputError, naming run, problem and remedy: reference or phase missing, runs that do not align, too few
    samples per period, sine too weak, torque of the wrong sign or without the injected part.
    """
    if inversion not in ("complex", "magnitude"):
        raise InputError("inversion", f'there is no "{inversion}"', 'Use "complex" or "magnitude".')
    require_alike(session, machine)
    ready = prepared(session)
    excited, frequency = excited_at(ready, frequency_hz)
    task = Task(ready, excited, machine, frequency, inversion, session, points)
    choices = ranked(task) if method == AUTO else (Choice(method_named(method), ""),)
    notes: tuple[str, ...] = (choices[0].reason,) if choices[0].reason else ()
    if remove_delay:
        ready, said = delay_removed(ready, excited, machine)
        excited, _ = excited_at(ready, frequency_hz)
        task, notes = replace(task, session=ready, excited=excited), notes + said
    found = _by(choices[0].method, task)
    for choice in choices[1:]:
        if not is_robust(choice.method):
            continue
        if found.trust.verdict != "good":
            found, said = _better_of(found, choice.method, task)
            notes += said
        elif leaves_much(task, windowed=bool(found.denoised)):
            found, said = _narrower_of(found, choice.method, task)
            notes += said
    table = replace(found.table, effort=session.effort)
    return replace(found, table=table, notes=notes + found.notes)


def _by(how: Method, task: Task) -> Estimate:
    """One method on all frequencies."""
    frequencies = frequencies_of(task.excited)
    if len(frequencies) == 1 or is_joint(how):
        return _one(how, task)
    return _several(how, task, frequencies)


def _better_of(found: Estimate, how: Method, task: Task) -> tuple[Estimate, tuple[str, ...]]:
    """The estimate at hand or that of another method, whichever is expected to be nearer; and what to say about it."""
    doubts = "; ".join(found.trust.reasons[:2])
    try:
        other = _by(how, task)
    except InputError as error:
        return found, (
            f"Method {found.method} is in doubt ({doubts}), but {how.name} cannot be used: {error}",
        )
    mine, others = found.trust.predicted_error, other.trust.predicted_error
    if mine is None or others is None or others >= mine:
        return found, (f"Method {found.method} is in doubt ({doubts}); {how.name} does no better.",)
    return other, (
        f"Method {found.method} is in doubt ({doubts}); {how.name}, which is robust against more, was taken.",
    )


def _narrower_of(found: Estimate, how: Method, task: Task) -> tuple[Estimate, tuple[str, ...]]:
    """The estimate at hand, or that of a method which takes more of the record: where it is as sure of itself and its
    band is narrower. What the former saw of the ripple stays beside it.
    """
    try:
        other = _by(how, replace(task, start=found.table))
    except InputError:
        return found, ()
    mine, others = (relative_band(one.table) for one in (found, other))
    # of what the record shows and the favourite leaves out, its band knows nothing
    better = other.shown or (mine is not None and others is not None and others < mine)
    if mine is None or others is None or other.trust.verdict != "good" or not better:
        return found, ()
    seen = found.trust
    trust = replace(
        other.trust,
        miv_kgm2=seen.miv_kgm2,
        relative_miv=seen.relative_miv,
        position_amplitude_rad=seen.position_amplitude_rad,
        position_dc_rad=seen.position_dc_rad,
    )
    why = (
        f"the record shows {' and '.join(other.shown)}, of which {found.method} knows nothing"
        if other.shown
        else f"it uses motion and injection together, and expects ±{100 * others:.2g} % of the inertia where "
        f"{found.method} expects ±{100 * mine:.2g} % (1σ)"
    )
    said = f"Method {how.name} was taken: {why}."
    return replace(other, trust=trust, traces=found.traces, denoised=found.denoised), (said,)


def _one(how: Method, task: Task) -> Estimate:
    """One method, once."""
    outcome = how.traces(task)
    if outcome.table is not None:
        combined = Combined(outcome.table, ())
    else:
        windows = [samples_per_window(run.sample_rate_hz, task.frequency_hz) for run in task.excited]
        combined = combine(outcome.traces, windows, task.points)
    slow = not how.needs_reference and outcome.windowed
    evidence = gather(outcome, task, combined.table)
    return Estimate(
        method=how.name,
        inversion=task.inversion,
        frequency_hz=task.frequency_hz,
        table=widened(combined.table, evidence.left_out),
        traces=outcome.traces,
        denoised=outcome.denoised,
        trust=judge(outcome, task, combined.table, evidence, needs_slow_motion=slow),
        notes=outcome.notes + combined.notes,
        shown=tuple(dict.fromkeys(LEFT_OUT[one].kind for one in outcome.shown)),
    )


def _several(how: Method, task: Task, frequencies: tuple[float, ...]) -> Estimate:
    """One estimate per frequency, their tables weighted by inverse variance; trust is that of the weightiest.

    What is left out of the bands is not averaged away: it is the same in all, as far as anybody knows.
    """
    each: list[Estimate] = []
    failed: list[InputError] = []
    for frequency in frequencies:
        excited, _ = excited_at(task.session, frequency)
        try:
            each.append(_one(how, replace(task, excited=excited, frequency_hz=frequency)))
        except InputError as error:
            failed.append(error)
    if not each:
        raise failed[0]
    combined, shares = combine_tables([found.table for found in each])
    best = each[shares.index(max(shares))]
    table = at_least(combined, sum(s * f.trust.left_out for s, f in zip(shares, each, strict=True)))
    weights = ", ".join(
        f"{found.frequency_hz:g} Hz {100 * share:.0f} %" for found, share in zip(each, shares, strict=True)
    )
    return replace(
        best,
        table=table,
        trust=replace(best.trust, predicted_error=relative_band(table)),
        traces=tuple(trace for found in each for trace in found.traces),
        denoised=tuple(pair for found in each for pair in found.denoised),
        notes=(
            *(note for found in each for note in found.notes),
            f"Frequencies were combined by inverse variance: {weights}.",
            *(f"One frequency was left out: {error}" for error in failed),
        ),
    )
