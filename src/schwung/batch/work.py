"""What one worker does with one session: read, estimate or explain, and say what came of it. It never raises."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any

from schwung import __version__
from schwung.batch.archive import Item, Wish, key_of
from schwung.drivetrain import InertiaTable, Machine, deviation, load_machine
from schwung.errors import SchwungError
from schwung.estimation import estimate
from schwung.session import Session, read_session
from schwung.session.gains import with_recorded_gains


@dataclass(frozen=True, eq=False)
class Outcome:
    """What came of one session: `error` is one sentence, or None and then `document` is the result."""

    code_version: str
    created: str = ""
    axis: str = "rotary"
    machine_name: str = ""
    document: Mapping[str, Any] = field(default_factory=dict)  # as estimate.json or explanation.json
    deviation_kgm2: float | None = None  # of the curve from the machine file's, RMS; None: it has no curve
    learned: Machine | None = None  # by `explain`
    error: str | None = None


def carry_out(item: Item, wish: Wish, key: str) -> Outcome:
    """Estimate or explain one session. `key`: of what shall be read, so that nothing else is taken for it."""
    try:
        if key_of(item, wish) != key:
            return failed(f"{item.session}: is not what it was when the archive was looked through")
        assert item.machine is not None  # else it had no key
        session = read_session(item.session)
        machine = with_recorded_gains(load_machine(item.machine), session)
        if wish.kind == "estimate":
            return _estimated(session, machine, wish)
        return _explained(session, machine)
    except SchwungError as error:
        place = str(item.session)
        return failed(f"{place}: {error.problem}. {error.remedy}" if error.place == "session" else str(error))
    except Exception as error:  # one bad file never ends a batch
        what = str(error).splitlines()[0] if str(error) else "no more is known"
        return failed(
            f"{item.session}: {type(error).__name__}: {what}. This is a defect of Schwung; please report it."
        )


def failed(sentence: str) -> Outcome:
    """An outcome that is none."""
    return Outcome(__version__, error=sentence)


def _estimated(session: Session, machine: Machine, wish: Wish) -> Outcome:
    found = estimate(
        session, machine, wish.method, wish.inversion, frequency_hz=wish.frequency_hz, points=wish.points
    )
    believed = machine.load_inertia
    off = deviation(found.table, believed if isinstance(believed, InertiaTable) else None)
    return _outcome(session, machine, found.to_json(), deviation_kgm2=off.rmse_kgm2 if off else None)


def _explained(session: Session, machine: Machine) -> Outcome:
    from schwung.explain.publishing.publish import publish  # noqa: PLC0415 (its compiled parts take a second to load)

    found = publish(session, machine)
    return _outcome(session, machine, found.to_json(), learned=found.machine)


def _outcome(session: Session, machine: Machine, document: Mapping[str, Any], **more: Any) -> Outcome:
    return Outcome(__version__, session.created, session.axis, machine.name, document, **more)


def code_version() -> str:
    """Of the Schwung that works here."""
    return __version__
