"""A session and a machine make an estimate: load inertia over angle, its band and the trust it deserves."""

from __future__ import annotations

from schwung.drivetrain.machine import Machine
from schwung.errors import InputError
from schwung.estimation.methods import Task, excited_at, method_named
from schwung.estimation.sampling import prepared
from schwung.estimation.sdft import samples_per_window
from schwung.estimation.table import Combined, combine
from schwung.estimation.trust import judge
from schwung.estimation.values import Denoised, Estimate, Inversion, Trace, Trust
from schwung.session.model import Session

__all__ = ["Denoised", "Estimate", "Trace", "Trust", "estimate"]


def estimate(
    session: Session,
    machine: Machine,
    method: str = "denoised",
    inversion: Inversion = "complex",
    *,
    frequency_hz: float | None = None,
    points: int | None = None,
) -> Estimate:
    """Estimate J_l over the load angle from every excited run of a session.

    `method`: "denoised" (needs reference runs) or "former"; any registered name. `inversion`: "complex" or
    "magnitude". `frequency_hz`: which excitation, where the session has several. `points`: of the table, at
    most. On a linear axis every quantity has its linear counterpart: m, m/s, N and kg.

    Raises InputError, naming run, problem and remedy: reference missing, runs that do not align, too few
    samples per period, sine too weak, torque of the wrong sign or without the injected part, several
    frequencies.
    """
    if inversion not in ("complex", "magnitude"):
        raise InputError("inversion", f'there is no "{inversion}"', 'Use "complex" or "magnitude".')
    how = method_named(method)
    recorded, session = session, prepared(session)
    excited, frequency = excited_at(session, frequency_hz)
    task = Task(session, excited, machine, frequency, inversion, recorded)
    outcome = how.traces(task)
    if outcome.table is not None:
        combined = Combined(outcome.table, ())
    else:
        windows = [samples_per_window(run.sample_rate_hz, frequency) for run in excited]
        combined = combine(outcome.traces, windows, points)
    trust = judge(outcome, task, combined.table, needs_slow_motion=not how.needs_reference)
    return Estimate(
        method=how.name,
        inversion=inversion,
        frequency_hz=frequency,
        table=combined.table,
        traces=outcome.traces,
        denoised=outcome.denoised,
        trust=trust,
        notes=outcome.notes + combined.notes,
    )
