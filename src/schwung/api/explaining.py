"""What a belief leaves out of a recording, with probabilities, and what is written of it."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

from schwung import drivetrain
from schwung import session as recording
from schwung.api.shown import Shown, as_shown
from schwung.api.values import Machine, machine_shown
from schwung.drivetrain import write_machine
from schwung.explain.publishing.publish import publish
from schwung.explain.publishing.values import Published
from schwung.report.content import units_of
from schwung.session.gains import with_recorded_gains

if TYPE_CHECKING:
    from matplotlib.axes import Axes

__all__ = ["Explanation", "explain", "write_explanation"]


class Explanation(Shown, Published):
    """How probable each physics is that a belief leaves out of a recording.

    Attributes: `names` (each with `physics`, `probability`, 0…1, `parameters` with unit and 95 % interval), `curves`
    (what has no name: `coordinate`, `torque_nm`, `drawn` with arrays (n,) of N·m, `formula`), `runners_up` (sets of
    names), `noise` (N·m, rad/s, rad), `timing` (by how much later torque is reported than speed, s), `proof` (on runs
    kept aside, in deviations of the noise, before and after), `machine` (the belief with what was
    learned). `to_json()`: the document of explanation.json.

    Raises InputError where `explain` does.

    >>> explanation.headline
    'the belief leaves out nothing that this session tells from noise'
    """

    machine: Machine

    @property
    def tone(self) -> str:
        """Whether the answer is "good", "doubtful" or "unusable" by its proof."""
        from schwung.report.explanation import tone_of

        return tone_of(self)

    def tables(self) -> list[tuple[str, tuple[str, ...], list[tuple[str, ...]]]]:
        """Everything in words: title, heads of the columns, and rows of each table."""
        from schwung.report.explanation import tables

        return tables(self)

    def _facts(self) -> Sequence[tuple[str, str]]:
        rows = [(row[0], "; ".join(row[1:])) for _, _, rows in self.tables() for row in rows]
        return [("in short", self.headline), *rows]

    def _draw(self, axes: Axes) -> None:
        from schwung.report.axes import draw_explanation

        draw_explanation(axes, self, units_of(self.axis, self.effort))

    def _columns(self) -> Mapping[str, Any]:
        rows = [(one, key, q) for one in self.names for key, q in one.parameters.items()]
        return {
            "physics": [one.physics for one, _, _ in rows],
            "probability": [one.probability for one, _, _ in rows],
            "parameter": [key for _, key, _ in rows],
            "value": [q.value for _, _, q in rows],
            "unit": [q.unit for _, _, q in rows],
            "low": [None if q.ci95 is None else q.ci95[0] for _, _, q in rows],
            "high": [None if q.ci95 is None else q.ci95[1] for _, _, q in rows],
        }


def explain(
    session: recording.Session,
    machine: drivetrain.Machine,
    *,
    progress: Callable[[str, float], None] | None = None,
) -> Explanation:
    """Say how probable it is, of each physics there is a name for, that a belief leaves it out of a recording.

    One likelihood of the samples, names by their evidence, and what has no name as a curve over its coordinate. The
    learned machine is written, read back, and so proven on runs kept aside.

    Args:
        session: as `read_session` gives it; arrays (n,), rad, rad/s, N·m.
        machine: the belief; what its [[physics]] says is known, and never named again.
        progress: told what is being done and the share that is done of all, 0…1.

    Returns names with probabilities and 95 % intervals, unnamed curves, runners-up, proof, and the learned machine.
    Raises InputError where the session cannot be what it says (units, signs, wraps), or the inertia is unknown.

    >>> schwung.explain(session, believed.model_copy(update={"effort": "current"}))
    Traceback (most recent call last):
    schwung.errors.InputError: machine "...": is in A, the session in N·m. Give the machine in N·m, without effort = ...
    """
    return explanation_shown(publish(session, with_recorded_gains(machine, session), progress=progress))


def explanation_shown(found: Published) -> Explanation:
    """An answer from below, with its machine, as notebooks show it."""
    return as_shown(Explanation, found, machine=machine_shown(found.machine))


def write_explanation(
    found: Published, session: recording.Session, believed: drivetrain.Machine, folder: Path
) -> None:
    """An answer for people, explanation.html, and the learned machine.toml, in a folder that is there.

    Raises InputError where they cannot be written.
    """
    from schwung.report.explanation import ExplanationContent
    from schwung.report.explanation import write_explanation as write_page

    learned = folder / "machine.toml"
    write_machine(found.machine, learned)
    content = ExplanationContent(
        title=f"{believed.name}: what the belief leaves out",
        published=found,
        believed=believed,
        session=session,
        machine_file=learned.read_text(encoding="utf-8"),
    )
    write_page(content, folder / "explanation.html")
