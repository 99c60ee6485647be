"""Which method a session allows, and why: `method="auto"`.

A method takes part by having `suits(task)`; rivals have none and are only taken by name. Where the favourite's own
evidence says that it misses physics, a method that is robust against more of it (it says so by an attribute `robust`)
is asked as well, and the one with the smaller error to be expected is taken. It is asked, too, where the record tells
more than the favourite takes of it (`leaves_much`), and taken where it is as sure of itself and its band is narrower.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Protocol, runtime_checkable

import numpy as np

from schwung.errors import InputError
from schwung.estimation.methods import METHODS, Method, Suitability, Task

AUTO = "auto"
#: Sessions of more samples are not gone through once more where the favourite is good: some hundred microseconds each.
MOST_SAMPLES = 100_000
#: Torque within this share of the peak counts as clipped.
CLIPPED = 0.995


@runtime_checkable
class Candidate(Protocol):
    """What a method adds to `Method` to be chosen by itself."""

    def suits(self, task: Task) -> Suitability | None:
        """How well it suits the session; None: it cannot be used on it."""
        ...


@dataclass(frozen=True)
class Choice:
    """The method taken, and the sentence that says why."""

    method: Method
    reason: str


def choose(task: Task) -> Choice:
    """The method with the highest score. Raises InputError where none can be used."""
    return ranked(task)[0]


def ranked(task: Task) -> tuple[Choice, ...]:
    """All methods that the session allows, the best first. Raises InputError where there is none."""
    found: list[tuple[float, str, Choice]] = []
    for name, method in METHODS.items():
        suitability = method.suits(task) if isinstance(method, Candidate) else None
        if suitability is not None:
            reason = f"Method {name} was chosen: {suitability.reason}."
            found.append((suitability.score, name, Choice(method, reason)))
    if not found:
        raise InputError(
            "session", "suits no method of estimation", f"Name one: {', '.join(sorted(METHODS))}."
        )
    return tuple(choice for _, _, choice in sorted(found, key=lambda entry: entry[:2], reverse=True))


def clipped_share(task: Task) -> float:
    """Largest share of samples of any run at the peak torque, 0…1."""
    limit = CLIPPED * task.machine.motor.peak_torque_nm
    return max(float(np.mean(np.abs(run.torque_nm) >= limit)) for run in task.session.runs)


def leaves_much(task: Task, *, windowed: bool) -> bool:
    """Whether the favourite leaves much of the record unused that can be had in reasonable time.

    Windows smear whatever changes within a period, and phases use the injection alone, which says most as long as the
    motion takes less torque than that. `windowed`: of the favourite, as in `Outcome`.
    """
    if sum(len(run) for run in task.session.runs) > MOST_SAMPLES:
        return False
    return windowed or motion_over_injection(task) > 1


def motion_over_injection(task: Task) -> float:
    """What the motion takes of the torque, over the injection (both rms over the excited runs)."""
    motion = injection = 0.0
    for run in task.excited:
        assert run.excitation is not None  # guaranteed by Run
        injected = run.excitation.torque(run.time_s)
        motion += float(np.var(run.torque_nm - injected))
        injection += float(np.mean(injected**2))
    return float(np.sqrt(motion / max(injection, 1e-300)))


def is_robust(method: Method) -> bool:
    """Whether it copes with what others miss: a wrong stiffness, clipping, short motions."""
    return bool(getattr(method, "robust", False))


def is_joint(method: Method) -> bool:
    """Whether it takes runs of all frequencies at once (it says so by an attribute `joint`)."""
    return bool(getattr(method, "joint", False))
