"""What is done in processes of its own (workshop.py): functions of paths and plain values, with plain results."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Any

from schwung.errors import InputError
from schwung.service.workshop import Tell

if TYPE_CHECKING:
    from schwung.api.optimising import Task
    from schwung.api.values import Machine, Session


def estimate_session(
    *,
    session: Path,
    machine: Path,
    folder: Path,
    method: str = "auto",
    inversion: str = "complex",
    frequency_hz: float | None = None,
    points: int | None = None,
    beside: dict[str, Any] | None = None,
    tell: Tell,
) -> dict[str, Any]:
    """Estimate; inertia.csv, measured.toml, estimate.json and report.html into `folder`. Raises InputError.

    beside: what else estimate.json shall say, e.g. the plan and the checks of a commissioning, which the report shows.
    """
    from schwung.api.computing import (
        estimate,
        load_machine,
        read_session,
        write_inertia,
        write_machine,
    )
    from schwung.api.reports import content_of, standard_of, write_page
    from schwung.api.responses import with_recorded_gains
    from schwung.files import json_text, replace_file

    tell("Estimating the load inertia", 0.0)
    recorded = read_session(session)
    believed = with_recorded_gains(load_machine(machine), recorded)
    found = estimate(
        recorded, believed, method=method, inversion="magnitude" if inversion == "magnitude" else "complex",
        frequency_hz=frequency_hz, points=points,
    )  # fmt: skip
    write_inertia(found.table, folder / "inertia.csv")
    load = believed.load.model_copy(
        update={"inertia_kgm2": None, "inertia_table": found.table, "trust": found.trust.verdict}
    )
    write_machine(believed.model_copy(update={"load": load}), folder / "measured.toml")
    replace_file(folder / "estimate.json", json_text(beside or {}))  # the report shows its checks
    content = content_of(recorded, believed, found, standard_of(believed, None), folder)
    document = found.to_json() | {"reach": content.reach and content.reach.to_json()}
    replace_file(folder / "estimate.json", json_text((beside or {}) | document))
    tell("Writing the report", 0.0)
    write_page(content, folder / "report.html")
    return {"verdict": found.trust.verdict, "document": document}


def session_summary(*, session: Path, tell: Tell) -> dict[str, Any]:
    """What a recording holds, in numbers. Raises InputError where it is none of ours."""
    from schwung.api.computing import read_session

    tell("Reading the recording", 0.0)
    found = read_session(session)
    lengths = [float(run.time_s[-1] - run.time_s[0]) for run in found.runs]
    return {
        "created": found.created,
        "source": found.source,
        "axis": found.axis,
        "references": len(found.references),
        "excited": len(found.excited),
        "duration_s": sum(lengths),
        "cut_short": list(found.partial_reasons),
    }


def explain_session(
    *,
    session: Path,
    machine: Path,
    folder: Path,
    next_motion: bool = False,
    tell: Tell,
) -> dict[str, Any]:
    """Explain; explanation.json, machine.toml (learned) and explanation.html into `folder`. Raises InputError.

    next_motion: see ExplainRequest. A next motion that nobody can choose leaves the explanation as it is. In the
    document, beside the numbers, `told`: title, heads and rows of every table in words.
    """
    from schwung.api.computing import load_machine, read_session
    from schwung.api.explaining import explain, write_explanation
    from schwung.api.responses import with_recorded_gains
    from schwung.files import json_text, replace_file
    from schwung.quantities import document_of, sentences_of

    recorded = read_session(session)
    believed = with_recorded_gains(load_machine(machine), recorded)
    found = explain(recorded, believed, progress=tell)
    write_explanation(found, recorded, believed, folder)
    words = sentences_of(recorded.effort)
    document = document_of(recorded.effort, found.to_json()) | {
        "told": [
            {"title": title, "heads": list(heads), "rows": [[words(cell) for cell in row] for row in rows]}
            for title, heads, rows in found.tables()
        ]
    }
    if next_motion:
        tell("Choosing the next motion", 0.0)
        document["next"] = _next_of(recorded, believed)
    replace_file(folder / "explanation.json", json_text(document))
    return {"verdict": found.verdict, "document": document}


def _next_of(recorded: Session, believed: Any) -> dict[str, Any]:
    """What it separates; `plan`: the fields of a PlanRequest that make it, None where there is none."""
    from schwung.api.experiments import next_motion

    try:
        found = next_motion(recorded, believed)
    except InputError as error:
        return {"sentence": str(error), "rivals": [], "experiment": None, "plan": None}
    plan = None
    if found.experiment is not None:
        wishes = found.experiment.wishes
        plan = {"profile_kind": wishes.kind} | {name: getattr(wishes, name) for name in _PLANNED}
    return found.to_json() | {"plan": plan, "start_rad": found.setting.start_position_rad}


#: What a plan takes from the wishes of a next motion; how drive and bus are used stays the drive's own.
_PLANNED = (
    "distance_rad", "duration_s", "returns", "frequency_hz", "amplitude_nm", "repeats", "phases", "sample_rate_hz",
)  # fmt: skip


def fit_bode_session(
    *,
    session: Path,
    machine: Path,
    folder: Path,
    torque_max_nm: float | None,
    distance_rad: float | None,
    duration_s: float,
    tell: Tell,
) -> dict[str, Any]:
    """Fit frequency responses, propose what to inject; bode.json, machine.toml and report.html into `folder`.

    Raises InputError where the recording allows no fit.
    """
    from schwung.api.computing import load_machine, read_session, write_machine
    from schwung.api.reports import BodeContent, write_bode_report
    from schwung.api.responses import (
        BODE_FILE,
        FORMAT,
        VERSION,
        Stroke,
        fit_bode,
        measured_responses,
        propose,
        with_recorded_gains,
    )
    from schwung.files import json_text, replace_file

    tell("Fitting the responses", 0.0)
    recorded = read_session(session)
    believed = with_recorded_gains(load_machine(machine), recorded)
    fit = fit_bode(measured_responses(recorded), believed)
    fitted = fit.machine(believed)
    way = distance_rad or fit.angles[-1].position_rad - fit.angles[0].position_rad
    stroke = Stroke(way, duration_s) if way else None
    proposal = None
    if fitted.control is not None:
        proposal = propose(fit, fitted, fit.responses[0].sample_rate_hz, torque_max_nm, stroke)
    write_machine(fitted, folder / "machine.toml")
    title = f"{believed.name}: frequency response at standstill"
    write_bode_report(BodeContent(title, recorded, fit, believed, proposal, ()), folder / "report.html")
    proposed = proposal and proposal.to_json() | {"stroke": stroke and vars(stroke)}
    document = {"format": FORMAT, "version": VERSION} | fit.to_json() | {"proposal": proposed}
    replace_file(folder / BODE_FILE, json_text(document))
    return document


def optimise_motion(
    *, machine: Path, folder: Path, asked: dict[str, Any], sample_rate_hz: float, tell: Tell
) -> dict[str, Any]:
    """Find the best motion of `task_of(machine, asked)`; setpoints, cams and pictures into `folder`. Raises
    InputError."""
    from schwung.api.computing import load_machine
    from schwung.api.optimising import optimise, write_front, write_optimised
    from schwung.files import json_text, replace_file

    tell("Finding the motion", 0.0)
    believed = load_machine(machine)
    task = task_of(believed, asked)
    found = optimise(believed, task, rivals=asked["rivals"])
    document = found.to_json()
    write_optimised(found, folder, sample_rate_hz, document)
    if asked["front"]:
        tell("Finding the Pareto front", 0.0)
        document["front"], _ = write_front(folder, believed, task)
    replace_file(folder / "optimised.json", json_text(document))
    return document


def task_of(machine: Machine, asked: dict[str, Any]) -> Task:
    """What is asked of a motion, by the fields of OptimiseRequest. Raises InputError where that is no task."""
    from schwung.api.optimising import MotionLimits, Task

    limits = dict(asked["limits"])
    torque = limits.pop("torque_max_nm") or machine.motor.peak_torque_nm
    return Task(
        start_rad=asked["start_rad"],
        distance_rad=asked["distance_rad"],
        limits=MotionLimits(torque_max_nm=torque, jerk_max_rad_s3=asked["jerk_max_rad_s3"], **limits),
        duration_s=asked["duration_s"],
        weights=asked["weights"],
        regeneration=asked["regeneration"],
        payloads_kgm2=(0.0, *asked["payloads_kgm2"]),
        band_sigmas=2.0 if asked["robust"] else 0.0,
    )


def work_through(
    *,
    items: list[tuple[Path, Path | None]],
    kind: str,
    wish: dict[str, Any],
    jobs: int | None,
    folder: Path,
    tell: Tell,
) -> dict[str, Any]:
    """Estimate or explain many sessions, pairs of session and machine; summary and pictures into `folder`.
    Raises InputError where Dask is not installed."""
    from schwung.errors import InputError

    try:
        from schwung.batch import Item, Results, Wish, run_batch, write_summary
        from schwung.batch.picture import write_pictures
        from schwung.batch.summary import document_of
    except ImportError:
        raise InputError("batch", "needs Dask", "Install it: pip install 'schwung[batch]'.") from None
    wanted = Wish("explain") if kind == "explain" else Wish("estimate", **wish)
    tell("Starting the workers", 0.0)
    (folder / "results").mkdir()
    done = run_batch(
        [Item(session, machine) for session, machine in items], wanted, Results(folder / "results"), jobs=jobs,
        progress=tell, tell=lambda sentence: tell(sentence, 0.0),
    )  # fmt: skip
    write_summary(done.rows, wanted.kind, folder)
    write_pictures(done.rows, wanted.kind, folder)
    return {"batch": document_of(done.rows, wanted.kind)}
